"""Corners of an image, one per square cell (chapter 1)."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.types import Array, BoolArray, Image
from ..paper.buckets import select_by_bucket, square_numbers
from ..paper.settings import BucketConfig
from .settings import KitFeatureConfig


def corner_strength(image: Image) -> NDArray[np.float32]:
    """Shi and Tomasi's corner strength of an image at half size, (H // 2, W // 2).

    The strength is the root of the structure tensor's smaller eigenvalue, in grey levels: the smallest
    contrast over all directions in a window of 3×3 pixels. A threshold therefore has the same meaning in
    every image. Half the size saves time; for tracking, which uses wider windows, the accuracy is sufficient.
    """
    height = image.shape[0] // 2
    width = image.shape[1] // 2
    # A factor of exactly two is by far the fastest; an odd last row or column is ignored.
    half = cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    strength = cv2.cornerMinEigenVal(half, 3, ksize=3)
    # For an 8-bit image, OpenCV returns the eigenvalue of grey / 255.
    return np.asarray(255.0 * np.sqrt(np.maximum(strength, 0.0)), np.float32)


def detect_corners(strength: NDArray[np.float32], config: KitFeatureConfig) -> tuple[Array, Array]:
    """The strongest corner of each square cell.

    Parameters
    ----------
    strength : (H // 2, W // 2) corner strength, from `corner_strength`.

    Returns
    -------
    (N, 2) pixels of the full image and (N,) strengths, row by row.
    """
    # A corner is a local maximum over all neighbours, including neighbours in the next cell.
    largest_around = cv2.dilate(strength, np.ones((5, 5), np.uint8))
    peaks = (strength >= largest_around) & (strength > config.quality)
    border = math.ceil(config.border / 2)  # of the image at half size
    peaks[:border] = False
    peaks[-border:] = False
    peaks[:, :border] = False
    peaks[:, -border:] = False
    v, u = np.divmod(np.flatnonzero(peaks), strength.shape[1])
    # A pixel at half size is the mean of four pixels of the full image; its centre is between the four. (The
    # half image of `coarse_disparity` is made in another way.)
    uv = 2.0 * np.stack([u, v], axis=1) + 0.5
    value = strength[v, u].astype(np.float64)
    one_per_cell = BucketConfig(size=config.cell, features=1)
    best = select_by_bucket(uv, np.zeros(len(uv), np.int64), value, one_per_cell)
    return uv[best], value[best]


def in_empty_cells(uv: Array, occupants: Array, cell: int) -> BoolArray:
    """Mask (N,) of corners `uv` (N, 2) in square cells, `cell` pixels wide, without `occupants` (M, 2)."""
    # Numbered together, since the numbers of squares depend on the rightmost pixel.
    numbers = square_numbers(np.rint(np.concatenate([uv, occupants])), cell)
    own = numbers[: len(uv)]
    occupied = numbers[len(uv) :]
    return ~np.isin(own, occupied)
