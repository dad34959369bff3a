"""Chapter 2: five points, their polynomial, their solutions, and the effect of noise on the rotation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.motion import essential_from_motion
from vo_lib.geometry.types import Array, BoolArray, Image, Index
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import sampson_inliers, truncated_errors
from vo_lib.settings import Checked, setting

from ..candidates import sets_of_five
from ..colours import BAD, CYCLE, DARK, PALE, THIRD, WHITE
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, figure, photo
from ..drawn_matches import draw_dots, draw_flow
from ..frames import Points, frame_points, stereo
from ..memory import Memory
from ..panel import Control, Drawing, Fact, Panel, State
from ..rotation_errors import reference_rotation, rotation_errors, set_errors
from . import figures as draw

CHART_HEIGHT = 214
SETS = 200  # in the histogram
SIDE_BY_SIDE = "side by side"  # a match and its four neighbours
OUTLIER_PX = 1.0  # from the true epipolar line
FIVE = (CYCLE[0], CYCLE[5], CYCLE[4], CYCLE[3], CYCLE[6])


@dataclass(frozen=True)
class FivePointView(Checked):
    """Settings of the panel of chapter 2."""

    draw: int = setting(0, "seed of the random choice of five matches", low=0, high=999)
    points: tuple[int, ...] = setting((), "numbers of five matches; empty: a random choice", low=0)
    match: float = setting(0.3, "match of the epipolar line; 0: leftmost, 1: rightmost", low=0, high=1)
    candidate: int = setting(1, "displayed solution of the set; 1 is the best", low=1, high=10)
    noise: float = setting(0.0, "noise added to every coordinate", unit="px", low=0, high=3)
    spread: str = setting(
        "anywhere", "positions of the matches of a random set", choices=("anywhere", SIDE_BY_SIDE)
    )


_errors: Memory[tuple[Array, float]] = Memory(16)


def with_noise(points: Points, noise: float, focal: float) -> Points:
    """The points with Gaussian noise of `noise` pixels on every coordinate, always the same noise."""
    extra = np.random.default_rng(1).normal(0.0, noise / focal, (2, *points.x_p.shape))
    return replace(points, x_p=points.x_p + extra[0], x_c=points.x_c + extra[1])


@dataclass(frozen=True, eq=False)
class _Reference:
    """With what the solutions are compared: the true motion or, without truth, the rotation by all matches.

    R : (3, 3) rotation. E : (3, 3) true essential matrix, or None. what, than : words for the angle to R.
    """

    R: Array
    E: Array | None
    what: str
    than: str


def _reference(sequence: Sequence, frame: int, points: Points) -> _Reference:
    """The reference of a frame with these points, which have no noise added."""
    R = reference_rotation(sequence, frame, points)
    if points.T_cp is None:
        return _Reference(R, None, "rotation difference", "the estimate from all matches (there is no truth)")
    E = essential_from_motion(points.T_cp[:3, :3], points.T_cp[:3, 3])
    return _Reference(R, E, "rotation error", "the true rotation")


def solutions_of(five: Index, points: Points, threshold: float) -> Array:
    """The essential matrices (M, 3, 3) that fit five matches, the smallest image error over all points first.

    threshold : at which the image errors are truncated, normalised units.
    """
    E = five_point(points.x_p[five][None], points.x_c[five][None]).E
    return np.asarray(E[np.argsort(truncated_errors(E, points.x_p, points.x_c, threshold))])


def outliers_among(five: Index, points: Points, E_true: Array | None, limit: float) -> float:
    """How many of five matches are farther than `limit`, normalised units, from the true E; NaN without truth."""
    if E_true is None:
        return np.nan
    right = sampson_inliers(E_true, points.x_p[five], points.x_c[five], limit)
    return len(five) - int(np.count_nonzero(right))


def closest_two(places: Array) -> float:
    """The smallest distance between two of some places (N, 2)."""
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    return float(apart[np.triu_indices(len(places), 1)].min())


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
        reference = _reference(sequence, state.frame, clean)
        five = five_matches(view, points)
        solutions = solutions_of(five, points, threshold)
        if len(solutions) == 0:
            control = "your five matches" if view.points else "another five"
            raise DataError(f"{control}: these five determine no essential matrix; choose five others")
        number = min(view.candidate, len(solutions))
        shown = solutions[number - 1]
        inlier = sampson_inliers(shown, points.x_p, points.x_c, threshold)
        error, best_error = rotation_errors(solutions[[number - 1, 0]], reference.R).tolist()
        error_by_set, error_of_winner = self._errors_of_sets(state, points, reference.R)
        charts, (left, right) = figure(CHART_HEIGHT, 2)
        draw.polynomial_chart(left, *draw.polynomial_of(points.x_p[five], points.x_c[five]))
        draw.errors_chart(right, error_by_set, error_of_winner, reference.what)

        by_column = np.argsort(points.x_c[:, 0])
        match = int(by_column[round(view.match * (len(by_column) - 1))])
        line = draw.epipolar_line(shown, points.x_p[match], camera)
        distance = abs(float(line @ [*draw.pixels(points.x_c[match], camera), 1.0]))
        lines = {BAD: shown}
        if reference.E is not None:
            lines = {THIRD: reference.E, BAD: shown}
        picture = self._picture(state, points, [*five, match], lines, inlier)

        sentence = (
            f"{len(solutions)} essential matrices fit the matches {', '.join(map(str, five))} exactly. A "
            f"{reference.what} is the angle to {reference.than}. Match {match} is {distance:.2f} px from its "
            "epipolar line (orange)."
        )
        facts = (
            Fact("inliers", int(np.count_nonzero(inlier))),
            Fact(f"{reference.what} of this solution", error, "°", 3),
            Fact(f"{reference.what} of solution 1", best_error, "°", 3),
            Fact(f"{reference.what}: median of the sets", float(np.median(error_by_set)), "°", 3),
            Fact("solution", number),
            Fact("noise added", view.noise, "px", 2),
            Fact("outliers among the five", outliers_among(five, points, reference.E, OUTLIER_PX / camera.f)),
            Fact("closest two of the five", camera.f * closest_two(points.x_c[five]), "px"),
        )
        return Drawing([picture, charts], sentence, facts, limits={"view.candidate": len(solutions)})

    def _errors_of_sets(self, state: State, points: Points, R: Array) -> tuple[Array, float]:
        """Rotation errors, degrees, of the best solution of each of `SETS` sets, and of the winner of all.

        A set without a solution has no error.

        R : (3, 3) the rotation with which they are compared.
        """
        view = state.view
        threshold = state.config.selection.threshold / state.sequence.camera.f

        def errors() -> tuple[Array, float]:
            sets = sets_of_five(points.x_c, 2, SETS, view.spread == SIDE_BY_SIDE)
            return set_errors(points, R, sets, threshold)

        key = (*points.key, R.tobytes(), view.spread, threshold)
        return _errors.get(key, errors)

    def _picture(
        self, state: State, points: Points, named: list[int], lines: dict[str, Array], inlier: BoolArray
    ) -> Image:
        """The frame with its matches, and the epipolar lines of one match.

        named : indices of the matches with a dot: the five, and last the match of the lines.
        lines : the E of each line by its colour.
        """
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
        return np.asarray(sets_of_five(points.x_c, [3, view.draw], 1, view.spread == SIDE_BY_SIDE)[0])
    count = len(points.x_p)
    if len(view.points) != 5 or len(set(view.points)) != 5 or max(view.points) >= count:
        raise DataError(f"your five matches: expected five different numbers from 0 to {count - 1}")
    return np.array(view.points)
