"""The ablation of variant `kit`: ideas, disturbed drives, finished runs, and the decision about an idea."""

from __future__ import annotations

import dataclasses
import itertools
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import winding_road, write_bands
from data_command import load

from measure.ablation import (
    COLUMNS,
    IDEAS,
    RESULTS,
    WHOLE,
    Ablation,
    Row,
    harm,
    read_row,
    row_of,
    tables,
)
from measure.disturbances import DISTURBANCES, GAP_START, Disturbance, disturb, disturbed_drives
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.poses import write_kitti_poses
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import csv_text, read_csv
from vo_lib.geometry.types import Array, Image
from vo_lib.report.page import ReportTable, markdown

FRAMES = 10
BY_NAME = {kind.name: kind for kind in DISTURBANCES}


@pytest.fixture
def long_bands(tmp_path: Path) -> Sequence:
    """The band sequence of ten frames, with a true path that is long enough for errors."""
    write_kitti_poses(write_bands(tmp_path / "bands", FRAMES) / "poses.txt", winding_road(FRAMES, 0.0, 10.0))
    return open_sequence(tmp_path / "bands")


@pytest.fixture
def short_bands(tmp_path: Path) -> Sequence:
    """The band sequence of five frames, for tests that run methods."""
    write_kitti_poses(write_bands(tmp_path / "bands", 5) / "poses.txt", winding_road(5, 0.0, 20.0))
    return open_sequence(tmp_path / "bands")


def levels(sequence: Sequence, index: int, side: int = 0) -> Array:
    return np.asarray(sequence.stereo(index)[side], np.float64)


def test_every_idea_has_settings_of_its_own() -> None:
    ideas = (*WHOLE, *IDEAS)
    assert len({(idea.method, idea.config()) for idea in ideas}) == len(ideas)
    assert len({idea.name for idea in IDEAS}) == len(IDEAS)


def test_eleven_kinds_of_disturbed_drives(long_bands: Sequence, tmp_path: Path) -> None:
    assert len(DISTURBANCES) == 11
    # Few frames are left of a short clip, so its disturbed drives have all frames.
    drives = disturbed_drives(long_bands, tmp_path / "disturbed")
    assert [drive.name for drive in drives] == [
        f"{long_bands.name}: {name}"
        for name in ("alternating", "swinging", "unequal", "blurred", "noisy", "dark", "reversed")
    ]
    assert all(len(drive) == FRAMES for drive in drives)
    assert not [*long_bands.folder.glob("*disturbed*")]


@pytest.mark.parametrize(
    ("name", "frame", "left", "right"),
    [
        ("alternating", 0, 0.65, 0.65),
        ("alternating", 1, 1.35, 1.35),
        ("swinging", 5, 1.5, 1.5),
        ("swinging", 15 % FRAMES, 1.5, 1.5),
        ("unequal", 3, 0.8, 1.3),
        ("dark", 2, 0.15, 0.15),
    ],
)
def test_light_changes_by_the_stated_factors(
    long_bands: Sequence, tmp_path: Path, name: str, frame: int, left: float, right: float
) -> None:
    drive = disturb(long_bands, BY_NAME[name], tmp_path / "disturbed")
    for side, factor in enumerate((left, right)):
        before, after = levels(long_bands, frame, side), levels(drive, frame, side)
        expected = np.clip(factor * before, 0, 255)
        np.testing.assert_allclose(after, expected, rtol=0, atol=0.51)


def test_every_seventh_frame_is_blurred(long_bands: Sequence, tmp_path: Path) -> None:
    drive = disturb(long_bands, BY_NAME["blurred"], tmp_path / "disturbed")
    changed = [i for i in range(FRAMES) if (levels(drive, i) != levels(long_bands, i)).any()]
    assert changed == [6]
    assert levels(drive, 6, 1).std() < 0.8 * levels(long_bands, 6, 1).std()


def test_noise_has_twelve_levels_and_differs_between_images(long_bands: Sequence, tmp_path: Path) -> None:
    drive = disturb(long_bands, BY_NAME["noisy"], tmp_path / "disturbed")
    noise = [levels(drive, i, side) - levels(long_bands, i, side) for i in (0, 1) for side in (0, 1)]
    middle = [np.abs(levels(long_bands, i, side) - 128) < 80 for i in (0, 1) for side in (0, 1)]
    for values, inside in zip(noise, middle, strict=True):
        assert values[inside].std() == pytest.approx(12.0, abs=0.3)
    for one, other in itertools.combinations(noise, 2):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.05


def test_disturbed_images_are_the_same_every_time(long_bands: Sequence, tmp_path: Path) -> None:
    for kind in (BY_NAME["noisy"], BY_NAME["swinging"]):
        one, other = (disturb(long_bands, kind, tmp_path / each) for each in "ab")
        files = [sorted(drive.folder.rglob("*.png")) for drive in (one, other)]
        assert len(files[0]) == 2 * FRAMES
        assert [path.read_bytes() for path in files[0]] == [path.read_bytes() for path in files[1]]
        times = [path.stat().st_mtime_ns for path in files[0]]
        assert disturb(long_bands, kind, tmp_path / "a").folder == one.folder
        assert [path.stat().st_mtime_ns for path in files[0]] == times  # not written again


def test_changed_source_images_are_disturbed_anew(long_bands: Sequence, tmp_path: Path) -> None:
    first = disturb(long_bands, BY_NAME["dark"], tmp_path / "disturbed")
    shutil.copy(long_bands.folder / "image_0" / "000003.png", long_bands.folder / "image_0" / "000004.png")
    again = disturb(long_bands, BY_NAME["dark"], tmp_path / "disturbed")
    assert again.folder != first.folder
    np.testing.assert_array_equal(levels(again, 4), levels(again, 3))


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("reversed", [9, 8, 7, 6, 5, 4, 3, 2, 1, 0]),
        ("every 2nd", [0, 2, 4, 6, 8]),
        ("every 3rd", [0, 3, 6, 9]),
    ],
)
def test_order_takes_images_truth_and_times_of_the_same_frames(
    long_bands: Sequence, tmp_path: Path, name: str, order: list[int]
) -> None:
    drive = disturb(long_bands, BY_NAME[name], tmp_path / "disturbed")
    assert drive.truth is not None
    assert long_bands.truth is not None
    for index, frame in enumerate(order):
        np.testing.assert_array_equal(levels(drive, index), levels(long_bands, frame))
        np.testing.assert_array_equal(drive.truth[index], long_bands.truth[frame])
    steps = np.diff(drive.times)
    np.testing.assert_allclose(steps, np.abs(np.diff(long_bands.times[order])))
    assert (steps > 0).all()


def test_gaps_are_in_the_middle_of_a_hundred_frames() -> None:
    for name, length in (("gap of 5", 5), ("gap of 10", 10)):
        kind = BY_NAME[name]
        assert kind.order is not None
        rest = kind.order(100)
        assert sorted(set(range(100)) - set(rest)) == list(range(GAP_START, GAP_START + length))
        assert not kind.keeps_frames


def test_disturbance_leaves_the_drive_it_is_made_from(long_bands: Sequence, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in sorted(long_bands.folder.rglob("*.*"))}
    for kind in DISTURBANCES:
        if kind.keeps_frames:
            disturb(long_bands, kind, tmp_path / "disturbed")
    assert {path: path.read_bytes() for path in sorted(long_bands.folder.rglob("*.*"))} == before


def test_stopped_making_of_images_leaves_no_folder(long_bands: Sequence, tmp_path: Path) -> None:
    class StopError(Exception):
        pass

    def stops(image: Image, frame: int, side: int) -> Array:
        if frame == 4:
            raise StopError
        return np.asarray(image, np.float64)

    kind = Disturbance("stopping", "", stops)
    with pytest.raises(StopError):
        disturb(long_bands, kind, tmp_path / "disturbed")
    assert not [*(tmp_path / "disturbed").iterdir()]


def test_measurement_goes_on_where_it_was_stopped(
    short_bands: Sequence, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, runs = tmp_path / "ablation.csv", tmp_path / "runs"
    words = ["--sequences", str(short_bands.folder), "--cache", str(tmp_path), "--seeds", "2"]
    words += ["--runs", str(runs), "--out", str(out), "--ideas"]
    assert load("measure_ablation")([*words, "prior,lens"]) == 0
    first = read_csv(out)
    assert [cells[0] for _, cells in first] == ["idea", "", "", "prior", "lens"]
    files = sorted(runs.rglob("config.json"))
    assert len(files) == 4 * 2
    times = {path: path.stat().st_mtime_ns for path in files}
    # A run that was not finished has no config.json.
    stopped = next(path for path in files if "lens" in str(path))
    stopped.unlink()
    assert load("measure_ablation")([*words, "lens"]) == 0
    assert [path for path in files if path.stat().st_mtime_ns != times[path]] == [stopped]
    again = read_csv(out)
    assert sorted(cells for _, cells in again) == sorted(cells for _, cells in first)
    assert "| prior | " in capsys.readouterr().out


@pytest.mark.slow  # runs many drives
def test_disturbed_drives_are_measured_and_reported(
    short_bands: Sequence, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, name = tmp_path / "ablation.csv", str(short_bands.folder)
    words = ["--sequences", name, "--disturb", name, "--cache", str(tmp_path), "--seeds", "1"]
    words += ["--runs", str(tmp_path / "runs"), "--out", str(out), "--ideas", "front end"]
    assert load("measure_ablation")(words) == 0
    rows = [read_row(cells) for _, cells in read_csv(out)[1:]]
    assert {row.sequence.partition(": ")[2] for row in rows} == {
        "",
        *(kind.name for kind in DISTURBANCES if kind.keeps_frames),
    }
    assert all(np.isfinite(row.mean["end"]) and np.isfinite(row.mean["lost"]) for row in rows)
    printed = capsys.readouterr().out
    kinds = " | ".join(kind.name for kind in DISTURBANCES if kind.keeps_frames)
    assert f"| without | clean, whole clip | {kinds} |" in printed
    assert "every seventh frame is blurred" in printed
    # The path is known: 4 steps of 0.5 m to the right, not 20 m forward as in poses.txt.
    clean = next(row for row in rows if row.idea == "" and ":" not in row.sequence)
    assert clean.mean["end"] == pytest.approx(np.hypot(2.0, 80.0), abs=0.1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--ideas", "frontend"], "--ideas 'frontend'"),
        (["--ideas", "prior,"], "--ideas ''"),
        (["--disturb", "00"], "--disturb kitti/00"),
        (["--seeds", "0"], "--seeds '0'"),
        (["--seeds", "two"], "--seeds 'two'"),
    ],
)
def test_wrong_options_are_refused(
    words: list[str], message: str, bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--sequences", str(bands), "--cache", str(tmp_path), "--runs", str(tmp_path / "runs")]
    assert load("measure_ablation")([*given, "--out", str(tmp_path / "a.csv"), *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "expected" in error
    assert not (tmp_path / "a.csv").exists()


def made(idea: str, sequence: str, te: float, deviation: float = 0.0, end: float = 0.0) -> Row:
    mean = dict.fromkeys(RESULTS, 0.0) | {"te": te, "end": end}
    return Row(
        idea, "feature_selection", sequence, 2, mean, dict.fromkeys(RESULTS, 0.0) | {"te": deviation}, np.nan
    )


def test_an_idea_is_needed_if_an_error_grows_clearly_without_it() -> None:
    whole = made("", "a", 2.0, end=3.0)
    assert harm(made("lens", "a", 0.019), whole) == {}  # less than 1 %
    assert harm(made("lens", "a", 0.021), whole) == {"te": pytest.approx(0.0105)}
    assert harm(made("lens", "a", 0.021, 0.011), whole) == {}  # less than two standard deviations
    assert harm(made("lens", "a", -1.0), whole) == {}  # the error falls
    assert harm(made("lens", "a", 0.0, end=0.06), whole) == {"end": pytest.approx(0.02)}


GAP = "kitti/00: gap of 10"


def test_growth_is_reported_for_every_drive() -> None:
    rows = [made("", "a", 2.0, end=3.0), made("", "a: dark", 1.0, end=1.0)]
    rows += [made("lens", "a", 0.1), made("lens", "a: dark", 0.2, end=4.0), made("an old idea", "a", 0.0)]
    ablation = Ablation(rows)
    assert ablation.harms("lens") == [("a: dark", "end", 4.0), ("a: dark", "te", 0.2), ("a", "te", 0.05)]
    assert ablation.removed == ["an old idea"]
    worth, te, *_, end, lost = tables(ablation)
    assert ["lens", "–", "2", "a: dark, end × 5", "the appendix"] in worth.rows
    assert ["an old idea", "–", "–", "–", "–"] in worth.rows  # it was not measured on "a: dark"
    assert "out of the same 2 drives for every idea, clean and disturbed ones" in worth.head[0]
    assert te.rows[0] == ["lens", "+5.0"]
    assert end.rows == [
        ["all ideas", "3.00", "1.00"],
        ["lens", "+0.00", "+4.00"],
        ["an old idea", "+0.00", "–"],
    ]
    assert lost.rows == [["all ideas", "0", "0"]]


def test_a_drive_that_many_ideas_lose_alike_is_named_below_the_table() -> None:
    rows = [made("", "a", 1.0), made("", "a: dark", 1.0)]
    for idea in ("prior", "lens", "calibration"):
        rows += [made(idea, "a", 0.0), lost_alike(idea, 7.6)]
    (note,) = tables(Ablation(rows))[0].notes
    assert note.startswith(
        "On a: dark, 3 ideas have the same change: without any one of them, one frame more"
    )
    assert "TE grows × 9. So the 3 rows that name this drive" in note
    assert tables(Ablation(rows[:-1]))[0].notes == []  # two ideas may be alike by chance
    assert tables(Ablation([*rows[:-1], lost_alike("calibration", 3.0)]))[0].notes == []


def lost_alike(idea: str, te: float) -> Row:
    row = made(idea, "a: dark", te)
    return dataclasses.replace(row, mean=row.mean | {"lost": 1.0})


def test_the_measured_gap_is_passed_narrowly() -> None:
    from measure_results import ABLATION

    rows = [read_row(cells) for _, cells in read_csv(ABLATION)[1:]]
    alike = [row for row in rows if row.idea and row.sequence == GAP and row.mean["lost"] == 1.0]
    assert len(alike) == 7
    worth = tables(Ablation(rows))[0]
    named = [row for row in worth.rows if row[3] == f"{GAP}, TE × 9"]
    assert {row[0] for row in named} < {row.idea for row in alike}
    (note,) = worth.notes
    assert note.startswith(f"On {GAP}, {len(alike)} ideas have the same change")
    assert f"TE grows × 9. So the {len(named)} rows that name this drive" in note


def test_drives_are_counted_only_if_all_ideas_were_measured_on_them() -> None:
    drives = ("a", "a: dark", "b")
    rows = [made("", drive, 1.0) for drive in drives] + [made("lens", drive, 0.5) for drive in drives]
    rows += [made("prior", "a", 0.5), made("prior", "b", 0.001)]
    ablation = Ablation(rows)
    assert ablation.counted == ["a", "b"]
    worth = tables(ablation)[0]
    assert [row[:3] for row in worth.rows] == [["prior", "–", "1"], ["lens", "–", "2"]]
    assert "out of the same 2 drives for every idea, without 1 on which" in worth.head[0]
    assert "(a: dark)" in worth.head[0]


def test_rows_are_read_as_they_are_written() -> None:
    results = np.array([[1.0, 2.0, 3.0, 4.0, 5.0], [2.0, 2.0, 3.0, 4.0, 7.0]])
    row = row_of(IDEAS[0], "a", results, np.zeros((2, 5)), np.nan)
    assert row.deviation["te"] == pytest.approx(np.sqrt(0.5))
    again = read_row(row.cells)
    assert dataclasses.replace(again, ms=0.0, mean={}, deviation={}) == dataclasses.replace(
        row, ms=0.0, mean={}, deviation={}
    )
    assert np.isnan(again.ms)
    assert again.mean == pytest.approx(row.mean)
    assert again.deviation == pytest.approx(row.deviation, abs=1e-6)
    assert csv_text([COLUMNS, again.cells]) == csv_text([COLUMNS, row.cells])


def test_stored_table_belongs_to_the_page() -> None:
    from measure_results import ABLATION

    (_, heading), *lines = read_csv(ABLATION)
    assert tuple(heading) == COLUMNS
    ablation = Ablation([read_row(cells) for _, cells in lines])
    assert {idea.name for idea in IDEAS} <= set(ablation.ideas)
    # An idea stays if a drive needs it, or if a chapter is about it.
    for idea in IDEAS:
        assert idea.taught or ablation.harms(idea.name), idea.name


@pytest.mark.parametrize("name", ["results.md", "real_traffic.md"])
def test_stored_pages_say_how_they_were_made(name: str) -> None:
    """The tables of the ideas come from another command with other seeds, and the page says so."""
    from measure_results import ABLATION, page_command, page_head

    page = ABLATION.with_name(name).read_text(encoding="utf-8")
    _, head, command, *_ = page.split("\n\n")
    words = shlex.split(command)
    detector = words[words.index("--detector") + 1]
    assert command == page_command(words[words.index("--sequences") + 1], detector)
    of_ideas: list[ReportTable] = []
    if name == "results.md":
        of_ideas = tables(Ablation([read_row(cells) for _, cells in read_csv(ABLATION)[1:]]))
        assert "`vo data measure_ablation`" in head
        assert "with seed 0 (the shortest of 3 each); it has no spread" in of_ideas[0].head[0]
    assert head == page_head([table.title for table in of_ideas])
    assert "Unless a table says otherwise, errors are means over seeds 0-4" in head
    last = "\n\n".join(map(markdown, of_ideas))
    assert page.endswith(last)
    assert all(f"## {table.title}\n" not in page.removesuffix(last) for table in of_ideas)
