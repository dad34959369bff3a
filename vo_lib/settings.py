"""Declarations of settings: default, unit, range and meaning of every threshold.

A settings class is a frozen dataclass with fields made by `setting`. Command-line options, widgets and the
JSON in a run folder are derived from these declarations.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any, cast, get_args, get_type_hints

from .errors import DataError, did_you_mean

# Pattern of a text in a setting that is a list: what can be typed between two commas.
WORD_OF_LIST = r"[^\s,-][^,\n]{0,99}"
SWITCH = {"on": True, "off": False}  # words for a bool
KINDS = {int: "a whole number", float: "a number", str: "a name", bool: "on or off"}


def setting(
    default: Any,
    text: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    when: Mapping[str, tuple[Any, ...]] | None = None,
) -> Any:
    """A dataclass field with a unit, a closed range [low, high] or choices, and a sentence on its meaning.

    Parameters
    ----------
    text : the sentence.
    when : names of other settings, each with the values for which this setting is used; by default, it is
        always used.
    """
    declaration = dict(text=text, unit=unit, low=low, high=high, choices=choices, when=when or {})
    return dataclasses.field(default=default, metadata=declaration)


def section(cls: type) -> Any:
    """A field for a nested settings class, with the defaults of that class."""
    return dataclasses.field(default_factory=cls)


@dataclasses.dataclass(frozen=True)
class Setting:
    """A setting with its name and its declaration.

    If the default is None, None is a valid value. If the default is a tuple, the value is a tuple, which may
    be empty if the default is.

    Attributes
    ----------
    name : dotted path, such as "selection.sets".
    kind : Python type of the value, or of the items of a list.
    The others are the parameters of `setting`.
    """

    name: str
    kind: Any
    default: Any
    text: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    when: Mapping[str, tuple[Any, ...]] = dataclasses.field(default_factory=dict)

    @property
    def is_list(self) -> bool:
        """Whether the value is a tuple."""
        return isinstance(self.default, tuple)

    def parse(self, raw: str) -> Any:
        """The checked value of a command-line argument; a `DataError` lists the allowed values."""
        with suppress(KeyError, ValueError):
            value = self._read(raw)
            if self._allows(value):
                return value
        raise DataError(f"{self.name}: {raw!r} is not {self.describe()}")

    def check(self, value: Any) -> None:
        """Raise `DataError` unless the value has the declared type, range and choices."""
        if not self._allows(value):
            raise DataError(f"{self.name}: {value!r} is not {self.describe()}")

    def _read(self, raw: str) -> Any:
        """The value of a command-line argument; KeyError or ValueError for another type."""
        if self.is_list:
            return tuple(self.kind(word.strip()) for word in raw.split(",") if word.strip())
        if self.default is None and raw == "none":
            return None
        return SWITCH[raw] if self.kind is bool else self.kind(raw)

    def _allows(self, value: Any) -> bool:
        """Whether the setting may have this value."""
        if not self.is_list:
            return self._allows_item(value)
        is_list_too = isinstance(value, tuple) and (value != () or self.default == ())
        return is_list_too and all(map(self._allows_item, value))

    def _allows_item(self, item: Any) -> bool:
        """Whether the setting may have this value, or this item of a list."""
        if item is None:
            return self.default is None
        is_whole_number = self.kind is float and type(item) is int
        if type(item) is not self.kind and not is_whole_number:
            return False
        if self.choices:
            return item in self.choices
        if self.kind is str:
            return not self.is_list or re.fullmatch(WORD_OF_LIST, item) is not None
        # NaN fails every comparison.
        return (self.low is None or item >= self.low) and (self.high is None or item <= self.high)

    def describe(self) -> str:
        """The allowed values as text, such as "a number from 0 to 5 px"."""
        text = "one of " + ", ".join(self.choices) if self.choices else KINDS[self.kind]
        if self.low is not None:
            text += f" from {self.low:g}"
        if self.high is not None:
            text += f" to {self.high:g}"
        text = f"{text} {self.unit}".rstrip()
        return f"{text}, or several separated by commas" if self.is_list else text


def as_typed(value: Any) -> str:
    """A value as written on the command line."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    return str(value)


class Checked:
    """Base of settings classes: the constructor checks every value against its declaration."""

    def __post_init__(self) -> None:
        for item in declared(type(self)):
            if "." not in item.name:  # the constructor of a nested class has checked the others
                item.check(getattr(self, item.name))


def _declared(cls: type, prefix: str = "") -> tuple[Setting, ...]:
    """All settings of a settings class, depth first, with `prefix` in front of every name."""
    hints = get_type_hints(cls)
    items = list[Setting]()
    for field in dataclasses.fields(cls):
        kind = hints[field.name]
        if dataclasses.is_dataclass(kind):
            items += _declared(cast(type, kind), f"{prefix}{field.name}.")
        elif field.metadata:
            kind = [*get_args(kind), kind][0]  # str and float for tuple[str, ...] and float | None
            items.append(Setting(prefix + field.name, kind, field.default, **field.metadata))
    return tuple(items)


# All settings of a settings class, in the order of declaration. Cached, since each picture of a panel asks
# for them some fifty times.
declared: Callable[..., tuple[Setting, ...]] = functools.cache(_declared)


def replace(config: Any, name: str, value: Any) -> Any:
    """A copy of nested settings in which the setting with this dotted name has a new, checked value."""
    items = {item.name: item for item in declared(type(config))}
    if name not in items:
        raise _no_such_setting(type(config), name, items)
    items[name].check(value)
    head, _, rest = name.partition(".")
    changed = replace(getattr(config, head), rest, value) if rest else value
    return dataclasses.replace(config, **{head: changed})


def _no_such_setting(cls: type, name: str, names: Iterable[str]) -> DataError:
    """The error for an unknown name, with the nearest of the known ones."""
    return DataError(f"{name}: {did_you_mean(name, names)}expected a setting of {cls.__name__}")


def value_of(config: Any, name: str) -> Any:
    """The value of the setting with this dotted name."""
    return functools.reduce(getattr, name.split("."), config)


def unused_because(config: Any, name: str) -> str:
    """Why a configuration does not use one of its settings: "estimator is reprojection"; "" if it is used."""
    items = {item.name: item for item in declared(type(config))}
    for other, values in items[name].when.items():
        value = value_of(config, other)
        if value not in values:
            return f"{other} is {as_typed(value)}"
    return ""


to_dict = dataclasses.asdict  # the settings as nested dicts for JSON


def from_dict(cls: Any, data: dict[str, Any]) -> Any:
    """Settings from nested dicts as returned by `to_dict`; absent fields keep their defaults."""
    if not isinstance(data, dict):
        raise DataError(f"expected a JSON object with the settings of {cls.__name__}")
    hints = get_type_hints(cls)
    values = dict[str, Any]()
    for name, value in data.items():
        if name not in hints:
            raise _no_such_setting(cls, name, hints)
        if dataclasses.is_dataclass(hints[name]):
            value = from_dict(hints[name], value)
        values[name] = tuple(value) if isinstance(value, list) else value
    return cls(**values)
