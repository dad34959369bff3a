"""A limit on the time of a call, for functions that may never end."""

from __future__ import annotations

import ctypes
import signal
import sys
import sysconfig
import threading
import time
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Any, TypeVar

from ..results import NOT_OWN

Value = TypeVar("Value")

AGAIN_S = 1.0  # a function with a bare `except:` goes on after the interruption, and is interrupted again
LEAST_S = 1e-3  # a timer of zero seconds would be no timer
NO_THREAD = 0
SPARED = (*NOT_OWN, sysconfig.get_path("stdlib"))  # parts of the paths of code that is not the student's


class TooLong(BaseException):
    """Raised inside a function that exceeds its time; `except Exception` in the function does not catch it.

    `swallowed` : whether the function caught it at least once, by an `except:` without a name, and went on.
    """

    swallowed = False


class TooLongAgain(TooLong):
    """An interruption after the first on a thread without signals.

    Its constructor runs on the thread of the function, where alone `interrupt_each_line` has an effect.
    """

    def __init__(self) -> None:
        super().__init__()
        interrupt_each_line(sys._getframe(1))


def interrupt_each_line(frame: FrameType | None) -> None:
    """Interrupt this thread at each line of the student's code, from the innermost `frame` outwards.

    A function that catches an interruption is interrupted again, but in a loop such as

        while True:
            try:
                work()
            except:
                pass

    nearly all interruptions arrive inside the `try`. Only an interruption at every line also arrives inside the
    handler.
    """
    interrupt = _interruption(threading.get_ident())
    while frame is not None and frame.f_code.co_name not in (_by_signal.__name__, _by_watcher.__name__):
        place = frame.f_code.co_filename
        own = True
        for part in SPARED:  # a loop, as a generator would be a frame of its own, with lines to interrupt
            own = own and part not in place
        if own:
            frame.f_trace = interrupt
        frame = frame.f_back
    # Python looks at `f_trace` only while a trace function is set. This one asks for nothing (no thread has the
    # number 0), so calls that begin from now on are left alone.
    sys.settrace(_interruption(NO_THREAD))


def _interruption(thread: int) -> Any:
    """A trace function that asks Python to raise `TooLong` in a thread.

    It is made of compiled code. A function of Python would be interrupted itself, and Python then switches the
    tracing off. Python calls it with the frame, the event and an argument, which the compiled code ignores.
    """
    request = ctypes.pythonapi["PyThreadState_SetAsyncExc"]
    request.argtypes = [ctypes.c_ulong, *[ctypes.py_object] * 4]
    request.restype = None
    return partial(request, thread, TooLong)


def within(seconds: float, function: Callable[..., Value], *inputs: Any) -> Value:
    """function(*inputs); raises `TooLong` if the call takes longer.

    The main thread is interrupted by a signal, which also ends a `time.sleep`. Other threads, and computers
    without this signal, get the exception before their next line of Python. A single call of compiled code,
    such as the inverse of a huge matrix, is not interrupted before its end.

    A function that catches the interruption goes on for `AGAIN_S`, and is then interrupted at each line.
    """
    if hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread():
        return _by_signal(seconds, function, inputs)
    return _by_watcher(seconds, function, inputs)


def _by_signal(seconds: float, function: Callable[..., Value], inputs: tuple[Any, ...]) -> Value:
    """`within` on the main thread, by a timer and its signal."""
    times = 0  # interruptions so far

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal times
        times += 1
        if times > 1:
            interrupt_each_line(frame)
        raise TooLong

    trace = sys.gettrace()
    start = time.monotonic()
    handler = signal.signal(signal.SIGALRM, interrupt)
    remaining, interval = signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN_S)
    try:
        return function(*inputs)
    except TooLong as error:
        error.swallowed = times > 1
        raise
    finally:
        if times > 1:
            try:  # noqa: SIM105  (to enter a `with` would be interrupted)
                sys.settrace(trace)
            except TooLong:
                pass  # the last request of the tracing
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
        if remaining > 0.0:  # a timer of somebody else goes on
            left = remaining - (time.monotonic() - start)
            signal.setitimer(signal.ITIMER_REAL, max(left, LEAST_S), interval)


def _by_watcher(seconds: float, function: Callable[..., Value], inputs: tuple[Any, ...]) -> Value:
    """`within` on any thread, by a second thread that waits for the end of the time."""
    thread = ctypes.c_ulong(threading.get_ident())
    ended = threading.Event()
    times = 0  # interruptions so far

    def watch() -> None:
        nonlocal times
        wait = seconds
        while not ended.wait(wait):
            times += 1
            kind = TooLong if times == 1 else TooLongAgain
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, ctypes.py_object(kind))
            wait = AGAIN_S

    trace = sys.gettrace()
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        return function(*inputs)
    except TooLong as error:
        error.swallowed = times > 1
        raise
    finally:
        if times > 1:
            try:  # noqa: SIM105  (to enter a `with` would be interrupted)
                sys.settrace(trace)
            except TooLong:
                pass  # the last request of the tracing
        while watcher.is_alive():
            # An interruption may still be on its way. To take it back (a request of None) would leave Python
            # looking for it at every step, and never come to an end under a debugger (3.11).
            try:
                ended.set()
                watcher.join()
            except TooLong:
                pass
