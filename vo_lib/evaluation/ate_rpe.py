"""Absolute (ATE) and relative (RPE) trajectory error, and the alignment of trajectories.

Definitions: Sturm et al., IROS 2012. All poses are `T_w_c`, (N, 4, 4), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from ..errors import DataError
from ..geometry.motion import quaternion_from_rotation, rotation_angle, rotation_from_quaternion
from ..geometry.types import Array, Index

DISPLACEMENTS = 20  # number of parts of a path over which displacements are compared
MAX_DISAGREEMENT = 0.25  # of displacements as seen from the poses, relative: 14° between the axes
DISAGREEMENT_RATIO = 4.0  # to the disagreement as seen from the world, or in the other order of quaternions
MIN_ROTATION_ERROR = np.radians(0.1)  # mean over the parts; on a straight path every order agrees
# Places of x, y, z, w in a quaternion whose numbers were read as if w came last, and as if it came first.
OTHER_ORDERS = [1, 2, 3, 0], [3, 0, 1, 2]


class Alignment(Enum):
    """Transformation of the estimate before the comparison of positions."""

    NONE = "none"
    ORIGIN = "origin"  # equal first poses
    SE3 = "se3"  # best rotation and translation
    SIM3 = "sim3"  # best rotation, translation and scale

    @property
    def words(self) -> str:
        """Text for the note of a table."""
        return "without alignment" if self is Alignment.NONE else f"with {self.name} alignment"


@dataclass(frozen=True, eq=False)
class AbsoluteError:
    """ATE: distances (N,), metres, between true and estimated positions after the `alignment`."""

    alignment: Alignment
    scale: float
    distance: Array

    def to_dict(self) -> dict[str, Any]:
        """Alignment, scale applied to the estimate, and statistics, for JSON."""
        return {"alignment": self.alignment.value, "scale": self.scale} | _in("m", self.distance)


class Delta(NamedTuple):
    """Interval of the relative error, in frames or in metres along the true path."""

    size: float = 1
    unit: str = "frames"

    @property
    def words(self) -> str:
        """Text for the note of a table."""
        return "from frame to frame" if self == Delta() else f"over {self.size:g} {self.unit}"


@dataclass(frozen=True, eq=False)
class RelativeError:
    """RPE over intervals `delta`: translation errors (M,), metres, and rotation errors (M,), radians."""

    delta: Delta
    translation: Array
    rotation: Array

    def to_dict(self) -> dict[str, Any]:
        """Interval and statistics, for JSON; None if the trajectory is shorter than delta."""
        return {
            f"delta_{self.delta.unit}": self.delta.size,
            "translation": _in("m", self.translation),
            "rotation": _in("deg", np.degrees(self.rotation)),
        }


def rmse(errors: Array) -> float | None:
    """Root of the mean square; None without errors."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else None


def motion_error(truth: Array, estimate: Array, first: Index, last: Index) -> Array:
    """Error motions inverse(Δest) Δgt, (S, 4, 4), with Δ = inverse(T[first]) T[last]."""
    # A general inverse: rotations in files are orthonormal only to 1e-7, so the transpose would cause
    # rotation errors of up to 0.05°.
    true_motion = np.linalg.inv(truth[first]) @ truth[last]
    estimated_motion = np.linalg.inv(estimate[first]) @ estimate[last]
    return np.asarray(np.linalg.inv(estimated_motion) @ true_motion)


def align(truth: Array, estimate: Array, alignment: Alignment) -> tuple[Array, float]:
    """The estimate aligned with the truth.

    SE3 and SIM3 minimise the squared distances of positions (Umeyama 1991, equations 38-43). On a straight
    path the rotation about the path is undetermined: distances are minimal, but orientations are arbitrary.

    Returns
    -------
    (N, 4, 4) aligned poses, and the scale applied to the estimate's positions (1 except for SIM3).
    """
    check_pair(truth, estimate)
    if alignment is Alignment.NONE:
        return estimate, 1.0
    if alignment is Alignment.ORIGIN:
        return np.asarray(truth[0] @ np.linalg.inv(estimate[0]) @ estimate), 1.0
    # Umeyama's names: x is moved onto y.
    y = truth[:, :3, 3]
    x = estimate[:, :3, 3]
    y_mean = y.mean(axis=0)
    x_mean = x.mean(axis=0)
    U, D, Vt = np.linalg.svd((y - y_mean).T @ (x - x_mean) / len(x))
    S = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    R = (U * S) @ Vt
    spread = float(np.mean(np.sum((x - x_mean) ** 2, axis=1)))
    scale = float(D @ S) / spread if alignment is Alignment.SIM3 and spread > 0 else 1.0
    aligned = estimate.copy()
    aligned[:, :3, :3] = R @ estimate[:, :3, :3]
    aligned[:, :3, 3] = scale * (x - x_mean) @ R.T + y_mean
    return aligned, scale


def absolute_error(truth: Array, estimate: Array, alignment: Alignment = Alignment.SE3) -> AbsoluteError:
    """ATE: distances between positions after alignment."""
    aligned, scale = align(truth, estimate, alignment)
    return AbsoluteError(alignment, scale, np.linalg.norm(aligned[:, :3, 3] - truth[:, :3, 3], axis=1))


def relative_error(
    truth: Array,
    estimate: Array,
    delta: float = 1,
    path: Array | None = None,
    frames: Index | None = None,
) -> RelativeError:
    """RPE over the frames 0 to delta, delta to 2·delta, … (evo's default pairs), without an alignment.

    truth : (N, 4, 4). estimate : (M, 4, 4).
    path : (N,) metres from the first true pose to each pose; `delta` is then in metres. A pair ends at the
    first pose at least `delta` ahead, and the next pair starts at this pose (evo: `--pairs_from_reference`).
    frames : (M,) increasing numbers of the true poses to which the estimated poses belong; None: all. A pair
    is `delta` frames of the truth apart, and both of its frames have an estimate.
    """
    frames = frames_of_truth(truth, estimate, frames)
    if path is None:
        starts, ends = _pairs_by_frames(frames, int(delta))
    else:
        starts, ends = _pairs_by_length(path[frames], delta)
    error = motion_error(truth[frames], estimate, starts, ends)
    apart = Delta(delta, "frames" if path is None else "m")
    return RelativeError(apart, np.linalg.norm(error[:, :3, 3], axis=1), rotation_angle(error[:, :3, :3]))


def _pairs_by_frames(frames: Index, delta: int) -> tuple[Index, Index]:
    """Places in `frames` of pairs that are `delta` frames apart; a pair starts at the end of the previous."""
    ends = np.searchsorted(frames, frames + delta)
    starts = list[int]()
    place = 0
    while place < len(frames):
        end = int(ends[place])
        if end < len(frames) and frames[end] == frames[place] + delta:
            starts.append(place)
            place = end
        else:
            place += 1
    chosen = np.array(starts, np.intp)
    return chosen, ends[chosen]


def _pairs_by_length(path: Array, delta: float) -> tuple[Index, Index]:
    """Places of pairs at least `delta` apart along a path (M,), metres; a pair starts where another ends."""
    chain = list[int]()
    end = 0
    while end < len(path):
        chain.append(end)
        end = int(np.searchsorted(path, path[end] + delta))
    places = np.array(chain, np.intp)
    return places[:-1], places[1:]


def orientations_disagree(truth: Array, estimate: Array) -> bool:
    """Whether two paths (N, 4, 4) have the same positions, but orientations of another convention.

    Such orientations are those of another sensor, or quaternions in another order: TE and RE are then large
    although the ATE is small. A displacement, seen from the world and seen from the pose before it, differs
    between the paths by the drift of an odometry in both cases; here, it differs only as seen from the pose.
    """
    parts = _parts(truth)
    if parts is None:
        return False
    first, last = parts
    moved = truth[last, :3, 3] - truth[first, :3, 3]
    aligned, scale = align(truth, estimate, Alignment.SIM3)
    by_world = aligned[last, :3, 3] - aligned[first, :3, 3] - moved
    from_pose = _displacement_error(truth, estimate, scale, first, last)
    from_world = float(np.median(np.linalg.norm(by_world, axis=1) / np.linalg.norm(moved, axis=1)))
    return from_pose > MAX_DISAGREEMENT and from_pose > DISAGREEMENT_RATIO * from_world


def quaternions_disagree(truth: Array, estimate: Array) -> bool:
    """Whether two paths (N, 4, 4) agree far better with the quaternions of one of them in the other order.

    One of the files then has qw first where its header or its format has it last, or the reverse. The
    rotations in the parts of the path decide: another order keeps their angles, but changes their axes. On a
    path with gentle bends, displacements as seen from the poses may still agree.
    """
    parts = _parts(truth)
    if parts is None:
        return False
    _, scale = align(truth, estimate, Alignment.SIM3)
    first, last = parts
    error = _rotation_error(truth, estimate, first, last)
    if error < MIN_ROTATION_ERROR:
        return False
    ends = np.union1d(first, last)
    for order in OTHER_ORDERS:
        for of_truth in (False, True):
            true_poses = _reordered(truth, order, ends) if of_truth else truth
            poses = estimate if of_truth else _reordered(estimate, order, ends)
            if (
                error > DISAGREEMENT_RATIO * _rotation_error(true_poses, poses, first, last)
                and _displacement_error(true_poses, poses, scale, first, last) < MAX_DISAGREEMENT
            ):
                return True
    return False


def inverses_agree(truth: Array, estimate: Array) -> bool:
    """Whether two paths (N, 4, 4) agree far better if the poses of one of them are inverted.

    Then that one has poses from the world to the camera. On a straight path, poses of a camera of which the
    z axis points backwards are no different.
    """
    return _inverse_agrees(truth, estimate) or _inverse_agrees(estimate, truth)


def _inverse_agrees(truth: Array, estimate: Array) -> bool:
    """Whether the inverses of the poses of `estimate` agree far better with the truth; both (N, 4, 4)."""
    parts = _parts(truth)
    if parts is None:
        return False
    errors = []
    for poses in (estimate, np.asarray(np.linalg.inv(estimate), np.float64)):
        _, scale = align(truth, poses, Alignment.SIM3)
        errors.append(_displacement_error(truth, poses, scale, *parts))
    as_it_is, inverted = errors
    return as_it_is > max(MAX_DISAGREEMENT, DISAGREEMENT_RATIO * inverted) and inverted < MAX_DISAGREEMENT


def mirrored_axis(truth: Array, estimate: Array) -> str:
    """The axis, "x", "y" or "z", of which the sign is reversed in one of two paths (N, 4, 4); "" for none.

    Axes with one reversed sign are left-handed, as those of game engines. Both the rotations and the
    displacements then agree far better with the sign of the other path.
    """
    parts = _parts(truth)
    if parts is None:
        return ""
    _, scale = align(truth, estimate, Alignment.SIM3)
    rotation = _rotation_error(truth, estimate, *parts)
    displacement = _displacement_error(truth, estimate, scale, *parts)
    if rotation < MIN_ROTATION_ERROR:
        return ""
    for k, axis in enumerate("xyz"):
        signs = np.ones(4)
        signs[k] = -1.0
        mirrored = estimate * np.outer(signs, signs)
        _, scale = align(truth, mirrored, Alignment.SIM3)
        if rotation > DISAGREEMENT_RATIO * _rotation_error(
            truth, mirrored, *parts
        ) and displacement > DISAGREEMENT_RATIO * _displacement_error(truth, mirrored, scale, *parts):
            return axis
    return ""


def _parts(truth: Array) -> tuple[Index, Index] | None:
    """First and last poses of the parts of a true path (N, 4, 4); None without a path of several parts."""
    steps = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1)
    path = np.concatenate([np.zeros(1), np.cumsum(steps)])
    if not path[-1] > 0:
        return None
    first, last = _pairs_by_length(path, float(path[-1]) / DISPLACEMENTS)
    length = np.linalg.norm(truth[last, :3, 3] - truth[first, :3, 3], axis=1)
    return (first, last) if len(first) >= 2 and length.all() else None


def _displacement_error(truth: Array, estimate: Array, scale: float, first: Index, last: Index) -> float:
    """Median error, relative, of displacements as seen from the poses `first`."""
    true = _seen_from(truth, first, last)
    error = np.linalg.norm(_seen_from(estimate, first, last) * scale - true, axis=1)
    return float(np.median(error / np.linalg.norm(true, axis=1)))


def _rotation_error(truth: Array, estimate: Array, first: Index, last: Index) -> float:
    """Mean angle, radians, between the rotations of two paths from the poses `first` to the poses `last`."""
    return float(np.mean(rotation_angle(motion_error(truth, estimate, first, last)[:, :3, :3])))


def _reordered(poses: Array, order: list[int], chosen: Index) -> Array:
    """Poses (N, 4, 4), the `chosen` ones with the numbers of their quaternions in another order."""
    result = poses.copy()
    for k in chosen:
        result[k, :3, :3] = rotation_from_quaternion(quaternion_from_rotation(poses[k, :3, :3])[order])
    return result


def _seen_from(poses: Array, first: Index, last: Index) -> Array:
    """Displacements (S, 3) from the poses `first` to the poses `last`, in the axes of the poses `first`."""
    moved = poses[last, :3, 3] - poses[first, :3, 3]
    return np.asarray(np.einsum("sij,si->sj", poses[first, :3, :3], moved))


def _in(unit: str, errors: Array) -> dict[str, float | None]:
    """Root of the mean square, mean, median and maximum of errors (N,), for JSON; None without errors."""
    names = [f"{name}_{unit}" for name in ("rmse", "mean", "median", "max")]
    if not len(errors):
        return dict.fromkeys(names)
    values = [rmse(errors), float(np.mean(errors)), float(np.median(errors)), float(np.max(errors))]
    return dict(zip(names, values, strict=True))


def frames_of_truth(truth: Array, estimate: Array, frames: Index | None) -> Index:
    """Numbers (M,) of the true poses (N, 4, 4) to which the poses of an estimate (M, 4, 4) belong.

    `frames` : these numbers, or None if every true pose has an estimated pose. Raises `DataError` if the
    number of poses is wrong, or a pose is not finite.
    """
    if frames is None:
        check_pair(truth, estimate)
        return np.arange(len(truth))
    check_pair(truth[frames], estimate)
    return frames


def check_pair(truth: Array, estimate: Array, where: str = "") -> None:
    """Raise `DataError` unless both trajectories have the same number of poses, all finite."""
    if len(truth) != len(estimate) or len(truth) == 0:
        raise DataError(
            f"{where}truth has {len(truth)} poses and the estimate {len(estimate)}; "
            "both need one pose for every frame"
        )
    for name, poses in (("truth", truth), ("estimate", estimate)):
        bad = ~np.isfinite(poses).all(axis=(1, 2))
        if bad.any():
            raise DataError(f"{where}pose {int(np.argmax(bad))} of the {name} is not finite")
