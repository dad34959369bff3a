"""Times and numbers in the names of images: pairs, times and gaps."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from fetch.name_times import frame_numbers, gap_note, times_of_names
from fetch.stereo_sources import pair_images
from vo_lib.errors import DataError

START_NS = 1403636579763555584
STEPS_NS = 50_000_000 * np.array([0, 1, 2, 5, 6, 7])  # two images are missing


def names(form: Callable[[int], str]) -> list[str]:
    return [form(START_NS + step) for step in STEPS_NS.tolist()]


def day(nanoseconds: int) -> datetime:
    return datetime.fromtimestamp(nanoseconds // 1000 / 1e6, UTC)


FORMS: dict[str, Callable[[int], str]] = {
    "nanoseconds": str,
    "microseconds": lambda t: str(t // 1000),
    "milliseconds": lambda t: str(t // 10**6),
    "seconds with decimals": lambda t: f"{t / 1e9:.6f}",
    "seconds and nanoseconds": lambda t: f"{t // 10**9}_{t % 10**9:09d}",
    "seconds and microseconds": lambda t: f"{t // 10**9}-{t % 10**9 // 1000:06d}",
    "between other words": lambda t: f"cam0_{t}_rect",
    "seconds of a recording": lambda t: f"{(t - START_NS) / 1e9:.4f}",
    "seconds without zeros at the end": lambda t: f"frame-{round(t / 1e9, 3)}",
    "short seconds of a recording": lambda t: f"{59.8125 + (t - START_NS) / 1e9:.10g}",
    "less than one second": lambda t: f"{60 + (t - START_NS) / 1e9:.10g}",
    "date": lambda t: day(t).strftime("%Y%m%d%H%M%S%f"),
    "date with separators": lambda t: day(t).strftime("img_%Y-%m-%d_%H-%M-%S.%f")[:-3],
    "Malaga": lambda t: f"img_CAMERA1_{t / 1e9:.6f}_left",
}


@pytest.mark.parametrize("form", FORMS)
def test_names_in_any_unit_are_times(form: str) -> None:
    times = times_of_names(names(FORMS[form]), Path("L"))
    assert times is not None
    np.testing.assert_allclose(times - times[0], 1e-9 * STEPS_NS, atol=1.1e-3)


@pytest.mark.parametrize(
    "words",
    [
        ["0000000000", "0000000001"],  # KITTI's raw drives
        ["000008", "000009"],
        ["1.1", "1.2"],  # a camera and a frame
        ["1.9", "1.10", "1.100"],
        ["2011092601", "2011092602"],  # a date and a number
        ["2018-02-03_20-48-35_400", "2018-02-03_20-48-35_410"],  # one date and a number
        ["2018-02-03_20-48-35_401", "2018-02-03_20-48-36_402"],
        ["20181303204835", "20181303204836"],  # month 13
        ["1403636579763555584_a", "1403636579863555584_b"],
        ["frame0007", "frame0008"],
        ["9" * 19, "9" * 18 + "8"],
    ],
)
def test_other_numbers_are_not_times(words: list[str]) -> None:
    assert times_of_names(words, Path("L")) is None


def test_one_time_twice_is_refused() -> None:
    with pytest.raises(DataError, match=r"^L: 1403636579\.5 and 1403636579\.50 have the same time"):
        times_of_names(["1403636579.5", "1403636579.25", "1403636579.50"], Path("L"))


@pytest.mark.parametrize("form", FORMS)
def test_images_named_by_times_are_paired_in_the_order_of_time(bands: Path, form: str) -> None:
    for side in ("image_0", "image_1"):
        for path, name in zip(sorted((bands / side).iterdir()), names(FORMS[form]), strict=True):
            path.rename(path.with_name(f"{name}.png"))
    result = pair_images(bands / "image_0", bands / "image_1")
    assert result.times is not None
    np.testing.assert_allclose(result.times - result.times[0], 1e-9 * STEPS_NS, atol=1.1e-3)
    assert [left.name for left, _ in result.paths] == [right.name for _, right in result.paths]


@pytest.mark.parametrize(
    ("numbers", "frames", "words"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3], ""),
        ([7, 10, 13], [0, 1, 2], ""),  # every third image was kept
        (
            [8, 9, 40, 41],
            [0, 1, 32, 33],
            "the numbers have a gap of 30 frames after 9; the times have the same",
        ),
        (
            [7, 10, 19, 22, 28],
            [0, 1, 4, 5, 7],
            "the numbers have 2 gaps of 3 frames together, the first after 10",
        ),
        ([1, 2, 4], [0, 1, 3], "the numbers have a gap of 1 frame after 2"),
    ],
)
def test_gaps_in_the_numbers_are_gaps_in_time(numbers: list[int], frames: list[int], words: str) -> None:
    result = frame_numbers(numbers)
    assert result.tolist() == frames
    note = gap_note(result, [str(number) for number in numbers])
    assert note.startswith(words)
    assert bool(note) == bool(words)
