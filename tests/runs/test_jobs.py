"""Many runs at once: the same bytes as one by one, one front end for all, an end of its own for each."""

from __future__ import annotations

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import small, write_bands

from vo_lib import DataError, Sequence, open_sequence, run
from vo_lib.commands.cli import main
from vo_lib.core.poses import format_kitti_poses
from vo_lib.runs.jobs import MATCHING, Job, counting, run_jobs
from vo_lib.runs.match_cache import CachedMatches
from vo_lib.runs.results import is_finished

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


@pytest.mark.parametrize("workers", [1, 2])
def test_jobs_give_the_bytes_of_single_runs(two: list[Sequence], tmp_path: Path, workers: int) -> None:
    seen: list[tuple[int, int]] = []
    jobs = all_jobs(two, tmp_path / "runs")
    outcomes = run_jobs(jobs, workers, lambda done, total: seen.append((done, total)), tmp_path / "cache")
    assert [outcome.job.name for outcome in outcomes] == [job.name for job in jobs]
    assert [outcome.error for outcome in outcomes] == [None] * 8
    for job in jobs:
        text = (job.folder / "poses.txt").read_text(encoding="utf-8")
        assert text == format_kitti_poses(run(job.sequence, job.config).poses)
    # Eight runs and two front ends.
    frames = (8 + 2 * MATCHING) * FRAMES
    assert {total for _, total in seen} == {frames}
    assert seen[-1][0] == frames
    assert seen == sorted(seen)
    assert len(list((tmp_path / "cache" / "matches").iterdir())) == 2


def test_the_front_end_runs_once_for_all_methods_and_seeds(
    two: list[Sequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[int] = []
    stereo = Sequence.stereo

    def counted(sequence: Sequence, index: int) -> object:
        decoded.append(index)
        return stereo(sequence, index)

    monkeypatch.setattr(Sequence, "stereo", counted)
    jobs = all_jobs(two[:1], tmp_path / "runs")
    run_jobs(jobs, cache=tmp_path / "cache")
    assert sorted(decoded) == list(range(FRAMES))
    shutil.rmtree(jobs[2].folder)
    outcomes = run_jobs(jobs, cache=tmp_path / "cache")
    assert [outcome.error for outcome in outcomes] == [None] * 4
    assert len(decoded) == FRAMES


def test_the_bar_counts_no_matches_that_are_found_again(
    two: list[Sequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vo_lib.runs.match_cache.CHUNK", 2)
    job, cache = all_jobs(two[:1], tmp_path / "runs")[0], tmp_path / "cache"
    matches = CachedMatches(job.sequence, job.config.features, job.config.matching, cache)
    matches.fill()

    def counted() -> int:
        seen: list[int] = []
        with counting([job], [job], cache, lambda done, total: seen.append(done)):
            while not seen:
                time.sleep(0.01)
        return seen[0]

    assert counted() == MATCHING * FRAMES
    next(matches.folder.iterdir()).unlink()
    assert counted() == 0


def test_finished_jobs_are_left_as_they_are_unless_asked(two: list[Sequence], tmp_path: Path) -> None:
    jobs = all_jobs(two[:1], tmp_path / "runs")[:2]
    run_jobs(jobs, cache=tmp_path / "cache")
    log = jobs[0].folder / "frames.csv"
    before = log.stat().st_mtime_ns
    shutil.rmtree(tmp_path / "cache")
    seen: list[int] = []
    outcomes = run_jobs(jobs, 1, lambda done, total: seen.append(done), tmp_path / "cache")
    assert [outcome.error for outcome in outcomes] == [None] * 2
    assert seen == []  # there is nothing to wait for
    assert log.stat().st_mtime_ns == before
    assert not (tmp_path / "cache").exists()
    time.sleep(0.01)
    run_jobs(jobs, cache=tmp_path / "cache", fresh=True)
    assert log.stat().st_mtime_ns > before


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_killed_table_gives_the_same_bytes_and_does_no_finished_run_twice(
    two: list[Sequence], tmp_path: Path, workers: str
) -> None:
    words = ["sweep", "--sequence", str(two[0].folder), "--method", "mesvo_f", "--seeds", "4", "--set"]
    words += ["selection.sets=10,20,30", "--set", "features.cell=16", "--cache", str(tmp_path / "cache")]
    out = tmp_path / "out"
    code = "import sys; from vo_lib.commands.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, *words, "--out", str(out), "--jobs", workers]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)
    while len(list(out.rglob("config.json"))) < 3 and process.poll() is None:
        time.sleep(0.001)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "the table was done before it could be killed"
    finished = {
        path: path.stat().st_mtime_ns for path in out.rglob("config.json") if is_finished(path.parent)
    }
    matches = {path: path.stat().st_mtime_ns for path in (tmp_path / "cache").rglob("*.npz")}
    assert finished
    assert matches
    assert main([*words, "--out", str(out)]) == 0
    assert main([*words, "--out", str(tmp_path / "whole")]) == 0
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    assert {path: path.stat().st_mtime_ns for path in matches} == matches
    paths = [path.relative_to(out) for path in out.rglob("*.txt")]
    assert len(paths) == 24  # poses in two formats
    for path in paths:
        assert (out / path).read_bytes() == (tmp_path / "whole" / path).read_bytes()


@pytest.mark.parametrize("workers", [1, 2])
def test_a_sequence_with_a_bad_image_fails_and_the_other_finishes(
    two: list[Sequence], tmp_path: Path, workers: int
) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(two[0].folder, folder)
    broken = open_sequence(folder)
    (folder / "image_1" / "000006.png").write_bytes(b"")
    jobs = all_jobs([broken, two[1]], tmp_path / "runs")
    outcomes = run_jobs(jobs, workers, cache=tmp_path / "cache")
    for outcome in outcomes[:4]:
        assert str(outcome.error).startswith(str(folder / "image_1" / "000006.png"))
        assert not outcome.job.folder.exists()
    assert [outcome.error for outcome in outcomes[4:]] == [None] * 4


def test_two_jobs_in_one_folder_are_refused(two: list[Sequence], tmp_path: Path) -> None:
    jobs = [dataclasses.replace(job, folder=tmp_path / "one") for job in all_jobs(two, tmp_path)]
    with pytest.raises(DataError, match="two jobs share a folder"):
        run_jobs(jobs)
