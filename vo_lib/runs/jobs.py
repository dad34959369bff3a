"""Runs in folders of their own: each done once, read back when it is asked for again; many at once."""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

from ..config import PublishedConfig
from ..core.errors import DataError
from ..core.files import only_process, written_at
from ..core.types import Progress
from ..data.sequence import Sequence
from .identity import run_identity
from .match_cache import CachedMatches
from .parallel import parallel
from .results import CONFIG, RUN_FILES, is_finished, read_config, read_run, run_folder, write_run
from .runner import Run, TimedMatches, run_methods, single_threaded

POLL = 0.3  # seconds between two looks at what was done
MATCHING = 4  # to find a frame's matches takes about as long as so many frames of a run
# What differs where a digest does.
DIGESTS = {
    "images": "other images",
    "labels": "other labels",
    "calibration": "it started from another calibration",
    "code": "the kit's code has changed",
}


def run_once(
    folder: Path,
    sequence: Sequence,
    config: PublishedConfig,
    method: str,
    *,
    matches: Iterable[TimedMatches] | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> tuple[Run, bool]:
    """A run whose files are in `folder`, and whether they were there before: then they are only read.

    Files are written after the last frame. Killed at any moment and started again it gives the same bytes.

    Parameters
    ----------
    folder : an existing folder, best from `results.run_folder`.
    method : the name written into the folder.
    matches, progress : as `run_methods` takes them.
    fresh : do it whatever the folder holds; finished files stay until new ones replace them.

    Raises `DataError` where the folder holds another run or results of something else, another process works
    in it, or it cannot be written.
    """
    identity = run_identity(sequence, config, method)
    with only_process(folder):
        if not fresh:
            _refuse_another(folder, identity)
            if is_finished(folder):
                return read_run(folder, sequence), True
        result = run_methods(sequence, {method: config}, progress, matches)[method]
        write_run(folder, result, method, identity)
    return result, False


def _refuse_another(folder: Path, wanted: dict[str, Any]) -> None:
    """`DataError` naming what differs, where the folder holds anything else than the run that is wanted."""
    if not (folder / CONFIG).exists():
        for name in RUN_FILES:
            if (folder / name).exists():
                raise DataError(
                    f"of something else, for there is no {CONFIG} beside it; choose another folder, or start "
                    "anew with --fresh",
                    folder / name,
                )
        return
    there = read_config(folder, unfinished=True)
    # Its name is no part of a sequence.
    differs = list(_differences(there, {name: value for name, value in wanted.items() if name != "sequence"}))
    if differs:
        more = f" and {len(differs) - 3} more" if len(differs) > 3 else ""
        raise DataError(
            f"the folder holds another run: {'; '.join(differs[:3])}{more}; "
            "choose another folder, or start anew with --fresh",
            folder,
        )


def _differences(there: Any, wanted: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """In words, everything that decides the poses and is not there as it is wanted."""
    for name, value in wanted.items():
        other = there.get(name) if isinstance(there, dict) else None
        if isinstance(value, dict):
            yield from _differences(other, value, "" if name in ("settings", "made_with") else f"{name}.")
        elif other != value:
            yield DIGESTS.get(name, f"{prefix}{name} is {other} there and {value} here")


@dataclass(frozen=True)
class Job:
    """One run to be done: everything that a process, here or on a cluster, needs to know.

    Attributes
    ----------
    sequence : what to run, opened by the caller (a part of it, or other labels, are set there).
    method : name of the method, written into the folder and shown to the person.
    config : its settings, the seed among them.
    folder : the run folder; made when needed, left as it is when it holds this run finished.
    """

    sequence: Sequence
    method: str
    config: PublishedConfig
    folder: Path

    @property
    def name(self) -> str:
        """How a person knows the job."""
        return f"{self.sequence.name}, {self.method}, seed {self.config.seed}"


@dataclass(frozen=True)
class Outcome:
    """What became of a job: the cause of its failure in one line, or None when the run folder is complete."""

    job: Job
    error: str | None


def run_jobs(
    jobs: list[Job],
    workers: int = 1,
    progress: Progress | None = None,
    cache: Path | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
) -> list[Outcome]:
    """Do all jobs; the front end of each sequence runs once, its matches are kept in the match cache.

    Parameters
    ----------
    jobs : with folders all different, which hold finished runs afterwards.
    workers : processes; 1 runs in this one.
    progress : called with (frames done, frames in all) over the jobs that are not finished and their front
        ends, where a frame counts `MATCHING` times, now and then, from another thread.
    cache : folder of the match cache; default the user's cache folder.
    scheduler : address of a Dask scheduler, "tcp://host:port", that runs the jobs in place of local
        processes; its workers must see the same files under the same names.
    fresh : start finished folders anew.

    Returns
    -------
    An outcome for each job, in the order of the jobs. A job that fails (bad input, an exception, a process
    that is killed) has its cause there while the others finish.

    Raises `DataError` where two jobs share a folder, or the scheduler cannot be reached.
    """
    jobs = [replace(job, folder=job.folder.resolve()) for job in jobs]
    if len({job.folder for job in jobs}) < len(jobs):
        raise DataError("two jobs share a folder")
    cache = None if cache is None else cache.resolve()
    left = [job for job in jobs if fresh or not is_finished(job.folder)]
    # One job for each front end that is needed.
    needed = {_front_end(job): job for job in left}
    with counting(left, list(needed.values()), cache, progress):
        filled = parallel(partial(_fill, cache=cache), list(needed.values()), workers, scheduler)
        broken = {name: error for name, error in zip(needed, filled, strict=True) if error}
        ready = [job for job in jobs if _front_end(job) not in broken or is_finished(job.folder)]
        run = partial(_run, cache=cache, fresh=fresh)
        ended = parallel(run, ready, workers, scheduler)
    done = {job.folder: error for job, error in zip(ready, ended, strict=True)}
    return [Outcome(job, done.get(job.folder, broken.get(_front_end(job)))) for job in jobs]


def _front_end(job: Job) -> Hashable:
    """What a job's matches depend on; jobs with the same share them."""
    return job.sequence.folder, job.sequence.frames, job.config.features, job.config.matching


def _matches(job: Job, cache: Path | None) -> CachedMatches:
    return CachedMatches(job.sequence, job.config.features, job.config.matching, cache)


def _fill(job: Job, cache: Path | None) -> None:
    """The front end: find all matches that are not in the cache."""
    with single_threaded():
        _matches(job, cache).fill()


def _run(job: Job, cache: Path | None, fresh: bool) -> None:
    """The back end, in the job's folder."""
    with run_folder(job.folder) as folder:
        run_once(folder, job.sequence, job.config, job.method, matches=_matches(job, cache), fresh=fresh)


@contextmanager
def counting(
    jobs: list[Job], front_ends: list[Job], cache: Path | None, progress: Progress | None
) -> Iterator[None]:
    """A context in which a thread tells how far the jobs are: matches kept, and runs finished since.

    It looks into the folders, which works for processes of this machine and of a cluster alike.
    """
    if progress is None or not jobs:
        yield
        return
    total = sum(len(job.sequence) for job in jobs + MATCHING * front_ends)
    ends = [(job.folder / CONFIG, written_at(job.folder / CONFIG), len(job.sequence)) for job in jobs]
    stop = Event()

    def watch() -> None:
        caches, begun = [], time.time_ns()
        for job in front_ends:
            with suppress(DataError):  # the task itself says what is wrong
                matches = _matches(job, cache)
                # Those of a front end that was stopped half way are all found again.
                whole = matches.frames_kept() == len(job.sequence)
                caches.append((matches, -1 if whole else begun))
        while not stop.is_set():
            found = MATCHING * sum(matches.frames_kept(since) for matches, since in caches)
            ended = sum(frames for path, before, frames in ends if written_at(path) != before)
            progress(found + ended, total)
            stop.wait(POLL)

    thread = Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
    progress(total, total)
