"""`vo sweep`: axes of the grid, records of single runs, and the heat map."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import write_bands

from vo_lib import Sequence, open_sequence, preset, run
from vo_lib.commands.cli import main
from vo_lib.config import change
from vo_lib.data.poses import from_first, read_kitti_poses
from vo_lib.data.tables import read_csv
from vo_lib.evaluation.kitti_errors import SHORT_PROTOCOL, kitti_errors
from vo_lib.report.blocks import parse_axis
from vo_lib.report.sweep_table import DEFAULT, Measured, Sweep, heat_map, run_sweep, sweep_table
from vo_lib.runs.drive import run_methods
from vo_lib.runs.jobs import Job, Outcome, run_jobs
from vo_lib.runs.run_quality import warnings_of


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """A sequence of 43 frames and 21 m, long enough for sub-sequences of 20 m."""
    return open_sequence(write_bands(tmp_path_factory.mktemp("sweep") / "bands", 43))


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that the sweeps share, so that the sequence is matched once."""
    return tmp_path_factory.mktemp("cache")


def axis(text: str) -> tuple[str, tuple[Any, ...]]:
    return parse_axis(text, preset("feature_selection"))


def sweep_of(sequence: Sequence, place: Path, *axes: str) -> Sweep:
    """A sweep of `feature_selection` with two seeds; cache and runs are in a temporary folder."""
    do = partial(run_jobs, cache=place / "cache")
    bases = {"feature_selection": preset("feature_selection")}
    (sweep,) = run_sweep(
        [sequence.name], bases, dict(map(axis, axes)), 2, place, lambda name, config: sequence, do
    )
    return sweep


def test_axis_values_have_the_declared_type() -> None:
    assert axis("selection.sets=50,100") == ("selection.sets", (50, 100))
    assert axis("filter.margin=0,0.1") == ("filter.margin", (0.0, 0.1))
    assert axis("selection.prior=on,off")[1] == (True, False)
    assert axis("filter.classes=car;2, 5,big truck")[1] == (("car",), ("2", "5", "big truck"))


def test_sweep_records_equal_single_runs(sequence: Sequence, tmp_path: Path) -> None:
    sweep = sweep_of(sequence, tmp_path, "matching.search_radius=40,60", "selection.sets=10,20")
    grid = [(radius, sets) for radius in ("40", "60") for sets in ("10", "20")]
    names = ("matching.search_radius", "selection.sets")
    assert [tuple(record[name] for name in names) for record in sweep.records] == grid
    assert [record["seeds"] for record in sweep.records] == [2] * 4
    config = change(change(preset("feature_selection"), names[0], 60), names[1], 10)
    assert sequence.truth is not None
    runs = run_methods(sequence, {str(seed): replace(config, seed=seed) for seed in (0, 1)})
    te: list[float | None] = []
    for single in runs.values():
        te.append(kitti_errors(sequence.truth, single.poses, SHORT_PROTOCOL.lengths, SHORT_PROTOCOL.step).te)
    record, te_of_seeds = sweep.records[2], np.array(te, float)
    assert record["te_percent"] == pytest.approx(te_of_seeds.mean(), abs=1e-6)
    assert record["te_percent_std"] == pytest.approx(te_of_seeds.std(ddof=1), abs=1e-6)
    # One front end per value of its setting, shared by the other runs.
    assert len(list((tmp_path / "cache").rglob("*.npz"))) == 2
    assert len(sweep_table(sweep).rows) == 4


@pytest.mark.parametrize(
    ("more", "lines"),
    [([], 3), (["buckets.features=2,4"], 5), (["buckets.features=2", "min_matches=6,8"], 5)],
)
def test_sweep_writes_table_and_heat_map(
    sequence: Sequence,
    cache: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
    lines: int,
) -> None:
    out = tmp_path / "out"
    words = ["sweep", "--sequence", str(sequence.folder), "--method", "mesvo_f", "--seeds", "1"]
    words += ["--cache", str(cache), "--out", str(out), "--set", "selection.sets=10,20"]
    assert main([*words, *(word for text in more for word in ("--set", text))]) == 0
    assert "one seed" in capsys.readouterr().out
    assert len((out / "sweep.csv").read_text(encoding="utf-8").splitlines()) == lines
    picture = cv2.imread(str(out / "sweep.png"))
    assert picture is not None
    assert picture.std() > 20


@pytest.mark.parametrize(("spread", "strong"), [(0.01, True), (0.5, False)])
def test_difference_within_the_spread_has_no_strong_colour(spread: float, strong: bool) -> None:
    names = ("te_percent", "re_deg_per_100m")
    records = [
        {name: error for name in names} | {f"{name}_std": spread for name in names} for error in (1.0, 1.1)
    ]
    picture = cv2.imdecode(np.frombuffer(heat_map(Sweep("", {"a": (1, 2)}, records)), np.uint8), 1)
    assert picture is not None
    darkest = (np.abs(picture - np.array([88, 29, 8])) < 3).all(axis=2)
    # Without this colour, a cell is missing; the colour bar has it in any case.
    assert (darkest.mean() > 0.1) == strong


@pytest.mark.parametrize(
    ("spreads", "coloured"), [((None, None), False), ((None, 0.01), True), ((0.01, 0.01), True)]
)
def test_a_cell_with_one_seed_has_no_colour(spreads: tuple[float | None, ...], coloured: bool) -> None:
    names = ("te_percent", "re_deg_per_100m")
    records: list[dict[str, Any]] = [
        {name: error for name in names} | {f"{name}_std": spread for name in names}
        for error, spread in zip((1.0, 3.0), spreads, strict=True)
    ]
    picture = cv2.imdecode(np.frombuffer(heat_map(Sweep("", {"a": (1, 2)}, records)), np.uint8), 1)
    assert picture is not None
    saturation = np.ptp(picture.astype(np.int64), axis=2)
    height, width = saturation.shape
    # Two cells beside each other in the upper half; the first one has a single seed, or both have.
    row = saturation[height // 4, : int(0.75 * width)]
    assert bool((row > 20).any()) == coloured
    if spreads[0] is None:
        assert (picture == 229).all(axis=2).mean() > 0.1


def test_sweep_of_a_short_path_has_distances_from_the_truth(
    sequence: Sequence, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["sweep", "--sequence", str(sequence.folder), "--frames", "0:5", "--seeds", "2", "--set"]
    places = ["--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    assert main([*words, "selection.sets=10,20", *places]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    told = printed.index("will have no errors, since its path has 2.0 m, the shortest sub-sequence 20 m;")
    assert told < printed.index("No TE and RE, since its path has 2.0 m, the shortest sub-sequence 20 m.")
    for column in ("length m", "end error m", "rmse error m"):
        assert column in printed
    assert (tmp_path / "out" / "sweep.png").exists()
    truth = sequence.part(0, 5).truth
    assert truth is not None
    for record in records_of(tmp_path / "out"):
        runs = sorted((tmp_path / "out" / "cells").glob(f"*/*/*/*{record['selection.sets']}/seed?/poses.txt"))
        assert len(runs) == 2
        paths = [from_first(read_kitti_poses(path)) for path in runs]
        ends = [np.linalg.norm((path - from_first(truth))[-1, :3, 3]) for path in paths]
        assert float(record["end_error_m"]) == pytest.approx(np.mean(ends), abs=1e-3)


@pytest.mark.usefixtures("pictures_not_drawn")
def test_rows_that_a_setting_does_not_touch_are_marked(
    sequence: Sequence,
    cache: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    words = ["sweep", "--sequence", str(sequence.folder), "--seeds", "1", "--method", "solution_selection"]
    words += ["--set", "selection.prior=on,off", "--set", "selection.top_k=1,2"]
    words += ["--cache", str(cache), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    (_, names), *rows = read_csv(tmp_path / "out" / "sweep.csv")
    records = [dict(zip(names, cells, strict=True)) for _, cells in rows]
    assert [record["not_used"] for record in records] == ["", "", "selection.top_k", "selection.top_k"]
    assert records[2]["te_percent"] == records[3]["te_percent"]
    printed = capsys.readouterr().out
    assert printed.count("1 (not used)") == printed.count("2 (not used)") == 1
    assert "(not used): the setting has no effect on the runs of this row." in printed


def records_of(folder: Path) -> list[dict[str, str]]:
    """The rows of sweep.csv."""
    (_, names), *rows = read_csv(folder / "sweep.csv")
    return [dict(zip(names, cells, strict=True)) for _, cells in rows]


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_sweep_of_several_methods_and_sequences(
    sequence: Sequence, cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_bands(tmp_path / "other", 43)
    words = ["sweep", "--sequences", f"{sequence.folder},{other}", "--methods", "viso2,mesvo_f"]
    words += ["--seeds", "1", "--cache", str(cache), "--out", str(tmp_path / "out")]
    assert main([*words, "--set", "selection.sets=10,20"]) == 0
    records = records_of(tmp_path / "out")
    assert [(record["sequence"], record["method"], record["selection.sets"]) for record in records] == [
        (name, method, sets)
        for name in ("bands", "other")
        for method in ("viso2", "mesvo_f")
        for sets in ("10", "20")
    ]
    # The sequences have the same images, so the same cell has the same errors.
    assert [record["te_percent"] for record in records[:4]] == [
        record["te_percent"] for record in records[4:]
    ]
    assert {record["method"]: record["not_used"] for record in records} == {
        "viso2": "selection.sets",
        "mesvo_f": "",
    }
    assert len({path.parent for path in (tmp_path / "out").rglob("poses.txt")}) == 8
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"sweep_bands.png", "sweep_other.png"}
    printed = capsys.readouterr().out
    assert printed.count("20 (not used)") == 2


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_sweep_without_truth_compares_with_the_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    folder = write_bands(tmp_path / "street")
    (folder / "poses.txt").unlink()
    words = ["sweep", "--sequence", str(folder), "--method", "mesvo_f", "--seeds", "2"]
    words += ["--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    assert main([*words, "--set", "selection.sets=5,20"]) == 0
    printed = capsys.readouterr().out
    assert "street, 6 frames, mesvo_f, published: no ground truth, so these numbers are no errors" in printed
    assert "mesvo_f: two seeds of the default settings are" in printed
    assert (tmp_path / "out" / "sweep.png").exists()
    sequence = open_sequence(folder)
    for record in records_of(tmp_path / "out"):
        ends = []
        warnings = set[str]()
        for seed in (0, 1):
            config = preset("mesvo_f", seed=seed)
            changed = change(config, "selection.sets", int(record["selection.sets"]))
            result = run(sequence, changed)
            ends.append(np.linalg.norm(result.poses[-1] - run(sequence, config).poses[-1]))
            warnings.update(warnings_of(result))
        # Two seeds may have a warning with different numbers: it is said once.
        assert record["warnings"].count("stereo contradicts the motion of") == min(1, len(warnings))
        assert ("(for some seeds with other numbers)" in record["warnings"]) == (len(warnings) > 1)
        assert float(record["end_apart_m"]) == pytest.approx(np.mean(ends), abs=1e-3)
        assert "te_percent" not in record
    # The preset has 200 sets; as a value on the axis, it is nothing apart from itself.
    assert main([*words, "--set", "selection.sets=200,5"]) == 0
    assert float(records_of(tmp_path / "out")[0]["rmse_apart_m"]) == 0.0


def test_a_reference_with_a_failed_run_tells_no_spread_of_seeds(tmp_path: Path) -> None:
    folder = write_bands(tmp_path / "street")
    (folder / "poses.txt").unlink()
    sequence = open_sequence(folder)

    def fail_in_the_reference(jobs: list[Job]) -> list[Outcome]:
        outcomes = run_jobs(jobs, cache=tmp_path / "cache")
        is_failed = [job.config.seed == 1 and DEFAULT in job.folder.parts for job in jobs]
        assert sum(is_failed) == 1
        return [
            replace(outcome, error="disk full") if failed else outcome
            for outcome, failed in zip(outcomes, is_failed, strict=True)
        ]

    bases = {"mesvo_f": preset("mesvo_f")}
    axes = {"selection.sets": (5, 20)}
    (sweep,) = run_sweep(
        [sequence.name], bases, axes, 2, tmp_path, lambda name, config: sequence, fail_in_the_reference
    )
    assert sweep.notes == (
        "mesvo_f: fewer than two runs of the default settings succeeded, so how far two seeds are apart is "
        "not known.",
    )


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_sweep_without_truth_names_the_settings_that_it_compares_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    folder = write_bands(tmp_path / "street")
    (folder / "poses.txt").unlink()
    cache = ["--cache", str(tmp_path / "cache")]
    assert main(["run", str(folder), "--selection.sets", "20", "--out", str(tmp_path / "run"), *cache]) == 0
    for config, reference in (
        (["--config", str(tmp_path / "run" / "config.json")], "the settings of --config"),
        ([], "the default settings"),
    ):
        capsys.readouterr()
        words = [
            "sweep",
            "--sequence",
            str(folder),
            "--set",
            "translation.pairs=2,3",
            "--seeds",
            "2",
            *config,
        ]
        assert main([*words, "--out", str(tmp_path / f"out{len(config)}"), *cache]) == 0
        printed = capsys.readouterr().out
        assert f"those of {reference} with the same seed" in printed
        assert f"seeds of {reference} " in printed
        assert printed.count("default settings") == (0 if config else 2)


@pytest.mark.parametrize(
    ("axes", "same"),
    [
        ({"method": ("viso2", "mesvo_f"), "a": ("1",)}, "the same method and seed"),
        ({"a": ("1",)}, "the same seed"),
    ],
)
def test_a_path_of_several_methods_is_compared_with_its_own_method(
    axes: dict[str, tuple[str, ...]], same: str
) -> None:
    numbers = dict.fromkeys(
        ["length_m", "end_apart_m", "end_apart_m_std", "rmse_apart_m", "rmse_apart_m_std"], 1.0
    )
    records = [
        {"method": method, "a": "1", "failed": "", **numbers} for method in axes.get("method", ["viso2"])
    ]
    table = sweep_table(Sweep("", axes, records, measured=Measured.APART))
    (note,) = table.notes
    assert f"those of the default settings with {same}, from the same start" in note


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_sweep_detects_its_boxes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_bands(tmp_path / "street")
    words = ["sweep", "--sequence", str(folder), "--set", "filter.margin=0,0.1", "--seeds", "1"]
    words += ["--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out"), "--detector", "street"]
    assert main(words) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "`street` was trained on drawn streets" in printed
    assert "No vehicle boxes" not in printed
    assert list((tmp_path / "cache" / "stereo-vo-kit" / "labels").iterdir())


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_sweep_says_how_long_the_rest_will_take(
    sequence: Sequence, cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], jobs: str
) -> None:
    """With one seed, too: every run has other settings then, and the matches may be kept."""
    words = ["sweep", "--sequence", str(sequence.folder), "--seeds", "1", "--method", "mesvo_f"]
    words += ["--frames", "0:12"]
    words += ["--set", "selection.sets=10,20,30,40", "--jobs", jobs, "--cache", str(cache)]
    for out in ("first", "second"):  # the second one with kept matches in any case
        capsys.readouterr()
        assert main([*words, "--out", str(tmp_path / out)]) == 0
        assert "The other runs will take about" in capsys.readouterr().out


@pytest.mark.usefixtures("pictures_not_drawn")
def test_equal_paths_of_all_seeds_are_called_equal(
    sequence: Sequence, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = write_bands(tmp_path / "bare", 6)
    (other / "poses.txt").unlink(missing_ok=True)
    words = ["sweep", "--sequence", str(other), "--method", "viso2", "--seeds", "2"]
    words += ["--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    assert main([*words, "--set", "matching.search_radius=40,60"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "no ground truth" in printed
    assert "viso2: all seeds of the default settings give the same path, to the millimetre." in printed
    assert "one run would not show" not in printed
