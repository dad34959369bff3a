"""Blobs and corners of an image, their Sobel descriptors, and the comparison of descriptors (chapter 1).

Features are the extrema of the responses of two 5×5 masks. The descriptor of a feature has the values of two
Sobel images, one along u and one along v, at 16 positions around it: 32 numbers. The smaller the sum of the
absolute differences of these numbers, the more similar are two features of the same kind. Source: Geiger,
Ziegler and Stiller, "StereoScan: dense 3d reconstruction in real-time", IV 2011, section III.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.rows import Rows
from ..geometry.types import Array, Image, Index, IntArray
from .settings import FeatureConfig

BLOB = np.array(
    [
        [-1, -1, -1, -1, -1],
        [-1, 1, 1, 1, -1],
        [-1, 1, 8, 1, -1],
        [-1, 1, 1, 1, -1],
        [-1, -1, -1, -1, -1],
    ],
    np.float32,
)
CORNER = np.array(
    [
        [-1, -1, 0, 1, 1],
        [-1, -1, 0, 1, 1],
        [0, 0, 0, 0, 0],
        [1, 1, 0, -1, -1],
        [1, 1, 0, -1, -1],
    ],
    np.float32,
)

# Sixteen positions (u, v) around a feature, at which the two Sobel images are sampled.
_OUTER_COLUMNS = [(u, v) for v in (-5, -1, 1, 5) for u in (-5, 5)]
_INNER_COLUMNS = [(u, v) for v in (-3, -1, 1, 3) for u in (-1, 1)]
DESCRIPTOR_OFFSETS = np.array(_OUTER_COLUMNS + _INNER_COLUMNS, np.intp)
DESCRIPTOR_RADIUS_PX = 6  # 5 px of the descriptor and 1 px of the Sobel mask
BATCH_FEATURES = 128  # number of features with similar u that are compared at once
# Largest row difference of compared features, whole pixels; after the refinement, `row_tolerance` applies.
MAX_ROW_DIFFERENCE_PX = 2


@dataclass(frozen=True, eq=False)
class DescribedFeatures(Rows):
    """N features of one image.

    Attributes
    ----------
    uv : (N, 2) whole pixels.
    kind : (N,) 0 … 3: blob maximum, blob minimum, corner maximum, corner minimum.
    strength : (N,) size of the mask's response, grey levels.
    descriptor : (N, 32) Sobel responses, along u and along v at each of the 16 positions.
    """

    uv: Array
    kind: IntArray
    strength: Array
    descriptor: NDArray[np.float32]


def describe(image: Image, config: FeatureConfig) -> DescribedFeatures:
    """The blobs and corners of an image (H, W) with their descriptors, sorted by kind, then by row.

    A feature is a pixel whose response is the largest in a square around it, `config.blob_cell` pixels wide,
    and above `config.blob_quality`. A minimum is a maximum of the negative response.
    """
    positions = []
    strengths = []
    for mask in (BLOB, CORNER):
        # 16-bit integers represent every response exactly, and take half the time of floats.
        response = np.asarray(cv2.filter2D(image, cv2.CV_16S, mask), np.int16)
        for signed in (response, -response):
            pixels, responses = _peaks(signed, config)
            positions.append(pixels)
            strengths.append(responses)
    kind = np.repeat(np.arange(4), [len(pixels) for pixels in positions])
    uv = np.concatenate(positions)
    return DescribedFeatures(uv, kind, np.concatenate(strengths), _descriptors(image, uv))


def _descriptors(image: Image, uv: Array) -> NDArray[np.float32]:
    """Both Sobel responses at the 16 positions around each of the pixels (N, 2), (N, 32)."""
    along_u = cv2.Sobel(image, cv2.CV_16S, 1, 0, ksize=3)
    along_v = cv2.Sobel(image, cv2.CV_16S, 0, 1, ksize=3)
    # One look-up gives both responses of a pixel, if the two 16-bit numbers are read as one of 32 bits. The
    # pixels are numbered row by row, so (u, v) has the number u + width * v.
    both = cv2.merge([along_u, along_v]).view(np.int32).ravel()
    to_number = np.array([1, image.shape[1]])
    centres = uv.astype(np.intp) @ to_number
    samples = both.take(centres[:, None] + DESCRIPTOR_OFFSETS @ to_number)
    return np.asarray(samples.view(np.int16), np.float32)


def _peaks(response: NDArray[np.int16], config: FeatureConfig) -> tuple[Array, Array]:
    """Pixels (N, 2) whose responses are the largest in the squares around them, and these responses (N,)."""
    largest_nearby = cv2.dilate(response, np.ones((config.blob_cell, config.blob_cell), np.uint8))
    border = max(config.border, DESCRIPTOR_RADIUS_PX)
    inner = slice(border, -border)
    is_largest = (response == largest_nearby)[inner, inner]
    # Responses are whole numbers: above 50.7 means above 50.
    is_strong = response[inner, inner] > int(config.blob_quality)
    peak = is_largest & is_strong
    # NumPy searches a one-dimensional array ten times as fast as an image. A very small image has no inside.
    width = max(peak.shape[1], 1)
    row, column = np.divmod(np.flatnonzero(peak), width)
    row += border
    column += border
    positions = np.stack([column, row], axis=1).astype(np.float64)
    return positions, response[row, column].astype(np.float64)


def stereo_matches(
    left: DescribedFeatures, right: DescribedFeatures, max_disparity: int
) -> tuple[Index, Index]:
    """For each left feature, the most similar right feature of the same kind, and vice versa.

    Two features are compared if their rows differ by at most `MAX_ROW_DIFFERENCE_PX` and their disparity
    is 0 … max_disparity, pixels. These pairs are so few that all of them are compared at once.

    Returns
    -------
    (N,) indices into `right` and (M,) indices into `left`; -1 for a feature without a pair.
    """
    # `describe` sorts features by kind and row, so the right features in near rows of a kind are one range:
    # for left feature i, those from first[i] to end[i] - 1.
    left_key = _kind_and_row(left)
    right_key = _kind_and_row(right)
    first = np.searchsorted(right_key, left_key - MAX_ROW_DIFFERENCE_PX)
    end = np.searchsorted(right_key, left_key + MAX_ROW_DIFFERENCE_PX, side="right")
    # A list of all pairs (i, j): left feature 0 with its range, left feature 1 with its range, and so on.
    count = end - first
    i = np.repeat(np.arange(len(left)), count)
    first_pair = np.cumsum(count) - count  # place of the first pair of each left feature in the list
    j = first[i] + np.arange(len(i)) - first_pair[i]
    disparity = left.uv[i, 0] - right.uv[j, 0]
    possible = (disparity >= 0) & (disparity <= max_disparity)
    i = i[possible]
    j = j[possible]
    difference = np.abs(left.descriptor[i] - right.descriptor[j]).sum(axis=1)
    # The pairs are written down from the least to the most similar one. A later assignment replaces an
    # earlier one, so the most similar pair remains; of equally similar pairs, the first one.
    order = np.argsort(difference, kind="stable")[::-1]
    to_right = np.full(len(left), -1, np.intp)
    to_left = np.full(len(right), -1, np.intp)
    to_right[i[order]] = j[order]
    to_left[j[order]] = i[order]
    return to_right, to_left


def _kind_and_row(features: DescribedFeatures) -> IntArray:
    """Kind and row of each feature in one number (N,), the kind in the higher bits; + 1 is the next row."""
    return np.asarray((features.kind << 32) + features.uv[:, 1].astype(np.intp))


def best_matches(query: DescribedFeatures, train: DescribedFeatures, radius: int) -> Index:
    """For each query feature, the most similar train feature of the same kind near the same position.

    Parameters
    ----------
    query : N features of one image; train : features of another image, which are searched.
    radius : largest distance along u and along v, pixels.

    Returns
    -------
    (N,) indices into `train`; -1 if no feature of the kind is near.
    """
    match = np.full(len(query), -1, np.intp)
    query_u, query_v = query.uv.T.astype(np.int16)
    train_u, train_v = train.uv.T.astype(np.int16)
    # Sorted by column, the features of a batch share nearly all neighbours: one comparison serves them all.
    query_order = np.argsort(query_u, kind="stable")
    train_order = np.argsort(train_u, kind="stable")
    for kind in range(4):
        queries = query_order[query.kind[query_order] == kind]
        trains = train_order[train.kind[train_order] == kind]
        for start in range(0, len(queries), BATCH_FEATURES):
            i = queries[start : start + BATCH_FEATURES]
            # The columns that the batch can reach, from its first query to its last.
            low = query_u[i[0]] - radius
            high = query_u[i[-1]] + radius
            first, end = np.searchsorted(train_u[trains], (low, high + 1))
            # Sorted, so that the first of equally similar features is selected.
            j = np.sort(trains[first:end])
            if len(j) == 0:
                continue
            near_u = np.abs(np.subtract.outer(query_u[i], train_u[j])) <= radius
            near_v = np.abs(np.subtract.outer(query_v[i], train_v[j])) <= radius
            mask = (near_u & near_v).view(np.uint8)
            _, nearest = cv2.batchDistance(
                query.descriptor[i], train.descriptor[j], dtype=-1, normType=cv2.NORM_L1, K=1, mask=mask
            )
            best = nearest.ravel()  # a place in j, or -1 if the mask has excluded all of j
            found = best >= 0
            match[i[found]] = j[best[found]]
    return match
