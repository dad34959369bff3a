"""Settings: declared ranges, parsing, and errors for invalid values."""

from __future__ import annotations

import pytest

from vo_lib import DataError, settings
from vo_lib.kit.settings import KitConfig

DECLARED = list(settings.declared(KitConfig))


@pytest.mark.parametrize("item", DECLARED, ids=lambda item: item.name)
def test_every_setting_has_a_meaning_and_its_default_parses(item: settings.Setting) -> None:
    assert item.text
    assert item.choices or item.kind is bool or item.low is not None or item.is_list
    assert item.parse(settings.as_typed(item.default)) == item.default
    item.check(item.default)


@pytest.mark.parametrize("item", DECLARED, ids=lambda item: item.name)
def test_value_out_of_range_is_refused(item: settings.Setting) -> None:
    with pytest.raises(DataError, match=rf"^{item.name}: '-100000' is not "):
        item.parse("-100000")
    with pytest.raises(DataError, match=rf"^{item.name}: -100000 is not "):
        settings.replace(KitConfig(), item.name, -100000)


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (None, None, "a number m"),
        (0, None, "a number from 0 m"),
        (None, 5, "a number to 5 m"),
        (0, 5, "a number from 0 to 5 m"),
    ],
)
def test_range_is_described(low: float | None, high: float | None, words: str) -> None:
    item = settings.Setting("x", float, 1.0, "a length", "m", low, high, ())
    assert item.describe() == words
    with pytest.raises(DataError, match=f"^x: '1 m' is not {words}$"):
        item.parse("1 m")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "1", None, True])
def test_values_of_another_type_are_refused(value: object) -> None:
    with pytest.raises(DataError, match="loop_tolerance"):
        settings.replace(KitConfig(), "matching.loop_tolerance", value)
