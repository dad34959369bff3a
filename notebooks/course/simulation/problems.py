"""Random relative-pose problems with known truth, for tests, notebooks and benchmarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from vo_lib.geometry.motion import essential_from_motion, rotation_from_vector
from vo_lib.geometry.types import Array

Motion = Literal[
    "general", "forward", "sideways", "planar", "planar_forward", "small_baseline", "pure_rotation"
]
MOTIONS: tuple[Motion, ...] = get_args(Motion)

# Half the field of view as tan(angle): the 1241×376 px image of KITTI at f = 718.856 px.
HALF_WIDTH = 0.863
HALF_HEIGHT = 0.262
FOCAL = 718.856  # pixels; turns noise into normalised coordinates
# Depth of the points in the previous camera, metres; on a plane, from half the nearest to twice the farthest.
NEAREST = 4.0
FARTHEST = 40.0
IN_FRONT = 0.5  # least depth in the current camera, metres


@dataclass(frozen=True, eq=False)
class PoseProblems:
    """S problems of N matches each, and their truth. X_c = R_cp X_p + t_cp.

    Attributes
    ----------
    R_cp : (S, 3, 3) rotations from the previous into the current camera.
    t_cp : (S, 3) translations, metres.
    E : (S, 3, 3) essential matrices [t_cp]× R_cp of Frobenius norm 1; zero where t_cp is zero.
    x_p, x_c : (S, N, 2) normalised image points, with noise.
    X_p : (S, N, 3) points in the previous camera, metres.
    """

    R_cp: Array
    t_cp: Array
    E: Array
    x_p: Array
    x_c: Array
    X_p: Array


def random_problems(
    rng: np.random.Generator,
    count: int,
    points: int = 5,
    motion: Motion = "general",
    *,
    noise_px: float = 0.0,
    rotation: float | None = None,
) -> PoseProblems:
    """Draw `count` problems of `points` matches, each with a t_cp of one metre if `motion` says nothing else.

    The points are in the view of the previous camera, and in front of the current one, but perhaps outside its
    view.

    Parameters
    ----------
    motion : "general": any direction; "forward" or "sideways": exactly along the optical axis or the x axis;
        "planar" or "planar_forward": "general" or "forward", with all points on one plane of random tilt;
        "small_baseline": 1 cm in any direction; "pure_rotation": no translation.
    noise_px : standard deviation of Gaussian noise on every image coordinate, pixels.
    rotation : largest rotation angle, radians; by default 0.05 for forward motions, else 0.3.
    """
    forward = motion in ("forward", "planar_forward")
    if rotation is None:
        rotation = 0.05 if forward else 0.3
    R_cp = rotation_from_vector(_directions(rng, count) * rng.uniform(0.0, rotation, (count, 1)))
    t_cp = _directions(rng, count)
    if forward:
        t_cp = np.tile([0.0, 0.0, -1.0], (count, 1))  # the scene comes nearer
    elif motion == "sideways":
        t_cp = np.tile([-1.0, 0.0, 0.0], (count, 1))
    if motion == "small_baseline":
        t_cp = 0.01 * t_cp
    elif motion == "pure_rotation":
        t_cp = np.zeros_like(t_cp)
    X_p = _visible_points(rng, R_cp, t_cp, points, planar=motion.startswith("planar"))
    X_c = X_p @ np.swapaxes(R_cp, 1, 2) + t_cp[:, None]
    E = essential_from_motion(R_cp, t_cp)
    norm = np.linalg.norm(E, axis=(1, 2), keepdims=True)
    noise_p, noise_c = rng.normal(0.0, noise_px / FOCAL, (2, count, points, 2))
    x_p = X_p[..., :2] / X_p[..., 2:] + noise_p
    x_c = X_c[..., :2] / X_c[..., 2:] + noise_c
    return PoseProblems(R_cp, t_cp, E / np.where(norm > 0.0, norm, 1.0), x_p, x_c, X_p)


def _directions(rng: np.random.Generator, count: int) -> Array:
    """Unit vectors (count, 3), uniform on the sphere."""
    d = rng.normal(size=(count, 3))
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


def _visible_points(rng: np.random.Generator, R_cp: Array, t_cp: Array, points: int, planar: bool) -> Array:
    """Points (S, N, 3) in the view of the previous camera and in front of both cameras."""
    count = len(R_cp)
    # Planes n·X = n·X0 through a point X0 on the optical axis, tilted by up to about 60°.
    normal = _directions(rng, count) * 0.85 + [0.0, 0.0, 1.0]
    distance = normal[:, 2] * rng.uniform(NEAREST, FARTHEST / 2, count)
    X_p = np.zeros((count, points, 3))
    todo = np.ones((count, points), dtype=bool)
    for _ in range(200):
        s, n = np.nonzero(todo)
        if not s.size:
            return X_p
        ray = np.ones((s.size, 3))
        ray[:, :2] = rng.uniform(-1.0, 1.0, (s.size, 2)) * [HALF_WIDTH, HALF_HEIGHT]
        depth = rng.uniform(NEAREST, FARTHEST, s.size)
        if planar:
            slope = np.sum(ray * normal[s], axis=1)
            depth = distance[s] / np.where(np.abs(slope) > 1e-3, slope, 1e-3)
        X = ray * depth[:, None]
        depth_c = np.einsum("ni,ni->n", R_cp[s, 2], X) + t_cp[s, 2]
        valid = (depth > NEAREST / 2) & (depth < 2 * FARTHEST) & (depth_c > IN_FRONT)
        X_p[s[valid], n[valid]] = X[valid]
        todo[s[valid], n[valid]] = False
    raise ValueError("no points in front of both cameras: the rotation is too large")
