"""Chapter 2: its puzzle, its own view of the library's functions, and what its text says about bad scenes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest

from course.ch02 import exercises, library
from course.ch02.puzzle import LEAST_SOLUTIONS, OFF_LINE_PX, ON_LINE_PX, find_puzzle
from course.frames import frame_points, scene_truth
from course.simulation.problems import random_problems
from course.simulation.true_matches import predict
from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.motion import essential_from_motion, rotation_angle
from vo_lib.geometry.types import Array
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import resolve_by_depth

NOTEBOOK = Path(__file__).resolve().parents[2] / "notebooks" / "02_five_point.ipynb"


def cells() -> dict[str, str]:
    """The sources of the chapter's cells by their ids."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)  # type: ignore[no-untyped-call]
    return {cell.id: cell.source for cell in notebook.cells}


def run(source: str, names: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> str:
    """What a cell prints."""
    exec(source, names)
    return capsys.readouterr().out


@pytest.mark.parametrize("frame", [20, 40, 60, 80])
def test_in_the_puzzle_the_sixth_match_fits_one_solution_alone(street: Sequence, frame: int) -> None:
    points = frame_points(street, frame, preset("solution_selection"))
    puzzle = find_puzzle(points, street.camera.f)
    assert len(puzzle.E) >= LEAST_SOLUTIONS
    assert puzzle.sixth not in puzzle.five
    place = [puzzle.sixth]
    away = [
        street.camera.f * float(library.distances(E, points.x_p[place], points.x_c[place])[0])
        for E in puzzle.E
    ]
    assert away[0] <= ON_LINE_PX
    assert min(away[1:]) > OFF_LINE_PX
    fits = [
        np.abs(library.rows(points.x_p[puzzle.five], points.x_c[puzzle.five]) @ E.ravel()).max()
        for E in puzzle.E
    ]
    assert max(fits) < 1e-9
    untrue = find_puzzle(replace(points, T_cp=None), street.camera.f)
    np.testing.assert_array_equal(untrue.five, puzzle.five)


@pytest.mark.parametrize("frame", [20, 40, 60, 80])
def test_the_sixth_match_of_the_puzzle_is_at_its_true_place(street: Sequence, frame: int) -> None:
    points = frame_points(street, frame, preset("solution_selection"))
    puzzle = find_puzzle(points, street.camera.f)
    known = scene_truth(street)
    assert known is not None
    place, _, valid = predict(known, frame - 1, frame, points.matches.prev_left)
    error = np.where(valid, np.linalg.norm(place - points.matches.cur_left, axis=1), np.nan)
    assert error[puzzle.sixth] < 1.0
    motion = library.choose_motion(library.four_motions(puzzle.E[0]), points.x_p, points.x_c)
    sixth = [puzzle.sixth]
    assert np.min(library.two_depths(motion, points.x_p[sixth], points.x_c[sixth])) > 0
    # Of the matches on their lines, many have another place: the line alone does not tell.
    on_line = street.camera.f * library.distances(puzzle.E[0], points.x_p, points.x_c) < ON_LINE_PX
    assert np.nanmax(error[on_line]) > 10.0


def test_few_matches_give_a_puzzle_without_a_sixth_that_separates(street: Sequence) -> None:
    points = frame_points(street, 60, preset("solution_selection"))
    seven = replace(points, x_p=points.x_p[:7], x_c=points.x_c[:7], X_p=points.X_p[:7])
    assert len(find_puzzle(seven, street.camera.f).E) > 0


def test_points_in_front_choose_the_motion_that_the_depths_choose() -> None:
    given = random_problems(np.random.default_rng(5), 50, 30, noise_px=0.3)
    for scene in range(50):
        E = essential_from_motion(given.R_cp[scene], given.t_cp[scene])
        views = given.x_p[scene], given.x_c[scene]
        chosen = library.choose_motion(library.four_motions(-E), *views)
        R, t = resolve_by_depth(E, given.x_c[scene], given.X_p[scene])
        np.testing.assert_allclose(chosen, np.column_stack([R, t]), atol=1e-9)
        np.testing.assert_allclose(R, given.R_cp[scene], atol=1e-9)


def test_the_example_by_hand_has_the_numbers_of_the_text() -> None:
    E = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    expected = {(1, -1): (2, 1), (1, 1): (-2, -1), (-1, -1): (2 / 3, -1 / 3), (-1, 1): (-2 / 3, 1 / 3)}
    match = np.array([[0.5, 0.25]]), np.array([[1.0, 0.5]])
    for motion in library.four_motions(E):
        key = round(motion[0, 0]), round(motion[2, 3])
        np.testing.assert_allclose(
            np.ravel(library.two_depths(motion, *match)), expected.pop(key), atol=1e-12
        )
    assert not expected


def test_the_text_on_planes_neighbours_and_rotations_holds(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {
        "np": np,
        "five_point": five_point,
        "library": library,
        "show": lambda *pictures: None,
        "resolve_by_depth": resolve_by_depth,
        "rotation_angle": rotation_angle,
    }
    source = cells()
    exec("from course.simulation.problems import FOCAL, random_problems", names)
    exec("from vo_lib.paper.selection import truncated_errors", names)
    exec(source["scenes"], names)
    fits = dict(re.findall(r"([\w ]+?) *: ([.\d]+) solutions", run(source["exact"], names, capsys)))
    assert fits == {"general": "1.0", "neighbours": "1.0", "a plane": "2.0", "pure rotation": "0.0"}
    table = run(source["degeneracy"], names, capsys)
    lines = re.findall(r"([\w ]+?) *, (one|vote).*error (\S+)°.*wrong: +(\d+)%", table)
    wrong = {(kind, way): int(share) for kind, way, _, share in lines}
    median = {(kind, way): float(error) for kind, way, error, _ in lines}
    # The vote removes gross errors of neighbours, not the rest.
    assert 5.5 < median["neighbours", "vote"] / median["general", "vote"] < 7.0
    assert "about six times here" in source["cell-29"]
    assert wrong["general", "one"] > 10
    assert wrong["general", "vote"] == 0
    assert wrong["neighbours", "one"] > 2 * wrong["general", "one"]
    assert wrong["neighbours", "vote"] < 5
    assert 40 <= wrong["a plane", "vote"] < 50
    assert wrong["pure rotation", "vote"] == 0
    assert "nearly half of the winners are more than 2° wrong" in source["cell-29"]


def test_the_second_depth_may_be_taken_from_the_point() -> None:
    def depths(motion: Array, x_p: Array, x_c: Array) -> tuple[Array, Array]:
        d_p, _ = library.two_depths(motion, x_p, x_c)
        X_c = d_p[:, None] * (library.homogeneous(x_p) @ motion[:, :3].T) + motion[:, 3]
        return d_p, X_c[:, 2]

    assert exercises.two_depths.grade(depths).passed
