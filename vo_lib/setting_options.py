"""Command-line options made from a settings class, for the data scripts."""

from __future__ import annotations

import argparse
from typing import Any, TypeVar

from .settings import declared

Config = TypeVar("Config")


def add_options(parser: argparse.ArgumentParser, cls: type) -> None:
    """An option for every setting of a class: `--min-height` for min_height."""
    for item in declared(cls):
        default = ",".join(map(str, item.default)) if isinstance(item.default, tuple) else item.default
        text = f"{item.text}; {item.describe()}; default {default}".replace("%", "%%")
        parser.add_argument("--" + item.name.replace("_", "-"), metavar="X", dest=item.name, help=text)


def from_options(options: argparse.Namespace, cls: type[Config]) -> Config:
    """The settings with what was given; `DataError` says which value is wrong and what was expected."""
    values: dict[str, Any] = {}
    for item in declared(cls):
        raw = getattr(options, item.name)
        if raw is not None:
            values[item.name] = item.parse(raw)
    return cls(**values)
