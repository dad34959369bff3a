"""The estimate of how long runs take."""

from __future__ import annotations

import pytest

from vo_lib.runs.durations import Durations, Task, duration_words


def test_an_estimate_fills_the_processes_in_order() -> None:
    durations = Durations(workers=2)
    durations.add(Task("matching", 100), 10.0)
    durations.add(Task("run", 50), 1.0)
    durations.add(Task("run", 150), 3.0)
    # 20, 10 and 10 s in two processes, then four runs of 2 s.
    matching = [Task("matching", frames) for frames in (200, 100, 100)]
    assert durations.estimate(matching) == pytest.approx(20.0)
    assert durations.estimate(matching, [Task("run", 100)] * 4) == pytest.approx(24.0)
    assert durations.estimate([], []) == 0.0
    # The last task decides, not the mean.
    assert durations.estimate([Task("run", 100), Task("run", 1000)]) == pytest.approx(20.0)
    assert durations.estimate(matching, [Task("detection", 1)]) is None


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "1 s"),
        (43.4, "43 s"),
        (60.0, "1 min"),
        (199.0, "3 min 20 s"),
        (596.0, "10 min"),
        (840.0, "14 min"),
        (3599.0, "60 min"),
        (3600.0, "1 h"),
        (33600.0, "9 h 20 min"),
        (200000.0, "56 h"),
    ],
)
def test_durations_are_rounded_to_what_matters(seconds: float, words: str) -> None:
    assert duration_words(seconds) == words
