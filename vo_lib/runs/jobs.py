"""Runs in folders of their own: each done once, read back when it is asked for again; many at once."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..data.sequence import Sequence
from ..errors import DataError
from ..files import only_process
from ..geometry.types import Progress
from ..paper.settings import MethodConfig
from ..parallel import local_pool
from .drive import Run, run_methods, single_threaded
from .folder import is_finished, read_config, read_run, refuse_foreign_files, run_folder, write_run
from .front_end import TimedMatches
from .identity import images_digest, run_identity
from .matches import CachedMatches

if TYPE_CHECKING:
    from ..kit.calibration import Calibration

MATCHING_FRAMES = 4  # to find a frame's matches takes about as long as so many frames of a run
CONNECT_TIMEOUT_S = 10.0


def run_once(
    folder: Path,
    sequence: Sequence,
    config: MethodConfig,
    method: str,
    *,
    matches: Iterable[TimedMatches] | None = None,
    calibration: Calibration | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> tuple[Run, bool]:
    """A run whose files are in `folder`, and whether they were there before: then they are only read.

    Files are written after the last frame. Killed at any moment and started again it gives the same bytes.
    `matches`, `calibration` and `progress` are those of `run_methods`; `method` is the name written into the
    folder. `fresh` does it whatever the folder holds; finished files stay until new ones replace them.

    Raises `DataError` where the folder is missing, holds another run or other files, another process works in
    it, or it cannot be written.
    """
    identity = run_identity(sequence, config, method, calibration)
    with only_process(folder):
        if not fresh:
            refuse_foreign_files(folder)
            if is_finished(folder):
                _refuse_another(folder, identity)
                return read_run(folder, sequence), True
        result = run_methods(sequence, {method: config}, progress, matches, calibration)[method]
        write_run(folder, result, identity)
    return result, False


def _refuse_another(folder: Path, wanted: dict[str, Any]) -> None:
    """`DataError` naming the differences, where the folder holds another run."""
    there, here = dict(_flat(read_config(folder))), dict(_flat(wanted))
    del here["sequence"]  # a name is no part of a sequence
    if other := [name for name, value in here.items() if there.get(name) != value]:
        more = f" and {len(other) - 3} more" if len(other) > 3 else ""
        raise DataError(
            f"the folder holds another run, with other {', '.join(other[:3])}{more}; "
            "choose another folder, or start anew with --fresh",
            folder,
        )


def _flat(mapping: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested mappings with their dotted names."""
    for name, value in mapping.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


@dataclass(frozen=True)
class Job:
    """One run in a folder, which is made when needed, and left as it is when the run is finished."""

    sequence: Sequence
    method: str
    config: MethodConfig
    folder: Path

    @property
    def name(self) -> str:
        """Sequence, method and seed, for messages."""
        return f"{self.sequence.name}, {self.method}, seed {self.config.seed}"


@dataclass(frozen=True)
class Outcome:
    """A job and the cause of its failure in one line, or None when the run folder is complete."""

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
    progress : called with (frames done, frames in all); a front end's frame counts `MATCHING_FRAMES` times.
    cache : folder of the match cache; default the user's cache folder.
    scheduler : address of a Dask scheduler, "tcp://host:port", that runs the jobs in place of local
        processes; its workers must see the same files under the same names.
    fresh : start finished folders anew.

    Returns
    -------
    An outcome for each job, in order; a job that fails has its cause there while the others finish.

    Raises `DataError` where two jobs share a folder, the scheduler cannot be reached, or a worker process is
    killed: the same command then goes on with the runs that are not finished.
    """
    jobs = [replace(job, folder=job.folder.resolve()) for job in jobs]
    if len({job.folder for job in jobs}) < len(jobs):
        raise DataError("two jobs share a folder")
    cache = None if cache is None else cache.resolve()
    # A job for each front end that is needed.
    needed = {_front_end(job): job for job in jobs if fresh or not is_finished(job.folder)}
    for sequence in {job.sequence.folder: job.sequence for job in jobs}.values():
        images_digest(sequence)  # hashed here once; workers read the hashes
    total = sum(len(job.sequence) for job in [*jobs, *MATCHING_FRAMES * list(needed.values())])
    done = 0

    def frames_done(frames: int, future: object = None) -> None:
        nonlocal done
        done += frames
        if progress is not None:
            progress(done, total)

    def in_pool(function: Callable[[Job], None], jobs: Iterable[Job], weight: int = 1) -> list[str | None]:
        """Call `function` for each job; the cause of each one's failure, in order, or None."""
        futures = []
        for job in jobs:
            futures.append(pool.submit(_attempt, function, job))
            futures[-1].add_done_callback(partial(frames_done, weight * len(job.sequence)))
        return [future.result() for future in futures]

    frames_done(0)
    with executor(workers, scheduler) as pool:
        try:
            filled = in_pool(partial(_fill, cache=cache), needed.values(), MATCHING_FRAMES)
            broken = {front_end: error for front_end, error in zip(needed, filled, strict=True) if error}
            ready = [job for job in jobs if _front_end(job) not in broken]
            ended = in_pool(partial(_run, cache=cache, fresh=fresh), ready)
        except Exception:  # jobs themselves raise none
            raise DataError(
                "a worker process was killed, perhaps for too much memory: the same command goes on"
            ) from None
    errors = {job.folder: error for job, error in zip(ready, ended, strict=True)}
    return [Outcome(job, errors.get(job.folder, broken.get(_front_end(job)))) for job in jobs]


def _front_end(job: Job) -> Hashable:
    """Everything a job's matches depend on; jobs with the same share them."""
    config = job.config
    return job.sequence.folder, job.sequence.frames, config.variant, config.features, config.matching


def _fill(job: Job, cache: Path | None) -> None:
    """The front end: find all matches that are not in the cache."""
    with single_threaded():
        CachedMatches(job.sequence, job.config, cache).fill()


def _run(job: Job, cache: Path | None, fresh: bool) -> None:
    """The back end, in the job's folder."""
    matches = CachedMatches(job.sequence, job.config, cache)
    with run_folder(job.folder) as folder:
        run_once(folder, job.sequence, job.config, job.method, matches=matches, fresh=fresh)


def _attempt(function: Callable[[Job], None], job: Job) -> str | None:
    """Do one job; an exception becomes one line that says where it came from."""
    try:
        function(job)
    except DataError as wrong:
        return str(wrong)
    except Exception as wrong:
        place = traceback.extract_tb(wrong.__traceback__)[-1]
        text = " ".join(str(wrong).split())
        return f"{type(wrong).__name__}: {text} ({Path(place.filename).name}, line {place.lineno})"
    return None


@contextmanager
def executor(workers: int, scheduler: str | None = None) -> Iterator[Executor]:
    """Processes of this machine, or the workers of a Dask scheduler; `DataError` where it has none."""
    if scheduler is None:
        with local_pool(workers) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise DataError('--dask needs the extra cluster: pip install -e ".[cluster]"') from None
    if not re.fullmatch(r"\w+://\S+:\d+", scheduler):
        raise DataError(f"--dask {scheduler}: expected an address such as tcp://127.0.0.1:8786")
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DataError(f"--dask {scheduler}: no scheduler answers there ({error})") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise DataError(f"--dask {scheduler}: the scheduler has no workers")
        yield client.get_executor(pure=False)
