"""When a panel draws, and since when it counts changes."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class Redraws:
    """The state of a panel's redraws.

    Controls change on several threads: a cell calls `set`, a slider moves, a job ends. One thread at a time
    draws, the others wait. A thread that changes several controls holds the redraws back, and draws once at
    the end:

        with redraws.held():
            slider.value = 3
            menu.value = "kit"
        draw()

    The browser sends the newest value of a moving slider when the picture before is finished. So the pictures
    follow the drag, and none waits in a queue.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._holders = 0  # nested `held` blocks of the thread that has the lock
        self._touched: object = None
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
        with self._lock:
            if self._holders:
                yield False
            else:
                with _collector_paused():
                    yield True

    def before(self, touched: object, facts: Mapping[str, float]) -> dict[str, float]:
        """The numbers with which those of the next picture are compared.

        They are the `facts` of the last picture before the control `touched` was touched. While the same
        control moves on, they stay. None stands for a change by code.
        """
        if touched is None or touched is not self._touched:
            self._touched = touched
            self._before = dict(facts)
        return self._before

    def forget(self) -> None:
        """Compare the next picture with nothing."""
        self._touched = None
        self._before = {}


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
