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
# The first estimate is corrected if it is wrong by more than this factor, and if more than this time is left.
CORRECTED_FACTOR = 1.5
CORRECTED_S = 60.0


@dataclass(frozen=True)
class Task:
    """Work on a number of frames: the matches of a sequence, a run, or the detection of its boxes.

    Tasks of one `kind` take the same time per frame, and tasks of one `family` a similar one. A kind has, for
    instance, one method with one set of settings; a family has all runs of a variant.
    """

    kind: Hashable
    frames: int
    family: Hashable = None


class Durations:
    """The time per frame of each kind of task, and the number of processes.

    It is the time of the tasks that this call of a command has done. For a kind of which it did none, it is
    the time of earlier calls, whose results were kept.

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
        return self._measured.has_any() if kind is None else self._measured.knows(kind)

    def seconds_of(self, task: Task, by_family: bool = False) -> float | None:
        """Estimated seconds of a task in one process; None if no task of its kind is known.

        by_family : for an unknown kind, take the tasks of its family in this call.
        """
        for rates in (self._measured, self._kept):
            if rates.knows(task.kind):
                return rates.seconds_of(task.kind, task.frames)
        if by_family and self._families.knows(task.family):
            return self._families.seconds_of(task.family, task.frames)
        return None

    def estimate(self, *stages: Iterable[Task], by_family: bool = False) -> float | None:
        """Estimated seconds of stages of tasks, one stage after the other; None if a kind is unknown.

        In a stage, a process that is free takes the next task, so the stage ends with its last task.
        `by_family` : as in `seconds_of`.
        """
        total = 0.0
        for stage in stages:
            # When each process is free again, seconds. A heap: the process that is free first comes first.
            free_at = [0.0] * self.workers
            for task in stage:
                seconds = self.seconds_of(task, by_family)
                if seconds is None:
                    return None
                heapq.heapreplace(free_at, free_at[0] + seconds)
            total += max(free_at)
        return total


class _Rates:
    """The time per frame of groups of tasks: the kinds, or the families."""

    def __init__(self) -> None:
        self._frames: dict[Hashable, int] = {}
        self._seconds: dict[Hashable, float] = {}

    def add(self, group: Hashable, frames: int, seconds: float) -> None:
        """Count a task of a group."""
        self._frames[group] = self._frames.get(group, 0) + frames
        self._seconds[group] = self._seconds.get(group, 0.0) + seconds

    def has_any(self) -> bool:
        """Whether any task was counted."""
        return bool(self._frames)

    def knows(self, group: Hashable) -> bool:
        """Whether a task of this group, with at least one frame, was counted."""
        return self._frames.get(group, 0) > 0

    def seconds_of(self, group: Hashable, frames: int) -> float:
        """The time of a number of frames of a group that `knows` knows, seconds."""
        return self._seconds[group] * frames / self._frames[group]


class Forecast:
    """Reports how long the rest of many tasks will take, and once more if the rest turns out much different.

    Methods may be called from several threads.
    """

    def __init__(
        self,
        durations: Durations,
        stages: Iterable[Iterable[Task]],
        report: Callable[[float, bool], None],
        clock: Callable[[], float] = time.monotonic,
    ):
        """Begin before the first task is done.

        stages : the tasks of each stage; a stage begins when the one before is done.
        report : called with the estimated seconds of the rest, and whether this corrects the first estimate.
        clock : returns the time in seconds, for tests.
        """
        self._durations = durations
        self._waiting = [Counter(stage) for stage in stages]
        self._report = report
        self._clock = clock
        self._first_estimate: float | None = None  # seconds, from the time below on
        self._estimated_at = 0.0
        self._corrected = False
        self._lock = threading.Lock()

    def done(self, task: Task, seconds: float | None) -> None:
        """Count a task that is done; `seconds` : its duration, None if it failed."""
        with self._lock:
            if seconds is not None:
                self._durations.add(task, seconds)
            for stage in self._waiting:
                if stage[task]:
                    stage[task] -= 1
                    break
            if self._first_estimate is not None and not self._corrected:
                self._correct(self._first_estimate)

    def announce(self) -> None:
        """Report how long the rest will take, unless nothing is left or nothing is known."""
        with self._lock:
            rest = self._rest()
            if rest:
                self._first_estimate = rest
                self._estimated_at = self._clock()
                self._report(rest, False)

    def _rest(self) -> float | None:
        """Estimated seconds of the tasks that are not done; None if nothing is known of one of them."""
        stages = [stage.elements() for stage in self._waiting]
        return self._durations.estimate(*stages, by_family=True)

    def _correct(self, first_estimate: float) -> None:
        """Report the rest once more if the first estimate was much wrong."""
        rest = self._rest()
        if rest is None or rest < CORRECTED_S:
            return
        better_estimate = self._clock() - self._estimated_at + rest
        longer = max(better_estimate, first_estimate)
        if longer > CORRECTED_FACTOR * min(better_estimate, first_estimate):
            self._corrected = True
            self._report(rest, True)


def duration_words(seconds: float) -> str:
    """A duration with two digits that matter: "40 s", "3 min 20 s", "14 min", "9 h 20 min", "55 h"."""
    if seconds < MINUTE_S:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 10 * MINUTE_S:
        minutes, tens_of_seconds = divmod(round(seconds / 10), 6)
        return f"{minutes} min {10 * tens_of_seconds} s" if tens_of_seconds else f"{minutes} min"
    if seconds < HOUR_S:
        return f"{seconds / MINUTE_S:.0f} min"
    if seconds < 10 * HOUR_S:
        hours, tens_of_minutes = divmod(round(seconds / (10 * MINUTE_S)), 6)
        return f"{hours} h {10 * tens_of_minutes} min" if tens_of_minutes else f"{hours} h"
    return f"{seconds / HOUR_S:.0f} h"
