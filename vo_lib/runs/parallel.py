"""Tasks in parallel processes, here or on a Dask cluster; one may fail or be killed."""

from __future__ import annotations

import concurrent.futures
import os
import re
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, as_completed
from contextlib import AbstractContextManager, contextmanager
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, TypeVar

import cv2
import loky
from loky.backend import resource_tracker as loky_tracker
from loky.process_executor import BrokenProcessPool

from ..core.errors import DataError

Item = TypeVar("Item")
Task = tuple[int, Callable[[Any], None], Any, int]
Pools = Callable[[int], AbstractContextManager[Executor]]  # by the number of tasks

KILLED = "its process was killed, perhaps for too much memory"
HOLDS_BACK = hasattr(signal, "pthread_sigmask")  # not Windows
WATCH = 0.5  # seconds between two looks at whether the first process is there
CONNECT = 10.0  # seconds to wait for a scheduler


def parallel(
    function: Callable[[Item], None],
    items: list[Item],
    workers: int = 1,
    scheduler: str | None = None,
    begun: Callable[[Item], bool] = lambda item: True,
) -> list[str | None]:
    """Call `function` for each item, in several processes.

    Returns for each, in order, the cause of its failure in one line, or None.

    When a process is killed, its pool is lost. The tasks that were begun then are done again alone, one at a
    time: the one at fault shows itself. The others go on in a new pool.

    Parameters
    ----------
    function : a function of a module, which can be called for the same item again.
    workers : processes, of which no more start than there are tasks; 1 works in this one, where a kill ends
        everything.
    scheduler : address of a Dask scheduler, whose workers are used instead.
    begun : whether an unfinished item may have been in work when a pool was lost.

    Raises
    ------
    DataError : the scheduler cannot be reached, or has no workers.
    KeyboardInterrupt : the processes are stopped.
    """
    if scheduler is None and workers == 1:
        return [_attempt((index, function, item, 0))[1] for index, item in enumerate(items)]
    threads = max(1, (os.cpu_count() or 1) // max(min(workers, len(items)), 1))
    tasks = [(index, function, item, threads) for index, item in enumerate(items)]
    done: dict[int, str | None] = {}
    with _pools(workers, scheduler) as (pools, killed):
        while len(done) < len(tasks):
            left = [task for task in tasks if task[0] not in done]
            try:
                _do(left, done, pools, killed)
            except killed:
                left = [task for task in left if task[0] not in done]
                for task in [task for task in left if begun(task[2])] or left:
                    try:
                        _do([task], done, pools, killed)
                    except killed:
                        done[task[0]] = KILLED
    return [done[index] for index in range(len(tasks))]


def _do(tasks: list[Task], done: dict[int, str | None], pools: Pools, killed: type[Exception]) -> None:
    """Do tasks in a pool; each is noted in `done` as it ends. Raises `killed` when one or more were lost."""
    lost = None
    with pools(len(tasks)) as pool:
        with _interrupts_held_back():
            running = [pool.submit(_attempt, task) for task in tasks]
        for ended in as_completed(running):
            try:
                index, error = ended.result()
            except killed as error_of_pool:
                lost = error_of_pool
            else:
                done[index] = error
    if lost is not None:
        raise lost


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """A context that Ctrl-C does not reach, nor the processes started in it, before they ignore it."""
    if not HOLDS_BACK:
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attempt(task: Task) -> tuple[int, str | None]:
    """Do one task; an exception becomes one line that says where it came from."""
    index, function, item, threads = task
    if threads:
        cv2.setNumThreads(threads)
    error = None
    try:
        function(item)
    except DataError as wrong:
        error = str(wrong)
    except Exception as wrong:
        place = traceback.extract_tb(wrong.__traceback__)[-1]
        text = " ".join(str(wrong).split())
        error = f"{type(wrong).__name__}: {text} ({Path(place.filename).name}, line {place.lineno})"
    return index, error


def _set_up_worker(parent: int) -> None:
    """Ctrl-C reaches every process of a terminal: the first stops the others, none of which may go on.

    When the first is killed it stops nothing: each sees itself that it is gone.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)


@contextmanager
def local_pool(workers: int) -> Iterator[Executor]:
    """Processes of this machine, which end when the work inside is done or fails."""
    for tracker in (loky_tracker, resource_tracker) if HOLDS_BACK else ():
        tracker.ensure_running()  # started later, it would let through interrupts that are held back
    pool = loky.ProcessPoolExecutor(workers, initializer=_set_up_worker, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        pool.shutdown(kill_workers=True)
        raise
    pool.shutdown()


def submitted(pool: Executor, calls: list[Callable[[], Item]]) -> list[concurrent.futures.Future[Item]]:
    """Calls given to a pool, whose processes start here: none of them is reached by Ctrl-C."""
    with _interrupts_held_back():
        return [pool.submit(call) for call in calls]


@contextmanager
def _pools(workers: int, scheduler: str | None) -> Iterator[tuple[Pools, type[Exception]]]:
    """What makes pools of local processes or a Dask cluster, and the exception that means a killed task."""
    if scheduler is None:
        # A process costs memory, so none goes without a task.
        yield lambda tasks: local_pool(min(workers, tasks)), BrokenProcessPool
        return
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise DataError('--dask needs the extra cluster: pip install -e ".[cluster]"') from None
    if not re.fullmatch(r"\w+://\S+:\d+", scheduler):
        raise DataError(f"--dask {scheduler}: expected an address such as tcp://127.0.0.1:8786")
    try:
        client = Client(scheduler, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DataError(f"--dask {scheduler}: no scheduler answers there ({error})") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise DataError(f"--dask {scheduler}: the scheduler has no workers")
        yield lambda tasks: client.get_executor(pure=False), KilledWorker
