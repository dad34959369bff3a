"""The one exception that means "the input is wrong", with the place where it is wrong."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path


class DataError(Exception):
    """Bad input: a file, a folder or an option that cannot be used as it is.

    The text is one line a person can act on: the file and line (or image) if there is one,
    then what was found and what was expected. The `vo` command prints it and exits with code 2.
    """

    def __init__(self, message: str, path: str | Path | None = None, line: int | None = None):
        place = "" if path is None else str(path) + ("" if line is None else f", line {line}") + ": "
        super().__init__(" ".join((place + message).split("\n")))


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """A question that names the nearest of the valid names, with a blank behind it; "" where none is near."""
    near = difflib.get_close_matches(name, list(names), n=1)
    return f"did you mean {near[0]}? " if near else ""
