"""Numbers in texts of unknown form: damaged files with long rows of one character."""

from __future__ import annotations

import pytest

from fetch.calibrations.numbers_in_text import differing_cameras, numbers_in, other_size_in

LONG = 20_000
ROWS = {
    "digits": "7" * LONG,
    "rows of zeros": ("0" * 20 + " ") * LONG,
    "zeros": "5 " + "0 " * LONG,
    "spaces": "fx" + " " * LONG,
    "signs": "fx" + "=" * LONG,
    "brackets": "1 0" + "[ " * LONG,
    "exponents": "1e" * LONG,
    "cameras": "cam1" * LONG,
    "images": "image_" * LONG,
    "sizes": "size " + "-" * LONG,
}


@pytest.mark.parametrize("text", ROWS.values(), ids=ROWS.keys())
def test_a_long_row_is_read_in_a_moment(text: str) -> None:
    """The patterns do not try all ways to cut it, which would take hours."""
    assert numbers_in(text) is None
    assert differing_cameras(text) == ""
    assert other_size_in(text, (640, 480)) == ""


def test_numbers_beside_a_long_row_are_found() -> None:
    text = f"fx = 500.5 fy: 500.5\ncx=320 cy=240 baseline [m] = 0.12\n{'0' * LONG}"
    numbers = numbers_in(text)
    assert numbers is not None
    assert (numbers.fx, numbers.fy, numbers.cx, numbers.cy) == (500.5, 500.5, 320.0, 240.0)
    assert (numbers.baseline, numbers.unit) == (0.12, "m")
