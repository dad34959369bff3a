"""What the cells of chapters 8 and 9 print and draw on a drive without truth, and on a piece of a drive."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import winding_road
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from course.ch07 import figures as figures_7
from course.ch08 import own
from course.ch09 import block_drive
from course.ch09 import exercises as ch09
from course.ch09 import figures as figures_9
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import Sequence, open_folder
from vo_lib.geometry.types import Array

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


class Cells:
    """Cells of a notebook that are run one by one, with names that a test gives in place of others."""

    def __init__(self, notebook: str, setup: str, **names: Any) -> None:
        cells = json.loads((NOTEBOOKS / notebook).read_text(encoding="utf-8"))["cells"]
        self.sources = {cell["id"]: "".join(cell["source"]) for cell in cells}
        self.pictures: list[Figure] = []
        self.names: dict[str, Any] = {}
        imports: list[ast.stmt] = [
            node
            for node in ast.parse(self.sources[setup]).body
            if isinstance(node, (ast.Import, ast.ImportFrom))
        ]
        exec(compile(ast.Module(imports, []), setup, "exec"), self.names)
        self.names |= {
            "with_bar": lambda words, work: work(lambda *_: None),
            "show": lambda *parts: self.pictures.extend(parts),
            "display": lambda *parts: None,
        }
        self.names |= names

    def run(self, cell: str, *changes: tuple[str, str]) -> None:
        source = self.sources[cell]
        for old, new in changes:
            assert source.count(old) == 1, old
            source = source.replace(old, new)
        exec(compile(source, cell, "exec"), self.names)


def words_of(page: Figure) -> str:
    names = [name for axis in page.axes for name in axis.get_legend_handles_labels()[1]]
    return ", ".join([*names, *(axis.get_title("left") for axis in page.axes)])


@pytest.fixture
def untrue(street: Sequence) -> Sequence:
    return replace(street.part(30, 36), truth=None)


def test_the_path_of_the_kit_is_called_so_where_it_stands_in_for_a_truth(
    untrue: Sequence, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = Cells("08_your_own_odometry.ipynb", "own-setup", street=untrue, SEEDS=(0, 1), mine=own.join())
    cells.run("own-question-path")
    assert "no ground truth. The kit's path stands in for it" in capsys.readouterr().out
    right = cells.names["right"]
    given = {"published": [right, right], "kit": [right, right], cells.names["mine"].name: [right, right]}
    cells.names["compared"] = lambda *_: given
    cells.run("own-drive", ("def compared(", "def not_compared("))
    cells.run("own-errors")
    printed = capsys.readouterr().out
    for page in cells.pictures:
        assert "the kit's path" in words_of(page)
        assert "distance from the kit's path" in words_of(page)
        assert "truth" not in words_of(page)
    # The distance of the kit's path from itself would be exactly 0.
    assert "kit," not in words_of(cells.pictures[1]).replace("published, ", "")
    assert "These are no errors" in printed
    assert "TE" not in printed
    assert "RE" not in printed


def test_no_part_is_called_better_without_a_truth(
    untrue: Sequence, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"known": False, "matches": [], "run_methods": lambda *_, **__: {}}
    cells = Cells("08_your_own_odometry.ipynb", "own-setup", street=untrue, SEEDS=(0, 1), **names)
    cells.run("own-decides")
    printed = capsys.readouterr().out
    assert "nothing can be said here" in printed
    assert "shows" not in printed
    assert "%" not in printed


@pytest.mark.parametrize(
    ("yours", "decisive"),
    [((1.0, 1.01, 1.02), "the kit's rotations"), ((0.2, 1.0, 2.4), "none of the three")],
)
def test_the_decisive_part_is_named_only_where_a_change_shows(
    yours: tuple[float, ...], decisive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = Cells("08_your_own_odometry.ipynb", "own-setup", street=None, SEEDS=(0, 1, 2), matches=[])
    cells.names |= {"known": False, "run_methods": lambda *_, **__: {}, "street": np}
    cells.run("own-decides", ("{street.name}", ""))
    cells.names["errors_of"] = lambda runs: np.array([runs, runs], float).T
    errors: dict[str, Any] = {
        name: yours for name in ("your loop", "the library's loop", "the kit's features")
    }
    errors |= {"the kit's rotations": (0.3, 0.31, 0.3), "the kit's translations": (0.99, 1.0, 1.01)}
    cells.names["print_changes"]({**errors, "all three the kit's": (0.1, 0.1, 0.1)})
    printed = capsys.readouterr().out
    assert f"decisive for TE: {decisive}" in printed
    assert f"decisive for RE: {decisive}" in printed
    assert "-7" in printed  # the change is printed in any case


def test_the_text_names_no_decisive_part_that_the_table_may_not_have() -> None:
    cells = Cells("08_your_own_odometry.ipynb", "own-setup")
    for cell in ("own-decides-read", "own-summary"):
        assert "it is the rotation" not in cells.sources[cell]
        assert "that is the rotation" not in cells.sources[cell]
    assert "to the last digit" not in cells.sources["own-question"]


@pytest.mark.parametrize(("turn", "step"), [(0.0, 0.6), (0.05, 0.6), (0.05, 1.2)])
def test_no_name_covers_a_path(turn: float, step: float) -> None:
    truth = winding_road(60, turn, step)
    runs = {name: winding_road(60, turn * 0.8, step) for name in ("published", "0 of 14 stages yours")}
    page = figures_7.paths_figure("thirty frames", truth, runs)
    FigureCanvasAgg(page).draw()  # type: ignore[no-untyped-call]
    axis = page.axes[0]
    legend = axis.get_legend()
    assert legend is not None
    box = legend.get_window_extent()
    for line in axis.get_lines():
        pixels = axis.transData.transform(np.asarray(line.get_xydata()))
        assert not any(box.contains(*point) for point in pixels)
        assert axis.bbox.padded(1).count_contains(pixels) == len(pixels)


def test_a_piece_of_a_drive_is_compared_in_the_axes_of_its_first_frame(
    capsys: pytest.CaptureFixture[str],
) -> None:
    some = ensure_scene(scene_config("block", **block_drive.SMALL), frames=range(150, 159), jobs=1)
    drawn = open_folder(some, "block")
    first = drawn.frames.index("000150")
    piece = drawn.part(first, first + 8)
    assert np.linalg.norm(piece.true_poses[0, :3, 3]) > 20.0
    cells = Cells("09_coming_back.ipynb", "back-setup", given=piece)
    cells.run(
        "back-setup", ('load(other) if other else with_bar("drawing the block", lesson.block)', "given")
    )
    cells.names["show"] = lambda *parts: cells.pictures.extend(parts)
    cells.names["with_bar"] = lambda words, work: work(lambda *_: None)
    cells.run("back-run")
    end = float(capsys.readouterr().out.split("the path ends ")[1].split(" m")[0])
    assert end < 0.5
    for line in cells.pictures[0].axes[0].get_lines():
        np.testing.assert_allclose(np.asarray(line.get_xydata())[0], 0.0, atol=1e-9)


def by_the_tutorial(p_i: Array, p_j: Array, m: Array) -> Array:
    return ch09.usual_residual(p_i, p_j, m)


def test_a_residual_is_compared_in_the_axes_that_it_uses() -> None:
    def empty(p_i: Array, p_j: Array, m: Array) -> None: ...

    def wrong(p_i: Array, p_j: Array, m: Array) -> Array:
        return 2.0 * ch09.usual_residual(p_i, p_j, m)

    assert ch09.residual_in_the_axes_of(by_the_tutorial) is ch09.usual_residual
    for answer in (ch09.edge_residual, empty, wrong, lambda *_: 1 / 0):
        assert ch09.residual_in_the_axes_of(answer) is ch09.edge_residual


def by_a_covariance(r: Array, sigma: Array, c: float) -> Array:
    information = np.linalg.inv(np.diag(sigma**2))
    return np.array([1.0 / (1.0 + row @ information @ row / c**2) for row in r])


def row_by_row(r: Array, sigma: Array, c: float) -> list[float]:
    return [1.0 / (1.0 + sum((a / s) ** 2 for a, s in zip(row, sigma, strict=True)) / c**2) for row in r]


@pytest.mark.parametrize("answer", [by_a_covariance, row_by_row])
def test_the_cell_calls_weights_as_the_check_does(answer: Any) -> None:
    assert ch09.weights.grade(answer).passed
    cells = Cells("09_coming_back.ipynb", "back-setup", ch09=ch09)
    cells.names["config"] = block_drive.CONFIG
    cells.run("back-plane")
    source = cells.sources["back-x5-own"]
    exec(source[: source.index("weights_of = own_or_library")], cells.names)
    places = cells.names["corner"]
    graph = cells.names["triangle"]
    got = cells.names["closed_with_weights"](places, graph, answer, 3.0)
    expected = cells.names["closed_with_weights"](places, graph, ch09.loop_weights, 3.0)
    np.testing.assert_allclose(got[0], expected[0])
    np.testing.assert_allclose(got[1], expected[1])


def overlaps(axis: Axes) -> bool:
    name = axis.yaxis.label.get_window_extent()
    return any(
        name.overlaps(label.get_window_extent()) for label in axis.get_yticklabels() if label.get_text()
    )


def test_the_name_of_an_axis_is_beside_its_numbers_and_on_the_page() -> None:
    weights = np.array([0.864, 0.991, 0.0])
    residuals = np.array([[1.1, -2.8, 0.0], [2.9, -2.8, 0.1]])
    for page in (
        figures_9.bars_by_loop({"yours": weights, "library": weights}, "weight", "weights"),
        figures_9.residual_vectors("yours", residuals, residuals, "the place again"),
        figures_9.residual_vectors("yours", 1e-16 * residuals, 0.0 * residuals, "the first edges"),
        figures_9.residual_vectors("yours", 1e-3 * residuals, 0.0 * residuals, "the first edges"),
    ):
        FigureCanvasAgg(page).draw()  # type: ignore[no-untyped-call]
        axis = page.axes[0]
        assert not overlaps(axis)
        assert axis.yaxis.label.get_window_extent().x0 >= 0.0


def test_the_truth_is_seen_where_paths_coincide() -> None:
    road = winding_road(20, 0.05, 1.0)
    page = figures_9.closing_figure(road, road, {"closed": road})
    lines = {str(line.get_label()): line for line in page.axes[0].get_lines()}
    assert lines["truth"].get_zorder() > lines["before"].get_zorder() > lines["closed"].get_zorder()
    assert lines["truth"].get_linewidth() < lines["before"].get_linewidth() < lines["closed"].get_linewidth()
