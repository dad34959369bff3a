"""Numbers of chapters 5 and 7 that are read from measured tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from course.ch05.claim import (
    by_threshold,
    threshold_figure,
    whole_drive_line,
)
from course.ch07.figures import choice_ratios
from course.measured_results import CHOICES, whole_drive_errors
from vo_lib.evaluation.statistics import one_run_shows

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
        errors = whole_drive_errors(section, row)
        for method in ("solution_selection", "feature_selection"):
            te, re_, te_sd, re_sd = errors[method]
            assert te > te_sd >= 0.0, (row, method)
            assert re_ > re_sd >= 0.0, (row, method)


def test_chapter_5_agrees_with_the_table_on_thresholds_and_boxes() -> None:
    measured = by_threshold()
    shown = {}
    for name in ("kitti/drive_0013", "synthetic/jam"):
        pairs = zip(measured[name, "all features"], measured[name, "boxes removed"], strict=True)
        shown[name] = {
            kept[0]: bool(one_run_shows(kept[1], kept[2], removed[1], removed[2])) for kept, removed in pairs
        }
    assert shown["kitti/drive_0013"] == {0.25: False, 0.5: False, 1.0: True, 2.0: True}
    assert all(shown["synthetic/jam"].values())
    kept, removed = (measured["kitti/drive_0013", boxes][:, 1] for boxes in ("all features", "boxes removed"))
    assert removed[1] / kept[1] == pytest.approx(2 / 3, abs=0.03)
    assert kept[2] > 4 * removed[2]


def test_chapter_5_agrees_with_the_table_on_the_kit_on_whole_drives() -> None:
    def words(drive: str) -> list[str]:
        return re.findall(r"\((better|worse|not shown)\)", whole_drive_line("Variant kit", drive))

    assert words("synthetic/highway") == words("synthetic/parked") == ["better", "better"]
    assert words("synthetic/traffic")[0] == "worse"
    assert words("kitti/drive_0013, 50 m, axes removed") == ["not shown", "worse"]
    drives = ("synthetic/parked", "synthetic/traffic", "kitti/drive_0013, 50 m, axes removed")
    for errors in (whole_drive_errors("Variant kit", drive) for drive in drives):
        for method in ("solution_selection", "feature_selection"):
            assert (2 * errors[method][2:] < 0.05 * errors[method][:2]).all()
    last = {
        variant: whole_drive_errors(f"Variant {variant}", drives[-1])[method][1]
        for variant, method in (("kit", "solution_selection"), ("published", "feature_selection"))
    }
    assert last == {"kit": 0.227, "published": 0.231}
