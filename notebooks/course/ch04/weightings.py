"""Chapter 4: simple ways to combine the rows of all features, compared with the method's own way."""

from __future__ import annotations

import numpy as np

from course.simulation.tracks import TrackConfig, simulate_tracks
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import transform
from vo_lib.geometry.types import Array
from vo_lib.kit.settings import KitTranslationConfig
from vo_lib.kit.weighted_translation import robust_translation
from vo_lib.paper import translation as paper
from vo_lib.paper.settings import TranslationConfig, TranslationLimits

from ..lessons import CAMERA, consensus_rotation, drive, pair_of

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
    return np.stack([rng.uniform(-0.7, 0.7, count) * z, rng.uniform(-0.2, 0.2, count) * z, z], axis=1)


def noisy_matches(camera: StereoCamera, X_p: Array, T_cp: Array, noise: float, seed: int) -> StereoMatches:
    """Matches of points X_p (N, 3), metres, for the motion T_cp, with Gaussian noise in pixels.

    Points with a noisy disparity of at most 0.5 px are dropped.
    """
    places = np.array([*camera.project(X_p), *camera.project(transform(T_cp, X_p))])
    places += np.random.default_rng(seed).normal(0.0, noise, places.shape)
    a, b, c, d = places[:, (places[0] - places[1])[:, 0] > 0.5]
    return StereoMatches(a, b, c, d, np.zeros(len(a), np.int64), np.ones(len(a)), np.arange(len(a)))


def alone(A: Array, B: Array, c: Array) -> Array:
    """The t of each feature alone, (N, 3) metres: the solution of its eight rows A, B (N, 8, 3), c (N, 8)."""
    M, d = paper.eliminate_points(A, B, c)
    return np.asarray((np.linalg.pinv(M) @ d[..., None])[..., 0])


def solve_all(M: Array, d: Array, weight: Array) -> Array:
    """Least-squares t (3,) from the rows M (N, 8, 3), d (N, 8), times the weights (N,) of the features."""
    rows = (weight[:, None, None] * M).reshape(-1, 3), (weight[:, None] * d).ravel()
    return np.asarray(np.linalg.lstsq(*rows)[0], np.float64)


def solve_by(
    weighting: str, camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: TranslationLimits
) -> tuple[Array, Array, Array] | None:
    """The translation t_cp (3,) of a weighting, metres, with residuals and weights; None without a solution.

    The residuals (N,) are norms over the eight rows of a feature, pixels (infinite beyond the largest depth).
    The weights (N,) do not include the division by depth; the weight of an unused feature is NaN.
    """
    if weighting == METHOD and isinstance(config, KitTranslationConfig):
        solved = robust_translation(camera, matches, R_cp, config)
        if solved is None:
            return None
        t, residual = solved
        return t, residual, np.where(np.isfinite(residual), 1 / (1 + (residual / config.scale) ** 2), np.nan)
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    used = np.flatnonzero(depth <= config.max_depth)
    if len(used) == 0:
        return None
    rows = paper.feature_rows(camera, matches[used], R_cp)
    M, d = paper.eliminate_points(*rows)
    weight = np.ones(len(used))
    if weighting == METHOD:
        assert isinstance(config, TranslationConfig)
        solution = paper.solve_translation(camera, matches[used], R_cp, config)
        if solution is None:
            return None
        t = solution[0]
        weight = solution[1].astype(np.float64)
    elif weighting in (MEDIAN, MEAN):
        t = (np.median if weighting == MEDIAN else np.mean)(alone(*rows), axis=0)
    else:
        t = solve_all(M, d, np.ones(len(used)) if weighting == METRES else 1 / depth[used])
    residuals, weights = np.full((2, len(matches)), ((np.inf,), (np.nan,)))
    residuals[used] = camera.f * np.linalg.norm(d - M @ t, axis=1) / depth[used]
    weights[used] = weight
    return np.asarray(t), residuals, weights


def weighting_errors(tracks: TrackConfig, frames: int, seed: int) -> dict[str, Array]:
    """Translation error of each frame, millimetres, by weighting, with the same estimated rotations."""
    ways = {PUBLISHED: METHOD, ROBUST: METHOD} | {name: name for name in WEIGHTINGS[1:]}
    errors: dict[str, list[float]] = {name: [] for name in ways}
    for frame in simulate_tracks(drive(frames), CAMERA, tracks, seed):
        rng = np.random.default_rng([seed, frame.frame])
        R_cp = consensus_rotation(pair_of(frame), rng, CAMERA.f)
        for name, way in ways.items():
            config = KitTranslationConfig() if name == ROBUST else TranslationConfig()
            solved = solve_by(way, CAMERA, frame.matches, R_cp, config)
            assert solved is not None
            errors[name].append(1e3 * float(np.linalg.norm(solved[0] - frame.T_cp[:3, 3])))
    return {name: np.array(values) for name, values in errors.items()}
