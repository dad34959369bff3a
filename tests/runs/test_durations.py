"""The estimate of how long runs take."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from vo_lib.runs.durations import Durations, Forecast, Task, duration_words
from vo_lib.runs.earlier_seconds import seconds_of_run
from vo_lib.runs.identity import processor_name


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


def test_kept_times_count_only_where_nothing_is_measured() -> None:
    durations = Durations()
    durations.add_kept(Task("run", 100), 5.0)
    assert durations.seconds_of(Task("run", 10)) == pytest.approx(0.5)
    assert not durations.has_measured("run")
    durations.add(Task("run", 10), 2.0)
    assert durations.seconds_of(Task("run", 10)) == pytest.approx(2.0)
    assert durations.has_measured()


def test_a_task_that_has_not_run_takes_the_time_of_its_family() -> None:
    durations = Durations()
    durations.add(Task("sets=50", 10, "run"), 2.0)
    other = Task("sets=100", 20, "run")
    assert durations.seconds_of(other) is None
    assert durations.seconds_of(other, by_family=True) == pytest.approx(4.0)
    assert durations.estimate([other], by_family=True) == pytest.approx(4.0)
    assert durations.estimate([other]) is None


def forecast_of(seconds_of_others: float) -> list[tuple[float, bool]]:
    """What is said of ten runs, of which the first takes 100 s and the others this time."""
    now = 0.0
    said: list[tuple[float, bool]] = []
    tasks = [Task(f"sets={count}", 10, "run") for count in range(10)]
    forecast = Forecast(Durations(), [tasks], lambda rest, again: said.append((rest, again)), lambda: now)
    forecast.done(tasks[0], 100.0)
    forecast.announce()
    for task in tasks[1:]:
        now += seconds_of_others
        forecast.done(task, seconds_of_others)
    return said


def test_a_forecast_is_corrected_once_if_it_was_much_wrong() -> None:
    assert forecast_of(110.0) == [(900.0, False)]
    for others in (1000.0, 5.0):
        first, second = forecast_of(others)
        assert first == (900.0, False)
        assert second[1]
        assert (second[0] > 900.0) == (others > 100.0)


def test_a_forecast_says_nothing_without_a_rest_or_a_measure() -> None:
    said: list[tuple[float, bool]] = []
    task = Task("run", 10, "run")
    forecast = Forecast(Durations(), [[], [task]], lambda rest, again: said.append((rest, again)))
    forecast.announce()  # nothing is done yet
    forecast.done(task, 3.0)
    forecast.announce()
    assert said == []


@pytest.mark.parametrize(
    ("ms_text", "seconds"),
    [
        ("2", 0.02),
        ("2.5", 0.025),
        ("-2", None),
        ("true", None),
        ('"2"', None),
        ("NaN", None),
        ("Infinity", None),
        ("1" + "0" * 400, None),
    ],
)
def test_the_time_of_a_kept_run_is_known_only_from_a_number(
    tmp_path: Path, ms_text: str, seconds: float | None
) -> None:
    """A person may have edited the file, and its times have no digest."""
    processor = json.dumps(processor_name())
    (tmp_path / "config.json").write_text(
        f'{{"settings": {{}}, "machine_info": {{"processor": {processor}}}, '
        f'"timing": {{"ms_per_frame_of": {{"matching": 9, "rotation": {ms_text}}}}}}}',
        encoding="utf-8",
    )
    assert seconds_of_run(tmp_path, frames=10) == (None if seconds is None else pytest.approx(seconds))
