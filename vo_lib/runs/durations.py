"""How long runs take: measured on the first ones, estimated for the others."""

from __future__ import annotations

import heapq
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field

DETECTION = "detection"  # the kind of the detector's tasks
MINUTE_S = 60.0
HOUR_S = 3600.0


@dataclass(frozen=True)
class Task:
    """Work on a number of frames; tasks of one `kind` take the same time per frame."""

    kind: Hashable
    frames: int


@dataclass
class Durations:
    """The time per frame of each kind of task, from the tasks that are done, and the number of processes."""

    workers: int = 1
    frames: dict[Hashable, int] = field(default_factory=dict)
    seconds: dict[Hashable, float] = field(default_factory=dict)

    def add(self, task: Task, seconds: float) -> None:
        """Count a finished task."""
        self.frames[task.kind] = self.frames.get(task.kind, 0) + task.frames
        self.seconds[task.kind] = self.seconds.get(task.kind, 0.0) + seconds

    def seconds_of(self, task: Task) -> float | None:
        """Estimated seconds of a task in one process; None if no task of this kind is done."""
        frames = self.frames.get(task.kind)
        return None if not frames else self.seconds[task.kind] * task.frames / frames

    def estimate(self, *stages: Iterable[Task]) -> float | None:
        """Estimated seconds of stages of tasks, one stage after the other; None if a kind is unknown.

        In a stage, a process that is free takes the next task, so the stage ends with its last task.
        """
        total = 0.0
        for stage in stages:
            ends = [0.0] * self.workers  # when each process is free
            for task in stage:
                seconds = self.seconds_of(task)
                if seconds is None:
                    return None
                heapq.heapreplace(ends, ends[0] + seconds)
            total += max(ends)
        return total


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
