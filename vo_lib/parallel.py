"""Processes that share work, through the interface of `concurrent.futures`."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

import loky

PARENT_CHECK_S = 0.5  # between two looks of a worker at whether the first process is there


class ThisProcess(Executor):
    """An executor without processes of its own: a call is done when it is submitted."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A finished future; exceptions of the call are raised here."""
        future: Future[Any] = Future()
        future.set_result(function(*args, **kwargs))
        return future


@contextmanager
def local_pool(workers: int) -> Iterator[Executor]:
    """Processes of this machine, which end with the context; 1 worker is this process.

    loky's processes, unlike the standard library's, start from scripts without a guarded main part too.
    """
    if workers == 1:
        yield ThisProcess()
        return
    pool = loky.ProcessPoolExecutor(workers, initializer=_set_up_worker, initargs=(os.getpid(),))
    try:
        yield pool
    except BaseException:
        pool.shutdown(kill_workers=True)
        raise
    pool.shutdown()


def _set_up_worker(parent: int) -> None:
    """Ctrl-C reaches every process of a terminal: workers leave it to the first, and end when it does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK_S)
    os._exit(1)
