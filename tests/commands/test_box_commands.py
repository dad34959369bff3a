"""Boxes shown and rules compared: `vo boxes`, its pictures, and the table of box rules."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import with_box, write_bands
from data_command import load

from vo_lib.beyond.box_tracks import MOVING, PARKED, UNKNOWN
from vo_lib.commands.cli import main
from vo_lib.core.boxes import Boxes
from vo_lib.core.matches import empty_matches
from vo_lib.core.types import Array
from vo_lib.tables.plots import match_image

measure_results = load("measure_results")
measure_choices = load("measure_choices")


@pytest.fixture
def labelled(tmp_path: Path) -> Path:
    """Thirteen frames of standing bands, 6 m, with a box in each that holds only what stands."""
    folder = write_bands(tmp_path / "bands", 13)
    return with_box(folder, 13, "7 0.25 0.8 0.3 0.3 0.75\n")


def drawn(state: int, *words: str, top: float = 40.0) -> Array:
    """A grey picture with one box."""
    image, nothing = np.full((120, 200), 60, np.uint8), empty_matches()
    box = Boxes(np.array([[20.0, top, 160.0, 90.0]]), np.array([2]), np.ones(1))
    return np.asarray(
        match_image(image, nothing, np.zeros(0, np.bool_), box, np.array([state]), words), float
    )


def test_moving_parked_and_unknown_boxes_differ_in_their_line() -> None:
    upper = {state: drawn(state)[40, 20:161] for state in (MOVING, PARKED, UNKNOWN)}
    white = {state: np.mean(np.all(line > 200, axis=1)) for state, line in upper.items()}
    assert white[MOVING] > 0.95
    assert 0.5 < white[PARKED] < 0.8
    assert 0.2 < white[UNKNOWN] < 0.5


@pytest.mark.parametrize("top", [40.0, 0.0])
def test_words_stand_above_their_box_and_inside_the_image(top: float) -> None:
    plain, written = drawn(MOVING, top=top), drawn(MOVING, "0.91 moves", top=top)
    rows = np.flatnonzero((plain != written).any(axis=(1, 2)))
    assert len(rows) > 5
    assert abs(rows.mean() - max(top - 6, 7)) < 6


def test_vo_boxes_prints_each_box_and_draws_each_frame(
    labelled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "pictures"
    assert main(["boxes", str(labelled), "--frames", "2:7", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert printed.count("parked") == 4
    assert printed.count("0.75") == 4
    assert sorted(p.name for p in out.glob("[!.]*")) == [f"{i:06d}.jpg" for i in range(3, 7)]
    picture = cv2.imread(str(out / "000004.jpg"))
    assert picture is not None
    assert picture.shape == (240, 480, 3)


def test_results_are_measured_by_one_command_with_other_seeds_to_check_them(
    labelled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import _result_tables as tables

    monkeypatch.setattr(tables, "SEEDS", range(1))
    monkeypatch.setattr(tables, "CHECKED", range(1, 2))
    monkeypatch.setattr(tables, "SHORT_LENGTHS", (1.0,))
    page = tmp_path / "results.md"
    words = ["--sequences", str(labelled), "--out", str(page), "--cache", str(tmp_path / "cache")]
    words += ["--runs", str(tmp_path / "runs")]
    assert measure_results(words) == 0
    text = page.read_text(encoding="utf-8")
    assert "vo data measure_results" in text
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| bands, 1 m")]
    # A row a variant, the rules of two methods, what learning does; nobody knows the truth of what moves.
    assert [len(row) for row in rows] == [5, 6, 5, 5, 8]
    assert rows[2][-1].startswith("–")
    removed = [int(re.findall(r"(\d+) % gone", cell)[0]) for cell in rows[3][1:4]]
    assert removed[0] == 0 < removed[1]
    assert removed[2] < removed[1]
    before = page.read_bytes()
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").rglob("poses.txt")}
    assert measure_results(words) == 0
    assert page.read_bytes() == before
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    assert measure_results(["--jobs", "0", "--out", str(page)]) == 2


def test_what_other_choices_change_is_written_with_its_spread(
    labelled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import measure_choices as script

    asked = ("as published", "solutions kept k", "rounds", "place kept whole", "boxes of classes")
    monkeypatch.setattr(script, "OPEN", [row for row in script.OPEN if row[0] in asked])
    table = tmp_path / "choices.csv"
    words = ["--sequences", str(labelled), "--cache", str(tmp_path / "cache"), "--out", str(table)]
    assert measure_choices(words) == 0
    with table.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [row["choice"] for row in rows] == [name for name, _, other in script.OPEN for _ in other]
    lengths = {(row["choice"], row["alternative"]): float(row["length"]) for row in rows}
    # The length as published is held against the truth's; the others against that of the same seed.
    assert abs(lengths["as published", ""]) < 1.0
    assert lengths["solutions kept k", "all"] == 0.0
    assert lengths["place kept whole", "current left"] != 0.0
    assert measure_choices(["--jobs", "0", "--out", str(table)]) == 2
