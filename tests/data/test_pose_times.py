"""Units of the times of poses, and the reason why the times of two files do not correspond."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vo_lib.data.pose_times import epoch_unit, interval_fault, likely_unit, refuse_intervals, time_mismatch
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array

SECONDS = 1403636579.75 + 0.1 * np.arange(150.0)


@pytest.mark.parametrize(("interval", "unit"), [(0.1, 1.0), (100.0, 1e-3), (50_000.0, 1e-6), (5e7, 1e-9)])
def test_the_unit_follows_from_the_interval(interval: float, unit: float) -> None:
    assert likely_unit(interval) == unit


@pytest.mark.parametrize("interval", [0.001, 0.005, 0.1, 10.0])
def test_plausible_intervals_since_1970_are_accepted(interval: float) -> None:
    times = 1403636579.75 + interval * np.arange(20.0)
    assert interval_fault(times) == ""
    assert epoch_unit(times) == 1.0


@pytest.mark.parametrize(
    ("unit", "name", "symbol"),
    [(1e-3, "milliseconds", "ms"), (1e-6, "microseconds", "us"), (1e-9, "nanoseconds", "ns")],
)
def test_times_in_another_unit_are_refused_with_its_name(unit: float, name: str, symbol: str) -> None:
    for start in (0.0, SECONDS[0]):
        times = (start + 0.1 * np.arange(20.0)) / unit
        with pytest.raises(
            DataError, match=f"expected 0.001 to 10 s; they are probably {name}: divide"
        ) as caught:
            refuse_intervals(times, Path("est.tum"), as_column=True)
        assert f"'# timestamp [{symbol}] tx ty tz qx qy qz qw'" in str(caught.value)
    assert epoch_unit(SECONDS / unit) == unit
    message = mismatch(SECONDS / unit, SECONDS, "gt", 0.01)
    assert f"its times are {SECONDS[0] / unit:.0f}" in message
    assert "those of gt 1403636579.75 to 1403636594.65; its times are probably" in message
    assert name in message
    message = mismatch(SECONDS, SECONDS / unit, "gt", 0.01)
    assert f"; those of gt are probably {name}: divide them by 1e" in message


def mismatch(times: Array, true_times: Array, truth_name: str, tolerance: float) -> str:
    """The words of the error, without the file."""
    path = Path("est.tum")
    return str(time_mismatch(times, true_times, truth_name, tolerance, path)).removeprefix(f"{path}: ")


def test_times_of_another_clock_or_with_an_offset_are_explained() -> None:
    message = mismatch(SECONDS, SECONDS - SECONDS[0], "gt", 0.01)
    assert "the clocks differ by about 1403636579.75 s" in message
    message = mismatch(SECONDS, 1e3 * (SECONDS - SECONDS[0]), "gt", 0.01)
    assert "those of gt are probably milliseconds" in message
    assert "the clocks differ by about 1403636579.75 s" in message
    message = mismatch(SECONDS + 0.03, SECONDS, "gt", 0.01)
    assert (
        "the nearest times are 0.03 s apart, so the clocks differ, or the tolerance is too small" in message
    )
    path = Path("est.tum")
    assert time_mismatch(SECONDS + 0.03, SECONDS, "gt", 0.01, path).remedy == "tolerance"
    for others in (SECONDS - SECONDS[0], 1e3 * SECONDS):  # no tolerance helps here
        assert time_mismatch(SECONDS, others, "gt", 0.01, path).remedy == ""
    # Two hundred frames per second in milliseconds have intervals of 5, which could be seconds.
    fast = 0.005 * np.arange(400.0)
    assert "its times are probably milliseconds" in mismatch(1e3 * fast + 1.0, fast, "gt", 0.0001)


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("start", [0.0, 1403636579.75])
def test_a_header_with_too_small_a_unit_is_blamed_on_its_own_file(factor: float, start: float) -> None:
    true_times = start + 0.1 * np.arange(150.0)
    words = f"are probably {factor:.0f} times too small: correct the unit in the header of that file"
    message = mismatch(true_times / factor, true_times, "gt", 0.01)
    assert f"; its times {words}" in message
    assert "those of gt are" not in message
    message = mismatch(true_times, true_times / factor, "gt", 0.01)
    assert f"; those of gt {words}" in message
    assert "its times are probably" not in message
    with pytest.raises(DataError, match=f"expected 0.001 to 10 s; they {words}"):
        refuse_intervals(true_times / factor, Path("est.csv"), as_column=True)


def test_an_impossible_interval_is_not_blamed_on_the_other_file() -> None:
    seconds = 0.1 * np.arange(150.0)
    message = mismatch(1e-13 * seconds + 2.0, seconds, "gt", 1e-6)
    assert "the median interval of the times is" in message
    assert "probably" not in message
