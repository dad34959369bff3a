"""The drawn data set that a detector can be trained on: its settings, declared once."""

from __future__ import annotations

from dataclasses import dataclass

from vo_lib.core.settings import Checked, setting


@dataclass(frozen=True)
class DetectionSetConfig(Checked):
    """The drawn data set that a detector of the synthetic street is trained on."""

    seed: int = setting(0, "shifts all seeds of the streets", low=0, high=99_999)
    train: int = setting(4000, "images to train on", low=1, high=1_000_000)
    valid: int = setting(240, "images for the curve of mAP while training", low=1, high=100_000)
    test_seeds: int = setting(2, "seeds of each named scene kept for the test", low=1, high=100)
    frames: int = setting(24, "images taken from a street, far apart", low=1, high=1000)
    min_pixels: int = setting(
        40, "a vehicle with fewer visible pixels has no label", unit="px", low=1, high=10_000
    )
    min_height: int = setting(8, "a vehicle lower than this has no label", unit="px", low=1, high=200)
    min_share: float = setting(
        0.2, "a vehicle seen by a smaller share of its outline has no label", low=0, high=1
    )
