"""Times of poses: plausible intervals, the likely unit, and the reason why the times of two files differ.

A unit is given by its length in seconds: 1 for seconds, 1e-9 for nanoseconds.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import DataError
from ..geometry.types import Array, Index
from .pose_columns import HEADER_EXAMPLE

FRAME_INTERVALS_S = (1e-3, 10.0)  # plausible; intervals in nanoseconds or milliseconds are outside
ROUNDING = 0.01  # times since 1970 in seconds have steps of 2e-7 s, so an interval of 1 ms is not exact
USUAL_INTERVAL_S = 0.1
# The units other than seconds.
UNIT_NAMES = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
UNIT_SYMBOLS = {1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
UNIT_DIVISORS = {1e-3: "1e3", 1e-6: "1e6", 1e-9: "1e9"}  # to seconds, as text
# Seconds under a header that names ms, us or ns are read as times that are too small, by these factors.
TOO_SMALL = (1e3, 1e6, 1e9)
EPOCH_SECONDS = (1e8, 1e11)  # times in seconds since 1970 from the years 1973 to 5138
SAME_SHIFT = 0.1  # relative difference of two shifts that may be one
MIN_COMMON_TIME = 0.1  # of the time of both paths together


def median_interval(times: Array) -> float | None:
    """Median difference of times (N,); None for a single time."""
    return float(np.median(np.diff(times))) if len(times) > 1 else None


def is_plausible(seconds: float) -> bool:
    """Whether an interval, seconds, is one between the frames of a camera."""
    shortest, longest = FRAME_INTERVALS_S
    return shortest * (1 - ROUNDING) <= seconds <= longest * (1 + ROUNDING)


def likely_unit(interval: float) -> float | None:
    """The unit, seconds, in which an interval would be plausible and nearest to that of a camera."""
    return _nearest_unit(interval, (1.0, *UNIT_NAMES))


def _nearest_unit(interval: float, units: tuple[float, ...]) -> float | None:
    """The one of `units`, seconds, in which an interval is plausible and nearest to that of a camera."""
    plausible = [unit for unit in units if is_plausible(unit * interval)]
    return min(plausible, key=lambda unit: abs(np.log(unit * interval / USUAL_INTERVAL_S)), default=None)


def epoch_unit(times: Array) -> float:
    """The unit, seconds, of times (N,) since 1970, from their size; 1 for seconds and for other times."""
    first, last = EPOCH_SECONDS
    for unit in UNIT_NAMES:
        if first <= unit * float(np.median(times)) < last:
            return unit
    return 1.0


def _implausible_interval(times: Array) -> float | None:
    """The median interval of times (N,), seconds, if it is not plausible; None otherwise."""
    interval = median_interval(times)
    if interval is None or is_plausible(interval):
        return None
    return interval


def interval_fault(times: Array, whose: str = "the times") -> str:
    """A sentence if the median interval of times (N,), seconds, is not plausible; "" otherwise.

    whose : the times, as the sentence calls them.
    """
    interval = _implausible_interval(times)
    if interval is None:
        return ""
    shortest, longest = FRAME_INTERVALS_S
    return f"the median interval of {whose} is {interval:.6g} s, expected {shortest:g} to {longest:g} s"


def refuse_intervals(times: Array, path: str | Path, as_column: bool = False) -> None:
    """Raise `DataError` with the likely unit if the median interval of times (N,), seconds, is not plausible.

    as_column : whether the file may name the unit of its times in a header.
    """
    interval = _implausible_interval(times)
    if interval is not None:
        unit = likely_unit(interval) or _nearest_unit(interval, TOO_SMALL)
        raise DataError(interval_fault(times) + _unit_words(unit, "they", as_column), path)


def are_frame_numbers(times: Array) -> bool:
    """Whether times (N,) are whole numbers, such as 0, 1, 2, … or 10, 12, 17, …, but not since 1970."""
    first_epoch, _ = EPOCH_SECONDS
    return bool(times[0] >= 0 and times[-1] < first_epoch and (times == np.rint(times)).all())


def clock_shift(times: Array, others: Array) -> float | None:
    """Seconds by which `times` (N,) begin and end later than `others` (M,), if by about the same; else None.

    Then both may be the same frames by two clocks, or one path begins later and also ends later than the
    other. None also for a shift of clearly less than an interval.
    """
    start_shift = float(times[0] - others[0])
    end_shift = float(times[-1] - others[-1])
    if start_shift * end_shift <= 0:
        return None  # one of them begins earlier and ends later: it only has more frames
    shift = min(start_shift, end_shift, key=abs)
    interval = max(median_interval(times) or 0.0, median_interval(others) or 0.0)
    if abs(shift) < (1 - SAME_SHIFT) * interval:
        return None
    if abs(start_shift - end_shift) > SAME_SHIFT * abs(shift) + interval:
        return None
    return shift


def time_ranges(times: Array, true_times: Array, truth_name: str) -> str:
    """The first and last times (seconds) of a file and of the truth, as a sentence."""
    return (
        f"its times are {_digits(times[0])} to {_digits(times[-1])}, those of {truth_name} "
        f"{_digits(true_times[0])} to {_digits(true_times[-1])}"
    )


def time_mismatch(
    times: Array, true_times: Array, truth_name: str, tolerance: float, path: Path
) -> DataError:
    """The error of a file of which fewer than two `times` (N,) are those of true poses `true_times` (M,).

    All times are in seconds. The error names the reason; a larger tolerance is its remedy only where the
    times lie a little apart.

    In this order: another unit, by the size or the interval of each file's own times; an interval that no
    unit makes plausible; another unit, by the overlap of both files; clocks that do not overlap even in the
    right unit; and, if none of these, times that lie a little apart.
    """
    ranges = time_ranges(times, true_times, truth_name)
    problem = f"fewer than two poses at the times of {truth_name}, within {tolerance:g} s: {ranges}"
    theirs = f"those of {truth_name}"
    own_unit = _unit_of(times)
    true_unit = _unit_of(true_times)
    no_other_unit_found = own_unit == 1.0 and true_unit == 1.0
    if no_other_unit_found:
        # A file whose own interval is impossible says nothing about the unit of the other file.
        faults = [fault for fault in (interval_fault(times), interval_fault(true_times, theirs)) if fault]
        if faults:
            return DataError("; ".join([problem, *faults]), path)
        # The unit in which the times of each file overlap those of the other best, if any do.
        own_unit = _common_unit(times, true_times) or 1.0
        true_unit = _common_unit(true_times, times) or 1.0
    reason = _unit_words(own_unit, "its times", as_column=True)
    reason += _unit_words(true_unit, theirs, as_column=True)
    seconds = own_unit * times
    true_seconds = true_unit * true_times
    if _common_share(seconds, true_seconds) < MIN_COMMON_TIME:
        offset = float(seconds[0] - true_seconds[0])
        reason += (
            f"; the clocks differ by about {_digits(offset)} s: write the times of one clock in both files"
        )
    elif not reason:
        distances = np.abs(times - true_times[nearest_indices(true_times, times)])
        reason = (
            f"; the nearest times are {float(distances.min()):.3g} s apart, so the clocks differ, or the "
            "tolerance is too small"
        )
        return DataError(problem + reason, path, remedy="tolerance")
    return DataError(problem + reason, path)


def _unit_of(times: Array) -> float:
    """The unit, seconds, of times (N,), from their size if they count from 1970, or from their interval.

    It is more than 1 s if seconds were read as a shorter unit (see `TOO_SMALL`), and 1 s if nothing fits.
    """
    unit = epoch_unit(times)
    interval = median_interval(times)
    if unit != 1.0 or interval is None or is_plausible(interval):
        return unit
    return likely_unit(interval) or _nearest_unit(interval, TOO_SMALL) or 1.0


def _common_unit(times: Array, true_times: Array) -> float | None:
    """The unit, seconds, in which `times` are partly within the range of `true_times`, or None."""
    shares = {unit: _common_share(unit * times, true_times) for unit in (1.0, *UNIT_NAMES)}
    best = max(shares, key=lambda unit: shares[unit])
    if shares[best] < MIN_COMMON_TIME:
        return None
    return best


def _common_share(times: Array, others: Array) -> float:
    """Time in which both paths have poses, divided by the time from the first to the last pose of both.

    Negative if one path ends before the other begins.
    """
    common = min(times[-1], others[-1]) - max(times[0], others[0])
    total = max(times[-1], others[-1]) - min(times[0], others[0])
    return float(common / total) if total > 0 else 0.0


def nearest_indices(sorted_times: Array, times: Array) -> Index:
    """Indices (N,) of the nearest of the increasing `sorted_times` for each of `times` (N,)."""
    last = len(sorted_times) - 1
    if last == 0:
        return np.zeros(len(times), np.intp)
    # The nearest time is one of two neighbours: the last one before a time, or the first one after it.
    after = np.clip(np.searchsorted(sorted_times, times), 1, last)
    before = after - 1
    is_before = np.abs(times - sorted_times[before]) <= np.abs(times - sorted_times[after])
    return np.asarray(np.where(is_before, before, after))


def _unit_words(unit: float | None, whose: str, as_column: bool) -> str:
    """What times probably are, and the remedy; "" for seconds or an unknown unit.

    unit : seconds. whose : the times, as the sentence calls them. as_column : as in `refuse_intervals`.
    """
    if unit is None or unit == 1.0:
        return ""
    if unit > 1.0:
        return (
            f"; {whose} are probably {unit:.0f} times too small: correct the unit in the header of that file"
        )
    words = f"; {whose} are probably {UNIT_NAMES[unit]}: divide them by {UNIT_DIVISORS[unit]}"
    if not as_column:
        return words
    header = HEADER_EXAMPLE.replace("[s]", f"[{UNIT_SYMBOLS[unit]}]")
    return f"{words}, or name their unit in a first line such as {header!r}"


def _digits(seconds: float) -> str:
    """A time with up to three decimals, without zeros at the end."""
    return f"{seconds:.3f}".rstrip("0").rstrip(".")
