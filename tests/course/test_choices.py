"""Numbers of chapters 5 and 7 that are read from measured tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from course.ch05.claim import CHOICES, by_threshold, threshold_figure, whole_drive
from course.ch07.figures import choice_ratios

DRIVES = "kitti/drive_0013", "synthetic/jam"
ROWS = """
threshold and boxes,"1 px, all features",kitti/drive_0013,2.7,0.02,1.17,0.09,,
threshold and boxes,"0.25 px, all features",kitti/drive_0013,2.8,0.03,0.25,0.05,,
threshold and boxes,"1 px, boxes removed",kitti/drive_0013,2.8,0.01,0.26,0.03,,
threshold and boxes,"0.25 px, boxes removed",kitti/drive_0013,2.8,0.03,0.23,0.01,,
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """The table of choices, whose rows on thresholds and boxes are only from one drive."""
    lines = [line for line in CHOICES.read_text("utf-8").splitlines() if "threshold and boxes" not in line]
    path = tmp_path / "choices.csv"
    path.write_text("\n".join(lines) + ROWS, encoding="utf-8")
    return path


def test_errors_over_the_threshold_are_drawn_with_boxes_and_without(table: Path) -> None:
    measured = by_threshold(table)
    of_all = [[0.25, 0.25, 0.05], [1, 1.17, 0.09]]
    np.testing.assert_array_equal(measured["kitti/drive_0013", "all features"], of_all)
    np.testing.assert_array_equal(measured["kitti/drive_0013", "boxes removed"][1], [1, 0.26, 0.03])
    (drawn,) = threshold_figure(measured).axes
    assert [each.get_text() for each in drawn.get_xticklabels()] == ["0.25", "1"]
    np.testing.assert_array_equal(drawn.get_lines()[0].get_ydata(), [0.25, 1.17])
    assert set(by_threshold()) == {
        (name, boxes) for name in DRIVES for boxes in ("all features", "boxes removed")
    }


def test_rows_that_are_no_differences_are_no_choices(table: Path) -> None:
    assert choice_ratios(table) == choice_ratios()
    assert "threshold and boxes" not in choice_ratios(table)


def test_a_row_of_the_results_is_read_with_the_names_of_its_columns() -> None:
    for section, row in (
        ("Variant published", "synthetic/parked"),
        ("Variant published", "kitti/00, 100 m"),
        ("Variant kit", "kitti/drive_0013, 50 m, axes removed"),
    ):
        cells = whole_drive(section, row)
        for method in ("solution_selection", "feature_selection"):
            assert re.fullmatch(r"[\d.]+ ± [\d.]+ / [\d.]+ ± [\d.]+", cells[method]), (row, method)
