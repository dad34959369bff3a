"""How long runs take: measured on the first ones, estimated for the others."""

from __future__ import annotations

import heapq
import threading
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass

DETECTION = "detection"  # the kind of the detector's tasks
MINUTE_S = 60.0
HOUR_S = 3600.0
# An estimate is corrected if it is wrong by more than this factor, and if more than this time is left.
CORRECTED_FACTOR = 1.5
CORRECTED_S = 60.0


@dataclass(frozen=True)
class Task:
    """Work on a number of frames.

    Tasks of one `kind` take the same time per frame, and tasks of one `family` a similar one.
    """

    kind: Hashable
    frames: int
    family: Hashable = None


class Durations:
    """The time per frame of each kind of task, and the number of processes.

    The tasks of this call count; for a kind without one, those that were done earlier and kept.

    Attributes
    ----------
    workers : number of processes.
    """

    def __init__(self, workers: int = 1):
        self.workers = workers
        self._measured = _Rates()
        self._kept = _Rates()
        self._families = _Rates()

    def add(self, task: Task, seconds: float) -> None:
        """Count a task of this call."""
        self._measured.add(task.kind, task.frames, seconds)
        self._families.add(task.family, task.frames, seconds)

    def add_kept(self, task: Task, seconds: float) -> None:
        """Count a task whose result is kept from an earlier call, in which it took this time."""
        self._kept.add(task.kind, task.frames, seconds)

    def has_measured(self, kind: Hashable | None = None) -> bool:
        """Whether a task of this kind, by default of any kind, was done in this call."""
        return bool(self._measured.frames if kind is None else self._measured.frames.get(kind))

    def seconds_of(self, task: Task, by_family: bool = False) -> float | None:
        """Estimated seconds of a task in one process; None if no task of its kind is known.

        by_family : for an unknown kind, take the tasks of its family in this call.
        """
        for rates, name in ((self._measured, task.kind), (self._kept, task.kind)):
            if rates.frames.get(name):
                return rates.seconds_of(name, task.frames)
        if by_family and self._families.frames.get(task.family):
            return self._families.seconds_of(task.family, task.frames)
        return None

    def estimate(self, *stages: Iterable[Task], by_family: bool = False) -> float | None:
        """Estimated seconds of stages of tasks, one stage after the other; None if a kind is unknown.

        In a stage, a process that is free takes the next task, so the stage ends with its last task.
        `by_family` : as in `seconds_of`.
        """
        total = 0.0
        for stage in stages:
            ends = [0.0] * self.workers  # when each process is free
            for task in stage:
                seconds = self.seconds_of(task, by_family)
                if seconds is None:
                    return None
                heapq.heapreplace(ends, ends[0] + seconds)
            total += max(ends)
        return total


class _Rates:
    """Frames and seconds by name, added up."""

    def __init__(self) -> None:
        self.frames: dict[Hashable, int] = {}
        self.seconds: dict[Hashable, float] = {}

    def add(self, name: Hashable, frames: int, seconds: float) -> None:
        self.frames[name] = self.frames.get(name, 0) + frames
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds

    def seconds_of(self, name: Hashable, frames: int) -> float:
        return self.seconds[name] * frames / self.frames[name]


class Forecast:
    """Says how long the rest of many tasks will take, and once more if the rest turns out much different.

    Methods may be called from several threads.
    """

    def __init__(
        self,
        durations: Durations,
        stages: Iterable[Iterable[Task]],
        said: Callable[[float, bool], None],
        clock: Callable[[], float] = time.monotonic,
    ):
        """Tasks of stages that follow each other.

        said : called with the estimated seconds of the rest, and whether this corrects the first estimate.
        """
        self._durations = durations
        self._waiting = [Counter(stage) for stage in stages]
        self._said = said
        self._clock = clock
        self._first: float | None = None  # the first estimate, and when it was made
        self._start = 0.0
        self._corrected = False
        self._lock = threading.Lock()

    def done(self, task: Task, seconds: float | None) -> None:
        """Count a task that is done; `seconds` : its duration, None if it did no work."""
        with self._lock:
            if seconds is not None:
                self._durations.add(task, seconds)
            for stage in self._waiting:
                if stage[task]:
                    stage[task] -= 1
                    break
            if self._first is not None and not self._corrected:
                self._correct(self._first)

    def say(self) -> None:
        """Say how long the rest will take, unless nothing is left or nothing is known."""
        with self._lock:
            rest = self._rest()
            if rest:
                self._first = rest
                self._start = self._clock()
                self._said(rest, False)

    def _rest(self) -> float | None:
        return self._durations.estimate(*(stage.elements() for stage in self._waiting), by_family=True)

    def _correct(self, first: float) -> None:
        """Say the rest once more if the first estimate was much wrong."""
        rest = self._rest()
        if rest is None or rest < CORRECTED_S:
            return
        whole = self._clock() - self._start + rest
        if max(whole, first) > CORRECTED_FACTOR * min(whole, first):
            self._corrected = True
            self._said(rest, True)


def duration_words(seconds: float) -> str:
    """A duration with two digits that matter: "40 s", "3 min 20 s", "14 min", "9 h 20 min", "55 h"."""
    if seconds < MINUTE_S:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 10 * MINUTE_S:
        tens = round(seconds / 10)
        return f"{tens // 6} min {10 * (tens % 6)} s".replace(" 0 s", "")
    if seconds < HOUR_S:
        return f"{seconds / MINUTE_S:.0f} min"
    if seconds < 10 * HOUR_S:
        tens = round(seconds / (10 * MINUTE_S))
        return f"{tens // 6} h {10 * (tens % 6)} min".replace(" 0 min", "")
    return f"{seconds / HOUR_S:.0f} h"
