"""Chapter 2: five points, their polynomial, their solutions, and the effect of noise on the rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.motion import decompose_essential, essential_from_motion, rotation_angle
from vo_lib.geometry.types import Array, BoolArray, Image, Index
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import draw_sets, sampson_inliers, truncated_errors
from vo_lib.settings import Checked, setting

from ..colours import BAD, CYCLE, DARK, PALE, THIRD, WHITE
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, figure, photo
from ..drawn_matches import draw_dots, draw_flow
from ..frames import Points, frame_points, key_of, stereo
from ..lessons import consensus_rotation
from ..memory import Memory
from ..panel import Control, Drawing, Fact, Panel, State
from . import figures as draw

CHART_HEIGHT = 214
SETS = 200  # in the histogram
OUTLIER_PX = 1.0  # from the true epipolar line
FIVE = (CYCLE[0], CYCLE[5], CYCLE[4], CYCLE[3], CYCLE[6])
NO_ESSENTIAL = np.zeros((3, 3))  # in place of an unknown true E


@dataclass(frozen=True)
class FivePointView(Checked):
    """Settings of the panel of chapter 2."""

    draw: int = setting(0, "seed of the random choice of five matches", low=0, high=999)
    points: tuple[int, ...] = setting((), "numbers of five matches; empty: a random choice", low=0)
    match: float = setting(0.3, "match of the epipolar line; 0: leftmost, 1: rightmost", low=0, high=1)
    candidate: int = setting(1, "displayed solution of the set; 1 is the best", low=1, high=10)
    noise: float = setting(0.0, "noise added to every coordinate", unit="px", low=0, high=3)
    spread: str = setting(
        "anywhere", "positions of the matches of a random set", choices=("anywhere", "side by side")
    )


_rotations: Memory[Array] = Memory(16)
_errors: Memory[tuple[Array, float]] = Memory(16)


def reference_rotation(sequence: Sequence, frame: int, points: Points) -> Array:
    """The true rotation or, without truth, the best rotation from all matches."""
    if points.T_cp is not None:
        return np.asarray(points.T_cp[:3, :3])

    def estimate() -> Array:
        return consensus_rotation(points, np.random.default_rng(0), sequence.camera.f)

    return _rotations.get((*key_of(sequence, frame), len(points.x_p)), estimate)


def with_noise(points: Points, noise: float, focal: float) -> Points:
    """The points with Gaussian noise of `noise` pixels on every coordinate, always the same noise."""
    extra = np.random.default_rng(1).normal(0.0, noise / focal, (2, *points.x_p.shape))
    return replace(points, x_p=points.x_p + extra[0], x_c=points.x_c + extra[1])


def rotation_errors(E: Array, R_true: Array) -> Array:
    """Angle between the rotation of each E (M, 3, 3) and the true rotation, (M,) degrees.

    E has two rotations; the result is the error of the nearer rotation. The other rotation differs by 180°
    about t, and the depths of the points exclude this rotation.
    """
    R, _ = decompose_essential(E)
    angles = rotation_angle(np.swapaxes(R, -1, -2) @ R_true)
    return np.asarray(np.degrees(angles.min(axis=-1)))


def first_of_each_set(errors: Array, set_index: Index, count: int = 1) -> BoolArray:
    """Mask (M,) of the candidates with the `count` smallest errors in their set."""
    order = np.lexsort((errors, set_index))
    rank = np.arange(len(order)) - np.searchsorted(set_index[order], set_index[order])
    return np.isin(np.arange(len(order)), order[rank < count])


def sets_of(points: Points, seed: Any, sets: int, spread: str) -> Index:
    """Five-point sets (sets, 5): random matches or, if "side by side", a match and its four neighbours."""
    chosen = draw_sets(np.random.default_rng(seed), len(points.x_c), sets)
    if spread == "anywhere":
        return chosen
    away = np.linalg.norm(points.x_c[chosen[:, :1]] - points.x_c, axis=2)
    return np.argsort(away, axis=1)[:, :5]


def set_errors(points: Points, R_true: Array, chosen: Index, threshold: float) -> tuple[Array, float]:
    """Rotation error, degrees, of the candidate with the smallest image error, by set (S,) and overall."""
    solutions = five_point(points.x_p[chosen], points.x_c[chosen])
    image_errors = truncated_errors(solutions.E, points.x_p, points.x_c, threshold)
    best = np.flatnonzero(first_of_each_set(image_errors, solutions.set_index))
    errors = rotation_errors(solutions.E[best], R_true)
    return errors, float(errors[np.argmin(image_errors[best])])


class FivePointPanel(Panel):
    """Five matches of a frame, all essential matrices that fit them, and the errors of these matrices."""

    kit = preset("solution_selection", variant="kit")
    title = "Five matches and every essential matrix through them"
    view = FivePointView
    height = PHOTO_HEIGHT + CHART_HEIGHT
    controls = (
        Control("view.draw", "another five", button=True),
        Control("view.points", "your five matches"),
        Control("view.match", "chosen match", step=0.005),
        Control("view.candidate", "solution"),
        Control("view.spread", "random five"),
        Control("selection.threshold", "inlier threshold", high=5, step=0.05),
        Control("view.noise", "noise", step=0.05),
    )

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        camera = sequence.camera
        view = state.view
        threshold = state.config.selection.threshold / camera.f
        clean = frame_points(sequence, state.frame, state.config)
        points = with_noise(clean, view.noise, camera.f)
        R_true = reference_rotation(sequence, state.frame, clean)
        E_true = NO_ESSENTIAL
        what = "rotation difference"
        than = "the estimate from all matches (there is no truth)"
        if clean.T_cp is not None:
            E_true = essential_from_motion(clean.T_cp[:3, :3], clean.T_cp[:3, 3])
            what = "rotation error"
            than = "the true rotation"

        five = five_matches(view, points)
        x_p = points.x_p[five]
        x_c = points.x_c[five]
        E = five_point(x_p[None], x_c[None]).E
        if len(E) == 0:
            control = "your five matches" if view.points else "another five"
            raise DataError(f"{control}: these five determine no essential matrix; choose five others")
        order = np.argsort(truncated_errors(E, points.x_p, points.x_c, threshold))
        number = min(view.candidate, len(order))
        shown = E[order[number - 1]]
        inlier = sampson_inliers(shown, points.x_p, points.x_c, threshold)
        error, best_error = rotation_errors(np.stack([shown, E[order[0]]]), R_true).tolist()

        def errors_of_sets() -> tuple[Array, float]:
            return set_errors(points, R_true, sets_of(points, 2, SETS, view.spread), threshold)

        key = (*key_of(sequence, state.frame), state.config.variant, view.noise, view.spread, threshold)
        spread, winner = _errors.get(key, errors_of_sets)
        charts, (left, right) = figure(CHART_HEIGHT, 2)
        draw.polynomial_chart(left, *draw.polynomial_of(x_p, x_c))
        draw.errors_chart(right, spread, winner, what)

        by_column = np.argsort(points.x_c[:, 0])
        match = int(by_column[round(view.match * (len(by_column) - 1))])
        line = draw.epipolar_line(shown, points.x_p[match], camera)
        distance = abs(float(line @ [*draw.pixels(points.x_c[match], camera), 1.0]))
        picture = self._picture(state, points, [*five, match], {THIRD: E_true, BAD: shown}, inlier)

        sentence = (
            f"{len(E)} essential matrices fit the matches {', '.join(map(str, five))} exactly. A {what} is the "
            f"angle to {than}. Match {match} is {distance:.2f} px from its epipolar line (orange)."
        )
        ends = camera.f * x_c
        apart = np.linalg.norm(ends[:, None] - ends, axis=2)[np.triu_indices(5, 1)].min()
        wrong = np.nan
        if clean.T_cp is not None:
            right_ones = sampson_inliers(E_true, x_p, x_c, OUTLIER_PX / camera.f)
            wrong = 5 - int(np.count_nonzero(right_ones))
        facts = (
            Fact("inliers", int(np.count_nonzero(inlier))),
            Fact(f"{what} of this solution", error, "°", 3),
            Fact(f"{what} of solution 1", best_error, "°", 3),
            Fact(f"{what}: median of the sets", float(np.median(spread)), "°", 3),
            Fact("solution", number),
            Fact("noise added", view.noise, "px", 2),
            Fact("outliers among the five", wrong),
            Fact("closest two of the five", float(apart), "px"),
        )
        return Drawing([picture, charts], sentence, facts, limits={"view.candidate": len(E)})

    def _picture(
        self, state: State, points: Points, named: list[int], lines: dict[str, Array], inlier: BoolArray
    ) -> Image:
        """The frame with its matches, and the epipolar line of match `named[-1]` for each E, by colour."""
        camera = state.sequence.camera
        match = named[-1]
        picture = photo(stereo(state.sequence, state.frame)[0], camera.width)
        starts = draw.pixels(points.x_p, camera)
        ends = draw.pixels(points.x_c, camera)
        # Outliers are black in white, to be seen on a dark photo and on a bright one.
        draw_flow(picture, starts[inlier], ends[inlier], [PALE] * int(inlier.sum()), 2)
        outliers = int(np.count_nonzero(~inlier))
        draw_flow(picture, starts[~inlier], ends[~inlier], [WHITE] * outliers, 4, thickness=3)
        draw_flow(picture, starts[~inlier], ends[~inlier], [DARK] * outliers, 2.5)
        for colour, E in lines.items():
            if E is not NO_ESSENTIAL:
                line = draw.epipolar_line(E, points.x_p[match], camera)
                draw.draw_line(picture, line, colour, 2 if colour == BAD else 1)
        draw_dots(picture, ends[named], (*FIVE, BAD), 6, named)
        words = (
            f"frame {state.frame}: five matches; line of match {match} (orange; true: green); black: outliers"
        )
        scale = min(WIDTH / camera.width, PHOTO_HEIGHT / camera.height)
        margin = (np.array((WIDTH, PHOTO_HEIGHT)) - scale * np.array((camera.width, camera.height))) / 2
        return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words, scale * ends[named] + margin)


def five_matches(view: FivePointView, points: Points) -> Index:
    """Indices of the five matches, typed or drawn at random; `DataError` for impossible numbers."""
    if not view.points:
        return np.asarray(sets_of(points, [3, view.draw], 1, view.spread)[0])
    count = len(points.x_p)
    if len(view.points) != 5 or len(set(view.points)) != 5 or max(view.points) >= count:
        raise DataError(f"your five matches: expected five different numbers from 0 to {count - 1}")
    return np.array(view.points)
