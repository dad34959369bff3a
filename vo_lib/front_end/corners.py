"""Chapter 1: corners of an image, and the choice of features by bucket, age and strength."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.types import Array, Mask
from ..method.buckets import square_numbers
from .config import FeatureConfig


def corner_strength(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Shi and Tomasi's strength of every pixel, (H, W): root of the structure tensor's smaller eigenvalue.

    In grey levels: the weakest contrast a 3×3 window sees in any direction, so a threshold means the
    same in every image.
    """
    strength = cv2.cornerMinEigenVal(image, 3, ksize=3)
    np.sqrt(np.maximum(strength, 0.0, out=strength), out=strength)
    # OpenCV scales an 8-bit image so that the eigenvalue is that of grey / 255 over the window.
    return np.asarray(np.multiply(strength, 255.0, out=strength), np.float32)


def detect_corners(strength: NDArray[np.float32], config: FeatureConfig) -> tuple[Array, Array]:
    """The strongest corner of each square cell.

    Parameters
    ----------
    strength : (H, W) corner strength, from `corner_strength`.

    Returns
    -------
    (N, 2) pixels and (N,) strengths, in row-major order of the cells.
    """
    b, cell = config.border, config.cell
    height, width = strength.shape
    # A corner is a local maximum: its neighbours in the next cell must not be stronger.
    peaks = strength * (strength >= cv2.dilate(strength, np.ones((5, 5), np.uint8)))
    peaks[:b], peaks[-b:], peaks[:, :b], peaks[:, -b:] = 0, 0, 0, 0
    rows, cols = -(-height // cell), -(-width // cell)
    padded = np.zeros((rows * cell, cols * cell), np.float32)
    padded[:height, :width] = peaks
    blocks = padded.reshape(rows, cell, cols, cell).transpose(0, 2, 1, 3).reshape(rows * cols, cell * cell)
    best = np.argmax(blocks, axis=1)
    value = blocks[np.arange(rows * cols), best]
    good = value > config.quality
    which = np.flatnonzero(good)
    v = (which // cols) * cell + best[which] // cell
    u = (which % cols) * cell + best[which] % cell
    return np.stack([u, v], axis=1).astype(np.float64), value[which].astype(np.float64)


def in_empty_cells(uv: Array, taken: Array, cell: int) -> Mask:
    """Which corners (N, 2) lie in a square cell, `cell` pixels wide, without a pixel taken (M, 2)."""
    number = square_numbers(np.rint(np.concatenate([uv, taken])), cell)
    return ~np.isin(number[: len(uv)], number[len(uv) :])
