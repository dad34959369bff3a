"""Command-line options from declared settings, for the `vo` command and the data scripts."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import Any, TypeVar

from ..settings import Setting, as_typed, declared

Config = TypeVar("Config")
OptionGroup = argparse._ActionsContainer  # a parser, or a group of its options


def add_option(
    group: OptionGroup, item: Setting, name: str, default: bool = True, shown: bool = True
) -> None:
    """Add the option `--name` for a setting; its help text, if shown, has meaning, range and default."""
    text = f"{item.text.removesuffix('.')}; {item.describe()}"
    if default:
        text += f"; default {as_typed(item.default)}"
    text = text.replace("%", "%%") if shown else argparse.SUPPRESS
    group.add_argument(f"--{name}", metavar="X", dest=item.name, help=text)


def option_values(options: argparse.Namespace, items: Iterable[Setting]) -> dict[str, Any]:
    """Values, by name, of the settings given as options; an invalid value raises `DataError`."""
    values: dict[str, Any] = {}
    for item in items:
        if (text := getattr(options, item.name)) is not None:
            values[item.name] = item.parse(text)
            item.check(values[item.name])
    return values


def add_settings(group: OptionGroup, cls: type, defaults: bool = True) -> None:
    """Add an option for every setting of a class: `--min-height` for min_height."""
    for item in declared(cls):
        add_option(group, item, item.name.replace("_", "-"), defaults)


def from_options(options: argparse.Namespace, cls: type[Config], prefix: str = "") -> Config:
    """Settings of a class, with the values given as options; an invalid value raises `DataError`.

    prefix : beginning of the option names, such as "detector.".
    """
    values = option_values(options, declared(cls, prefix))
    return cls(**{name.removeprefix(prefix): value for name, value in values.items()})
