"""Chapter 5, beyond the paper: how the vehicle in each box moves against the background.

The camera's motion comes from the features outside all boxes. A feature that stands still must then be
found at one place in both current images; what is left over is a step in space. Unlike the distance to an
epipolar line, it also shows a car ahead that keeps its distance: its disparity stays, a standing car's grows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import rigid
from ..geometry.reprojection import fit_motion
from ..geometry.rows import Rows
from ..geometry.types import Array, IntArray
from ..paper.boxes import inside
from ..paper.buckets import select_by_bucket
from ..paper.settings import BucketConfig

# Features for the motion of the camera: enough for a millimetre, few enough for a millisecond.
BACKGROUND_BUCKETS = BucketConfig(size=100, features=2)
# A feature agrees with a step when its squared error is below this, in deviations: 99 % of normal noise.
AGREES_CHI2 = 11.3
STEP_ITERATIONS = 3
# Information on a direction that no feature sees, 1/m².
MIN_INFORMATION_RATIO = 1e-6
# The tallest car, and the tallest vehicle of any other class, metres.
CAR, CAR_HEIGHT, HEIGHT = 2, 2.3, 4.2
# Features of a box without which nothing is said of it, and the share of them that must move together.
MIN_BOX_FEATURES, MOVED_SHARE = 3, 0.3
# Standard deviations of the camera's step from features outside boxes, metres, and of its rotation, radians.
STEP_ERROR, TURN_ERROR = 0.01, np.radians(0.01)


@dataclass(frozen=True, eq=False)
class PointSteps(Rows):
    """How N features moved against the background between two frames.

    Attributes
    ----------
    step : (N, 3) displacement in the current left camera's axes, metres.
    information : (N, 3, 3) inverse covariance of the step for matches with a deviation of one pixel.
    depth : (N,) metres, where a standing feature would be.
    """

    step: Array
    information: Array
    depth: Array

    def squared_error(self, step: Array) -> Array:
        """Squared distance (N,) of each feature to a step (3,) or (N, 3), pixels²."""
        e = self.step - step
        return np.asarray(np.einsum("ni,nij,nj->n", e, self.information, e))


def background_motion(camera: StereoCamera, matches: StereoMatches, start: Array, iterations: int) -> Array:
    """Motion T_cp (4, 4) of the camera from features that stand still, most of them."""
    chosen = matches[select_by_bucket(matches.cur_left, matches.age, matches.strength, BACKGROUND_BUCKETS)]
    chosen = chosen[chosen.prev_left[:, 0] > chosen.prev_right[:, 0]]
    X_p = camera.triangulate(chosen.prev_left, chosen.prev_right)
    R, t, _ = fit_motion(
        camera, X_p, chosen.cur_left, chosen.cur_right, start[:3, :3], start[:3, 3], 0.5, iterations
    )
    return rigid(R, t)


def point_steps(camera: StereoCamera, matches: StereoMatches, T_cp: Array) -> PointSteps:
    """Step of each feature against the background: where it is less where a standing one would be.

    Both points are triangulated, u_left, v and u_right of three unknowns each, so that a far feature's
    step is known well across the line of sight and badly along it; the information says so.
    """
    R_cp = T_cp[:3, :3]
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    X_c = camera.triangulate(matches.cur_left, matches.cur_right)
    stands = X_p @ R_cp.T + T_cp[:3, 3]
    spread_c = _point_covariance(camera, X_c)
    spread_p = R_cp @ _point_covariance(camera, X_p) @ R_cp.T
    return PointSteps(X_c - stands, np.asarray(np.linalg.inv(spread_p + spread_c)), stands[:, 2])


def _point_covariance(camera: StereoCamera, X: Array) -> Array:
    """Covariance (N, 3, 3) of triangulated points for a deviation of one pixel in u_left, v and u_right.

    With d = u_left - u_right: Z = f b / d, X = (u_left - cx) Z / f, Y = (v - cy) Z / f.
    """
    z = X[:, 2]
    per_pixel = z / camera.f
    depth = -z * z / (camera.f * camera.baseline)  # dZ / dd
    D = np.zeros((len(X), 3, 3))
    D[:, :, 0] = (depth / z)[:, None] * X
    D[:, :, 2] = -D[:, :, 0]
    D[:, 0, 0] += per_pixel
    D[:, 1, 1] = per_pixel
    return D @ np.swapaxes(D, 1, 2)


def owner_of(camera: StereoCamera, left: Array, right: Array, boxes: Boxes) -> IntArray:
    """Box that each feature (N, 2), (N, 2) may lie on, -1 for none; of several the one in front.

    The one in front is the lowest in the image. A feature so far away that a vehicle there would be taller
    than any of its class belongs to the background that a box holds beside its vehicle.
    """
    if len(boxes) == 0:
        return np.full(len(left), -1)
    height = np.where(boxes.class_id == CAR, CAR_HEIGHT, HEIGHT)
    # depth <= f height / (bottom - top), as disparity
    least = camera.baseline * (boxes.xyxy[:, 3] - boxes.xyxy[:, 1]) / height
    may = inside(left, boxes.xyxy) & (left[:, :1] - right[:, :1] >= least)
    nearness = np.where(may, boxes.xyxy[:, 3], -np.inf)
    return np.where(may.any(axis=1), np.argmax(nearness, axis=1), -1)


@dataclass(frozen=True, eq=False)
class BoxSteps(Rows):
    """How the vehicles in K boxes moved between two frames, from these two frames alone.

    Attributes
    ----------
    step : (K, 3) displacement against the background in the current left camera's axes, metres.
    information : (K, 3, 3) its inverse covariance, 1/m²; zero where nothing is known.
    matches : (K,) features that may lie on the vehicle.
    """

    step: Array
    information: Array
    matches: IntArray


def no_steps(number: int) -> BoxSteps:
    """Nothing known of a number of boxes."""
    return BoxSteps(np.zeros((number, 3)), np.zeros((number, 3, 3)), np.zeros(number, np.int64))


def box_steps(points: PointSteps, owner: IntArray, number: int, noise: float) -> BoxSteps:
    """One step for each of `number` boxes from the features it owns (owner (N,), -1: none).

    `noise` is the variance of a match, pixels².

    A box holds the vehicle, some background behind it, and outlines that belong to neither. Two robust means
    compete (Cauchy weights): of all features, and of those alone that do not agree with standing still.
    """
    stands = points.squared_error(np.zeros(3)) / noise
    mine = (owner >= 0) & np.isfinite(stands)
    points, owner, stands = points[mine], owner[mine], stands[mine]
    member = (owner == np.arange(number)[:, None]).astype(np.float64)
    total = member.sum(axis=1)
    moved = stands > AGREES_CHI2
    weight = np.stack([1.0 / (1.0 + stands / AGREES_CHI2), moved.astype(np.float64)])
    flat = points.information.reshape(len(owner), 9) / noise
    pull = np.einsum("nij,nj->ni", points.information, points.step) / noise
    parts = np.concatenate([flat, pull], axis=1)
    for _ in range(STEP_ITERATIONS):
        sums = member @ (weight[:, :, None] * parts)  # (2, K, 12)
        information = sums[:, :, :9].reshape(2, number, 3, 3)
        steps = np.linalg.solve(information + MIN_INFORMATION_RATIO * np.eye(3), sums[:, :, 9:, None])[
            :, :, :, 0
        ]
        e = points.step - steps[:, owner]
        errors = np.einsum("sni,nij,snj->sn", e, points.information, e) / noise
        weight = 1.0 / (1.0 + errors / AGREES_CHI2)
    agreeing = member @ (moved & (errors[1] < AGREES_CHI2))
    moves = (agreeing >= np.maximum(MIN_BOX_FEATURES, MOVED_SHARE * total)).astype(np.int64)
    chosen = moves, np.arange(number)
    depth = member @ points.depth / np.maximum(total, 1.0)
    # What the motion of the camera does not know, no number of features in the box can tell.
    shared = STEP_ERROR**2 + (TURN_ERROR * depth) ** 2
    spread = np.linalg.inv(information[chosen] + MIN_INFORMATION_RATIO * np.eye(3)) + shared[
        :, None, None
    ] * np.eye(3)
    enough = (total >= MIN_BOX_FEATURES)[:, None, None]
    return BoxSteps(steps[chosen], np.where(enough, np.linalg.inv(spread), 0.0), total.astype(np.int64))
