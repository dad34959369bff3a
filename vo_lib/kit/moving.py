"""Displacements of the vehicles in boxes against the background (chapter 5, not in the paper).

The camera's motion is estimated from the features outside all boxes. This motion predicts the position of a
static feature; the measured position minus this prediction is a displacement in space. Unlike the distance to
an epipolar line, the displacement also detects a car ahead at a constant distance: the car's disparity is
constant, while the disparity of a parked car grows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.reprojection import fit_motion
from ..geometry.rows import Rows
from ..geometry.types import Array, IntArray
from ..paper.box_removal import inside
from ..paper.buckets import select_by_bucket
from ..paper.settings import BucketConfig

# Buckets for the camera's motion: few features are quick to fit, and precise enough.
BACKGROUND_BUCKETS = BucketConfig(size=100, features=2)
BACKGROUND_SCALE_PX = 0.5  # residual at which a feature's weight in this motion is halved
# Largest squared error, in variances, of a feature that agrees with a displacement: the 99 % quantile of χ²
# with three degrees of freedom. (Matches are removed by a stricter limit, see `BoxMotionClassifier`.)
AGREES_CHI2 = 11.3
STEP_ITERATIONS = 3  # of the robust means in `box_steps`
# Information on a direction that no feature measures, 1/m².
MIN_INFORMATION = 1e-6
CAR = 2  # COCO number of cars
MAX_CAR_HEIGHT_M = 2.3
MAX_VEHICLE_HEIGHT_M = 4.2  # of any other vehicle
# Smallest number and smallest share of a box's features that must agree on a displacement.
MIN_BOX_FEATURES = 3
MIN_MOVED_SHARE = 0.3
# Assumed standard deviations of the camera's motion, on the safe side: its median errors are 1 mm and 0.003°
# in drawn streets, 4 mm and 0.006° on the drawn highway.
STEP_DEVIATION_M = 0.01
TURN_DEVIATION_RAD = np.radians(0.01)


@dataclass(frozen=True, eq=False)
class PointSteps(Rows):
    """Displacements of N features against the background between two frames.

    Attributes
    ----------
    step : (N, 3) displacement in the current left camera's axes, metres.
    information : (N, 3, 3) inverse covariance of the step for matches with a variance of 1 px², so in
        px²/m².
    depth : (N,) depth of the predicted static feature, metres.
    """

    step: Array
    information: Array
    depth: Array

    def squared_error(self, step: Array) -> Array:
        """Squared errors (N,), pixels², of one displacement (3,) or of a displacement per feature (N, 3)."""
        e = self.step - step
        return np.asarray(np.einsum("ni,nij,nj->n", e, self.information, e))


def background_motion(camera: StereoCamera, matches: StereoMatches, start: Array, iterations: int) -> Array:
    """Motion T_cp (4, 4) of the camera from features that are mostly static, fitted from T_cp `start`."""
    selected = select_by_bucket(matches.cur_left, matches.age, matches.strength, BACKGROUND_BUCKETS)
    sample = matches[selected]
    sample = sample[sample.prev_left[:, 0] > sample.prev_right[:, 0]]
    return fit_motion(camera, sample, start, BACKGROUND_SCALE_PX, iterations).T_cp


def point_steps(camera: StereoCamera, matches: StereoMatches, T_cp: Array) -> PointSteps:
    """Displacement of each feature: its position minus the position that a static feature would have.

    Both points are triangulated from u_left, v and u_right. The displacement of a far feature is therefore
    precise across the line of sight and uncertain along this line, as the information matrix expresses.
    """
    R_cp = T_cp[:3, :3]
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    X_c = camera.triangulate(matches.cur_left, matches.cur_right)
    static = X_p @ R_cp.T + T_cp[:3, 3]
    spread_c = _point_covariance(camera, X_c)
    spread_p = R_cp @ _point_covariance(camera, X_p) @ R_cp.T
    return PointSteps(X_c - static, np.asarray(np.linalg.inv(spread_p + spread_c)), static[:, 2])


def _point_covariance(camera: StereoCamera, X: Array) -> Array:
    """Covariance (N, 3, 3), metres², of triangulated points for a variance of 1 px² in u_left, v and u_right.

    With d = u_left - u_right: Z = f b / d, X = (u_left - cx) Z / f, Y = (v - cy) Z / f.
    """
    z = X[:, 2]
    per_pixel = z / camera.f
    depth_per_disparity = -z * z / (camera.f * camera.baseline)  # dZ / dd
    # Derivatives of X, Y, Z with respect to u_left, v and u_right: a change of d moves X along the ray.
    J = np.zeros((len(X), 3, 3))
    J[:, :, 0] = (depth_per_disparity / z)[:, None] * X
    J[:, :, 2] = -J[:, :, 0]
    J[:, 0, 0] += per_pixel
    J[:, 1, 1] = per_pixel
    return J @ np.swapaxes(J, 1, 2)


def owner_of(camera: StereoCamera, left: Array, right: Array, boxes: Boxes) -> IntArray:
    """Index (N,) of the box of each feature with pixels (N, 2): the nearest possible box, or -1 for none.

    The nearest box has the lowest bottom edge. A feature inside a box is on the background if a vehicle that
    fills the box at the feature's depth would be taller than any vehicle of its class.
    """
    if len(boxes) == 0:
        return np.full(len(left), -1)
    height = np.where(boxes.class_id == CAR, MAX_CAR_HEIGHT_M, MAX_VEHICLE_HEIGHT_M)
    # A vehicle that is at most this tall and fills the box is at most f height / (bottom - top) away, so its
    # disparity f b / Z is at least:
    min_disparity = camera.baseline * (boxes.xyxy[:, 3] - boxes.xyxy[:, 1]) / height
    possible = inside(left, boxes.xyxy) & (left[:, :1] - right[:, :1] >= min_disparity)
    bottom = np.where(possible, boxes.xyxy[:, 3], -np.inf)
    return np.where(possible.any(axis=1), np.argmax(bottom, axis=1), -1)


@dataclass(frozen=True, eq=False)
class BoxSteps(Rows):
    """Displacements of the vehicles in K boxes between two frames.

    Attributes
    ----------
    step : (K, 3) displacement against the background in the current left camera's axes, metres.
    information : (K, 3, 3) inverse covariance of `step`, 1/m²; zero without a measurement.
    matches : (K,) number of features that may be on the vehicle.
    """

    step: Array
    information: Array
    matches: IntArray


def no_steps(number: int) -> BoxSteps:
    """Steps of boxes without a measurement."""
    return BoxSteps(np.zeros((number, 3)), np.zeros((number, 3, 3)), np.zeros(number, np.int64))


def box_steps(
    points: PointSteps, owner: IntArray, number: int, variance: float, moving_mean: bool = True
) -> BoxSteps:
    """The displacement of each of K = `number` boxes from its features.

    The features in a box are on the vehicle, on the background or on outlines. Two robust means of all
    features of the box, with Cauchy weights, compete. They differ in where they start: the first at the
    background, the second at the features that have moved, which means that they clearly disagree with the
    background (`AGREES_CHI2`). The second mean wins if enough of the moved features agree with it.

    Parameters
    ----------
    owner : (N,) box of each of the N points, or -1.
    variance : variance of a matched position, pixels².
    moving_mean : whether the second of the two means takes part in the competition.
    """
    static_error = points.squared_error(np.zeros(3)) / variance
    owned = (owner >= 0) & np.isfinite(static_error)
    points = points[owned]
    owner = owner[owned]
    static_error = static_error[owned]
    member = (owner == np.arange(number)[:, None]).astype(np.float64)  # (K, N)
    total = member.sum(axis=1)
    moved = static_error > AGREES_CHI2
    # (2, N): the means start with the weights of static features, and with the moved features alone.
    start = np.stack([1.0 / (1.0 + static_error / AGREES_CHI2), moved.astype(np.float64)])
    means, information, errors = _robust_means(points, owner, member, variance, start)
    agreeing = member @ (moved & (errors[1] < AGREES_CHI2))
    second_wins = agreeing >= np.maximum(MIN_BOX_FEATURES, MIN_MOVED_SHARE * total)
    if not moving_mean:
        second_wins[:] = False
    step = np.where(second_wins[:, None], means[1], means[0])
    information = np.where(second_wins[:, None, None], information[1], information[0])
    depth = member @ points.depth / np.maximum(total, 1.0)
    # More features in the box do not reduce the uncertainty of the camera's motion.
    shared = STEP_DEVIATION_M**2 + (TURN_DEVIATION_RAD * depth) ** 2
    covariance = np.linalg.inv(information + MIN_INFORMATION * np.eye(3))
    covariance += shared[:, None, None] * np.eye(3)
    enough = (total >= MIN_BOX_FEATURES)[:, None, None]
    return BoxSteps(step, np.where(enough, np.linalg.inv(covariance), 0.0), total.astype(np.int64))


def _robust_means(
    points: PointSteps, owner: IntArray, member: Array, variance: float, weight: Array
) -> tuple[Array, Array, Array]:
    """Two robust means of the steps of N points in each of K boxes, from two sets of weights at the start.

    Parameters
    ----------
    owner : (N,) box of each point; member : (K, N) 1 for the points of a box, or else 0.
    variance : variance of a matched position, pixels². weight : (2, N) at the start.

    Returns
    -------
    Means (2, K, 3), metres; their information (2, K, 3, 3), 1/m²; squared error (2, N) of each point for the
    mean of its box, in variances.
    """
    # Of each point, nine numbers of its information, and three of the information times its step.
    flat_information = points.information.reshape(len(owner), 9) / variance
    vector = np.einsum("nij,nj->ni", points.information, points.step) / variance
    parts = np.concatenate([flat_information, vector], axis=1)
    for _ in range(STEP_ITERATIONS):
        sums = member @ (weight[:, :, None] * parts)  # (2, K, 12)
        information = sums[:, :, :9].reshape(2, len(member), 3, 3)
        sums_of_vectors = sums[:, :, 9:, None]
        means = np.linalg.solve(information + MIN_INFORMATION * np.eye(3), sums_of_vectors)[:, :, :, 0]
        off = points.step - means[:, owner]
        errors = np.einsum("sni,nij,snj->sn", off, points.information, off) / variance
        weight = 1.0 / (1.0 + errors / AGREES_CHI2)
    return means, information, errors
