"""Progress of long work: a bar in a cell, or a thread with a bar and a Stop button."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import ipywidgets as widgets
from IPython.display import display

from vo_lib.geometry.types import Progress

from .drawing import shortened

LABEL_LENGTH = 48  # characters of a job's label that are shown

Value = TypeVar("Value")


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
    """What a job fails with after Stop was pressed; the progress function raises it, too."""


class Job:
    """The function that was started last, while it runs; Stop, or the start of another one, gives it up.

    That takes effect at once, although the function given up runs on until its next report, which may take
    seconds: what it returns or raises then is dropped.

    `box` has a bar, words and a Stop button; the box is hidden while nothing runs.
    """

    def __init__(self) -> None:
        self._bar = widgets.IntProgress(min=0, max=1, layout={"flex": "1 1 120px", "max_width": "420px"})
        self._words = widgets.HTML(layout={"flex": "0 0 auto"})
        button = widgets.Button(description="Stop", icon="stop", layout={"min_width": "90px"})
        button.on_click(lambda _: self.stop())
        self.box = widgets.HBox([self._bar, self._words, button], layout={"display": "none"})
        self._lock = threading.Lock()
        self._thread = threading.Thread()  # of the function that was started last; after Stop, of none
        self._over = threading.Event()  # set when this function has ended or is given up
        self._over.set()
        self._failed: Callable[[Exception], None] = lambda error: None

    @property
    def running(self) -> bool:
        """Whether a function is running that is not given up."""
        return self._thread.is_alive()

    def start(
        self,
        label: str,
        work: Callable[[Progress], Any],
        done: Callable[[Any], None],
        failed: Callable[[Exception], None],
    ) -> None:
        """Run `work(progress)` on a thread, then `done(result)` or `failed(exception)` on the same thread.

        `work` calls progress(done, total) at least a few times per second; a function that is given up ends in
        these calls. After Stop, `failed` gets `Stopped` at once, on the thread that stops.
        """
        over = threading.Event()
        words = f'<span title="{html.escape(label)}">{html.escape(shortened(label, LABEL_LENGTH))}'

        def report(count: int, total: int) -> None:
            with self._lock:
                if over.is_set():
                    raise Stopped
                self._bar.max = max(total, 1)
                self._bar.value = count
                self._words.value = f"{words}: {count} of {total}</span>"

        def body() -> None:
            wrong: Exception | None = None
            try:
                result = work(report)
            except Exception as error:
                wrong = error
            if not self._end(over):
                return
            if wrong is None:
                try:
                    done(result)
                except Exception as error:
                    wrong = error
            if wrong is not None:
                failed(wrong)

        thread = threading.Thread(target=body, daemon=True)
        with self._lock:
            self._over.set()
            self._over = over
            self._thread = thread
            self._failed = failed
            self._bar.value = 0
            self._words.value = f"{words}</span>"
            self.box.layout.display = ""
        thread.start()

    def _end(self, over: threading.Event) -> bool:
        """Hide the bar of a function that ends now; False if it is already over."""
        with self._lock:
            if over.is_set():
                return False
            over.set()
            self.box.layout.display = "none"
            return True

    def stop(self) -> None:
        """Give up the running function, if there is one."""
        failed = self._failed
        if self._end(self._over):
            self._thread = threading.Thread()
            failed(Stopped())

    def wait(self, seconds: float | None = None) -> None:
        """Wait for the end of the running function; not for one that is given up."""
        if self.running:
            self._thread.join(seconds)
