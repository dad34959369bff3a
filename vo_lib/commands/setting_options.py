"""Command-line options made from declared settings, for the `vo` command and the data scripts."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any, TypeVar

from ..core.settings import Setting, declared

Config = TypeVar("Config")
Group = argparse._ActionsContainer  # a parser, or a group of its options


def add_option(group: Group, item: Setting, name: str, default: bool = True, shown: bool = True) -> None:
    """The option `--name` for a setting: its help says the range and, unless told otherwise, the default.

    `shown` : in the parser's help.
    """
    text = f"{item.text.removesuffix('.')}; {item.describe()}"
    if default:
        value = ",".join(map(str, item.default)) if isinstance(item.default, tuple) else item.default
        text += f"; default {value}"
    about = text.replace("%", "%%") if shown else argparse.SUPPRESS
    group.add_argument(f"--{name}", metavar="X", dest=item.name, help=about)


def given(options: argparse.Namespace, items: Iterable[Setting]) -> dict[str, Any]:
    """Values of the settings that were given, by name; `DataError` says what was expected."""
    raw = {item: getattr(options, item.name) for item in items}
    values = {item: item.parse(text) for item, text in raw.items() if text is not None}
    for item, value in values.items():
        item.check(value)
    return {item.name: value for item, value in values.items()}


def add_settings(group: Group, cls: type, defaults: bool = True) -> None:
    """An option for every setting of a class: `--min-height` for min_height."""
    for item in declared(cls):
        add_option(group, item, item.name.replace("_", "-"), defaults)


def from_options(options: argparse.Namespace, cls: type[Config]) -> Config:
    """The settings with what was given; `DataError` says which value is wrong and what was expected."""
    return cls(**given(options, declared(cls)))
