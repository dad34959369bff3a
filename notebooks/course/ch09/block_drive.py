"""Chapter 9: the drive round a block, and its true and false loops."""

from __future__ import annotations

import numpy as np

from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import Sequence, open_folder
from vo_lib.evaluation.ate_rpe import Alignment, absolute_error, rmse
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.twist import motion_from_twist
from vo_lib.geometry.types import Array, BoolArray, IntArray, Progress
from vo_lib.loops.find import PlacePairs
from vo_lib.loops.places import place_frames
from vo_lib.loops.settings import LoopConfig

SMALL = {"width": 620, "height": 188}  # half of KITTI's image in each direction
CONFIG = LoopConfig(inliers=30)  # a small image has fewer matches
TRUE_GAP_M = 1.0  # largest distance between the translation of a true loop and that of the true motion


def block(progress: Progress | None = None) -> Sequence:
    """The drawn scene `block` with small images; a missing scene is drawn."""
    return open_folder(ensure_scene(scene_config("block", **SMALL), progress=progress), "block")


def ate(truth: Array, poses: Array) -> float:
    """Root mean square distance between two paths after alignment by rotation and translation, metres."""
    return rmse(absolute_error(truth, poses, Alignment.SE3).distance) or 0.0


def is_true(loops: PlacePairs, truth: Array) -> BoolArray:
    """Mask (N,) of the loops whose translation is within `TRUE_GAP_M` of the true one; rotations are not compared."""
    motion = inverse(truth[loops.first_frame]) @ truth[loops.second_frame]
    return np.asarray(np.linalg.norm((inverse(motion) @ loops.motion)[:, :3, 3], axis=1) < TRUE_GAP_M)


def second_visits(truth: Array, frames: IntArray, gap: int, near: float = 3.0) -> IntArray:
    """Pairs (M, 2) of frames: the first and the second visit of a place, in the same direction.

    Parameters
    ----------
    truth : (N, 4, 4) poses. frames : (P,) frames of the places.
    gap : fewest frames between the visits. near : largest distance of the places, metres.
    """
    place = truth[frames, :3, 3]
    forward = truth[frames, :3, 2]
    distance = np.linalg.norm(place[:, None] - place, axis=2)
    other_direction = forward @ forward.T < 0.9
    not_earlier = frames[:, None] - frames < gap
    distance[other_direction | not_earlier] = np.inf
    second = np.flatnonzero(distance.min(axis=1) < near)
    first = distance[second].argmin(axis=1)
    return np.stack([frames[first], frames[second]], axis=1)


def made_up_loops(truth: Array, pairs: IntArray, config: LoopConfig, false: int, seed: int) -> PlacePairs:
    """Loops with the true motion between pairs (M, 2) of frames, then false loops; every motion has noise."""
    rng = np.random.default_rng([9, seed])
    frames = place_frames(len(truth), config)
    place = truth[frames, :3, 3]
    is_far = np.linalg.norm(place[:, None] - place, axis=2) > 10.0  # metres
    far_pairs = np.argwhere(np.triu(is_far))
    wrong = frames[rng.choice(far_pairs, false if len(far_pairs) else 0)]
    sigma = np.repeat([np.radians(config.loop_turn), config.loop_step], 3)
    first, second = np.concatenate([pairs, wrong]).T
    motion = inverse(truth[first]) @ truth[second]
    motion[len(pairs) :] = np.eye(4)  # "this is the same place"
    motion = motion @ motion_from_twist(rng.normal(size=(len(motion), 6)) * sigma)
    count = len(first)
    return PlacePairs(
        first_frame=first,
        second_frame=second,
        similarity=np.ones(count),
        matches=np.full(count, 100),
        inliers=np.full(count, 100),
        residual=np.zeros(count),
        motion=motion,
    )
