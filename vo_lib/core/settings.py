"""Settings declared once: default, unit, range and meaning of every threshold.

A settings class is a frozen dataclass whose fields are made by `setting`. Command-line options, widgets,
the JSON in a run folder and the reference page are all derived from these declarations.
"""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from .errors import DataError


def setting(
    default: Any,
    text: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field with its unit, closed range (low, high) or choices, and one sentence of meaning."""
    meta = {"text": text, "unit": unit, "low": low, "high": high, "choices": choices}
    return dataclasses.field(default=default, metadata=meta)


def section(cls: type) -> Any:
    """A nested settings class as a field, with its own defaults."""
    return dataclasses.field(default_factory=cls)


@dataclass(frozen=True)
class Setting:
    """One declared setting: `name` is the dotted path such as "selection.sets", `kind` its Python type."""

    name: str
    kind: Any
    default: Any
    text: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]

    @property
    def _kinds(self) -> tuple[Any, ...]:
        """The types that a value, or each of several, may have."""
        return tuple(kind for kind in typing.get_args(self.kind) or (self.kind,) if kind is not Ellipsis)

    @property
    def _many(self) -> bool:
        return typing.get_origin(self.kind) is tuple

    def parse(self, raw: str) -> Any:
        """The value of a command-line word; `DataError` says what was expected."""
        kind, word = self._kinds[0], raw.lower()
        try:
            if kind is bool:
                return {"true": True, "on": True, "1": True, "false": False, "off": False, "0": False}[word]
            if self._many:
                return tuple(kind(item) for item in raw.split(",") if item)
            return None if type(None) in self._kinds and word == "none" else kind(raw)
        except (KeyError, ValueError):
            raise DataError(f"{self.name}: {raw!r} is not {self.describe()}") from None

    def check(self, value: Any) -> None:
        """Raise `DataError` unless the value has the declared type, range and choices."""
        values = value if isinstance(value, tuple) else (value,)
        wrong = [item for item in values if not self._allows(item)]
        if wrong or isinstance(value, tuple) != self._many:
            raise DataError(f"{self.name}: {wrong[0] if wrong else value!r} is not {self.describe()}")

    def _allows(self, item: Any) -> bool:
        if isinstance(item, bool) or not isinstance(item, (int, float)):
            return type(item) in self._kinds and (not self.choices or item in self.choices)
        if type(item) not in self._kinds and float not in self._kinds:
            return False
        # NaN compares false.
        return (self.low is None or item >= self.low) and (self.high is None or item <= self.high)

    def describe(self) -> str:
        """The values allowed, in words: "a number from 0 to 5 px"."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        kind = self._kinds[0]
        if kind is bool:
            return "on or off"
        noun = {int: "whole number", float: "number"}.get(kind, "text")
        text = f"a comma-separated list of {noun}s" if self._many else f"a {noun}"
        if self.low is not None and self.high is not None:
            text += f" from {self.low:g} to {self.high:g}"
        elif self.low is not None:
            text += f" of {self.low:g} or more"
        return text + (f" {self.unit}" if self.unit else "")


class Checked:
    """Base of settings classes: every instance is checked against its declarations when made."""

    def __post_init__(self) -> None:
        for item in declared(type(self), nested=False):
            item.check(getattr(self, item.name))


# They are looked up for every widget and option, and take a millisecond.
_hints = functools.cache(typing.get_type_hints)


def declared(cls: type, prefix: str = "", nested: bool = True) -> Iterator[Setting]:
    """All settings of a settings class, depth first, in the order of declaration."""
    hints = _hints(cls)
    for field in dataclasses.fields(cls):
        kind = hints[field.name]
        if dataclasses.is_dataclass(kind):
            if nested:
                yield from declared(typing.cast(type, kind), f"{prefix}{field.name}.")
        elif field.metadata:
            yield Setting(name=prefix + field.name, kind=kind, default=field.default, **field.metadata)


@functools.cache
def _by_name(cls: type) -> dict[str, Setting]:
    return {item.name: item for item in declared(cls)}


def replace(config: Any, name: str, value: Any) -> Any:
    """A copy of nested settings with one changed by its dotted name, checked."""
    item = _by_name(config.__class__).get(name)
    if item is None:
        raise DataError(f"{name}: there is no such setting")
    item.check(value)
    return _replace(config, name.split("."), value)


def _replace(config: Any, path: list[str], value: Any) -> Any:
    head, *rest = path
    return dataclasses.replace(
        config, **{head: _replace(getattr(config, head), rest, value) if rest else value}
    )


def to_dict(config: Any) -> dict[str, Any]:
    """Nested plain dict, ready for JSON."""
    return dataclasses.asdict(config)


def from_dict(cls: Any, data: dict[str, Any]) -> Any:
    """Settings from a nested dict as `to_dict` gives it; absent fields keep their defaults."""
    if not isinstance(data, dict):
        raise DataError(f"expected the settings of {cls.__name__} by name")
    hints = _hints(cls)
    values: dict[str, Any] = {}
    for name, value in data.items():
        if name not in hints:
            raise DataError(f"{name}: there is no such setting")
        kind = hints[name]
        if dataclasses.is_dataclass(kind):
            value = from_dict(kind, value)
        values[name] = tuple(value) if isinstance(value, list) else value
    return cls(**values)
