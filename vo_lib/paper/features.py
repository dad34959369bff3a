"""Blobs and corners of an image, their Sobel descriptors, and the comparison of descriptors (chapter 1).

Features are the extrema of the responses of two 5×5 masks. Features of the same kind are compared by the sum
of absolute differences between two Sobel images at 16 positions around each feature. Source: Geiger, Ziegler
and Stiller, "StereoScan: dense 3d reconstruction in real-time", IV 2011, section III.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.rows import Rows
from ..geometry.types import Array, Image, Index, IntArray
from .settings import FeatureConfig

BLOB = np.full((5, 5), -1, np.float32)
BLOB[1:4, 1:4] = 1
BLOB[2, 2] = 8
CORNER = np.zeros((5, 5), np.float32)
CORNER[:2, :2] = CORNER[3:, 3:] = -1
CORNER[:2, 3:] = CORNER[3:, :2] = 1

# Sixteen positions (u, v) in an 11×11 neighbourhood at which the two Sobel images are sampled.
DESCRIPTOR_OFFSETS = np.array(
    [(u, v) for v in (-5, -1, 1, 5) for u in (-5, 5)] + [(u, v) for v in (-3, -1, 1, 3) for u in (-1, 1)],
    np.intp,
)
DESCRIPTOR_RADIUS_PX = 6  # 5 px of the descriptor and 1 px of the Sobel mask
BATCH_FEATURES = 128  # number of features with similar u that are compared at once
MAX_ROW_DIFFERENCE_PX = 2  # largest row difference in a stereo pair, whole pixels


@dataclass(frozen=True, eq=False)
class Described(Rows):
    """N features of one image: uv (N, 2) pixels, kind (N,) 0 … 3, strength (N,), descriptor (N, 32)."""

    uv: Array
    kind: IntArray
    strength: Array
    descriptor: NDArray[np.float32]


def describe(image: Image, config: FeatureConfig) -> Described:
    """Described features of an image; kinds 0 … 3: blob maxima, blob minima, corner maxima, corner minima.

    A feature is a pixel whose response is the largest in a square around it, `config.blob_cell` pixels wide,
    and above `config.blob_quality`.
    """
    # 16-bit integers represent every response exactly, and take half the time of floats.
    responses = [np.asarray(cv2.filter2D(image, cv2.CV_16S, m), np.int16) for m in (BLOB, CORNER)]
    peaks = [_peaks(response, config) for each in responses for response in (each, -each)]
    positions, strength = (np.concatenate(each) for each in zip(*peaks, strict=True))
    kind = np.repeat(np.arange(4), [len(uv) for uv, _ in peaks])
    sobel = cv2.merge([cv2.Sobel(image, cv2.CV_16S, dx, 1 - dx, ksize=3) for dx in (1, 0)])
    # Pixels are numbered row by row, and the two Sobel responses of a pixel are read as one 32-bit number.
    steps = np.array([1, image.shape[1]])
    samples = (
        sobel.view(np.int32)
        .ravel()
        .take((positions.astype(np.intp) @ steps)[:, None] + DESCRIPTOR_OFFSETS @ steps)
    )
    descriptor = samples.view(np.int16).astype(np.float32)
    return Described(positions, kind, strength, descriptor)


def _peaks(response: NDArray[np.int16], config: FeatureConfig) -> tuple[Array, Array]:
    """Pixels (N, 2) whose responses are the largest in the squares around them, and these responses (N,)."""
    top = cv2.dilate(response, np.ones((config.blob_cell, config.blob_cell), np.uint8))
    border = max(config.border, DESCRIPTOR_RADIUS_PX)
    inner = slice(border, -border)
    peak = (response == top)[inner, inner] & (response[inner, inner] > int(config.blob_quality))
    # NumPy searches a one-dimensional array ten times as fast as an image.
    row, column = (part + border for part in np.divmod(np.flatnonzero(peak), max(peak.shape[1], 1)))
    return np.stack([column, row], axis=1).astype(np.float64), response[row, column].astype(np.float64)


def stereo_matches(left: Described, right: Described, max_disparity: int) -> tuple[Index, Index]:
    """For each left feature, the most similar right feature of the same kind, and vice versa.

    Two features are compared if their rows differ by at most `MAX_ROW_DIFFERENCE_PX` and their disparity
    is 0 … max_disparity, pixels. These pairs are few, so all pairs are compared at once.

    Returns
    -------
    (N,) indices into `right` and (M,) indices into `left`; -1 for a feature without a pair.
    """
    # `describe` sorts features by kind and row. With both in one number, near rows of a kind are one range.
    positions, others = ((side.kind << 32) + side.uv[:, 1].astype(np.intp) for side in (left, right))
    first = np.searchsorted(others, positions - MAX_ROW_DIFFERENCE_PX)
    last = np.searchsorted(others, positions + MAX_ROW_DIFFERENCE_PX, side="right")
    count = last - first
    i = np.repeat(np.arange(len(count)), count)
    j = np.arange(len(i)) + np.repeat(last - np.cumsum(count), count)  # first[i] … last[i] - 1
    disparity = left.uv[i, 0] - right.uv[j, 0]
    possible = (disparity >= 0) & (disparity <= max_disparity)
    i, j = i[possible], j[possible]
    difference = np.abs(left.descriptor[i] - right.descriptor[j]).sum(axis=1)
    # A later assignment replaces an earlier assignment, so the most similar pair remains; of equally similar
    # pairs, the first pair remains.
    order = np.argsort(difference, kind="stable")[::-1]
    to_right, to_left = (np.full(len(side.kind), -1, np.intp) for side in (left, right))
    to_right[i[order]], to_left[j[order]] = j[order], i[order]
    return to_right, to_left


def best_matches(query: Described, train: Described, radius: int) -> Index:
    """For each query feature, the most similar train feature of the same kind near the same position.

    Parameters
    ----------
    radius : largest distance along u and along v, pixels.

    Returns
    -------
    (N,) indices into `train`; -1 if no feature of the kind is near.
    """
    match = np.full(len(query.kind), -1, np.intp)
    # An image is wider than high, so most features of a batch, sorted by column, have the same neighbours.
    positions, others = (side.uv.T.astype(np.int16) for side in (query, train))
    orders = [np.argsort(side[0], kind="stable") for side in (positions, others)]
    for kind in range(4):
        queries, trains = (o[side.kind[o] == kind] for o, side in zip(orders, (query, train), strict=True))
        for i in (queries[n : n + BATCH_FEATURES] for n in range(0, len(queries), BATCH_FEATURES)):
            ends = positions[0, i[0]] - radius, positions[0, i[-1]] + radius + 1
            # Sorted, so that the first of equally similar features is selected.
            j = np.sort(trains[slice(*np.searchsorted(others[0, trains], ends))])
            if len(j) == 0:
                continue
            u, v = (np.abs(np.subtract.outer(positions[k, i], others[k, j])) <= radius for k in (0, 1))
            mask = (u & v).view(np.uint8)
            _, best = cv2.batchDistance(
                query.descriptor[i], train.descriptor[j], -1, normType=cv2.NORM_L1, K=1, mask=mask
            )
            some = np.flatnonzero(best >= 0)
            match[i[some]] = j[best.ravel()[some]]
    return match
