"""Chapter 1's comparison of the two front ends, from the measured table."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import nbformat
import pytest

from course.ch01.front_end_table import (
    ABLATION,
    PAPERS,
    TIMED_FRAMES,
    Times,
    front_end_lines,
    front_ends,
    times,
)
from measure import ablation as measurement
from measure.ablation import IDEAS, Ablation, read_row
from vo_lib.data.tables import read_csv

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
WITH_LOSSES = ("alternating", "blurred")  # disturbances with which the paper's front end loses frames
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
    assert times(table) == Times("kitti/00", 40.0, 48.5)


def test_lines_have_both_front_ends_side_by_side(table: Path) -> None:
    *_, clean, dark, seeds, star, rule, runs, time = front_end_lines(table).splitlines()
    assert clean.split() == ["kitti/00", "1.50", "1.40", "0.10", "1.00", "1.25*", "0.00", "0.0", "0.0"]
    # TE of the dark drive changes by 1.0, more than 2 √(0.1² + 0.2²).
    assert dark.split()[2:] == ["2.00", "3.00*", "0.10", "1.00", "0.50*", "0.00", "0.0", "12.5"]
    assert seeds.startswith("Means over 2 seeds")
    assert "one run would show" in star
    assert "difference between two runs" in rule
    assert runs.endswith("on the first 40 frames of kitti/00:")
    assert time == "40.0 ms a frame with the kit's front end, 48.5 ms with the paper's."
    assert max(map(len, front_end_lines().splitlines())) <= 90


def test_a_star_asks_for_both_deviations_and_two_per_cent(table: Path) -> None:
    """The deviation with the paper's front end is not in the file: it counts with the most that it can be."""
    (clean, _) = front_ends(table)

    def shown(change: float, own: float, of_change: float) -> bool:
        drive = replace(clean, kit=(1.5,), change=(change,), kit_deviation=(own,), deviation=(of_change,))
        return drive.shows(0)

    limit = 2 * math.hypot(0.1, 0.1 + 0.2)
    assert shown(1.01 * limit, 0.1, 0.2)
    assert not shown(0.99 * limit, 0.1, 0.2)
    assert not shown(0.029, 0.0, 0.0)  # of 1.5
    assert shown(-0.031, 0.0, 0.0)


def test_measured_table_has_clean_and_disturbed_drives() -> None:
    compared = front_ends(ABLATION)
    assert [each.drive for each in compared if not each.disturbed] == [
        "kitti/00",
        "kitti/01",
        "kitti/drive_0013",
    ]
    assert sum(each.disturbed for each in compared) == 18


def text_of(notebook: str, cell: str) -> str:
    """The source of a cell."""
    cells = nbformat.read(next(NOTEBOOKS.glob(notebook)), as_version=4).cells  # type: ignore[no-untyped-call]
    return str(next(each.source for each in cells if each.id == cell))


def shares(number: int) -> dict[str, float]:
    """The change of an error with the paper's front end by drive, as a share of the kit's."""
    return {each.drive: each.change[number] / each.kit[number] for each in front_ends()}


def test_chapter_and_appendix_say_the_same_of_clean_drives() -> None:
    """Not more accurate: no drive shows it in TE, and one of three in RE."""
    assert {each.seeds for each in front_ends()} == {2}
    assert "Two seeds give only a rough standard deviation" in text_of("01_*.ipynb", "kit-worth-read")
    clean = [each for each in front_ends() if not each.disturbed]
    te = [shares(0)[each.drive] for each in clean]
    assert min(te) < 0 < max(te)
    assert max(map(abs, te)) < 0.02
    assert not any(each.shows(0) for each in clean)
    assert [each.drive for each in clean if each.shows(1)] == ["kitti/01"]
    percent = f"{100 * shares(1)['kitti/01']:.1f} %"
    assert percent == "3.6 %"
    chapter = text_of("01_*.ipynb", "kit-worth-read")
    assert "not more accurate on clean drives" in chapter
    assert f"on 01, where it is {percent} higher with the paper's" in chapter
    assert "TE has no star on any of the three: it differs by less than 2 %, now up, now down" in chapter
    appendix = text_of("appendix_*.ipynb", "benefit")
    assert "does not make them more accurate" in appendix
    assert "TE changes by less than 2 % on each of the three, up or down" in appendix
    assert f"on 01 alone, where it grows by {percent}" in appendix


def test_the_chapter_names_the_lost_frames_and_their_reasons() -> None:
    chapter = text_of("01_*.ipynb", "kit-worth-read")
    compared = {each.drive: each for each in front_ends()}
    assert all(each.kit[2] == 0 for each in compared.values())
    lost = {name: each.paper[2] for name, each in compared.items() if each.paper[2] > 0}
    assert lost.keys() == {f"kitti/{drive}: {kind}" for drive in ("00", "01") for kind in WITH_LOSSES}
    assert lost["kitti/00: alternating"] > 99 / 2
    assert lost["kitti/01: alternating"] == 50  # of 51 frames
    assert f"lost {lost['kitti/00: blurred']:g} and {lost['kitti/01: blurred']:g} frames" in chapter
    ablation = Ablation([read_row(cells) for _, cells in read_csv(ABLATION)[1:]])
    steps = [idea.name for idea in IDEAS if any("matching." in name for name in idea.off)]
    steps.remove(PAPERS)

    def lost_without(step: str, drive: str) -> float:
        row = ablation.row(step, drive)
        assert row is not None
        return row.mean["lost"]

    exposure = "equal exposure for the second search"
    assert lost_without(exposure, "kitti/00: alternating") == 99
    assert lost_without(exposure, "kitti/01: alternating") == 50
    of_blur = [lost_without(step, f"kitti/{drive}: blurred") for step in steps for drive in ("00", "01")]
    assert max(of_blur) == 2
    assert "whichever step of the kit's front end is turned off, at most two frames are lost" in chapter
    brighter = [100 * shares(0)[f"kitti/{drive}: unequal"] for drive in ("00", "01")]
    assert "TE is {:.0f} and {:.0f} % higher with the paper's".format(*brighter) in chapter
    assert shares(0)["kitti/01: blurred"] < 0
    kinds = (*WITH_LOSSES, "unequal")
    rest = [each for each in compared.values() if each.disturbed and not each.drive.endswith(kinds)]
    signs = {each.change[number] > 0 for each in rest for number in (0, 1) if each.shows(number)}
    assert signs == {True, False}


def test_the_chapter_says_what_was_timed() -> None:
    chapter = text_of("01_*.ipynb", "kit-worth-read")
    measured = times()
    assert TIMED_FRAMES == measurement.TIMED_FRAMES
    assert f"by {measured.paper - measured.kit:.1f} ms a frame" in chapter
    assert f"one measurement on {TIMED_FRAMES} frames" in chapter
    rows = [read_row(cells) for _, cells in read_csv(ABLATION)[1:]]
    timed = [row for row in rows if row.idea and row.sequence == measured.drive]
    idle = [abs(row.ms) for row in timed if not any(row.mean.values())]
    assert len(idle) == 5
    assert "five other ideas of the kit change no number on this drive" in chapter
    assert f"differs by up to {max(idle):.1f} ms" in chapter
