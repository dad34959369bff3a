"""Chapter 1: its statements about matches of the drawn street, the measure without truth, lost matches."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import nbformat
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from course.ch01.figures import errors_chart, on_edge
from course.ch01.trace import LOST, open_loops, trace, whole_pixels
from course.ch01.wrong_matches import (
    GROSS,
    RIGHT,
    RISE,
    ErrorMeasure,
    count_line,
    measure_of,
    strongest_wrong,
    wrong_example,
)
from course.drawing import figure
from course.frames import stereo
from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array
from vo_lib.paper.matching import DescribedPair, close_loop, describe_pair, subpixel_matches

NOTEBOOK = next((Path(__file__).resolve().parents[2] / "notebooks").glob("01_*.ipynb"))
TEXT = "\n".join(cell.source for cell in nbformat.read(NOTEBOOK, as_version=4).cells)  # type: ignore[no-untyped-call]
FRAME = 60
PAPER = preset("solution_selection")
Pairs = tuple[DescribedPair, DescribedPair]


def numbers(sentence: str) -> list[float]:
    """The numbers in a sentence of the chapter, given as a pattern."""
    found = re.search(sentence, TEXT)
    assert found is not None, sentence
    return [float(number) for number in found.groups()]


def share(error: Array, limit: float) -> float:
    """Share of the known errors above a limit."""
    return float(np.mean(error[np.isfinite(error)] > limit))


@pytest.fixture(scope="module")
def pairs(street: Sequence) -> Pairs:
    described = [describe_pair(stereo(street, f), PAPER.features, PAPER.matching) for f in (FRAME - 1, FRAME)]
    return described[0], described[1]


@pytest.fixture(scope="module")
def measure(street: Sequence) -> ErrorMeasure:
    return measure_of(street, FRAME)


@pytest.fixture(scope="module")
def whole(pairs: Pairs) -> StereoMatches:
    return whole_pixels(*pairs, *close_loop(*pairs, PAPER.matching.search_radius))


def test_an_open_loop_is_wrong_and_a_closed_loop_often(
    pairs: Pairs, measure: ErrorMeasure, whole: StereoMatches
) -> None:
    astray, ends = open_loops(*pairs, PAPER.matching.search_radius)
    assert not np.isin(astray.id, whole.id).any()
    assert np.all(np.any(ends != astray.prev_left, axis=1))
    assert share(measure(astray), RIGHT) > 0.95
    error = measure(whole)
    assert "about half of the closed loops with a known error are off by more than a pixel" in TEXT
    assert share(error, RIGHT) == pytest.approx(0.5, abs=0.05)
    assert "less than a third of these wrong ones are below 2 px" in TEXT
    assert share(error[error > RIGHT], 2.0) > 2 / 3
    assert "More than half are gross, and that is more than a quarter of all closed loops" in TEXT
    assert share(error[error > RIGHT], GROSS) > 1 / 2
    assert share(error, GROSS) > 1 / 4


def test_lucas_kanade_removes_most_gross_errors(
    pairs: Pairs, measure: ErrorMeasure, whole: StereoMatches
) -> None:
    refined = subpixel_matches(*pairs, whole, PAPER.matching)
    removed = whole[~np.isin(whole.id, refined.id)]
    before, after = numbers(r"share falls from (\d+) % of the closed loops to (\d+) % of the kept matches")
    assert round(100 * share(measure(whole), GROSS)) == before
    assert round(100 * share(measure(refined), GROSS)) == after
    few, all_of = numbers(r"(\d+) of (\d+) removed matches with a known error were wrong")
    assert share(measure(removed), RIGHT) == pytest.approx(few / all_of, abs=0.01)
    assert np.nanmedian(measure(refined)) < 0.5 * np.nanmedian(measure(whole[~np.isin(whole.id, removed.id)]))


def test_wrong_matches_that_pass_are_more_often_at_outlines(street: Sequence, measure: ErrorMeasure) -> None:
    kept = trace(street, FRAME, PAPER).chosen
    error = measure(kept)
    outline = measure.on_outline(kept)
    assert outline is not None
    assert "two of five wrong survivors are at an outline" in TEXT
    assert np.mean(outline[error > RIGHT]) == pytest.approx(2 / 5, abs=0.03)
    assert "only one in seven of the right ones is" in TEXT
    assert np.mean(outline[error <= RIGHT]) == pytest.approx(1 / 7, abs=0.02)
    edge = on_edge(stereo(street, FRAME - 1)[0], kept.prev_left)
    assert (
        "a quarter of the wrong ones are on a window that is nearly an edge, and a tenth of the right" in TEXT
    )
    assert np.mean(edge[error > RIGHT]) == pytest.approx(1 / 4, abs=0.03)
    assert np.mean(edge[error <= RIGHT]) == pytest.approx(1 / 10, abs=0.03)
    worst = strongest_wrong(kept, error)
    assert worst is not None
    assert error[worst] > GROSS


def test_matches_that_are_not_found_again_have_places(street: Sequence, measure: ErrorMeasure) -> None:
    traced = trace(street, FRAME, PAPER)
    assert len(traced.lost) == np.count_nonzero(traced.fate == LOST) > 100
    assert share(measure(traced.lost), RIGHT) > 0.9
    assert len(trace(street, FRAME, preset("solution_selection", variant="kit")).lost) == 0


def test_epipolar_lines_show_a_part_of_the_errors(
    street: Sequence, measure: ErrorMeasure, whole: StereoMatches
) -> None:
    unknown = replace(measure, known=None)
    error = measure(whole)
    distance = unknown(whole)
    np.testing.assert_array_equal(distance, measure.from_lines(whole))
    assert unknown.name.startswith("distance")
    assert unknown.true_places(whole) == {}
    assert unknown.on_outline(whole) is None
    gross = error > GROSS
    assert 0.05 < np.mean(distance[gross] > GROSS) < 0.5
    assert np.mean(distance[error <= RIGHT] > GROSS) == 0.0
    # A current left place that is moved across its line by 7 px is 7 px away from it.
    right = whole[error <= RIGHT]
    lines = measure.lines(right)
    on_line = (
        right.cur_left - (np.sum(lines[:, :2] * right.cur_left, axis=1) + lines[:, 2])[:, None] * lines[:, :2]
    )
    moved = replace(right, cur_left=on_line + 7.0 * lines[:, :2])
    np.testing.assert_allclose(unknown(moved), 7.0, atol=1e-9)


def test_count_line_separates_unknown_errors() -> None:
    error = np.array([0.5, 1.5, 6.0, 0.2, np.nan])
    assert count_line("these", error) == (
        "these: 4 matches, 2 above 1 px, 1 above 5 px = 25.0%; 1 more have no known error"
    )
    assert count_line("none", np.zeros(0)) == "none: 0 matches, 0 above 1 px, 0 above 5 px"


def test_no_match_is_wrong_where_all_errors_are_small(whole: StereoMatches) -> None:
    assert strongest_wrong(whole, np.full(len(whole), 0.9)) is None
    error = np.full(len(whole), np.nan)
    error[5] = 3.0
    assert strongest_wrong(whole, error) == 5


def test_without_truth_a_match_is_called_wrong_only_if_it_is(
    street: Sequence, measure: ErrorMeasure, whole: StereoMatches
) -> None:
    """Right matches on the moving cars of the street leave their lines; none of them may be called wrong."""
    unknown = replace(measure, known=None)
    error = measure(whole)
    rise = unknown.rises(whole)
    assert np.all(rise[error <= RIGHT] < RISE)
    assert np.count_nonzero(rise[error > GROSS] > RISE) > 20
    worst, words = wrong_example(unknown, whole)
    assert worst is not None
    assert error[worst] > GROSS
    assert "it is wrong" in words


def test_a_right_match_on_a_moving_thing_is_not_called_wrong(
    measure: ErrorMeasure, whole: StereoMatches
) -> None:
    # Points that move by 0.6 m to the side and 0.4 m away, all the others stand still.
    right = whole[(measure(whole) <= RIGHT) & (whole.prev_left[:, 0] - whole.prev_right[:, 0] > 15)]
    camera = measure.sequence.camera
    X = camera.triangulate(right.cur_left, right.cur_right) + np.array([0.6, 0.0, 0.4])
    u = camera.f * X[:, 0] / X[:, 2] + camera.cx
    v = camera.f * X[:, 1] / X[:, 2] + camera.cy
    disparity = camera.f * camera.baseline / X[:, 2]
    moved = replace(right, cur_left=np.column_stack([u, v]), cur_right=np.column_stack([u - disparity, v]))
    unknown = replace(measure, known=None)
    assert np.count_nonzero(unknown(moved) > GROSS) > 10
    worst, words = wrong_example(unknown, moved)
    assert worst is None
    assert "may be right, on something that moves" in words
    none, words = wrong_example(unknown, right)
    assert none is None
    assert f"none of the {len(right)} matches is between 5 and 40 px" in words


@pytest.mark.parametrize("true", [True, False])
def test_a_curve_never_runs_through_the_legend(true: bool) -> None:
    # All errors are tiny, or all are large: the curves are at the left or at the right edge.
    made, (axis,) = figure(230)
    errors = {name: np.full(50, 0.01 if true else 90.0) for name in ("kept", "removed", "open")}
    errors_chart(axis, errors)
    FigureCanvasAgg(made).draw()  # type: ignore[no-untyped-call]
    legend = axis.get_legend()
    assert legend is not None
    bottom = legend.get_window_extent().y0
    top = axis.transData.transform((1.0, 100.0))[1]
    assert bottom > top
