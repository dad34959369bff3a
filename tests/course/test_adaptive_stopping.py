"""Chapter 3: where adaptive stopping ends, also when the sets drawn are never enough."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from course.candidates import candidates_of
from course.ch03 import figures
from course.ch03.comparisons import adaptive_stopping
from course.minutes import cells_of
from course.notebook_folder import NOTEBOOKS
from course.simulation.drives import CAMERA, Scene, SimulatedPoints, points_by_frame
from course.simulation.tracks import TrackConfig

NOTEBOOK = NOTEBOOKS / "03_solution_selection.ipynb"
LIMIT = 1.0 / CAMERA.f  # of an inlier, normalised units
ORDERS = 4


def points_with(wrong: float) -> SimulatedPoints:
    """The matches of a simulated frame, of which a share is wrong."""
    return next(points_by_frame(Scene(TrackConfig(wrong=wrong)), 1, seed=0))


@pytest.mark.parametrize(("wrong", "sets"), [(0.0, 1), (0.0, 60), (0.2, 60), (0.6, 60), (0.6, 1), (0.75, 8)])
def test_drawing_stops_when_enough_sets_are_drawn_or_after_all(wrong: float, sets: int) -> None:
    points = points_with(wrong)
    candidates = candidates_of(points, sets, draw=1)
    drawn = len(np.unique(candidates.set_index))
    needed, best, stop = adaptive_stopping(candidates, points, LIMIT, ORDERS)
    assert needed.shape == best.shape == (ORDERS, drawn)
    for required, last in zip(needed, stop, strict=True):
        enough = [number for number in range(1, drawn + 1) if required[number - 1] <= number]
        assert last == (enough[0] if enough else drawn)


def test_the_notebook_claims_no_stop_that_did_not_happen(capsys: pytest.CaptureFixture[str]) -> None:
    points = points_with(0.75)
    candidates = candidates_of(points, 8, draw=1)
    cells = {cell["id"]: "".join(cell["source"]) for cell in cells_of(NOTEBOOK)}
    names: dict[str, Any] = {
        "E": candidates.E,
        "set_index": candidates.set_index,
        "points": points,
        "tau": LIMIT,
        "np": np,
        "draw": figures,
        "show": lambda figure: figure,
    }
    exec(cells["stopping"], names)
    assert (names["needed"] > np.arange(1, 9)).all()
    first, second = capsys.readouterr().out.splitlines()
    assert first == "stop after 8 to 8 of 8 sets, median 8"
    image_error = f"{names['best'][0, -1]:.3f}"
    assert second == f"image error of the winner: {image_error} there, {image_error} after all sets"
