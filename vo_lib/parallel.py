"""Worker processes with the interface of `concurrent.futures`."""

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

PARENT_CHECK_S = 0.5  # interval at which a worker checks that its parent process exists


class ThisProcess(Executor):
    """An executor without worker processes: `submit` makes the call at once."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The completed future; `submit` raises an exception of the call at once."""
        future: Future[Any] = Future()
        future.set_result(function(*args, **kwargs))
        return future


@contextmanager
def local_pool(workers: int) -> Iterator[Executor]:
    """Worker processes on this machine, which end with the context. With 1 worker, calls run in this process.

    Unlike processes of the standard library, loky's processes start without a `__main__` guard.
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
    """Make a worker ignore Ctrl-C, which the parent process handles, and end when the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()


def _end_with_parent(parent: int) -> None:
    """Wait for the end of the parent process, which has this number, then end this process."""
    while os.getppid() == parent:  # on Windows always: there, a worker whose parent was killed ends its call
        time.sleep(PARENT_CHECK_S)
    os._exit(1)
