"""Times and frame numbers in the names of images."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from vo_lib.errors import DataError
from vo_lib.geometry.types import Array, IntArray

# Times since 1970, with the unit in nanoseconds of the whole number and of its decimals or second number. A
# whole number is a time only in a plausible year, so that frame numbers are not.
WHOLE = {r"\d{18,19}": 1, r"\d{16}": 1_000, r"\d{13}": 1_000_000, r"\d{10}": 1_000_000_000}
FIRST_S = 300_000_000  # 1979
LAST_S = 2_000_000_000  # 2033; a date and a number (2011092601) are later
TWO_NUMBERS = {r"(\d{9,10})[_-](\d{9})": 1, r"(\d{9,10})[_-](\d{6})": 1_000}  # of ROS: seconds, nanoseconds
PARTS = "year", "month", "day", "hour", "minute", "second"
DATE = (
    r"(?P<year>20\d\d)[-_.]?(?P<month>\d\d)[-_.]?(?P<day>\d\d)[-_. T]?(?P<hour>\d\d)[-_.:h]?"
    r"(?P<minute>\d\d)[-_.:m]?(?P<second>\d\d)(?:(?P<point>[-_.s])?(?P<decimals>\d{9}|\d{6}|\d{3}))?"
)
SINCE_1970 = r"\d{9,10}\.\d+"
SINCE_START = r"\d{1,8}(?:\.\d{1,9})?"
MIN_DECIMALS = 3  # of some of the seconds since the start; 1.1 and 1.2 may be a camera and two frames


def times_of_names(names: list[str], place: Path) -> Array | None:
    """Times (N,), seconds, if each name is a time between equal texts; None otherwise.

    A time is a whole number of seconds, milliseconds, microseconds or nanoseconds since 1970, seconds with
    decimals, seconds and nanoseconds as two numbers, or a date with the time of day. Raises `DataError` for
    two images with one time.

    place : folder or pattern of the images, for messages.
    """
    nanoseconds = _nanoseconds(names)
    if nanoseconds is None:
        return None
    if len(set(nanoseconds)) < len(names):
        ordered = sorted(zip(nanoseconds, names, strict=True))
        twins = next((a, b) for (time_a, a), (time_b, b) in pairwise(ordered) if time_a == time_b)
        raise DataError(f"{twins[0]} and {twins[1]} have the same time", place)
    return np.array(nanoseconds, np.float64) * 1e-9


def _nanoseconds(names: list[str]) -> list[int] | None:
    """The times in the names, nanoseconds; None if they are not times. The first form that fits counts."""
    for pattern, unit in WHOLE.items():
        words = _words(names, rf"({pattern})")
        values = [int(word[1]) * unit for word in words]
        if values and all(FIRST_S <= value / 1e9 <= LAST_S for value in values):
            return values
    for pattern, unit in TWO_NUMBERS.items():
        words = _words(names, pattern)
        values = [int(word[1]) * 1_000_000_000 + int(word[2]) * unit for word in words]
        if values and all(FIRST_S <= value / 1e9 <= LAST_S for value in values):
            return values
    dates = _dates(names)
    if dates:
        return dates
    words = _words(names, rf"({SINCE_1970})")
    if words:
        return [_exact(word[1]) for word in words]
    return _since_start(names)


def _since_start(names: list[str]) -> list[int] | None:
    """Nanoseconds of seconds with decimals, counted from any start; None for other names.

    A program that leaves out zeros at the end writes 60.05, 60.5 and 61, but never 60.10. A camera 60 with
    its frames has 60.9 and 60.10, but never 60.05.
    """
    words = _words(names, rf"({SINCE_START})")
    decimals = [word[1].partition(".")[2] for word in words]
    lengths = {len(digits) for digits in decimals}
    starts_with_zero = any(re.fullmatch(r"0\d+", digits) for digits in decimals)
    ends_with_zero = any(re.fullmatch(r"\d+0", digits) for digits in decimals)
    if not words or (len(lengths) > 1 and ends_with_zero):
        return None
    if max(lengths) >= MIN_DECIMALS or (len(lengths) > 1 and starts_with_zero):
        return [_exact(word[1]) for word in words]
    return None


def _dates(names: list[str]) -> list[int] | None:
    """Nanoseconds of dates with hours, minutes, seconds and perhaps decimals; None for other names."""
    words = _words(names, DATE)
    decimals = [word["decimals"] or "" for word in words]
    if any(word["point"] for word in words):  # the decimals may be the number of a frame
        counted = sorted(int(word) for word in decimals if word)
        if counted == list(range(counted[0], counted[0] + len(counted))):
            return None
        if len({word.group(*PARTS) for word in words}) == 1:
            return None
    values = []
    for word, rest in zip(words, decimals, strict=True):
        try:
            moment = datetime(**{part: int(word[part]) for part in PARTS}, tzinfo=UTC)
        except ValueError:  # such as month 13
            return None
        values.append(int(moment.timestamp()) * 1_000_000_000 + int(rest.ljust(9, "0")))
    return values


def _exact(word: str) -> int:
    """Nanoseconds of a number of seconds with decimals."""
    whole, _, decimals = word.partition(".")
    return int(whole) * 1_000_000_000 + int(decimals[:9].ljust(9, "0"))


def _words(names: list[str], pattern: str) -> list[re.Match[str]]:
    """The number in each name, if it is the only one of its form and the text around it is always equal."""
    form = re.compile(rf"(?<![\d.]){pattern}(?![\d.])", re.ASCII)
    found = [list(form.finditer(name)) for name in names]
    if any(len(matches) != 1 for matches in found):
        return []
    words = [matches[0] for matches in found]
    around = {(word.string[: word.start()], word.string[word.end() :]) for word in words}
    return words if len(around) == 1 else []


def frame_numbers(numbers: list[int]) -> IntArray:
    """The frame (N,) of each image, 0 for the first, from increasing numbers in the names.

    If every third image was kept, the numbers increase by three from frame to frame: one frame is the largest
    number that divides all steps.
    """
    steps = [after - before for before, after in pairwise(numbers)]
    unit = math.gcd(*steps)
    return np.array([(number - numbers[0]) // unit for number in numbers], np.int64)


def gap_note(frames: IntArray, names: list[str]) -> str:
    """A sentence on the gaps in the frame numbers of images; "" without gaps."""
    steps = np.diff(frames)
    gaps = np.flatnonzero(steps > 1)
    if not len(gaps):
        return ""
    missing = int((steps[gaps] - 1).sum())
    frames_word = "1 frame" if missing == 1 else f"{missing} frames"
    if len(gaps) == 1:
        words = f"the numbers have a gap of {frames_word} after {names[gaps[0]]}"
    else:
        words = (
            f"the numbers have {len(gaps)} gaps of {frames_word} together, the first after {names[gaps[0]]}"
        )
    return f"{words}; the times have the same"
