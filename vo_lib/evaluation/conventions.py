"""Whether two paths differ by a convention of their files, and not only by errors.

A file of poses does not say all of its conventions. If the poses are read by another convention than the one
in which they were written, the errors are large though the odometry is good. Each case has a function:

- `orientations_disagree`: the positions agree, but not the orientations, such as those of another sensor;
- `quaternions_disagree`: the four numbers of the quaternions stand in another order;
- `inverses_agree`: the poses lead from the world to the camera;
- `mirrored_axis`: one axis points the other way.

Each cuts the true path into parts, and compares every part with the estimate by its rotation, or by its
displacement as seen from the pose at which it begins, or by both. `orientations_disagree` compares the
displacements in the axes of the world, too, and `inverses_agree` also does all this with the two paths
exchanged. Both paths are given as they were read, as poses `T_w_c`, (N, 4, 4), metres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.motion import quaternion_from_rotation, rotation_angle, rotation_from_quaternion
from ..geometry.types import Array, Index
from .ate_rpe import Alignment, align, motion_error, pairs_by_length
from .kitti_errors import trajectory_distances

PARTS = 20  # number of parts of a path
# A displacement agrees if its error is a smaller share of its length; axes 14° apart give this error.
MAX_DISAGREEMENT = 0.25
DISAGREEMENT_RATIO = 4.0  # an error is far larger than another from this ratio on
# Mean rotation error, below which there is nothing to explain: a straight path has no rotations, and so says
# nothing about the order of a quaternion or about an axis.
MIN_ROTATION_ERROR = np.radians(0.1)
# Places of the true x, y, z, w in a quaternion that was read in the wrong order: the file has w, x, y, z and
# was read as x, y, z, w; and the reverse.
OTHER_ORDERS = ([1, 2, 3, 0], [3, 0, 1, 2])


class Parts(NamedTuple):
    """Parts of a path: each goes from the pose `first` to the pose `last`, numbers (S,) of poses."""

    first: Index
    last: Index


def orientations_disagree(truth: Array, estimate: Array) -> bool:
    """Whether two paths (N, 4, 4) have the same positions, but orientations of another convention.

    Such orientations are those of another sensor, or quaternions in another order. TE and RE are then large,
    although the ATE is small. Drift makes the displacement of a part wrong both in the axes of the world and
    in those of the part's first pose; other orientations make it wrong only in the latter.
    """
    parts = _parts(truth)
    if parts is None:
        return False
    aligned, _ = align(truth, estimate, Alignment.SIM3)
    true_displacement = truth[parts.last, :3, 3] - truth[parts.first, :3, 3]
    displacement = aligned[parts.last, :3, 3] - aligned[parts.first, :3, 3]
    error = np.linalg.norm(displacement - true_displacement, axis=1)
    in_world = float(np.median(error / np.linalg.norm(true_displacement, axis=1)))
    from_pose = _displacement_error(truth, estimate, parts)
    return from_pose > MAX_DISAGREEMENT and from_pose > DISAGREEMENT_RATIO * in_world


def quaternions_disagree(truth: Array, estimate: Array) -> bool:
    """Whether two paths (N, 4, 4) agree far better with the quaternions of one of them in the other order.

    One of the files then has qw first where its header or its format has it last, or the reverse. The
    rotations of the parts decide: another order keeps their angles, but changes their axes. (On a path with
    gentle bends, the displacements may agree in either order.)
    """
    parts = _parts(truth)
    if parts is None:
        return False
    error = _rotation_error(truth, estimate, parts)
    if error < MIN_ROTATION_ERROR:
        return False
    for order in OTHER_ORDERS:
        for true_poses, poses in (
            (truth, _reordered(estimate, order, parts)),
            (_reordered(truth, order, parts), estimate),
        ):
            rotation_agrees = error > DISAGREEMENT_RATIO * _rotation_error(true_poses, poses, parts)
            if rotation_agrees and _displacement_error(true_poses, poses, parts) < MAX_DISAGREEMENT:
                return True
    return False


def inverses_agree(truth: Array, estimate: Array) -> bool:
    """Whether two paths (N, 4, 4) agree far better if the poses of one of them are inverted.

    Then that one has poses from the world to the camera. On a straight path, inverted poses look like those
    of a camera whose z axis points backwards, so the result is then true for such a camera, too.
    """
    return _inverse_agrees(truth, estimate) or _inverse_agrees(estimate, truth)


def _inverse_agrees(truth: Array, estimate: Array) -> bool:
    """Whether the inverses of the poses of `estimate` agree far better with the truth; both (N, 4, 4)."""
    parts = _parts(truth)
    if parts is None:
        return False
    as_given = _displacement_error(truth, estimate, parts)
    inverted = _displacement_error(truth, np.asarray(np.linalg.inv(estimate)), parts)
    is_far_better = as_given > max(MAX_DISAGREEMENT, DISAGREEMENT_RATIO * inverted)
    return is_far_better and inverted < MAX_DISAGREEMENT


def mirrored_axis(truth: Array, estimate: Array) -> str:
    """The axis, "x", "y" or "z", of which the sign is reversed in one of two paths (N, 4, 4); "" for none.

    Axes with one reversed sign are left-handed, as those of game engines. If the sign is reversed back, both
    the rotations and the displacements agree far better.
    """
    parts = _parts(truth)
    if parts is None:
        return ""
    rotation = _rotation_error(truth, estimate, parts)
    if rotation < MIN_ROTATION_ERROR:
        return ""
    displacement = _displacement_error(truth, estimate, parts)
    # To mirror the truth in its place would give the same errors, so the result holds for either path.
    for k, axis in enumerate("xyz"):
        signs = np.ones(4)
        signs[k] = -1.0
        mirrored = estimate * np.outer(signs, signs)  # S T S, with the diagonal matrix S of the signs
        mirrored_rotation = _rotation_error(truth, mirrored, parts)
        mirrored_displacement = _displacement_error(truth, mirrored, parts)
        if (
            rotation > DISAGREEMENT_RATIO * mirrored_rotation
            and displacement > DISAGREEMENT_RATIO * mirrored_displacement
        ):
            return axis
    return ""


def _parts(truth: Array) -> Parts | None:
    """About `PARTS` parts of equal length of a true path (N, 4, 4).

    None if the path does not have two parts, or if a part ends at the position where it begins.
    """
    path = trajectory_distances(truth)
    if not path[-1] > 0:
        return None
    first, last = pairs_by_length(path, float(path[-1]) / PARTS)
    displacement = np.linalg.norm(truth[last, :3, 3] - truth[first, :3, 3], axis=1)
    if len(first) < 2 or not displacement.all():
        return None
    return Parts(first, last)


def _displacement_error(truth: Array, estimate: Array, parts: Parts) -> float:
    """Median error of the parts' displacements, as seen from their first poses, relative to their lengths.

    The estimate is first brought to the scale of the truth.
    """
    _, scale = align(truth, estimate, Alignment.SIM3)
    true_displacement = _seen_from_first(truth, parts)
    error = np.linalg.norm(_seen_from_first(estimate, parts) * scale - true_displacement, axis=1)
    return float(np.median(error / np.linalg.norm(true_displacement, axis=1)))


def _seen_from_first(poses: Array, parts: Parts) -> Array:
    """Displacements (S, 3) of the parts, in the axes of their first poses."""
    displacement = poses[parts.last, :3, 3] - poses[parts.first, :3, 3]
    return np.asarray(np.einsum("sij,si->sj", poses[parts.first, :3, :3], displacement))


def _rotation_error(truth: Array, estimate: Array, parts: Parts) -> float:
    """Mean angle, radians, between the rotations of two paths over the parts."""
    error = motion_error(truth, estimate, parts.first, parts.last)
    return float(np.mean(rotation_angle(error[:, :3, :3])))


def _reordered(poses: Array, order: list[int], parts: Parts) -> Array:
    """Poses (N, 4, 4) with the numbers of the quaternions in another order, at the ends of the parts."""
    result = poses.copy()
    for k in np.union1d(parts.first, parts.last):
        quaternion = quaternion_from_rotation(poses[k, :3, :3])
        result[k, :3, :3] = rotation_from_quaternion(quaternion[order])
    return result
