"""Parallel runs: same results as single runs, a shared front end, separate failures."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import small, write_bands

from vo_lib import DataError, Sequence, open_sequence, run
from vo_lib.data.poses import format_kitti_poses
from vo_lib.files import file_sha256
from vo_lib.runs.jobs import MATCHING_FRAMES, Job, run_jobs

FRAMES = 8


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> list[Sequence]:
    """Two sequences."""
    base = tmp_path_factory.mktemp("two")
    return [open_sequence(write_bands(base / name, FRAMES, name == "still")) for name in ("bands", "still")]


def all_jobs(sequences: list[Sequence], folder: Path) -> list[Job]:
    return [
        Job(
            each,
            method,
            small(method, seed=seed, selection__sets=20),
            folder / each.name / method / str(seed),
        )
        for each in sequences
        for method in ("mesvo_f", "solution_selection")
        for seed in (0, 1)
    ]


@pytest.fixture(scope="module")
def poses_of_single_runs(two: list[Sequence]) -> list[str]:
    """The text of poses.txt of each job, from a run without jobs and without stored matches."""
    return [format_kitti_poses(run(job.sequence, job.config).poses) for job in all_jobs(two, Path())]


@pytest.mark.parametrize("workers", [1, 2])
def test_jobs_equal_single_runs(
    two: list[Sequence], poses_of_single_runs: list[str], tmp_path: Path, workers: int
) -> None:
    message: list[tuple[int, int]] = []
    jobs = all_jobs(two, tmp_path / "runs")
    outcomes = run_jobs(jobs, workers, lambda done, total: message.append((done, total)), tmp_path / "cache")
    assert [outcome.job.name for outcome in outcomes] == [job.name for job in jobs]
    assert [outcome.error for outcome in outcomes] == [None] * 8
    texts = [(job.folder / "poses.txt").read_text(encoding="utf-8") for job in jobs]
    assert texts == poses_of_single_runs
    # Eight runs and two front ends.
    frames = (8 + 2 * MATCHING_FRAMES) * FRAMES
    assert {total for _, total in message} == {frames}
    assert message[-1][0] == frames
    assert message == sorted(message)
    assert len(list((tmp_path / "cache").rglob("*.npz"))) == 2


def test_jobs_share_matches_and_hashes(
    two: list[Sequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded, hashed = list[int](), list[Path]()
    stereo = Sequence.stereo

    def counted(sequence: Sequence, index: int) -> object:
        decoded.append(index)
        return stereo(sequence, index)

    def watched(path: Path) -> str:
        hashed.append(path)
        return file_sha256(path)

    monkeypatch.setattr("vo_lib.data.image_hashes.cache_folder", lambda: tmp_path / "user")
    monkeypatch.setattr("vo_lib.data.image_hashes.file_sha256", watched)
    monkeypatch.setattr(Sequence, "stereo", counted)
    jobs = all_jobs(two[:1], tmp_path / "runs")
    run_jobs(jobs, cache=tmp_path / "cache")
    assert sorted(decoded) == list(range(FRAMES))
    assert len(hashed) == 2 * FRAMES
    shutil.rmtree(jobs[2].folder)
    outcomes = run_jobs(jobs, cache=tmp_path / "cache")
    assert [outcome.error for outcome in outcomes] == [None] * 4
    assert (len(decoded), len(hashed)) == (FRAMES, 2 * FRAMES)


def test_bad_image_fails_its_sequence_only(two: list[Sequence], tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(two[0].folder, folder)
    broken = open_sequence(folder)
    (folder / "image_1" / "000006.png").write_bytes(b"")
    outcomes = run_jobs(all_jobs([broken, two[1]], tmp_path / "runs"), 2, cache=tmp_path / "cache")
    for outcome in outcomes[:4]:
        assert str(outcome.error).startswith(str(folder / "image_1" / "000006.png"))
        assert not outcome.job.folder.exists()
    assert [outcome.error for outcome in outcomes[4:]] == [None] * 4


def test_a_finished_run_that_cannot_be_read_fails_by_itself(two: list[Sequence], tmp_path: Path) -> None:
    jobs = all_jobs(two[:1], tmp_path / "runs")
    run_jobs(jobs, cache=tmp_path / "cache")
    config_file = jobs[1].folder / "config.json"
    config = json.loads(config_file.read_text(encoding="utf-8"))
    log = jobs[1].folder / "frames.csv"
    log.write_text("frame,count\n", encoding="utf-8")
    config["files"]["frames.csv"] = file_sha256(log)  # so the damage is not seen
    config_file.write_text(json.dumps(config), encoding="utf-8")
    first, damaged, *others = run_jobs(jobs, cache=tmp_path / "cache")
    assert str(damaged.error).startswith(str(jobs[1].folder / "frames.csv"))
    assert [outcome.error for outcome in (first, *others)] == [None] * 3


def test_killed_worker_gives_one_line(
    two: list[Sequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = all_jobs(two[:1], tmp_path / "runs")
    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.jobs._fill", _killed)
        with pytest.raises(DataError, match=r"a worker process was killed.*repeat the command"):
            run_jobs(jobs, 2, cache=tmp_path / "cache")
    assert [outcome.error for outcome in run_jobs(jobs, 2, cache=tmp_path / "cache")] == [None] * 4


def _killed(job: Job, cache: Path | None) -> bool:
    os.kill(os.getpid(), signal.SIGKILL)
    return False


def test_failed_workers_keep_the_cause(
    two: list[Sequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Elsewhere(Executor):
        """The workers of a cluster on which a module is missing."""

        def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            future: Future[Any] = Future()
            future.set_exception(ModuleNotFoundError("No module named 'vo_lib'"))
            return future

    monkeypatch.setattr("vo_lib.runs.jobs.executor", lambda *_: nullcontext(Elsewhere()))
    with pytest.raises(DataError) as raised:
        run_jobs(all_jobs(two[:1], tmp_path / "runs"), cache=tmp_path / "cache")
    assert str(raised.value) == "the workers failed: ModuleNotFoundError: No module named 'vo_lib'"
    assert isinstance(raised.value.__cause__, ModuleNotFoundError)


def test_dask_cluster_runs_the_jobs(
    two: list[Sequence], poses_of_single_runs: list[str], tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed")
    jobs = all_jobs(two[:1], tmp_path / "runs")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster:
        outcomes = run_jobs(jobs, cache=tmp_path / "cache", scheduler=cluster.scheduler_address)
    assert [outcome.error for outcome in outcomes] == [None] * 4
    texts = [(job.folder / "poses.txt").read_text(encoding="utf-8") for job in jobs]
    assert texts == poses_of_single_runs[: len(jobs)]


def test_other_runs_are_refused_at_once(two: list[Sequence], tmp_path: Path) -> None:
    jobs = all_jobs(two[:1], tmp_path / "runs")[:2]
    run_jobs(jobs, cache=tmp_path / "cache")
    others = [replace(job, config=replace(job.config, min_matches=7)) for job in jobs]
    with pytest.raises(DataError, match=r"2 finished runs here differ in settings\.min_matches .* --fresh$"):
        run_jobs(others, cache=tmp_path / "other")
    assert not (tmp_path / "other").exists()
    assert [outcome.error for outcome in run_jobs(others, cache=tmp_path / "other", fresh=True)] == [None] * 2
