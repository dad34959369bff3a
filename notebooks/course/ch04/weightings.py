"""Chapter 4: simple ways to combine the rows of all features, compared with the method's own way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import mean_and_deviation
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import transform
from vo_lib.geometry.types import Array
from vo_lib.kit.settings import KitTranslationConfig
from vo_lib.kit.weighted_translation import robust_translation
from vo_lib.paper import translation as paper
from vo_lib.paper.settings import TranslationConfig, TranslationLimits

from ..candidates import consensus_rotation
from ..simulation.drives import CAMERA, drive, points_of
from ..simulation.tracks import TrackConfig, simulate_tracks

# How the rows of all features are combined: by the configuration's own method, or in a plain way.
METHOD = "the method's own"
PIXELS = "rows in pixels"
METRES = "rows in metres"
MEDIAN = "median of features"
MEAN = "mean of features"
WEIGHTINGS = (METHOD, PIXELS, METRES, MEDIAN, MEAN)
PUBLISHED = "published"
ROBUST = "robust (kit)"


def spread_points(count: int, seed: int, nearest: float, farthest: float) -> Array:
    """Points (count, 3), metres, spread over the image between two depths."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(nearest, farthest, count)
    x = rng.uniform(-0.7, 0.7, count) * z
    y = rng.uniform(-0.2, 0.2, count) * z
    return np.stack([x, y, z], axis=1)


def noisy_matches(camera: StereoCamera, X_p: Array, T_cp: Array, noise: float, seed: int) -> StereoMatches:
    """Matches of points X_p (N, 3), metres, for the motion T_cp, with Gaussian noise in pixels.

    Points with a noisy disparity of at most 0.5 px are dropped.
    """
    prev_left, prev_right = camera.project(X_p)
    cur_left, cur_right = camera.project(transform(T_cp, X_p))
    exact = np.array([prev_left, prev_right, cur_left, cur_right])
    places = exact + np.random.default_rng(seed).normal(0.0, noise, exact.shape)
    disparity = (places[0] - places[1])[:, 0]
    prev_left, prev_right, cur_left, cur_right = places[:, disparity > 0.5]
    count = len(prev_left)
    age = np.zeros(count, np.int64)
    return StereoMatches(prev_left, prev_right, cur_left, cur_right, age, np.ones(count), np.arange(count))


def rows_of_match(
    x_pl: Array, x_pr: Array, x_cl: Array, x_cr: Array, R_cp: Array, b: float
) -> tuple[Array, Array]:
    """The library's rows M (8, 6) and c (8,) of one match, for its normalised points (2,) in the four images."""
    camera = StereoCamera(f=1.0, cx=0.0, cy=0.0, baseline=b, width=1, height=1)
    prev_left, prev_right, cur_left, cur_right = np.array([x_pl, x_pr, x_cl, x_cr], np.float64)[:, None]
    one = np.ones(1, np.int64)
    match = StereoMatches(prev_left, prev_right, cur_left, cur_right, one, np.ones(1), one)
    A, B, c = paper.feature_rows(camera, match, R_cp)
    return np.hstack([A[0], B[0]]), c[0]


def alone(A: Array, B: Array, c: Array) -> Array:
    """The t of each feature alone, (N, 3) metres: the solution of its eight rows A, B (N, 8, 3), c (N, 8)."""
    M, d = paper.eliminate_points(A, B, c)
    return np.asarray((np.linalg.pinv(M) @ d[..., None])[..., 0])


def solve_all(M: Array, d: Array, weight: Array) -> Array:
    """The t (3,) with the smallest Σ w |d - M t|², from rows M (N, 8, 3), d (N, 8) and weights w (N,)."""
    factor = np.sqrt(weight)
    left = (factor[:, None, None] * M).reshape(-1, 3)
    right = (factor[:, None] * d).ravel()
    return np.asarray(np.linalg.lstsq(left, right)[0], np.float64)


def weights_by_depth(Z: Array) -> Array:
    """Weights (N,) of features at depths Z (N,) with which rows in metres become rows in pixels over f."""
    return np.asarray(1.0 / Z**2)


def weights_by_residual(r: Array, s: float) -> Array:
    """Cauchy weights (N,) of residuals r (N,) at the scale s."""
    return np.asarray(1.0 / (1.0 + (r / s) ** 2))


def length_errors(answers: Array, t_true: Array) -> Array:
    """Errors (S,) of the lengths of translations (S, 3), in % of the true length."""
    return np.asarray(100.0 * (np.linalg.norm(answers, axis=-1) / np.linalg.norm(t_true) - 1.0))


def bias_and_deviation(answers: Array, t_true: Array) -> tuple[float, float]:
    """Mean and standard deviation (over S - 1) of the lengths of translations (S, 3), in % of the true length."""
    return mean_and_deviation(length_errors(answers, t_true))


class Solution(NamedTuple):
    """A translation t_cp (3,), metres, and what each of the N features contributes.

    Attributes
    ----------
    residuals : (N,) norms over the eight rows of a feature, pixels; infinite beyond the largest depth.
    weights : (N,) without the division by depth; NaN for a feature that is not used.
    """

    t_cp: Array
    residuals: Array
    weights: Array


def solve_by(
    weighting: str, camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: TranslationLimits
) -> Solution | None:
    """The translation by a weighting; None without a solution."""
    if weighting == METHOD and isinstance(config, KitTranslationConfig):
        solved = robust_translation(camera, matches, R_cp, config)
        if solved is None:
            return None
        t, residual = solved
        weight = np.where(np.isfinite(residual), weights_by_residual(residual, config.scale), np.nan)
        return Solution(t, residual, weight)
    # All other weightings are those of variant `published`, or plain ones.
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    used = np.flatnonzero(depth <= config.max_depth)
    if len(used) == 0:
        return None
    A, B, c = paper.feature_rows(camera, matches[used], R_cp)
    M, d = paper.eliminate_points(A, B, c)
    weight = np.ones(len(used))
    if weighting == METHOD:
        solution = paper.solve_translation(camera, matches[used], R_cp, config)
        if solution is None:
            return None
        t, inliers = solution
        weight = inliers.astype(np.float64)
    elif weighting == MEDIAN:
        t = np.median(alone(A, B, c), axis=0)
    elif weighting == MEAN:
        t = np.mean(alone(A, B, c), axis=0)
    elif weighting == METRES:
        t = solve_all(M, d, np.ones(len(used)))
    else:  # PIXELS
        t = solve_all(M, d, weights_by_depth(depth[used]))
    residuals = np.full(len(matches), np.inf)
    weights = np.full(len(matches), np.nan)
    residuals[used] = camera.f * np.linalg.norm(d - M @ t, axis=1) / depth[used]
    weights[used] = weight
    return Solution(np.asarray(t), residuals, weights)


def weighting_errors(tracks: TrackConfig, frames: int, seed: int) -> dict[str, Array]:
    """Translation error of each frame, millimetres, by weighting, with the same estimated rotations."""
    names = (PUBLISHED, ROBUST, *WEIGHTINGS[1:])
    errors: dict[str, list[float]] = {name: [] for name in names}
    for frame in simulate_tracks(drive(frames), CAMERA, tracks, seed):
        rng = np.random.default_rng([seed, frame.frame])
        R_cp = consensus_rotation(points_of(frame), rng, CAMERA.f)
        for name in names:
            config = KitTranslationConfig() if name == ROBUST else TranslationConfig()
            weighting = METHOD if name in (PUBLISHED, ROBUST) else name
            solved = solve_by(weighting, CAMERA, frame.matches, R_cp, config)
            if solved is None:
                raise DataError("a frame of these tracks gives no translation: use more points")
            errors[name].append(1e3 * float(np.linalg.norm(solved.t_cp - frame.T_cp[:3, 3])))
    return {name: np.array(values) for name, values in errors.items()}
