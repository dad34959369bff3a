"""Tasks in parallel processes, here or on a Dask cluster; one may fail or be killed."""

from __future__ import annotations

import concurrent.futures
import os
import re
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, as_completed
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TypeVar

import loky
from loky.backend import resource_tracker as loky_tracker
from loky.process_executor import BrokenProcessPool

from ..core.errors import DataError

Item = TypeVar("Item")
Pools = Callable[[int], AbstractContextManager[Executor]]  # by the number of tasks

KILLED = "its process was killed, perhaps for too much memory"
HOLDS_BACK = hasattr(signal, "pthread_sigmask")  # not Windows
WATCH = 0.5  # seconds between two looks at whether the first process is there
CONNECT = 10.0  # seconds to wait for a scheduler


def parallel(
    function: Callable[[Item], None], items: list[Item], workers: int = 1, scheduler: str | None = None
) -> list[str | None]:
    """Call `function`, which may be called for the same item again, for each item, in several processes.

    Returns for each, in order, the cause of its failure in one line, or None.

    When a process is killed, its pool is lost. Tasks begin in their order, so that those in work then are
    the first not done: they are done again one at a time, and the one at fault shows itself. The others go
    on in a new pool.

    Parameters
    ----------
    workers : processes, of which no more start than there are tasks; 1 works in this one, where a kill ends
        everything.
    scheduler : address of a Dask scheduler, whose workers are used instead.

    Raises
    ------
    DataError : the scheduler cannot be reached, or has no workers.
    KeyboardInterrupt : the processes are stopped.
    """
    if scheduler is None and workers == 1:
        return [_attempt(function, item) for item in items]
    done: dict[int, str | None] = {}

    with _pools(workers, scheduler) as (pools, killed):

        def lost(numbers: list[int]) -> bool:
            """Do these items in a pool, each noted as it ends; whether a process was killed meanwhile."""
            with pools(len(numbers)) as pool:
                calls = [partial(_attempt, function, items[n]) for n in numbers]
                running = dict(zip(submitted(pool, calls), numbers, strict=True))
                for ended in as_completed(running):
                    with suppress(killed):
                        done[running[ended]] = ended.result()
            return not done.keys() >= set(numbers)

        while left := [n for n in range(len(items)) if n not in done]:
            if lost(left):
                # Of a cluster all that are not done were lost, each by itself.
                first = workers if scheduler is None else len(items)
                for number in [n for n in left if n not in done][:first]:
                    if lost([number]):
                        done[number] = KILLED
    return [done[n] for n in range(len(items))]


def _attempt(function: Callable[[Item], None], item: Item) -> str | None:
    """Do one task; an exception becomes one line that says where it came from."""
    try:
        function(item)
    except DataError as wrong:
        return str(wrong)
    except Exception as wrong:
        place = traceback.extract_tb(wrong.__traceback__)[-1]
        text = " ".join(str(wrong).split())
        return f"{type(wrong).__name__}: {text} ({Path(place.filename).name}, line {place.lineno})"
    return None


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


def submitted(pool: Executor, calls: Iterable[Callable[[], Item]]) -> list[concurrent.futures.Future[Item]]:
    """Calls given to a pool, whose processes start here: Ctrl-C reaches none before it ignores it."""
    if not HOLDS_BACK:
        return [pool.submit(call) for call in calls]
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return [pool.submit(call) for call in calls]
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
