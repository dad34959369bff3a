"""Runs in one folder each: a run is computed once, and later read from its folder. Jobs run in parallel."""

from __future__ import annotations

import math
import os
import re
import time
import traceback
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..data.sequence import Sequence
from ..errors import DataError
from ..files import only_process
from ..geometry.types import Progress
from ..paper.settings import MethodConfig
from ..parallel import local_pool
from .drive import Run, run_methods, single_threaded
from .durations import Durations, Forecast, Task
from .earlier_seconds import seconds_of_matches, seconds_of_run, write_seconds
from .folder import (
    DETECTOR_OF_BOXES,
    changed_files,
    delete_unfinished,
    has_runs,
    is_finished,
    read_config,
    read_run,
    refuse_foreign_files,
    run_folder,
    write_run,
)
from .front_end import TimedMatches
from .identity import NOT_USED, images_digest, run_identity
from .match_cache import CachedMatches

if TYPE_CHECKING:
    from ..kit.calibration import Calibration

MATCHING_FRAMES = 4  # the matches of a frame take as long as the back end takes for so many frames
# First, a job of each kind (`durations.Task`) is done, and the time of the others is then estimated. If the
# first jobs would be more than this share of all jobs, it is only one of each family.
MOST_FIRST_JOBS = 0.25
SIZE_CLASSES = 4  # images of twice as many pixels are so many classes further on, see `_size_class`
NAMED_INPUTS = 3  # of those that differ, a message names so many
DASK_WORKER_KILLED = "KilledWorker"  # the exception of Dask, which is not always installed
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
    own: bool = False,
    progress: Progress | None = None,
) -> tuple[Run, bool]:
    """The run with its files in `folder`, and whether the run was read from these files, not computed.

    Files are written after the last frame. A run that is killed and repeated gives the same poses, byte
    for byte. A finished run whose files have changed (`changed_files`) is computed again.

    Parameters
    ----------
    method : the name written into the folder.
    matches, calibration, progress : as in `run_methods`.
    fresh : compute the run in any case; the new files replace the old files at the end.
    own : the files in the folder are known to be the kit's, even without a config.json.

    Raises
    ------
    DataError : the folder is missing, not writable, in use by another process, or contains another run or
        other files; and as `run_identity` and `run_methods`.
    """
    if not own:
        refuse_foreign_files(folder, fresh)  # before the lock, which marks the folder as the kit's
    identity = run_identity(sequence, config, method, calibration)
    with only_process(folder):
        if is_finished(folder) and not fresh:
            refuse_another(folder, identity)
            if not changed_files(folder):
                return read_run(folder, sequence), True
        delete_unfinished(folder)
        result = run_methods(sequence, {method: config}, progress, matches, calibration)[method]
        write_run(folder, result, identity)
    return result, False


def refuse_another(folder: Path, identity: dict[str, Any], detector: dict[str, Any] | None = None) -> None:
    """Raise `DataError` with the differences if the folder contains a run with another identity.

    detector : as in `inputs_that_differ`.
    """
    differing = inputs_that_differ(folder, identity, detector)
    if differing:
        raise DataError(
            f"the folder contains another run, which differs in {_few_of(differing)}; "
            "choose another folder, or replace the run with --fresh",
            folder,
        )


def _few_of(names: list[str]) -> str:
    """Words with the first of some names, and with the number of the others."""
    words = ", ".join(names[:NAMED_INPUTS])
    others = len(names) - NAMED_INPUTS
    return f"{words} and {others} more" if others > 0 else words


def _flat(mapping: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested mappings by dotted name."""
    for name, value in mapping.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


@dataclass(frozen=True)
class Job:
    """A run to do. A missing folder is created; a folder with the finished run is not changed.

    `settings` : the settings that differ from the method's preset, for messages.
    """

    sequence: Sequence
    method: str
    config: MethodConfig
    folder: Path
    settings: str = ""

    @property
    def system(self) -> str:
        """The method, with the settings that differ from its preset."""
        return f"{self.method}, {self.settings}" if self.settings else self.method

    @property
    def name(self) -> str:
        """Sequence, method, settings and seed, for messages."""
        return f"{self.sequence.name}, {self.system}, seed {self.config.seed}"


def refuse_other_runs(
    jobs: Iterable[Job],
    detector_of: Callable[[Job], dict[str, Any] | None] = lambda job: None,
) -> None:
    """Raise one `DataError` if folders of the jobs contain finished runs with other inputs.

    detector_of : the record of the detector (`label_folders.detection_record`) whose boxes a job will get, or
        None for a job that has its boxes. So a table with another detector is refused before it detects.
    """
    refused_folders: list[Path] = []
    all_differing: list[str] = []
    # An identity has digests of many files. All seeds of a method share them, so they are computed once.
    identity_of_seeds: dict[tuple[int, MethodConfig, str], dict[str, Any]] = {}
    for job in jobs:
        if not is_finished(job.folder):
            continue
        key = (id(job.sequence), replace(job.config, seed=0), job.method)
        if key not in identity_of_seeds:
            identity_of_seeds[key] = run_identity(job.sequence, job.config, job.method)
        identity = dict(identity_of_seeds[key])
        identity["settings"] = identity["settings"] | {"seed": job.config.seed}
        differing = inputs_that_differ(job.folder, identity, detector_of(job))
        if differing:
            refused_folders.append(job.folder)
            all_differing += differing
    if not refused_folders:
        return
    names = list(dict.fromkeys(all_differing))
    count = len(set(refused_folders))
    start = "a finished run here differs" if count == 1 else f"{count} finished runs here differ"
    raise DataError(
        f"{start} in {_few_of(names)} from the runs to do; "
        "choose another folder, or replace the runs with --fresh",
        os.path.commonpath(refused_folders),
    )


def inputs_that_differ(
    folder: Path, identity: dict[str, Any], detector: dict[str, Any] | None = None
) -> list[str]:
    """Names of the inputs in which the finished run of a folder differs from an identity.

    identity : result of `run_identity`.
    detector : the record of the detector whose boxes a run of this identity will get. Then its labels are not
        those of the identity yet, and the detectors are compared in their place.
    """
    stored = dict(_flat(read_config(folder)))
    expected = dict(_flat(identity))
    del expected["sequence"]  # the name may change
    has_other_detector = False
    if detector is not None and expected["labels"] != NOT_USED:
        del expected["labels"]
        has_other_detector = _has_other_detector(folder, detector)
    differing = [name for name, value in expected.items() if stored.get(name) != value]
    return ["detector", *differing] if has_other_detector else differing


def _has_other_detector(folder: Path, detector: dict[str, Any]) -> bool:
    """Whether the boxes of a finished run are not those of a detector with this record."""
    record = read_config(folder).get(DETECTOR_OF_BOXES)
    if not isinstance(record, dict):
        return True  # labels of another origin, or no boxes at all
    # The model's file may have another name now: its "sha256" is compared.
    return any(record.get(name) != value for name, value in detector.items() if name != "model")


@dataclass(frozen=True)
class Outcome:
    """How a job ended.

    error : the cause of its failure as one line; None for success.
    changed : names of files that differed from what an earlier run wrote, so that the run was repeated.
    """

    job: Job
    error: str | None
    changed: tuple[str, ...] = ()


def run_jobs(
    jobs: list[Job],
    workers: int = 1,
    progress: Progress | None = None,
    cache: Path | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    durations: Durations | None = None,
    estimated: Callable[[float, bool], None] = lambda seconds, again: None,
) -> list[Outcome]:
    """Do all jobs; each front end runs once per sequence and stores its matches in the match cache.

    Parameters
    ----------
    jobs : runs in different folders.
    workers : number of processes, at most one for each job; 1 means this process.
    progress : called with (frames done, total frames); a frame of a front end counts as `MATCHING_FRAMES`.
    cache : folder with the kit's cache folder; default the user's.
    scheduler : address of a Dask scheduler, "tcp://host:port", used instead of local processes; the workers
        need the same files under the same paths.
    fresh : repeat finished runs.
    durations : gets the time of each job, and the number of processes.
    estimated : called with the estimated seconds of the rest, after the first jobs, those on the shortest
        sequences; and a second time, with True, if the rest turns out much different.

    Returns
    -------
    An outcome for each job, in order; a failure does not stop the other jobs.

    Raises
    ------
    DataError : two jobs share a folder, a folder contains a finished run with other inputs, the scheduler
        cannot be reached, or a worker process is killed; a second call then does the unfinished runs.
    """
    jobs = [replace(job, folder=job.folder.resolve()) for job in jobs]
    if len({job.folder for job in jobs}) < len(jobs):
        raise DataError("two jobs share a folder")
    if not fresh:
        refuse_other_runs(jobs)
    cache = None if cache is None else cache.resolve()
    durations = Durations() if durations is None else durations
    changed = {job.folder: () if fresh else tuple(changed_files(job.folder)) for job in jobs}
    to_run = [job for job in jobs if fresh or changed[job.folder] or not is_finished(job.folder)]
    for sequence in {job.sequence.folder: job.sequence for job in jobs}.values():
        images_digest(sequence)  # hash here once; workers read the stored hashes
    # Of the jobs that share a front end, and so their matches, one stands for all.
    job_for_front_end = {_front_end(job): job for job in to_run}
    unfilled = [job for job in job_for_front_end.values() if not _has_matches(job, cache)]
    _add_kept_times(jobs, to_run, unfilled, cache, durations)
    # The first jobs say how long the others will take.
    first_runs = _first_jobs(to_run, running_task, workers)
    # Done first: the front ends that these runs need and, to measure its time, one front end of each kind. A
    # run whose front end was done only for its time comes later.
    first_keys = [_front_end(job) for job in [*first_runs, *_first_jobs(unfilled, matching_task, workers)]]
    first_front_ends = {key: job_for_front_end[key] for key in first_keys}
    other_front_ends = {key: job for key, job in job_for_front_end.items() if key not in first_front_ends}
    # Also the finished ones: `_run` reads them back, so one that cannot be read fails here, and by itself.
    other_runs = [job for job in jobs if job not in first_runs]
    matching = _Stage(partial(_fill, cache=cache), matching_task, MATCHING_FRAMES)
    running = _Stage(partial(_run, cache=cache, fresh=fresh), running_task, 1)
    frames_done = _FramesDone(matching.cost(job_for_front_end.values()) + running.cost(jobs), progress)
    tasks = [map(matching_task, unfilled), map(running_task, to_run)]
    forecast = Forecast(durations, tasks, estimated)
    with executor(min(workers, max(len(jobs), 1)), scheduler, durations) as pool:
        runner = _JobRunner(pool, matching, running, frames_done, forecast)
        try:
            runner.do(first_front_ends, first_runs)
            forecast.announce()
            runner.do(other_front_ends, other_runs)
        except Exception as error:  # `_attempt` catches the exceptions of the jobs
            raise _error_of_workers(error) from error
    return [Outcome(job, runner.failure_of(job), changed[job.folder]) for job in jobs]


def _error_of_workers(error: Exception) -> DataError:
    """What is said of an exception of the pool, not of a job."""
    if isinstance(error, BrokenExecutor) or type(error).__name__ == DASK_WORKER_KILLED:
        return DataError(
            "a worker process was killed, perhaps for lack of memory; repeat the command to continue"
        )
    return DataError(f"the workers failed: {_in_one_line(error)}")


class _Stage(NamedTuple):
    """One half of the work on jobs: their matches, or their runs.

    function : does it for a job, and returns whether there was work to do.
    task : describes it for an estimate.
    frame_cost : how long a frame takes, compared with a frame of a run.
    """

    function: Callable[[Job], bool]
    task: Callable[[Job], Task]
    frame_cost: int

    def cost(self, jobs: Iterable[Job]) -> int:
        """How long the stage takes for some jobs, in frames of a run."""
        return sum(self.frame_cost * len(job.sequence) for job in jobs)


class _FramesDone:
    """Counts frames, and tells a progress function of them."""

    def __init__(self, total: int, progress: Progress | None):
        self._total = total
        self._progress = progress
        self._done = 0
        self.add(0)

    def add(self, frames: int) -> None:
        """Count further frames."""
        self._done += frames
        if self._progress is not None:
            self._progress(self._done, self._total)


class _JobRunner:
    """Does jobs in a pool of processes: first the front ends that they need, then their runs."""

    def __init__(
        self, pool: Executor, matching: _Stage, running: _Stage, frames_done: _FramesDone, forecast: Forecast
    ):
        self._pool = pool
        self._matching = matching
        self._running = running
        self._frames_done = frames_done
        self._forecast = forecast
        self._failed_front_ends: dict[Hashable, str] = {}  # the cause of each failure by `_front_end`
        self._ended_runs: dict[Path, str | None] = {}  # the cause of a failure by folder; None for success

    def do(self, job_for_front_end: dict[Hashable, Job], jobs: list[Job]) -> None:
        """Run front ends, each for one of its jobs, then the jobs whose front ends have not failed."""
        causes = self._do_stage(self._matching, list(job_for_front_end.values()))
        for key, cause in zip(job_for_front_end, causes, strict=True):
            if cause:
                self._failed_front_ends[key] = cause
        ready = [job for job in jobs if _front_end(job) not in self._failed_front_ends]
        causes = self._do_stage(self._running, ready)
        for job, cause in zip(ready, causes, strict=True):
            self._ended_runs[job.folder] = cause

    def failure_of(self, job: Job) -> str | None:
        """The cause of a job's failure, in its run or in its front end; None for success."""
        if job.folder in self._ended_runs:
            return self._ended_runs[job.folder]
        return self._failed_front_ends.get(_front_end(job))

    def _do_stage(self, stage: _Stage, jobs: list[Job]) -> list[str | None]:
        """Do a stage of each job; return the causes of failure, in order, None for success."""
        futures = []
        for job in jobs:
            future = self._pool.submit(_attempt, stage.function, job)
            future.add_done_callback(partial(self._job_done, stage, job))
            futures.append(future)
        return [future.result().cause for future in futures]

    def _job_done(self, stage: _Stage, job: Job, future: Future[_Attempt]) -> None:
        """Count the frames of a job, and its time if it took any."""
        self._frames_done.add(stage.cost([job]))
        if future.exception() is not None:
            return
        attempt = future.result()
        # A job without work had its result already, and so the forecast has no task for it.
        if attempt.worked or attempt.cause:
            self._forecast.done(stage.task(job), attempt.seconds if attempt.worked else None)


def matching_task(job: Job) -> Task:
    """The front end of a job, as a task."""
    config = job.config
    kind = ("matching", _size_class(job), config.variant, config.features, config.matching)
    return Task(kind, len(job.sequence), ("matching", config.variant))


def running_task(job: Job) -> Task:
    """The run of a job with given matches, as a task."""
    kind = ("run", _size_class(job), job.method, replace(job.config, seed=0))
    return Task(kind, len(job.sequence), ("run", job.config.variant))


def _size_class(job: Job) -> int:
    """A number for the size of images: how often the number of pixels doubles, in quarters.

    Images of one class differ by at most 19 %, a factor of 2^(1/4).
    """
    return round(SIZE_CLASSES * math.log2(job.sequence.camera.width * job.sequence.camera.height))


def _first_jobs(jobs: list[Job], task: Callable[[Job], Task], workers: int) -> list[Job]:
    """A job of each kind of task, on the shortest sequence, and others until every process has work.

    Where this would be much of the work, as with many settings and one seed, it is a job of each family
    (`Task.family`).
    """
    by_length = sorted(jobs, key=lambda job: len(job.sequence))
    # The shortest comes last, so it is the one that stays.
    shortest_of: dict[Hashable, Job] = {task(job).kind: job for job in reversed(by_length)}
    if len(shortest_of) > MOST_FIRST_JOBS * len(jobs):
        shortest_of = {task(job).family: job for job in reversed(by_length)}
    chosen = list(shortest_of.values())
    for job in by_length:
        if len(chosen) >= workers:
            break
        if job not in chosen:
            chosen.append(job)
    return chosen


def _add_kept_times(
    jobs: list[Job], to_run: list[Job], unfilled: Iterable[Job], cache: Path | None, durations: Durations
) -> None:
    """Count the durations of finished runs and of cached matches, as far as they are known.

    to_run : those of the jobs whose run will be computed.
    unfilled : a job for each front end without matches.
    """
    job_for_front_end = {_front_end(job): job for job in jobs}
    without_matches = {_front_end(job) for job in unfilled}
    for key, job in job_for_front_end.items():
        if key not in without_matches:
            seconds = seconds_of_matches(CachedMatches(job.sequence, job.config, cache))
            if seconds is not None:
                durations.add_kept(matching_task(job), seconds)
    to_compute = {job.folder for job in to_run}
    for job in jobs:
        if job.folder not in to_compute:
            seconds = seconds_of_run(job.folder, len(job.sequence))
            if seconds is not None:
                durations.add_kept(running_task(job), seconds)


def seconds_of_jobs(jobs: Iterable[Job], cache: Path | None) -> tuple[float, int]:
    """Seconds that the matches and runs of finished jobs took, each once, and for how many it is not known.

    cache : folder with the kit's cache folder; default the user's.
    """
    finished = [job for job in jobs if is_finished(job.folder)]
    times = [seconds_of_run(job.folder, len(job.sequence)) for job in finished]
    job_for_front_end = {_front_end(job): job for job in finished}
    for job in job_for_front_end.values():
        times.append(seconds_of_matches(CachedMatches(job.sequence, job.config, cache)))
    known = [seconds for seconds in times if seconds is not None]
    return math.fsum(known), len(times) - len(known)


def _front_end(job: Job) -> Hashable:
    """The inputs of a job's matches, as a key: jobs with equal keys share their matches."""
    config = job.config
    return job.sequence.folder, job.sequence.frames, config.variant, config.features, config.matching


def _has_matches(job: Job, cache: Path | None) -> bool:
    """Whether the cache has the matches of a job."""
    return CachedMatches(job.sequence, job.config, cache).path.exists()


def _fill(job: Job, cache: Path | None) -> bool:
    """Run the front end for matches that are not in the cache; return whether it ran."""
    matches = CachedMatches(job.sequence, job.config, cache)
    start = time.perf_counter()
    with single_threaded():
        computed = matches.fill()
    if computed:
        write_seconds(matches, time.perf_counter() - start)
    return computed


def _run(job: Job, cache: Path | None, fresh: bool) -> bool:
    """Run the back end in the job's folder; return whether it ran, because its run was not there."""
    matches = CachedMatches(job.sequence, job.config, cache)
    with run_folder(job.folder) as folder:
        # A folder of a table with files, but without a config.json, has an unfinished run if its neighbours
        # have finished ones.
        own = has_runs(folder.parent)
        _, read_back = run_once(
            folder, job.sequence, job.config, job.method, matches=matches, fresh=fresh, own=own
        )
    return not read_back


class _Attempt(NamedTuple):
    """How a stage of a job ended: the cause of a failure or None, whether there was work, and its seconds."""

    cause: str | None
    worked: bool
    seconds: float


def _attempt(function: Callable[[Job], bool], job: Job) -> _Attempt:
    """Do a stage of one job; an exception becomes one line with its origin."""
    start = time.perf_counter()
    try:
        worked = function(job)
    except DataError as error:
        return _Attempt(str(error), False, 0.0)
    except Exception as error:
        origin = traceback.extract_tb(error.__traceback__)[-1]
        cause = f"{_in_one_line(error)} ({Path(origin.filename).name}, line {origin.lineno})"
        return _Attempt(cause, False, 0.0)
    return _Attempt(None, worked, time.perf_counter() - start)


def _in_one_line(error: BaseException) -> str:
    """The type of an exception and its message, without line breaks."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


@contextmanager
def executor(
    workers: int, scheduler: str | None = None, durations: Durations | None = None
) -> Iterator[Executor]:
    """Local processes, or the workers of a Dask scheduler.

    workers : number of local processes; scheduler : as in `run_jobs`.
    durations : gets the number of jobs that are done at the same time.

    Raises
    ------
    DataError : Dask is not installed, the address is wrong, no scheduler answers, or it has no workers.
    """
    durations = Durations() if durations is None else durations
    if scheduler is None:
        durations.workers = workers
        with local_pool(workers) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise DataError('Dask is missing; it is in the extra cluster: pip install -e ".[cluster]"') from None
    if not re.fullmatch(r"\w+://\S+:\d+", scheduler):
        raise DataError(f"Dask scheduler {scheduler}: expected an address such as tcp://127.0.0.1:8786")
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DataError(
            f"Dask scheduler {scheduler}: no scheduler answers at this address ({error})"
        ) from None
    with client:
        threads = client.nthreads()
        if not threads:
            raise DataError(f"Dask scheduler {scheduler}: the scheduler has no workers")
        durations.workers = sum(threads.values())
        yield client.get_executor(pure=False)
