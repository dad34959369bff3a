"""The exception for bad input, which names the file and line at fault."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

_PREFIX = re.compile("^(--|.*/)")  # of options and of sequences such as kitti/07


MAX_TYPED = 80  # characters of a value that a message shows


def shorten(text: str) -> str:
    """A text of at most `MAX_TYPED` characters: of a longer text, the middle is left out."""
    if len(text) <= MAX_TYPED:
        return text
    half = (MAX_TYPED - 3) // 2
    return f"{text[: MAX_TYPED - 3 - half]} … {text[-half:]}"


class DataError(Exception):
    """Bad input: a file, a folder or an option that cannot be used.

    The message is a single line: the file and its line (or image), if any, then the fault and the expected
    content. The `vo` command prints the message and exits with code 2.

    remedy : name of a parameter that would help, such as "fresh"; the `vo` command adds how to type it.
    """

    def __init__(
        self, message: str, path: str | Path | None = None, line: int | None = None, *, remedy: str = ""
    ):
        self.remedy = remedy
        location = "" if path is None else str(path) + ("" if line is None else f", line {line}") + ": "
        super().__init__(" ".join((location + message).split("\n")))


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """A question for an error message, with the valid name nearest to `name`; "" if no name is near."""
    # A common beginning would make short names similar.
    words = {_PREFIX.sub("", valid).lower(): valid for valid in names}
    near = difflib.get_close_matches(_PREFIX.sub("", name).lower(), words, n=1)
    return f"did you mean {words[near[0]]}? " if near else ""
