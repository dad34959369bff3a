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
from .find import PlacePairs
from .places import place_frames
from .settings import LoopConfig

MAX_STEPS = 40  # of Gauss-Newton
# Largest component of a pose's rotation vector in a step, radians. A longer step is shortened: with false
# loops, the poses would diverge.
MAX_TURN = 0.2
LAST_MOVE = 1e-4  # largest component of a pose's twist in the last step, radians and metres
# In step k, counted from 0, the scale of the weights is at least this to the power k, times the largest
# residual of a loop at that time.
NARROWING = 0.25
# The derivative of log(exp(r) exp(δ)) by δ is x / (1 - exp(-x)), where x is the bracket of the twist r. Its
# series is 1 + x/2 + x²/12 - x⁴/720 + x⁶/30240 - …: these are the powers and factors behind the 1.
SERIES = ((1, 0.5), (2, 1 / 12), (4, -1 / 720), (6, 1 / 30240))


@dataclass(frozen=True, eq=False)
class Edges(Rows):
    """M measured motions between poses.

    Attributes
    ----------
    first_place, second_place : (M,) indices of the poses.
    motion : (M, 4, 4) pose of the second camera relative to the first.
    sigma : (M, 2) standard deviations of the rotation, radians, and of the translation, metres.
    is_loop : (M,) mask of the edges with a robust weight.
    """

    first_place: IntArray
    second_place: IntArray
    motion: Array
    sigma: Array
    is_loop: BoolArray


def linearised(poses: Array, edges: Edges) -> tuple[Array, Array, Array]:
    """Residuals (M, 6) of edges in standard deviations, and derivatives (M, 6, 6) by first and second twist.

    The twist δ of a pose changes the pose in the camera's frame: T_w_c exp(δ). With B = T_i⁻¹ T_j, the twist
    of pose j makes B exp(δ) of it, and that of pose i makes exp(-δ) B = B exp(-adjoint(B⁻¹) δ).

    poses : (N, 4, 4) T_w_c.
    """
    between = inverse(poses[edges.first_place]) @ poses[edges.second_place]
    r = twist_from_motion(inverse(edges.motion) @ between)
    x = bracket(r)
    by_second = np.eye(6) + sum(factor * np.linalg.matrix_power(x, power) for power, factor in SERIES)
    by_first = -by_second @ adjoint(inverse(between))
    sigma = np.repeat(edges.sigma, 3, axis=1)
    return r / sigma, by_first / sigma[:, :, None], by_second / sigma[:, :, None]


def optimise(
    poses: Array, edges: Edges, scale: float, tolerance: float = LAST_MOVE
) -> tuple[Array, Array, Array]:
    """Optimise poses T_w_c (N, 4, 4) by Gauss-Newton; the first pose is fixed.

    scale : residual at which a loop has weight ½, in standard deviations; if infinite, all weights are 1.
        The first steps have a larger scale: before the drift is corrected, true loops have large residuals.
    tolerance : largest component of a pose's twist in the last step, radians and metres.

    Returns the poses (N, 4, 4), and of each edge the residual (M,) in standard deviations and the weight (M,)
    in [0, 1].
    """
    poses = poses.copy()
    largest_move = np.inf
    for step in range(MAX_STEPS + 1):
        r, by_first, by_second = linearised(poses, edges)
        residual = np.linalg.norm(r, axis=1)
        largest_of_loops = float(residual[edges.is_loop].max(initial=0.0))
        current_scale = max(scale, NARROWING**step * largest_of_loops)
        weight = np.where(edges.is_loop, 1.0 / (1.0 + (residual / current_scale) ** 2), 1.0)
        is_final_scale = current_scale == scale
        converged = is_final_scale and largest_move < tolerance
        # The last round is without a step, so that residuals and weights are those of the final poses.
        if converged or step == MAX_STEPS:
            break
        delta = gauss_newton_step(len(poses), edges, r, by_first, by_second, weight)
        largest_turn = np.abs(delta[:, :3]).max()
        poses[1:] = poses[1:] @ motion_from_twist(delta / max(1.0, largest_turn / MAX_TURN))
        largest_move = float(np.abs(delta).max())
    return poses, residual, weight


def gauss_newton_step(
    count: int, edges: Edges, r: Array, by_first: Array, by_second: Array, weight: Array
) -> Array:
    """Twists (N - 1, 6) of all of N poses but the first: the solution of the weighted normal equations.

    r, by_first, by_second : from `linearised`; weight : (M,) weights of the edges.
    """
    H = np.zeros((count, count, 6, 6))
    g = np.zeros((count, 6))
    sides = ((edges.first_place, by_first), (edges.second_place, by_second))
    for i, J_i in sides:
        weighted = weight[:, None, None] * np.swapaxes(J_i, 1, 2)
        np.add.at(g, i, (weighted @ r[:, :, None])[..., 0])
        for j, J_j in sides:
            np.add.at(H, (i, j), weighted @ J_j)
    free = H[1:, 1:].transpose(0, 2, 1, 3).reshape(6 * count - 6, 6 * count - 6)
    return np.asarray(np.linalg.solve(free, -g[1:].ravel()), np.float64).reshape(-1, 6)


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """A path with closed loops.

    Attributes
    ----------
    poses : (N, 4, 4) T_w_c of all frames, the first unchanged.
    loops : the L closed loops.
    weight : (L,) weight of each loop in the pose graph, from 0 to 1.
    gap_m : (L,) metres between the second visit's position in `poses` and its position by the loop's motion.
    """

    poses: Array
    loops: PlacePairs
    weight: Array
    gap_m: Array


def close_path(poses: Array, loops: PlacePairs, config: LoopConfig) -> LoopClosure:
    """The path T_w_c (N, 4, 4) of a run after all `loops` have been closed; unchanged without loops.

    loops : the accepted pairs only, see `PlacePairs.accepted`. config : the one with which they were found.
    """
    frames = place_frames(len(poses), config)
    if len(loops) == 0:
        return LoopClosure(poses.copy(), loops, np.zeros(0), np.zeros(0))
    edges = graph_edges(poses[frames], frames, loops, config)
    moved_places, _, weight = optimise(poses[frames], edges, config.scale)
    moved = interpolate_corrections(poses, frames, moved_places)
    between = inverse(moved[loops.first_frame]) @ moved[loops.second_frame]
    error = inverse(loops.motion) @ between
    gap_m = np.linalg.norm(error[:, :3, 3], axis=1)
    return LoopClosure(moved, loops, weight[edges.is_loop], gap_m)


def interpolate_corrections(poses: Array, frames: IntArray, moved: Array) -> Array:
    """Poses (N, 4, 4) of all frames after the poses of `frames` (K,) have changed to `moved` (K, 4, 4).

    The first of `frames` is 0. Between successive `frames`, the change is distributed evenly, as a twist.
    Frames behind the last of them get its change.
    """
    correction = moved @ inverse(poses[frames])
    position = np.interp(np.arange(len(poses)), frames, np.arange(len(frames)))
    before = np.floor(position).astype(np.int64)
    after = np.ceil(position).astype(np.int64)
    change = twist_from_motion(inverse(correction[before]) @ correction[after])
    part_of_change = motion_from_twist((position - before)[:, None] * change)
    return np.asarray(correction[before] @ part_of_change @ poses)


def graph_edges(places: Array, frames: IntArray, loops: PlacePairs, config: LoopConfig) -> Edges:
    """Edges between successive places, followed by the edges of the loops.

    places : (N, 4, 4) poses T_w_c of the places. frames : (N,) their frames.
    """
    number = np.arange(len(frames) - 1)
    steps = inverse(places[:-1]) @ places[1:]
    # Errors of frames add up as in a random walk. The default ratio, 0.3 m per degree, is from drawn streets.
    frame_sigma = [np.radians(config.frame_turn), config.frame_step]
    step_sigma = np.sqrt(np.diff(frames))[:, None] * frame_sigma
    loop_sigma = np.tile([np.radians(config.loop_turn), config.loop_step], (len(loops), 1))
    return Edges(
        first_place=np.concatenate([number, np.searchsorted(frames, loops.first_frame)]),
        second_place=np.concatenate([number + 1, np.searchsorted(frames, loops.second_frame)]),
        motion=np.concatenate([steps, loops.motion]),
        sigma=np.concatenate([step_sigma, loop_sigma]),
        is_loop=np.repeat([False, True], [len(number), len(loops)]),
    )
