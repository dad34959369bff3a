"""The main job with nothing downloaded, and tables over seeds, on small scenes drawn here."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from vo_lib import METHODS, DataError, open_sequence
from vo_lib.cli import main
from vo_lib.report import Picture, ReportTable, render_report
from vo_lib.reproduce import compare_methods, markdown, parse_sequences
from vo_lib.synthetic import SCENES, scene_config


@pytest.fixture
def small_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes of the real names, but short and small."""
    for name in ("traffic", "jam"):
        tiny = scene_config(name, length=12.0, width=480, height=200)
        monkeypatch.setitem(SCENES, name, tiny)


@pytest.mark.usefixtures("small_scenes")
def test_the_demo_draws_runs_and_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "runs" / "demo"
    arguments = ["demo", "--cache", str(tmp_path / "cache"), "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "What next" in printed
    assert all(method in printed for method in METHODS)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == page.count("data:image/") == 2
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    for method in METHODS:
        poses = (out / method / "poses.txt").read_bytes()
        log = (out / method / "frames.csv").read_bytes()
        assert len(poses.splitlines()) == len(log.splitlines()) >= 10
    # The second time nothing is drawn, and the result is the same to the byte.
    drawn = sorted(p.stat().st_mtime_ns for p in (tmp_path / "cache").rglob("*.png"))
    assert main(arguments) == 0
    assert sorted(p.stat().st_mtime_ns for p in (tmp_path / "cache").rglob("*.png")) == drawn
    assert (out / method / "poses.txt").read_bytes() == poses


@pytest.mark.usefixtures("small_scenes")
def test_a_damaged_cache_is_drawn_anew(tmp_path: Path) -> None:
    first = open_sequence("synthetic/traffic", cache=tmp_path)
    image = first.folder / "image_0" / "000003.png"
    whole = image.read_bytes()
    image.write_bytes(whole[:1000])
    again = open_sequence("synthetic/traffic", cache=tmp_path)
    assert (again.folder / "image_0" / "000003.png").read_bytes() == whole


def test_an_unknown_scene_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["run", "synthetic/jamm", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "jamm" in error
    assert "traffic" in error
    assert len(error.splitlines()) == 1


def test_all_scenes_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "--json"]) == 0
    assert {f"synthetic/{name}" for name in SCENES} <= set(json.loads(capsys.readouterr().out))


def test_a_table_over_seeds_is_printed_and_written(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = bands.parent / "table"
    arguments = ["--sequences", str(bands), "--methods", "mesvo_f", "--seeds", "2", "--out", str(out)]
    assert main(["reproduce", *arguments]) == 0
    text = (out / "table.md").read_text(encoding="utf-8")
    assert "mesvo_f" in text
    assert "2 seeds" in capsys.readouterr().out
    assert main(["reproduce", *arguments[:4], "--seeds", "0", "--out", str(out)]) == 2
    assert main(["reproduce", *arguments[:2], "--methods", "mesvo", "--out", str(out)]) == 2


def test_the_spread_over_seeds_is_that_of_single_runs(bands: Path) -> None:
    sequence = open_sequence(bands)
    errors, words = compare_methods(sequence, ["mesvo_f", "solution_selection"], 3)
    assert words.startswith("20, 50")
    assert [len(e.te) for e in errors.values()] == [3, 3]
    assert all(np.isnan(e.te).all() for e in errors.values())  # the path is 2.5 m long


def test_sequence_numbers_and_ranges_mean_kitti() -> None:
    assert parse_sequences("00,02-04,synthetic/jam,a/b") == [
        "kitti/00",
        "kitti/02",
        "kitti/03",
        "kitti/04",
        "synthetic/jam",
        "a/b",
    ]
    for wrong in ("05-03", "00,,01", ""):
        with pytest.raises(DataError, match="--sequences"):
            parse_sequences(wrong)


def test_reports_escape_their_text() -> None:
    table = ReportTable("<b>", ["a & b"], [["<script>"]], ["1 < 2"])
    page = render_report("t", ["<i>"], [table], [Picture(b"\x89PNG", "<img>")], ["x"])
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "data:image/png;base64,iVBORw==" in page


def test_markdown_has_a_rule_under_its_heading() -> None:
    assert markdown(["a", "b"], [["1", "2"]]) == "| a | b |\n| --- | --- |\n| 1 | 2 |\n"
