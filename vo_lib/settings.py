"""Declarations of settings: default, unit, range and meaning of every threshold.

A settings class is a frozen dataclass with fields made by `setting`. Command-line options, widgets and the
JSON in a run folder are derived from these declarations.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from .errors import DataError, did_you_mean

# Pattern of each item of a setting that is a list: what can be typed between two commas.
WORD_OF_LIST = r"[^\s,-][^,\n]{0,99}"
SWITCH = {"true": True, "on": True, "1": True, "false": False, "off": False, "0": False}  # words for a bool
NOUNS = {int: "whole number", float: "number"}  # for what a reader types, unless a setting has its own `noun`


def setting(
    default: Any,
    text: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    when: Mapping[str, tuple[Any, ...]] | None = None,
    noun: str = "",
    pattern: str = "",
) -> Any:
    """A dataclass field with a unit, a closed range [low, high] or choices, and a sentence on its meaning.

    Parameters
    ----------
    text : the sentence.
    when : names of other settings, each with the values for which this setting is used; by default, it is
        always used.
    noun : what a text is, such as "name". pattern : regular expression that a text matches completely.
    """
    declaration = {
        "text": text,
        "unit": unit,
        "low": low,
        "high": high,
        "choices": choices,
        "when": when or {},
        "noun": noun,
        "pattern": pattern,
    }
    return dataclasses.field(default=default, metadata=declaration)


def section(cls: type) -> Any:
    """A field for a nested settings class, with the defaults of that class."""
    return dataclasses.field(default_factory=cls)


@dataclass(frozen=True)
class Setting:
    """A setting with its name and its declaration.

    If the default is None, None is a valid value. If the default is a tuple, the value is a tuple.

    Attributes
    ----------
    name : dotted path, such as "selection.sets".
    kind : Python type of the value.
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
    noun: str = ""
    pattern: str = ""

    @property
    def _item_kind(self) -> Any:
        """The type of the value: `kind`, or str and float for tuple[str, ...] and float | None."""
        types = typing.get_args(self.kind)
        return types[0] if types else self.kind

    def parse(self, raw: str) -> Any:
        """The value of a command-line argument; the message of a `DataError` lists the allowed values."""
        kind = self._item_kind
        is_none = raw.lower() == "none"
        try:
            if kind is bool:
                return SWITCH[raw.lower()]
            if isinstance(self.default, tuple):
                if is_none:
                    return ()
                words = [item.strip() for item in raw.split(",")]
                return tuple(kind(word) for word in words if word)
            if self.default is None and is_none:
                return None
            return kind(raw)
        except (KeyError, ValueError):
            raise DataError(f"{self.name}: {raw!r} is not {self.describe()}") from None

    def check(self, value: Any) -> None:
        """Raise `DataError` unless the value has the declared type, range and choices."""
        # A list of choices may be empty, typed as "none"; a list of words may not.
        if self.pattern and _items(value) == ():
            raise DataError(f"{self.name} is empty, expected {self.describe()}")
        if not self._has_declared_form(value) or not all(self._allows(item) for item in _items(value)):
            raise DataError(f"{self.name}: {self._shown(value)!r} is not {self.describe()}")

    def _has_declared_form(self, value: Any) -> bool:
        """Whether a value is a list where the default is a list, and a single value where it is none."""
        return isinstance(value, tuple) == isinstance(self.default, tuple)

    def _shown(self, value: Any) -> Any:
        """A value as a message shows it: a list of the right type as it is typed, with commas."""
        is_typed = isinstance(value, tuple) and all(type(item) is self._item_kind for item in value)
        return as_typed(value) if is_typed else value

    def _allows(self, item: Any) -> bool:
        """Whether the setting may have this value, or this item of a list."""
        if item is None:
            return self.default is None
        kind = self._item_kind
        is_whole_number = kind is float and type(item) is int
        if type(item) is not kind and not is_whole_number:
            return False
        if self.choices:
            return item in self.choices
        if self.pattern:
            return re.fullmatch(self.pattern, item) is not None
        # NaN fails every comparison.
        is_not_too_low = self.low is None or item >= self.low
        is_not_too_high = self.high is None or item <= self.high
        return is_not_too_low and is_not_too_high

    def describe(self) -> str:
        """The allowed values as text, such as "a number from 0 to 5 px"."""
        if self.choices and isinstance(self.default, tuple):
            return "a comma-separated list of " + ", ".join(self.choices) + ", or none"
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self._item_kind is bool:
            return "on or off"
        noun = self.noun or NOUNS.get(self._item_kind, "text")
        text = f"a comma-separated list of {noun}s" if isinstance(self.default, tuple) else f"a {noun}"
        if self.low is not None and self.high is not None:
            text += f" from {self.low:g} to {self.high:g}"
        elif self.low is not None:
            text += f" of {self.low:g} or more"
        elif self.high is not None:
            text += f" of {self.high:g} or less"
        return f"{text} {self.unit}".rstrip()


def _items(value: Any) -> tuple[Any, ...]:
    """The items of a list, or the single value."""
    return value if isinstance(value, tuple) else (value,)


def as_typed(value: Any) -> str:
    """A value as written on the command line."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return ",".join(map(str, value)) or "none"
    return str(value)


class Checked:
    """Base of settings classes: the constructor checks every value against its declaration."""

    def __post_init__(self) -> None:
        for item in declared(type(self)):
            is_nested = "." in item.name
            if not is_nested:  # the constructor of the nested class has checked the others
                item.check(getattr(self, item.name))


# The type of each field by name. A call takes a millisecond, and each config.json needs one for each section.
_hints = functools.cache(typing.get_type_hints)


def declared(cls: type, prefix: str = "") -> tuple[Setting, ...]:
    """All settings of a settings class, depth first, in the order of declaration."""
    return _declared(cls, prefix)


# Cached, since each picture of a panel asks for the settings some fifty times. The cached function is not
# `declared` itself, because a cache hides the types of the arguments from mypy.
@functools.cache
def _declared(cls: type, prefix: str) -> tuple[Setting, ...]:
    """`declared`, with `prefix` in front of every name."""
    hints = _hints(cls)
    items = list[Setting]()
    for field in dataclasses.fields(cls):
        kind = hints[field.name]
        if dataclasses.is_dataclass(kind):
            items += _declared(typing.cast(type, kind), f"{prefix}{field.name}.")
        elif field.metadata:
            items.append(Setting(prefix + field.name, kind, field.default, **field.metadata))
    return tuple(items)


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
    near = did_you_mean(name, names)
    hint = f"; {near.rstrip()}" if near else ""
    return DataError(f"{name} is no setting of {cls.__name__}{hint}")


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


def to_dict(config: Any) -> dict[str, Any]:
    """The settings as nested dicts for JSON."""
    return dataclasses.asdict(config)


def from_dict(cls: Any, data: dict[str, Any]) -> Any:
    """Settings from nested dicts as returned by `to_dict`; absent fields keep their defaults."""
    if not isinstance(data, dict):
        raise DataError(f"expected a JSON object with the settings of {cls.__name__}")
    hints = _hints(cls)
    values = dict[str, Any]()
    for name, value in data.items():
        if name not in hints:
            raise _no_such_setting(cls, name, hints)
        if dataclasses.is_dataclass(hints[name]):
            values[name] = from_dict(hints[name], value)
        elif isinstance(value, list):
            values[name] = tuple(value)
        else:
            values[name] = value
    return cls(**values)
