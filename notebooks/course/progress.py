"""Progress of long work: a bar in a cell, or a thread with a bar and a Stop button."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

import ipywidgets as widgets
from IPython.display import display

from vo_lib.geometry.types import Progress

Value = TypeVar("Value")
STOPPING = "stopping …"


def with_bar(words: str, work: Callable[[Progress], Value]) -> Value:
    """The result of `work(progress)` for a notebook cell; a bar is shown from the first report to the end."""
    bar = widgets.IntProgress(description=words, style={"description_width": "initial"})

    def report(done: int, total: int) -> None:
        if bar.value == 0:
            display(bar)  # type: ignore[no-untyped-call]
        bar.max = total
        bar.value = max(done, 1)

    try:
        return work(report)
    finally:
        bar.layout.display = "none"  # a closed bar could be missing in a page that loads slowly


class Stopped(Exception):
    """Raised by the progress function of a job after Stop was pressed."""


class Job:
    """One running function that counts; the start of a function stops the previous function.

    The new function does not wait for the next report of the previous one, which may take seconds: until then
    both run, and what the previous one returns or raises is dropped.

    `box` has a bar, words and a Stop button; the box is hidden while nothing runs.
    """

    def __init__(self) -> None:
        self._bar = widgets.IntProgress(min=0, max=1, layout={"width": "420px"})
        self._words = widgets.Label(layout={"width": "380px"})
        button = widgets.Button(description="Stop", icon="stop", layout={"min_width": "90px"})
        button.on_click(lambda _: self.stop())
        self.box = widgets.HBox([self._bar, self._words, button], layout={"display": "none"})
        self._thread = threading.Thread()  # the last one
        self._stop = threading.Event()

    @property
    def running(self) -> bool:
        """Whether a function is running."""
        return self._thread.is_alive()

    def start(
        self,
        label: str,
        work: Callable[[Progress], Any],
        done: Callable[[Any], None],
        failed: Callable[[Exception], None],
    ) -> None:
        """Run `work(progress)` on a thread, then `done(result)` or `failed(exception)` on the same thread.

        `work` calls progress(done, total) at least a few times per second; Stop takes effect in these calls.
        A result that comes after Stop is not wanted: `failed` gets `Stopped` instead.
        """
        self._stop.set()
        stop = self._stop = threading.Event()
        self._bar.value = 0
        self._words.value = label
        self.box.layout.display = ""

        def report(count: int, total: int) -> None:
            if stop.is_set():
                raise Stopped
            self._bar.max = max(total, 1)
            self._bar.value = count
            self._words.value = f"{label}: {count} of {total}"

        def body() -> None:
            try:
                result = work(report)
                if stop.is_set():
                    raise Stopped
                self._hide(stop)
                done(result)
            except Exception as error:
                if self._hide(stop):
                    failed(error)

        thread = threading.Thread(target=body, daemon=True)
        thread.start()
        self._thread = thread

    def _hide(self, stop: threading.Event) -> bool:
        """Hide the bar of the function with this event; False if another function has taken its place."""
        if stop is not self._stop:
            return False
        self.box.layout.display = "none"
        return True

    def stop(self) -> None:
        """End the running function at its next report."""
        self._stop.set()
        self._words.value = STOPPING

    def wait(self, seconds: float | None = None) -> None:
        """Wait for the end of the running function; not for one that another has replaced."""
        if self.running:
            self._thread.join(seconds)
