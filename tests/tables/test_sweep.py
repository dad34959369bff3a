"""A grid over settings: every cell is a run of its own, whatever computes it."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import write_bands

from vo_lib import DataError, Sequence, open_sequence, preset, run
from vo_lib.commands.cli import main
from vo_lib.core import settings
from vo_lib.evaluation.kitti import SHORT_MEASURE, kitti_errors
from vo_lib.runs.jobs import run_jobs
from vo_lib.tables.error_plots import heat_map_figure
from vo_lib.tables.sweep import Axis, parse_axis, run_sweep, sweep_csv, sweep_table


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Forty-three frames, 21 m: sub-sequences of 20 m fit."""
    return open_sequence(write_bands(tmp_path_factory.mktemp("sweep") / "bands", 43))


def test_an_axis_has_values_of_the_declared_kind() -> None:
    assert parse_axis("selection.sets=50,100") == Axis("selection.sets", (50, 100))
    assert parse_axis("filter.margin=0,0.1") == Axis("filter.margin", (0.0, 0.1))
    assert parse_axis("selection.prior=on,off").values == (True, False)
    assert parse_axis("filter.classes=2;2,5,7").values == ((2,), (2, 5, 7))


def test_cells_hold_the_errors_of_single_runs(sequence: Sequence, tmp_path: Path) -> None:
    axes = parse_axis("features.cell=20,24"), parse_axis("selection.sets=10,20")
    sweep = run_sweep(sequence, "mesvo_f", axes, 2, tmp_path, partial(run_jobs, cache=tmp_path / "cache"))
    grid = [("20", "10"), ("20", "20"), ("24", "10"), ("24", "20")]
    assert [cell.values for cell in sweep.cells] == grid
    config = settings.replace(preset("mesvo_f", seed=1), "features.cell", 24)
    poses = run(sequence, settings.replace(config, "selection.sets", 10)).poses
    assert sequence.truth is not None
    expected = kitti_errors(sequence.truth, poses, SHORT_MEASURE.lengths, SHORT_MEASURE.step)
    te, _ = sweep.cells[2].errors
    assert te[1] == pytest.approx(expected.te, abs=1e-6)
    assert te[0] != te[1]
    # A front end for each value of its setting, shared by the rest.
    assert len(list((tmp_path / "cache" / "matches").iterdir())) == 2
    rows = list(csv.DictReader(io.StringIO(sweep_csv(sweep))))
    assert [(row["features.cell"], row["selection.sets"]) for row in rows] == grid
    assert (float(rows[2]["te_percent"]), float(rows[2]["te_std"])) == (te.mean(), te.std())
    assert [row["seeds"] for row in rows] == ["2"] * 4
    assert len(sweep_table(sweep).rows) == 4


def test_a_cell_that_fails_is_named_and_the_others_finish(sequence: Sequence, tmp_path: Path) -> None:
    axes = (parse_axis("selection.sets=20,30"),)
    do = partial(run_jobs, cache=tmp_path / "cache")
    (tmp_path / "cells" / "kit" / "selection.sets=30").mkdir(parents=True)
    (tmp_path / "cells" / "kit" / "selection.sets=30" / "seed1").write_text("no folder", encoding="utf-8")
    sweep = run_sweep(sequence.part(0, 20), "feature_selection", axes, 2, tmp_path, do)
    assert [len(cell.failed) for cell in sweep.cells] == [0, 1]
    assert [cell.errors.shape for cell in sweep.cells] == [(2, 2), (2, 1)]
    assert sweep.cells[1].failed[0].startswith("seed 1: ")
    bare, failed = sweep_table(sweep).notes
    assert "no labels: boxes remove nothing" in bare
    assert "selection.sets=30, seed 1: " in failed
    assert "cannot be" in list(csv.DictReader(io.StringIO(sweep_csv(sweep))))[1]["errors"]


def test_without_truth_or_with_a_setting_given_twice_nothing_is_run(bands: Path, tmp_path: Path) -> None:
    axis = parse_axis("selection.sets=20,30")
    with pytest.raises(DataError, match="given twice"):
        run_sweep(open_sequence(bands), "mesvo_f", (axis, axis), 1, tmp_path, run_jobs)
    (bands / "poses.txt").unlink()
    with pytest.raises(DataError, match="no ground truth"):
        run_sweep(open_sequence(bands), "mesvo_f", (axis,), 1, tmp_path, run_jobs)


def test_the_command_writes_table_and_heat_map(
    sequence: Sequence, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["sweep", "--sequence", str(sequence.folder), "--method", "mesvo_f", "--seeds", "1"]
    words += ["--cache", str(tmp_path / "cache"), "--out", str(out), "--set", "selection.sets=10,20"]
    assert main([*words, "--set", "features.cell=20,24,30"]) == 0
    printed = capsys.readouterr().out
    assert "selection." in printed
    assert "one seed" in printed
    assert len((out / "sweep.csv").read_text(encoding="utf-8").splitlines()) == 7
    picture = cv2.imread(str(out / "sweep.png"))
    assert picture is not None
    assert picture.std() > 20


def test_a_heat_map_shows_its_numbers_and_marks_what_is_missing() -> None:
    cells = np.dstack([np.arange(6.0).reshape(2, 3), np.full((2, 3), 0.25)])
    cells[1, 0] = np.nan
    figure = heat_map_figure(
        r"$\foo$ " * 30, ("row", ["a", "b"]), ("column", ["x", "y", "z"]), {"TE [%]": cells}
    )
    axis = figure.axes[0]
    texts = [text.get_text() for text in axis.texts]
    assert texts == ["0.000\n± 0.250", "1.000\n± 0.250", "2.000\n± 0.250", "×", *texts[4:]]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["x", "y", "z"]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["a", "b"]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("column", "row")


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    """Address of a Dask scheduler with two workers, all processes of this machine."""
    pytest.importorskip("distributed")
    place = str(tmp_path / "scheduler.json")
    common = ["--host", "127.0.0.1", "--scheduler-file", place, "--no-dashboard"]
    worker = ["dask_worker", "--nthreads", "1", "--no-nanny", "--local-directory", str(tmp_path), *common]
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{command}", *words],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for command, *words in (["dask_scheduler", "--port", "0", *common], worker, worker)
    ]
    try:
        from distributed import Client

        deadline = time.monotonic() + 120
        while not Path(place).exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        with Client(scheduler_file=place, set_as_default=False, timeout=60) as client:
            client.wait_for_workers(2, timeout=120)
            yield client.scheduler.address
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_a_dask_cluster_gives_the_same_table(sequence: Sequence, tmp_path: Path, scheduler: str) -> None:
    axes = parse_axis("selection.sets=10,20"), parse_axis("features.cell=20,24")
    here, there = (
        run_sweep(sequence, "mesvo_f", axes, 1, tmp_path / place / "out", run)
        for place, run in (
            ("here", partial(run_jobs, cache=tmp_path / "here")),
            ("there", partial(run_jobs, cache=tmp_path / "there", scheduler=scheduler)),
        )
    )
    assert [cell.failed for cell in there.cells] == [()] * 4
    for path in (tmp_path / "here").rglob("poses.txt"):
        other = tmp_path / "there" / path.relative_to(tmp_path / "here")
        assert other.read_bytes() == path.read_bytes()
    assert [cell.errors.tolist() for cell in there.cells] == [cell.errors.tolist() for cell in here.cells]
