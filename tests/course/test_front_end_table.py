"""Chapter 1's comparison of the two front ends, from the measured table."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest

from course.ch01.front_end_table import ABLATION, PAPERS, SEEDS, front_end_lines, front_ends, saved_ms

NOTEBOOK = next((Path(__file__).resolve().parents[2] / "notebooks").glob("01_*.ipynb"))
HEAD = "idea,method,sequence,seeds,te,te_sd,re,re_sd,end,end_sd,length,length_sd,lost,lost_sd,ms\n"
ROWS = f"""
,feature_selection,kitti/00: dark,2,2.0,0.1,1.0,0.0,3.0,0.0,0.1,0.0,0.0,0.0,
,feature_selection,kitti/00,2,1.5,0.1,1.0,0.0,2.0,0.0,0.1,0.0,0.0,0.0,40.0
,moving_selection,kitti/00,2,9.9,0.1,9.0,0.0,9.0,0.0,0.1,0.0,9.0,0.0,41.0
{PAPERS},feature_selection,kitti/00: dark,2,1.0,0.1,-0.5,0.0,4.0,0.0,0.1,0.0,12.5,0.0,
{PAPERS},feature_selection,kitti/00,2,-0.1,0.1,0.25,0.0,0.5,0.0,0.1,0.0,0.0,0.0,8.5
{PAPERS},feature_selection,synthetic/jam,2,5.0,0.1,0.25,0.0,0.5,0.0,0.1,0.0,0.0,0.0,
lens,feature_selection,kitti/00,2,5.0,0.1,0.25,0.0,0.5,0.0,0.1,0.0,0.0,0.0,1.5
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "ablation.csv"
    path.write_text(HEAD + ROWS.strip() + "\n", encoding="utf-8")
    return path


def test_front_ends_are_compared_on_real_drives(table: Path) -> None:
    clean, dark = front_ends(table)
    assert (clean.drive, clean.disturbed) == ("kitti/00", False)
    assert (dark.drive, dark.disturbed) == ("kitti/00: dark", True)
    assert clean.kit == (1.5, 1.0, 0.0)
    assert clean.paper == pytest.approx((1.4, 1.25, 0.0))
    assert dark.paper == pytest.approx((3.0, 0.5, 12.5))
    assert (dark.seeds, dark.deviation) == (2, (0.1, 0.0, 0.0))
    assert saved_ms(table) == 8.5


def test_lines_have_both_front_ends_side_by_side(table: Path) -> None:
    *_, clean, dark, seeds, warning, time = front_end_lines(table).splitlines()
    assert clean.split() == ["kitti/00", "1.50", "1.40", "0.10", "1.00", "1.25", "0.00", "0.0", "0.0"]
    assert dark.split()[2:] == ["2.00", "3.00", "0.10", "1.00", "0.50", "0.00", "0.0", "12.5"]
    assert seeds.startswith("Means over 2 seeds")
    assert warning.endswith("would need 5 seeds to count; here are 2.")
    assert time.endswith("8.5 ms less per frame.")
    assert max(map(len, front_end_lines().splitlines())) <= 90


def test_five_seeds_are_enough(table: Path) -> None:
    table.write_text(table.read_text("utf-8").replace(",2,", ",5,"), encoding="utf-8")
    assert "would need" not in front_end_lines(table)


def test_measured_table_has_clean_and_disturbed_drives() -> None:
    compared = front_ends(ABLATION)
    assert [each.drive for each in compared if not each.disturbed] == [
        "kitti/00",
        "kitti/01",
        "kitti/drive_0013",
    ]
    assert sum(each.disturbed for each in compared) == 18


def test_the_chapter_says_of_two_seeds_what_happened_in_these_runs() -> None:
    """What chapter 1 says about the printed numbers; it claims no smaller error from so few seeds."""
    cells = nbformat.read(NOTEBOOK, as_version=4).cells  # type: ignore[no-untyped-call]
    text = next(cell.source for cell in cells if cell.id == "kit-worth-read")
    compared = {each.drive: each for each in front_ends()}
    if min(each.seeds for each in compared.values()) < SEEDS:
        assert "too few" in text
        assert not re.search(r"smaller|more accurate|nearer|better", text)
    for name in ("kitti/00", "kitti/01"):
        for disturbance in ("alternating", "blurred"):
            drive = compared[f"{name}: {disturbance}"]
            assert drive.kit[2] == 0
            assert drive.paper[2] > 10
    other = [each for each in compared.values() if not each.drive.endswith(("alternating", "blurred"))]
    assert all(each.kit[2] == each.paper[2] for each in other)
