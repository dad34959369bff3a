"""When a panel draws, and since when it counts changes."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

# A slider that still moves has sent its next value within this time: then there is nothing to finish.
PAUSE_S = 0.01


class Redraws:
    """The state of a panel's redraws.

    Controls change on several threads: a cell calls `set`, a slider moves, a job ends. One thread at a time
    draws, the others wait. A thread that changes several controls holds the redraws back, and draws once at
    the end:

        with redraws.held():
            slider.value = 3
            menu.value = "kit"
        draw()

    The browser sends the newest value of a moving slider when the redraw before has ended. So the pictures
    follow the drag, and none waits in a queue. A redraw may end with an unfinished picture; then a thread
    finishes it, unless another redraw starts:

        with redraws.one() as allowed:
            ...
            redraws.finish_later(finish)
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._holders = 0  # nested `held` blocks of the thread that has the lock
        self._newest = threading.Event()  # of the newest redraw; set when another one follows
        self._thread = threading.Thread()  # the last one that finished a picture
        self._touched: object = None
        self._shown: dict[str, float] = {}
        self._before: dict[str, float] = {}

    @contextmanager
    def held(self) -> Iterator[None]:
        """No redraw starts in this block; a redraw by another thread waits for the end of the block."""
        with self._lock:
            self._holders += 1
            try:
                yield
            finally:
                self._holders -= 1

    @contextmanager
    def one(self) -> Iterator[bool]:
        """A block that draws, if the value is true; no other thread draws meanwhile."""
        if not self._holders:
            self._supersede()  # now, so that a thread that finishes a picture gives way at once
        with self._lock:
            if self._holders:
                yield False
            else:
                self._supersede()
                with _collector_paused():
                    yield True

    def finish_later(self, finish: Callable[[Callable[[], bool]], None]) -> None:
        """Call `finish(is_wanted)` soon, on a thread; for the block of `one`.

        Once another redraw has started, `is_wanted` returns False, and `finish` should return. It draws in
        blocks of `still`.
        """
        mine = self._newest

        def is_wanted() -> bool:
            return self._newest is mine

        def body() -> None:
            mine.wait(PAUSE_S)
            if is_wanted():
                finish(is_wanted)

        # Not a daemon: it ends soon, and Python waits for it at the end.
        self._thread = threading.Thread(target=body)
        self._thread.start()

    @contextmanager
    def still(self, is_wanted: Callable[[], bool]) -> Iterator[bool]:
        """A block that draws more of a picture, if the value is true; no other thread draws meanwhile."""
        with self._lock, _collector_paused():
            yield is_wanted()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until the picture is finished."""
        if self._thread.is_alive():
            self._thread.join(seconds)

    def shown(self, facts: Mapping[str, float]) -> None:
        """The numbers of a finished picture are shown."""
        self._shown = dict(facts)

    def before(self, touched: object) -> dict[str, float]:
        """The numbers with which those of the next picture are compared.

        They are those of the last finished picture before the control `touched` was touched. While the same
        control moves on, they stay. None stands for a change by code.
        """
        if touched is None or touched is not self._touched:
            self._touched = touched
            self._before = self._shown
        return self._before

    def forget(self) -> None:
        """Finish no picture, and compare the next one with nothing."""
        self._supersede()
        self._touched = None
        self._shown = {}
        self._before = {}

    def _supersede(self) -> None:
        """Another redraw follows: the picture of the one before need not be finished."""
        self._newest.set()
        self._newest = threading.Event()


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Python's collector of garbage waits.

    A chart consists of thousands of objects. If the collector ran before they are garbage, they would count
    as long-lived, and after some twenty pictures the collector would search all objects of the kernel, which
    takes longer than a picture.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
