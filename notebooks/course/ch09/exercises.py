"""Exercises of chapter 9: nearest neighbours, the residual of an edge, gauge, a step, weights, the panel."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array, IntArray

from ..checker import Case, Condition, Exercise
from ..results import as_array, result_of


def nearest_earlier(S: Array, gap: int) -> IntArray:
    """For each place, the most similar place at least `gap` places earlier; -1 if there is none.

    S : similarity (N, N) of the places.
    """
    nearest = np.full(len(S), -1)
    for k in range(gap, len(S)):
        nearest[k] = S[k, : k - gap + 1].argmax()
    return nearest


def nearest_far_place(S: Array, gap: int) -> IntArray:
    """Wrong answer: the most similar place at least `gap` places earlier or later."""
    places = np.arange(len(S))
    away = np.abs(places[:, None] - places)
    return np.asarray(np.where(away >= gap, S, -1.0).argmax(axis=1))


def similar_places() -> list[Case]:
    """Cases with a similarity matrix (N, N) and a gap."""
    rng = np.random.default_rng(4)
    cases = []
    for count, gap in ((5, 3), (12, 4)):
        S = rng.uniform(0.0, 0.6, (count, count))
        places = np.arange(count)
        away = np.abs(places[:, None] - places)
        S = 0.5 * (S + S.T) + 0.9 * np.exp(-away)
        cases.append((S, gap))
    return cases


def turn(angle: float) -> Array:
    """Rotation (2, 2) by a heading from z towards x: columns are the axes right and forward."""
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _wrapped(angle: float) -> float:
    """The angle plus a number of full turns, in [-π, π), radians."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def edge_residual(p_i: Array, p_j: Array, m: Array, axes: float | None = None, wrap: Any = _wrapped) -> Array:
    """Residual (3,) of an edge in the plane: pose j in the axes of pose i, minus the measured pose m.

    Poses and m are (x, z, heading), metres and radians.

    axes : heading of the axes instead of that of p_i. wrap : function that brings the angle into its range.
    """
    heading = p_i[2] if axes is None else axes
    x, z = turn(heading).T @ (p_j[:2] - p_i[:2]) - m[:2]
    angle = wrap(p_j[2] - p_i[2] - m[2])
    return np.array([x, z, angle])


def turned_the_other_way(p_i: Array, p_j: Array, m: Array) -> Array:
    """Wrong answer: the whole residual is turned back into the axes of the world."""
    residual = edge_residual(p_i, p_j, m)
    x, z = turn(p_i[2]) @ residual[:2]
    return np.array([x, z, residual[2]])


def usual_residual(p_i: Array, p_j: Array, m: Array, wrap: Any = _wrapped) -> Array:
    """The residual of M⁻¹ (Tᵢ⁻¹ Tⱼ), as in the tutorial of Grisetti et al.: in the axes of the measured pose."""
    residual = edge_residual(p_i, p_j, m, wrap=wrap)
    x, z = turn(m[2]).T @ residual[:2]
    return np.array([x, z, residual[2]])


def _as_pose(*poses: Array) -> Array:
    """The pose (x, z, heading) of several poses, each in the axes of the one before."""
    place = np.zeros(2)
    heading = 0.0
    for x, z, angle in poses:
        place = place + turn(heading) @ np.array([x, z])
        heading += angle
    return np.array([*place, _wrapped(heading)])


def _inverse(pose: Array) -> Array:
    """The inverse of a pose (x, z, heading)."""
    x, z = -turn(pose[2]).T @ pose[:2]
    return np.array([x, z, -pose[2]])


def _seen_from(p_i: Array, p_j: Array) -> Array:
    """Pose j in the axes of pose i, Tᵢ⁻¹ Tⱼ."""
    return _as_pose(_inverse(p_i), p_j)


def residual_in_the_axes_of(answer: Any) -> Callable[..., Array]:
    """The library's residual in the axes that an answer uses: those of pose i, or of the measured pose.

    They are those of the measured pose if the answer has the results of `usual_residual` in all cases.
    """
    for case in plane_edges():
        got = as_array(result_of(answer, case))
        right = usual_residual(*case)
        if not (isinstance(got, np.ndarray) and got.shape == right.shape and np.allclose(got, right)):
            return edge_residual
    return usual_residual


def plane_edges() -> list[Case]:
    """Cases with two poses and the measured pose of the second pose relative to the first."""
    first = ([3.0, 1.0, 0.4], [4.0, 5.0, 0.6], [-0.5, 4.0, 2.25])
    second = ([-2.0, 7.0, 3.0], [-6.0, 7.5, -3.1], [0.2, -4.1, 0.1])
    third = ([0.0, 0.0, 1.5], [2.0, 1.0, -1.6], [1.0, -2.0, 3.1])
    return [tuple(map(np.array, case)) for case in (first, second, third)]


def gauss_newton(J: Array, r: Array) -> Array:
    """The step (3N,) of all poses; the first pose is fixed."""
    delta = np.zeros(J.shape[1])
    delta[3:] = np.linalg.solve(J[:, 3:].T @ J[:, 3:], -J[:, 3:].T @ r)
    return delta


def linear_problems() -> list[Case]:
    """Cases with derivatives (3M, 3N) and residuals (3M,) of a small graph in the plane with a free gauge."""
    rng = np.random.default_rng(2)
    cases = []
    axes = np.eye(3) + rng.normal(0.0, 0.2, (5, 3, 3))  # the gauge changes each pose in a different way
    for edges in ([(0, 1), (1, 2), (0, 2)], [(0, 1), (1, 2), (2, 3), (3, 4), (0, 4)]):
        poses = 1 + max(j for _, j in edges)
        J = np.zeros((3 * len(edges), 3 * poses))
        for row, (i, j) in enumerate(edges):
            block = np.eye(3) + rng.normal(0.0, 0.2, (3, 3))
            J[3 * row : 3 * row + 3, 3 * i : 3 * i + 3] = -block @ axes[i]
            J[3 * row : 3 * row + 3, 3 * j : 3 * j + 3] = block @ axes[j]
        cases.append((J, rng.normal(size=len(J))))
    return cases


def loop_weights(r: Array, sigma: Array, c: float) -> Array:
    """Cauchy's weights (N,) of residuals (N, 3) with standard deviations (3,)."""
    return np.asarray(1.0 / (1.0 + np.sum((r / sigma) ** 2, axis=1) / c**2))


def loop_residuals() -> list[Case]:
    """Cases with residuals (N, 3), their standard deviations (3,) and a scale."""
    sigma = np.array([0.05, 0.05, 0.001])
    rng = np.random.default_rng(6)
    return [
        (np.array([[0.0, 0, 0], [0.15, 0, 0], [30.0, 2, 1]]), sigma, 3.0),
        (rng.normal(size=(6, 3)), sigma, 2.0),
    ]


candidates = Exercise(
    nearest_earlier,
    similar_places,
    praise="each place has its most similar earlier place; the places just before do not count.",
    hint="compare place k with the places 0 … k - gap. If there is no such place, the answer is -1.",
    line="int(S[k, : k - gap + 1].argmax()) if k >= gap else -1",
    mistakes={
        "without the gap, each place is most similar to the place just before.": lambda S, gap: (
            nearest_earlier(S, 1)
        ),
        "each place is most similar to itself: the gap is missing.": lambda S, gap: S.argmax(axis=1),
        "if no place is early enough, return -1, not 0.": lambda S, gap: nearest_earlier(S, gap).clip(0),
        "if no place is early enough, return -1, not None.": Condition(
            lambda got, *case: np.isnan(got).any()
        ),
        "the last allowed place, k - gap, is missing.": lambda S, gap: nearest_earlier(S, gap + 1),
        "later places are among the answers: only earlier places count.": nearest_far_place,
    },
)

residual = Exercise(
    edge_residual,
    plane_edges,
    also=(usual_residual,),
    praise="the residual is 0 if the poses agree with the edge. Its units are metres and radians.",
    hint="rotate the difference of the two positions into the axes of pose i, then subtract m.",
    line="place = turn(p_i[2]).T @ (p_j[:2] - p_i[:2]) - m[:2]; angle = (d + np.pi) % (2 * np.pi) - np.pi",
    mistakes={
        "the difference of the positions is in the axes of the world: rotate it into the axes of pose i.": (
            partial(edge_residual, axes=0.0)
        ),
        "the rotation is inverted: the axes of pose i are the columns of turn(heading).": (
            lambda p_i, p_j, m: edge_residual(p_i, p_j, m, -p_i[2])
        ),
        "this is the residual of the inverse, (Tⱼ⁻¹ Tᵢ) M, in the axes of pose j: it is 0 for the same poses, but "
        "the task asks for pose j in the axes of pose i, Tᵢ⁻¹ Tⱼ.": (
            lambda p_i, p_j, m: _as_pose(_seen_from(p_j, p_i), m),
            lambda p_i, p_j, m: _seen_from(p_j, p_i) - _inverse(m),
        ),
        "the measured pose is inverted on the other side, as (Tᵢ⁻¹ Tⱼ) M⁻¹ or M (Tⱼ⁻¹ Tᵢ): write M⁻¹ (Tᵢ⁻¹ Tⱼ), or "
        "subtract m.": (
            lambda p_i, p_j, m: _as_pose(_seen_from(p_i, p_j), _inverse(m)),
            lambda p_i, p_j, m: _as_pose(m, _seen_from(p_j, p_i)),
        ),
        "the measured pose is not inverted: M (Tᵢ⁻¹ Tⱼ) or (Tᵢ⁻¹ Tⱼ) M adds the edge to the motion.": (
            lambda p_i, p_j, m: _as_pose(m, _seen_from(p_i, p_j)),
            lambda p_i, p_j, m: _as_pose(_seen_from(p_i, p_j), m),
        ),
        "the sign is wrong: m is subtracted from the motion, not the motion from m.": lambda *x: (
            -usual_residual(*x)
        ),
        "poses i and j are exchanged.": lambda p_i, p_j, m: edge_residual(p_j, p_i, m),
        "the measured pose m is not subtracted.": lambda p_i, p_j, m: edge_residual(p_i, p_j, 0.0 * m),
        "the difference is in the axes of the world or of pose j; use those of pose i.": (
            lambda p_i, p_j, m: edge_residual(p_i, p_j, m, p_j[2]),
            turned_the_other_way,
        ),
        "the angle is in degrees; the residual has radians.": (
            partial(edge_residual, wrap=lambda angle: np.degrees(_wrapped(angle))),
            partial(usual_residual, wrap=lambda angle: np.degrees(_wrapped(angle))),
        ),
        "wrap the angle to [-π, π), not to [0, 2π).": (
            partial(edge_residual, wrap=lambda a: a % (2 * np.pi)),
            partial(usual_residual, wrap=lambda a: a % (2 * np.pi)),
        ),
        "the angle is wrapped too early: wrap it after m is subtracted.": lambda p_i, p_j, m: np.array(
            [*edge_residual(p_i, p_j, m)[:2], _wrapped(p_j[2] - p_i[2]) - m[2]]
        ),
        "the angle is not wrapped: from 179° to -179° it is 2°, not 358°.": (
            partial(edge_residual, wrap=float),
            partial(usual_residual, wrap=float),
        ),
    },
)

gauge = Exercise(
    3,
    praise="3: if the whole path is shifted in x and z and turned, no residual changes. A fixed pose prevents this.",
    hint="which motions of the whole path change no residual?",
    line="np.count_nonzero(np.linalg.eigvalsh(J.T @ J) < 1e-9)",
    mistakes={
        "this is the number in space: three shifts and three turns. In the plane there are fewer.": 6,
        "these are the two shifts: the whole path may also turn.": 2,
        "an edge measures only the motion between two poses: the origin of the world is free.": 0,
    },
)

step = Exercise(
    gauss_newton,
    linear_problems,
    atol=1e-5,  # single precision is enough
    praise="these are the normal equations of all poses but the first.",
    hint="remove the first three columns of J, solve the normal equations, and put three zeros in front.",
    line="delta[3:] = np.linalg.solve(J[:, 3:].T @ J[:, 3:], -J[:, 3:].T @ r)",
    mistakes={
        "the first pose moves: this is the shortest of many steps. Leave its three columns out.": lambda J, r: (
            np.linalg.lstsq(J, -r, rcond=None)[0]
        ),
        "three numbers are missing: the first pose has a step too, zero.": lambda *x: gauss_newton(*x)[3:],
        "the sign is wrong: r + J delta should become small.": lambda J, r: -gauss_newton(J, r),
        "three numbers of the shortest step are set to zero: solve without the first three columns.": lambda J, r: (
            np.r_[np.zeros(3), np.linalg.lstsq(J, -r, rcond=None)[0][3:]]
        ),
        "the last pose is fixed; fix the first pose instead.": lambda J, r: np.r_[
            np.linalg.lstsq(J[:, :-3], -r, rcond=None)[0], np.zeros(3)
        ],
        "this is the gradient alone: divide by JᵀJ, that is, solve.": lambda J, r: np.concatenate(
            [np.zeros(3), -J[:, 3:].T @ r]
        ),
    },
)

weights = Exercise(
    loop_weights,
    loop_residuals,
    praise="1 for a residual of 0, ½ at c standard deviations, almost 0 for a false loop.",
    hint="metres and radians are comparable in standard deviations: divide first, then take the norm.",
    line="1 / (1 + np.sum((r / sigma) ** 2, axis=1) / c**2)",
    mistakes={
        "metres and radians are added: divide each by its standard deviation.": lambda r, sigma, c: (
            1 / (1 + np.sum(r**2, axis=1) / c**2)
        ),
        "c is not squared.": lambda r, sigma, c: 1 / (1 + np.sum((r / sigma) ** 2, axis=1) / c),
        "the squares of different loops are added: sum over the three numbers of a loop, axis=1.": lambda r, sigma, c: (
            1 / (1 + np.sum((r / sigma) ** 2, axis=0) / c**2)
        ),
        "the norm is not squared.": lambda r, sigma, c: 1 / (1 + np.linalg.norm(r / sigma, axis=1) / c),
        "each component has its own weight: a loop has one weight.": lambda r, sigma, c: (
            1 / (1 + (r / sigma / c) ** 2)
        ),
    },
)

bends = Exercise(
    {"ATE before": 1.0, "ATE after": 0.2, "false loops": 3.0, "robust": 1.0, "smallest weight, true": 0.96},
    praise="{ATE before:.2f} m before, {ATE after:.2f} m after, with {false loops:.0f} false loops. Large residuals "
    "remove the false loops; true loops keep nearly their full weight.",
    mistakes={
        "the number of false loops is {false loops:.0f}: raise it to three or more.": lambda now: (
            now["false loops"] < 3
        ),
        "all loops have full weight: switch `robust weights` on.": lambda now: now["robust"] == 0,
        "{ATE before:.2f} m before, {ATE after:.2f} m after: are the loops closed, and is there a drift to "
        "remove?": lambda now: now["ATE after"] > 0.5 * now["ATE before"],
        "a true loop has the weight {smallest weight, true:.2f} only: which control raises it to 0.95?": lambda now: (
            now["smallest weight, true"] < 0.95
        ),
    },
)
