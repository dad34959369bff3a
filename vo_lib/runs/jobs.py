"""Many runs at once, in parallel processes, each in a run folder of its own."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event, Thread

from ..config import PublishedConfig
from ..core.errors import DataError
from ..core.files import LOCK
from ..core.types import Progress
from ..data.sequence import Sequence
from .match_cache import CachedMatches
from .parallel import parallel
from .results import CONFIG, is_finished, run_folder
from .run_once import run_once
from .runner import single_threaded

POLL = 0.3  # seconds between two looks at what was done


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

    Afterwards each folder without an error holds poses.txt, poses_tum.txt, config.json, frames.csv and, where
    there is truth, metrics.json: `results.read_run` gives the run back.

    Parameters
    ----------
    jobs : with folders all different.
    workers : processes; 1 runs in this one.
    progress : called with (frames done, frames in all) over the jobs that are not finished and their front
        ends, now and then, from another thread.
    cache : folder of the match cache; default the user's cache folder.
    scheduler : address of a Dask scheduler, "tcp://host:port", that runs the jobs in place of local
        processes; its workers must see the same files under the same names.
    fresh : start finished folders anew.

    Returns
    -------
    An outcome for each job, in the order of the jobs. A job that fails (bad input, an exception, a process
    that is killed) has its cause there while the others finish.

    Raises
    ------
    DataError : two jobs share a folder, or the scheduler cannot be reached.
    KeyboardInterrupt : all processes are stopped; what is finished is not done again.
    """
    jobs = [replace(job, folder=job.folder.resolve()) for job in jobs]
    if len({job.folder for job in jobs}) < len(jobs):
        raise DataError("two jobs share a folder")
    cache = None if cache is None else cache.resolve()
    left = [job for job in jobs if fresh or not is_finished(job.folder)]
    # One job for each front end that is needed.
    needed = {_front_end(job): job for job in left}
    with _counting(left, list(needed.values()), cache, progress):
        filled = parallel(partial(_fill, cache=cache), list(needed.values()), workers, scheduler)
        broken = {name: error for name, error in zip(needed, filled, strict=True) if error}
        ready = [job for job in jobs if _front_end(job) not in broken or is_finished(job.folder)]
        run = partial(_run, cache=cache, fresh=fresh)
        ended = parallel(run, ready, workers, scheduler, begun=_is_begun)
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
        run_once(folder, job.sequence, job.config, job.method, cached=True, cache=cache, fresh=fresh)


def _is_begun(job: Job) -> bool:
    """Whether a process was killed in the job's folder: it left its lock there."""
    return (job.folder / LOCK).exists()


@contextmanager
def _counting(
    jobs: list[Job], front_ends: list[Job], cache: Path | None, progress: Progress | None
) -> Iterator[None]:
    """A context in which a thread tells how far the jobs are: matches kept, and runs finished since.

    It looks into the folders, which works for processes of this machine and of a cluster alike.
    """
    if progress is None or not jobs:
        yield
        return
    total = sum(len(job.sequence) for job in jobs + front_ends)
    before = {job.folder: _changed(job) for job in jobs}
    stop = Event()

    def watch() -> None:
        caches = []
        for job in front_ends:
            with suppress(DataError):  # the task itself says what is wrong
                caches.append(_matches(job, cache))
        while not stop.is_set():
            found = sum(matches.frames_kept() for matches in caches)
            ended = sum(len(job.sequence) for job in jobs if _changed(job) != before[job.folder])
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


def _changed(job: Job) -> int:
    """When a job's run was last written, nanoseconds; 0 when never."""
    try:
        return (job.folder / CONFIG).stat().st_mtime_ns
    except OSError:
        return 0
