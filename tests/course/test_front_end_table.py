"""Chapter 1's comparison of the two front ends, from the measured table."""

from __future__ import annotations

from pathlib import Path

import pytest

from course.ch01.front_ends import ABLATION, PAPERS, front_end_lines, front_ends, saved_ms

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
    assert clean.kit == (1.5, 1.0, 2.0, 0.0)
    assert clean.paper == pytest.approx((1.4, 1.25, 2.5, 0.0))
    assert dark.paper == pytest.approx((3.0, 0.5, 7.0, 12.5))
    assert saved_ms(table) == 8.5


def test_lines_have_both_front_ends_side_by_side(table: Path) -> None:
    *_, clean, dark, time = front_end_lines(table).splitlines()
    assert clean.split() == ["kitti/00", "1.50", "1.40", "1.00", "1.25", "2.00", "2.50", "0.0", "0.0"]
    assert dark.split()[2:] == ["2.00", "3.00", "1.00", "0.50", "3.00", "7.00", "0.0", "12.5"]
    assert time.endswith("8.5 ms less per frame.")
    assert max(map(len, front_end_lines().splitlines())) <= 90


def test_measured_table_has_clean_and_disturbed_drives() -> None:
    compared = front_ends(ABLATION)
    assert [each.drive for each in compared if not each.disturbed] == [
        "kitti/00",
        "kitti/01",
        "kitti/drive_0013",
    ]
    assert sum(each.disturbed for each in compared) == 18


def test_the_kits_front_end_is_robust_and_faster_but_not_more_accurate() -> None:
    """What chapter 1 says about the printed numbers."""
    compared = {each.drive: each for each in front_ends()}
    clean = [each for each in compared.values() if not each.disturbed]
    # On clean drives, neither front end has the smaller error throughout.
    better = {each.change[error] > 0 for each in clean for error in (0, 1)}
    assert better == {True, False}
    for error in (0, 1):
        assert all(abs(each.change[error]) < 0.05 * each.kit[error] for each in clean)
    for name in ("kitti/00", "kitti/01"):
        flicker = compared[f"{name}: alternating"]
        assert flicker.kit[3] == 0
        assert flicker.paper[3] > 20
        assert flicker.paper[2] > 2 * flicker.kit[2]
        blurred = compared[f"{name}: blurred"]
        assert blurred.kit[3] == 0
        assert blurred.paper[3] > 10
        assert blurred.paper[2] < blurred.kit[2]
        assert compared[f"{name}: unequal"].paper[2] > compared[f"{name}: unequal"].kit[2]
    backwards = compared["kitti/01: reversed"]
    assert all(backwards.paper[error] > backwards.kit[error] for error in (0, 1))
    assert all(each.kit[3] <= each.paper[3] for each in compared.values())
    assert saved_ms() > 4.0
