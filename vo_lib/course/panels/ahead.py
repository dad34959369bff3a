"""States of a panel that may come next, prepared while nobody asks for anything."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Generic, TypeVar

PAUSE = 0.3  # seconds without a change, after which work begins

State = TypeVar("State")


class Ahead(Generic[State]):
    """Prepares states one after the other, on a thread of its own, until something else is asked for.

    prepare : does and keeps what a state needs; what it raises is left to whoever asks for that state.
    """

    def __init__(self, prepare: Callable[[State], None]):
        self._prepare = prepare
        self._timer: threading.Timer | None = None
        self._here: Hashable = None

    def look(self, here: Hashable, states: list[State]) -> None:
        """Prepare `states` in a while. Not again for the same `here`: who stays there wants other things."""
        if self._timer is not None:
            self._timer.cancel()
        last, self._here = self._here, here
        if here == last or not states:
            return

        def work() -> None:
            for state in states:
                if not timer.finished.is_set():  # `cancel` sets it
                    with suppress(Exception):
                        self._prepare(state)

        self._timer = timer = threading.Timer(PAUSE, work)
        timer.daemon = True
        timer.start()

    def wait(self, seconds: float) -> None:
        """Block until all is prepared."""
        if self._timer is not None:
            self._timer.join(seconds)
