"""The pose graph: least squares over measured motions between poses, by Gauss-Newton.

An edge from pose i to pose j measures the pose Z of j in i. The residual is the twist of Z⁻¹ T_i⁻¹ T_j
(Grisetti et al., "A tutorial on graph-based SLAM", 2010). Loops may be false, so they have Cauchy weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.motion import inverse
from ..geometry.rows import Rows
from ..geometry.twist import adjoint, bracket, motion_from_twist, twist_from_motion
from ..geometry.types import Array, BoolArray, IntArray
from .find import Loops
from .places import place_frames
from .settings import LoopConfig

MAX_STEPS = 40
MAX_TURN = 0.2  # largest rotation of a pose in a step, radians; with false loops, longer steps diverge
LAST_MOVE = 1e-4  # largest move of a pose in the last step, radians and metres
NARROWING = 0.25  # factor between the scales of the weights in successive steps
SERIES = ((1, 0.5), (2, 1 / 12), (4, -1 / 720), (6, 1 / 30240))  # powers, factors of x / (1 - exp(-x)) - 1


@dataclass(frozen=True, eq=False)
class Edges(Rows):
    """N measured motions between poses.

    first, second : (N,) numbers of the poses.
    motion : (N, 4, 4) pose of the second camera relative to the first.
    sigma : (N, 2) standard deviations of the rotation, radians, and of the translation, metres.
    is_loop : (N,) mask of the edges with a robust weight.
    """

    first: IntArray
    second: IntArray
    motion: Array
    sigma: Array
    is_loop: BoolArray


def linearised(poses: Array, edges: Edges) -> tuple[Array, Array, Array]:
    """Residuals (N, 6) of edges in standard deviations, and derivatives (N, 6, 6) by first and second twist.

    The twist δ of a pose changes the pose in the camera's frame: T_w_c exp(δ).
    """
    between = inverse(poses[edges.first]) @ poses[edges.second]
    r = twist_from_motion(inverse(edges.motion) @ between)
    to_second = np.eye(6) + sum(c * np.linalg.matrix_power(bracket(r), power) for power, c in SERIES)
    sigma = np.repeat(edges.sigma, 3, axis=1)
    to_first = -to_second @ adjoint(inverse(between))
    return r / sigma, to_first / sigma[:, :, None], to_second / sigma[:, :, None]


def optimise(poses: Array, edges: Edges, scale: float, tolerance: float = LAST_MOVE) -> tuple[Array, ...]:
    """Optimise poses T_w_c (N, 4, 4) by Gauss-Newton; the first pose is fixed.

    scale : residual at which a loop has weight ½, in standard deviations; if infinite, all weights are 1.
        The first steps have a larger scale: before the drift is corrected, true loops have large residuals.
    tolerance : largest move of a pose in the last step, radians and metres.

    Returns the poses and, for each edge (M,), the residual in standard deviations and the weight in [0, 1].
    """
    poses, moved, count, ends = poses.copy(), np.inf, len(poses), (edges.first, edges.second)
    for step in range(MAX_STEPS + 1):
        r, *sides = linearised(poses, edges)
        size = np.linalg.norm(r, axis=1)
        current = max(scale, NARROWING**step * float(size[edges.is_loop].max(initial=0.0)))
        weight = np.where(edges.is_loop, 1.0 / (1.0 + (size / current) ** 2), 1.0)
        if step == MAX_STEPS or (current == scale and moved < tolerance):
            break
        H, g = np.zeros((count, count, 6, 6)), np.zeros((count, 6))
        for i, J_i in zip(ends, sides, strict=True):
            weighted = weight[:, None, None] * np.swapaxes(J_i, 1, 2)
            np.add.at(g, i, (weighted @ r[:, :, None])[..., 0])
            for j, J_j in zip(ends, sides, strict=True):
                np.add.at(H, (i, j), weighted @ J_j)
        free = H[1:, 1:].transpose(0, 2, 1, 3).reshape(6 * count - 6, 6 * count - 6)
        delta = np.asarray(np.linalg.solve(free, -g[1:].ravel()), np.float64).reshape(-1, 6)
        poses[1:] = poses[1:] @ motion_from_twist(delta / max(1.0, np.abs(delta[:, :3]).max() / MAX_TURN))
        moved = float(np.abs(delta).max())
    return poses, size, weight


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """A path with closed loops.

    poses : (N, 4, 4) T_w_c of all frames, the first unchanged.
    loops : the M closed loops.
    weight : (M,) weight of each loop in the pose graph, from 0 to 1.
    gap : (M,) metres between the second visit's position in `poses` and its position by the loop's motion.
    """

    poses: Array
    loops: Loops
    weight: Array
    gap: Array


def close_path(poses: Array, loops: Loops, config: LoopConfig) -> LoopClosure:
    """The path (N, 4, 4) of a run after all `loops` have been closed; without loops, the unchanged path."""
    frames = place_frames(len(poses), config)
    if len(loops) == 0:
        return LoopClosure(poses.copy(), loops, np.zeros(0), np.zeros(0))
    edges = graph_edges(poses[frames], frames, loops, config)
    moved_places, _, weight = optimise(poses[frames], edges, config.scale)
    moved = interpolate_corrections(poses, frames, moved_places)
    between = inverse(moved[loops.first]) @ moved[loops.second]
    gap = np.linalg.norm((inverse(loops.motion) @ between)[:, :3, 3], axis=1)
    return LoopClosure(moved, loops, weight[edges.is_loop], gap)


def interpolate_corrections(poses: Array, frames: IntArray, moved: Array) -> Array:
    """Poses (N, 4, 4) of all frames after the poses of `frames` (K,) have changed to `moved` (K, 4, 4).

    The first of `frames` is 0. Between successive `frames`, the change is distributed evenly, as a twist.
    """
    correction = moved @ inverse(poses[frames])
    position = np.interp(np.arange(len(poses)), frames, np.arange(len(frames)))
    before, after = np.floor(position).astype(np.int64), np.ceil(position).astype(np.int64)
    change = twist_from_motion(inverse(correction[before]) @ correction[after])
    return np.asarray(correction[before] @ motion_from_twist((position - before)[:, None] * change) @ poses)


def graph_edges(places: Array, frames: IntArray, loops: Loops, config: LoopConfig) -> Edges:
    """Edges between successive places (poses (N, 4, 4), frames (N,)), followed by the edges of the loops."""
    number, size = np.arange(len(frames) - 1), np.diff(frames)
    # Errors of frames add up as in a random walk. The default ratio, 0.3 m per degree, is from drawn streets.
    steps = np.sqrt(size)[:, None] * [np.radians(config.frame_turn), config.frame_step]
    return Edges(
        np.concatenate([number, np.searchsorted(frames, loops.first)]),
        np.concatenate([number + 1, np.searchsorted(frames, loops.second)]),
        np.concatenate([inverse(places[:-1]) @ places[1:], loops.motion]),
        np.concatenate([steps, np.tile([np.radians(config.loop_turn), config.loop_step], (len(loops), 1))]),
        np.repeat([False, True], [len(number), len(loops)]),
    )
