"""The translation by the pseudo-inverse, equations (2) and (3) of the paper (chapter 4).

Let Q be a feature's point in the axes of the previous left camera, and P the same point in the axes of the
left camera of any pair: P = Q in the previous pair, and P = R Q + t in the current one. In a left image, the
feature is at x = P_x / P_z and y = P_y / P_z, where x = (u - cx) / f and y = (v - cy) / f. Multiplied by P_z,
that is

    (x e3 - e1)ᵀ P = 0,   (y e3 - e2)ᵀ P = 0,

with the unit vectors e1, e2, e3. The right camera is a baseline b to the right, which changes the first row
to (x e3 - e1)ᵀ P = -b. Two rows in each of four images are eight rows, with the six unknowns Q and t, since R
is known.

In (2), the paper's Q̂ is in the current frame; where it is projected into the previous images, R and t are the
inverse motion. Here Q is in the previous frame, and t is t_cp itself. The paper's P̂ is the projection, in
pixels; our P is a point. The matrix A of (3) is [A | B] here, and the right-hand side B of (3) is c here.

Section 2 requires the constraints of three consecutive frames. A feature that was already matched one frame
earlier has four more rows, with P = R' Q + t', where (R', t') is the inverse of the last motion. These rows
depend only on Q.

The paper says nothing of weights, of a limit of depth or of wrong matches, so these three are ours:

- With rows in metres, far features would have the largest weight, and the translations on KITTI's 01, which
  are too long already, would be longer still (notebooks/paper_and_code.md has the numbers). So all rows of a
  feature are divided by one number, its depth in the previous left camera. A row is then an error in the
  image, in pixels divided by f. In (2), the factor α divides by the depth, too.
- A feature farther away than the setting `max_depth` is not used.
- Features whose rows do not fit the translation are left out; the first estimate is the median of the
  translations of single features (`solve_translation`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import inverse
from ..geometry.types import Array, BoolArray
from .settings import TranslationLimits

SOLVING_ROUNDS = 2  # number of times that outliers are removed and the rest is solved


class PairBefore(NamedTuple):
    """The result of the previous frame, for the equations of the frame before it (`earlier_rows`).

    Attributes
    ----------
    matches : between the frame before the previous one and the previous one.
    T_cp : (4, 4) motion between these two frames, metres.
    """

    matches: StereoMatches
    T_cp: Array


def view_rows(camera: StereoCamera, uv: Array) -> Array:
    """The rows x e3 - e1 and y e3 - e2 of pixels (N, 2) in one image, (N, 2, 3)."""
    rows = np.zeros((len(uv), 2, 3))
    rows[:, :, 2] = camera.normalise(uv)
    rows[:, 0, 0] = -1.0
    rows[:, 1, 1] = -1.0
    return rows


def feature_rows(camera: StereoCamera, matches: StereoMatches, R_cp: Array) -> tuple[Array, Array, Array]:
    """The system A Q + B t = c of every feature, equation (3), in metres.

    Parameters
    ----------
    matches : N features; R_cp : (3, 3) rotation, previous to current.

    Returns
    -------
    A (N, 8, 3), B (N, 8, 3), c (N, 8). Rows: x and y in previous left, previous right, current left,
    current right.
    """
    n = len(matches)
    views = (matches.prev_left, matches.prev_right, matches.cur_left, matches.cur_right)
    A = np.stack([view_rows(camera, uv) for uv in views], axis=1)
    # In the current pair, P = R Q + t: the rows are multiplied by R for Q, and stay as they are for t.
    B = np.zeros_like(A)
    B[:, 2:] = A[:, 2:]
    A[:, 2:] = A[:, 2:] @ R_cp
    # In the right images, the x rows equal -b.
    c = np.zeros((n, 4, 2))
    c[:, [1, 3], 0] = -camera.baseline
    return A.reshape(n, 8, 3), B.reshape(n, 8, 3), c.reshape(n, 8)


def earlier_rows(camera: StereoCamera, matches: StereoMatches, before: PairBefore) -> tuple[Array, Array]:
    """The rows A Q = c of the frame before the previous frame, for N features of the current pair.

    Returns
    -------
    A (N, 4, 3), c (N, 4). Rows: x and y in the left, then in the right image; zeros for a feature without a
    match in that frame.
    """
    n = len(matches)
    A = np.zeros((n, 2, 2, 3))
    c = np.zeros((n, 2, 2))
    # Places of the features that are in both sets of matches, in each of the two.
    _, here, there = np.intersect1d(matches.id, before.matches.id, return_indices=True)
    earlier = before.matches[there]
    # R' and t' of the module's text: from the previous frame, where Q is, to the frame before it.
    T_earlier = inverse(before.T_cp)
    # With P = R' Q + t', the part with t' is known: it goes to the right-hand side.
    for view, uv in enumerate((earlier.prev_left, earlier.prev_right)):
        rows = view_rows(camera, uv)
        A[here, view] = rows @ T_earlier[:3, :3]
        c[here, view] = -rows @ T_earlier[:3, 3]
    c[here, 1, 0] -= camera.baseline
    return A.reshape(n, 4, 3), c.reshape(n, 4)


def all_rows(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, before: PairBefore | None
) -> tuple[Array, Array, Array, BoolArray]:
    """The system A Q + B t = c of every feature: `feature_rows` and, with a pair `before`, `earlier_rows`.

    Returns
    -------
    A (N, K, 3), B (N, K, 3), c (N, K), with K = 8 rows or, with `before`, twelve; and a mask (N,) of the
    features that were matched one frame earlier, so that their last four rows are not zero.
    """
    A, B, c = feature_rows(camera, matches, R_cp)
    if before is None:
        return A, B, c, np.zeros(len(matches), np.bool_)
    A_before, c_before = earlier_rows(camera, matches, before)
    seen_before = np.asarray(A_before.any(axis=(1, 2)))
    A = np.concatenate([A, A_before], axis=1)
    B = np.concatenate([B, np.zeros_like(A_before)], axis=1)
    c = np.concatenate([c, c_before], axis=1)
    return A, B, c, seen_before


def eliminate_points(A: Array, B: Array, c: Array) -> tuple[Array, Array]:
    """The rows M t = d of every feature, without its point Q.

    The projector I - A A⁺ eliminates Q, since (I - A A⁺) A = 0, where A⁺ is the pseudo-inverse.

    Parameters
    ----------
    A, B : (N, K, 3); c : (N, K). The rows of each feature, eight or twelve, from `all_rows`.

    Returns
    -------
    M (N, K, 3), d (N, K).
    """
    A_plus = np.linalg.solve(A.swapaxes(1, 2) @ A, A.swapaxes(1, 2))
    projector = np.eye(A.shape[1]) - A @ A_plus
    M = projector @ B
    d = (projector @ c[..., None])[..., 0]
    return M, d


def residual_limit(agreement: float, seen_before: BoolArray) -> Array:
    """Largest residual norm (N,) of an inlier's rows, pixels; larger for a feature with twelve rows.

    Of K rows with noise of standard deviation σ in each, the elimination of the three unknowns of Q leaves
    K - 3 independent residuals. (The three unknowns of t take almost none, since hundreds of features share
    them.) So the expected squared norm is (K - 3) σ²: 5 σ² for eight rows, and 9 σ² for twelve rows. With one
    limit for both, features that were matched one frame earlier would be removed more often than the others.

    Parameters
    ----------
    agreement : limit for eight rows, pixels. seen_before : (N,) mask of the features with twelve rows.
    """
    independent_residuals = np.where(seen_before, 12 - 3, 8 - 3)
    return np.asarray(agreement * np.sqrt(independent_residuals / (8 - 3)))


def solve_translation(
    camera: StereoCamera,
    matches: StereoMatches,
    R_cp: Array,
    config: TranslationLimits,
    before: PairBefore | None = None,
) -> tuple[Array, BoolArray] | None:
    """One translation for all features: the rows of (3) without Q, stacked and solved by least squares.

    That is the solution which the pseudo-inverse of the stacked rows gives.

    Each feature alone gives a translation, and the median of these is the first estimate. Then, twice, the
    features whose rows do not fit the estimate are left out (`residual_limit`), and the stacked rows of the
    others give a new one.

    Parameters
    ----------
    matches : N features; R_cp : (3, 3) rotation, previous to current.
    before : result of the previous frame, for the constraints of three frames; None: two frames.

    Returns
    -------
    t_cp (3,), metres, and a mask (N,) of the features from which it was computed. None if no feature is near
    enough to be used, or if their rows do not determine a translation.
    """
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    near = np.flatnonzero(depth <= config.max_depth)  # an undefined depth is NaN, which fails the comparison
    if len(near) == 0:
        return None
    A, B, c, seen_before = all_rows(camera, matches[near], R_cp, before)
    limit = residual_limit(config.agreement, seen_before)
    M, d = eliminate_points(A, B, c)
    # Divided by the depth, the rows are errors in the image.
    M = M / depth[near, None, None]
    d = d / depth[near, None]
    # The normal equations H t = g of each feature; those of the stacked rows are their sums.
    H = M.swapaxes(1, 2) @ M
    g = (M.swapaxes(1, 2) @ d[..., None])[..., 0]
    try:
        t_of_each = np.linalg.solve(H, g[..., None])[..., 0]
        t = np.median(t_of_each, axis=0)
        for _ in range(SOLVING_ROUNDS):
            residual = camera.f * np.linalg.norm(d - M @ t, axis=1)
            fits = residual < limit
            t = np.linalg.solve(H[fits].sum(axis=0), g[fits].sum(axis=0))
    except np.linalg.LinAlgError:
        return None
    inliers = np.zeros(len(matches), np.bool_)
    inliers[near[fits]] = True
    return t, inliers
