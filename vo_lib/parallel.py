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

    The context waits for all calls, but after an error it ends the processes at once. Unlike processes of the
    standard library, loky's processes start without a `__main__` guard.
    """
    if workers == 1:
        yield ThisProcess()
        return
    with loky.ProcessPoolExecutor(workers, initializer=_follow_parent, initargs=(os.getpid(),)) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(kill_workers=True)
            raise


def _follow_parent(parent: int) -> None:
    """Make a worker ignore Ctrl-C, which its parent handles, and end with the process of this number."""

    def watch() -> None:
        while os.getppid() == parent:  # on Windows always: there, a worker ends when its call does
            time.sleep(0.5)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=watch, daemon=True).start()
