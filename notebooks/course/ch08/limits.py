"""A limit on the time of a call, for functions that may never end."""

from __future__ import annotations

import ctypes
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

AGAIN_S = 1.0  # a function with a bare `except:` goes on after the interruption, and is interrupted again
LEAST_S = 1e-3  # a timer of zero seconds would be no timer


class TooLong(BaseException):
    """Raised inside a function that exceeds its time; `except Exception` in the function does not catch it."""


def within(seconds: float, function: Callable[..., Any], *inputs: Any) -> Any:
    """function(*inputs); raises `TooLong` if the call takes longer.

    The main thread is interrupted by a signal, which also ends a `time.sleep`. Other threads, and computers
    without this signal, get the exception before their next line of Python. A single call of compiled code,
    such as the inverse of a huge matrix, is not interrupted before its end.
    """
    if hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread():
        return _by_signal(seconds, function, inputs)
    return _by_watcher(seconds, function, inputs)


def _by_signal(seconds: float, function: Callable[..., Any], inputs: tuple[Any, ...]) -> Any:
    def interrupt(number: int, frame: FrameType | None) -> None:
        raise TooLong

    start = time.monotonic()
    handler = signal.signal(signal.SIGALRM, interrupt)
    remaining, interval = signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN_S)
    try:
        return function(*inputs)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
        if remaining > 0.0:  # a timer of somebody else goes on
            left = remaining - (time.monotonic() - start)
            signal.setitimer(signal.ITIMER_REAL, max(left, LEAST_S), interval)


def _by_watcher(seconds: float, function: Callable[..., Any], inputs: tuple[Any, ...]) -> Any:
    thread = ctypes.c_ulong(threading.get_ident())
    ended = threading.Event()

    def watch() -> None:
        wait = seconds
        while not ended.wait(wait):
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, ctypes.py_object(TooLong))
            wait = AGAIN_S

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        return function(*inputs)
    finally:
        ended.set()
        watcher.join()
        ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, None)  # one that has not arrived yet
