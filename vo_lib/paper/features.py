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
CORNER[:2, :2] = -1
CORNER[3:, 3:] = -1
CORNER[:2, 3:] = 1
CORNER[3:, :2] = 1

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
    peaks = []
    for mask in (BLOB, CORNER):
        response = np.asarray(cv2.filter2D(image, cv2.CV_16S, mask), np.int16)
        peaks.append(_peaks(response, config))
        peaks.append(_peaks(-response, config))
    positions = np.concatenate([uv for uv, _ in peaks])
    strength = np.concatenate([values for _, values in peaks])
    kind = np.repeat(np.arange(4), [len(uv) for uv, _ in peaks])
    along_u = cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3)
    along_v = cv2.Sobel(image, cv2.CV_16S, 0, 1, ksize=3)
    # The two Sobel responses of a pixel are read as one 32-bit number, and pixels are numbered row by row.
    sobel = cv2.merge([along_u, along_v]).view(np.int32).ravel()
    to_number = np.array([1, image.shape[1]])
    centres = positions.astype(np.intp) @ to_number
    samples = sobel.take(centres[:, None] + DESCRIPTOR_OFFSETS @ to_number)
    descriptor = samples.view(np.int16).astype(np.float32)
    return Described(positions, kind, strength, descriptor)


def _peaks(response: NDArray[np.int16], config: FeatureConfig) -> tuple[Array, Array]:
    """Pixels (N, 2) whose responses are the largest in the squares around them, and these responses (N,)."""
    top = cv2.dilate(response, np.ones((config.blob_cell, config.blob_cell), np.uint8))
    border = max(config.border, DESCRIPTOR_RADIUS_PX)
    inner = slice(border, -border)
    peak = (response == top)[inner, inner] & (response[inner, inner] > int(config.blob_quality))
    # NumPy searches a one-dimensional array ten times as fast as an image.
    row, column = np.divmod(np.flatnonzero(peak), max(peak.shape[1], 1))
    row += border
    column += border
    positions = np.stack([column, row], axis=1).astype(np.float64)
    return positions, response[row, column].astype(np.float64)


def stereo_matches(left: Described, right: Described, max_disparity: int) -> tuple[Index, Index]:
    """For each left feature, the most similar right feature of the same kind, and vice versa.

    Two features are compared if their rows differ by at most `MAX_ROW_DIFFERENCE_PX` and their disparity
    is 0 … max_disparity, pixels. These pairs are so few that all of them are compared at once.

    Returns
    -------
    (N,) indices into `right` and (M,) indices into `left`; -1 for a feature without a pair.
    """
    # `describe` sorts features by kind and row, so the right features in near rows of a kind are one range.
    left_rows = _kind_and_row(left)
    right_rows = _kind_and_row(right)
    first = np.searchsorted(right_rows, left_rows - MAX_ROW_DIFFERENCE_PX)
    last = np.searchsorted(right_rows, left_rows + MAX_ROW_DIFFERENCE_PX, side="right")
    # All pairs one after the other: left feature i with each right feature j from first[i] to last[i] - 1.
    count = last - first
    i = np.repeat(np.arange(len(left)), count)
    first_pair = np.cumsum(count) - count  # place of the first pair of each left feature among all pairs
    j = first[i] + np.arange(len(i)) - first_pair[i]
    disparity = left.uv[i, 0] - right.uv[j, 0]
    possible = (disparity >= 0) & (disparity <= max_disparity)
    i = i[possible]
    j = j[possible]
    difference = np.abs(left.descriptor[i] - right.descriptor[j]).sum(axis=1)
    # A later assignment replaces an earlier assignment, so the most similar pair remains; of equally similar
    # pairs, the first pair remains.
    order = np.argsort(difference, kind="stable")[::-1]
    to_right = np.full(len(left), -1, np.intp)
    to_left = np.full(len(right), -1, np.intp)
    to_right[i[order]] = j[order]
    to_left[j[order]] = i[order]
    return to_right, to_left


def _kind_and_row(features: Described) -> IntArray:
    """Kind and row of each feature in one number (N,), ordered by kind, then by row."""
    return np.asarray((features.kind << 32) + features.uv[:, 1].astype(np.intp))


def best_matches(query: Described, train: Described, radius: int) -> Index:
    """For each query feature, the most similar train feature of the same kind near the same position.

    Parameters
    ----------
    radius : largest distance along u and along v, pixels.

    Returns
    -------
    (N,) indices into `train`; -1 if no feature of the kind is near.
    """
    match = np.full(len(query), -1, np.intp)
    query_u, query_v = query.uv.T.astype(np.int16)
    train_u, train_v = train.uv.T.astype(np.int16)
    # An image is wider than high, so most features of a batch, sorted by column, have the same neighbours.
    query_order = np.argsort(query_u, kind="stable")
    train_order = np.argsort(train_u, kind="stable")
    for kind in range(4):
        queries = query_order[query.kind[query_order] == kind]
        trains = train_order[train.kind[train_order] == kind]
        for start in range(0, len(queries), BATCH_FEATURES):
            i = queries[start : start + BATCH_FEATURES]
            ends = query_u[i[0]] - radius, query_u[i[-1]] + radius + 1
            first, last = np.searchsorted(train_u[trains], ends)
            # Sorted, so that the first of equally similar features is selected.
            j = np.sort(trains[first:last])
            if len(j) == 0:
                continue
            near_u = np.abs(np.subtract.outer(query_u[i], train_u[j])) <= radius
            near_v = np.abs(np.subtract.outer(query_v[i], train_v[j])) <= radius
            mask = (near_u & near_v).view(np.uint8)
            _, best = cv2.batchDistance(
                query.descriptor[i], train.descriptor[j], -1, normType=cv2.NORM_L1, K=1, mask=mask
            )
            some = np.flatnonzero(best >= 0)
            match[i[some]] = j[best.ravel()[some]]
    return match
