"""What decides a detector's training: the drawn data set and the training itself, declared once."""

from __future__ import annotations

from dataclasses import dataclass

from vo_lib.core.settings import Checked, setting

MODEL = "detector.onnx"  # of a training's folder


@dataclass(frozen=True)
class DetectionSetConfig(Checked):
    """The drawn data set that a detector of the synthetic street is trained on."""

    seed: int = setting(0, "shifts all seeds of the streets", low=0, high=99_999)
    train: int = setting(4000, "images to train on", low=1, high=1_000_000)
    valid: int = setting(240, "images for the curve of mAP while training", low=1, high=100_000)
    test_seeds: int = setting(2, "seeds of each named scene kept for the test", low=1, high=100)
    frames: int = setting(24, "images taken from a street, far apart", low=1, high=1000)
    min_pixels: int = setting(
        40, "a vehicle with fewer visible pixels is ignored", unit="px", low=1, high=10_000
    )
    min_height: int = setting(8, "a vehicle lower than this is ignored", unit="px", low=1, high=200)
    min_share: float = setting(
        0.2, "a vehicle seen by a smaller share of its outline is ignored", low=0, high=1
    )


@dataclass(frozen=True)
class TrainingConfig(Checked):
    """Training of a detector (chapter 5; needs the extra `[train]`)."""

    seed: int = setting(0, "seed of the first weights, the order of the images and their changes", low=0)
    epochs: int = setting(6, "times every image is shown", low=1, high=10_000)
    batch: int = setting(8, "images in one step", low=1, high=1024)
    rate: float = setting(
        1.5e-3, "highest learning rate; it rises at first, then falls as a cosine", low=1e-6, high=1
    )
    decay: float = setting(0.02, "weight decay", low=0, high=1)
    average: float = setting(
        0.998, "the weights kept are a moving average with this memory a step", low=0, high=1
    )
    size: int = setting(
        640, "longer side of a whole image as the network sees it", unit="px", low=64, high=4096
    )
    width: int = setting(
        320, "width of the windows trained on; a multiple of 32", unit="px", low=64, high=4096
    )
    height: int = setting(
        160, "height of the windows trained on; a multiple of 32", unit="px", low=64, high=4096
    )
    aim: float = setting(0.6, "chance that a window is laid over a box, not anywhere", low=0, high=1)
    smallest: float = setting(0.75, "images are made smaller by up to this factor", low=0.1, high=1)
    largest: float = setting(2.0, "images are made larger by up to this factor", low=1, high=10)
    mirror: float = setting(0.5, "chance of a mirrored image", low=0, high=1)
    mosaic: float = setting(0.15, "chance of a mosaic of four images; none in the last fifth", low=0, high=1)
    tones: float = setting(0.4, "range of gain and gamma, as a logarithm", low=0, high=2)
    blur: float = setting(0.2, "chance of blur", low=0, high=1)
    noise: float = setting(0.3, "chance of noise", low=0, high=1)
    box_weight: float = setting(5.0, "weight of the box loss beside the class loss", low=0, high=100)
    candidates: int = setting(10, "cells that learn one box", low=1, high=100)
    threads: int = setting(1, "processor threads", low=1, high=64)
