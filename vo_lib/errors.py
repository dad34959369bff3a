"""The exception for bad input, which names the file and line at fault."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

_LONG_WORD = re.compile(r"(\S{40})\S{40,}(\S{40})")  # a message shows both its ends
_PREFIX = re.compile("^(--|.*/)")  # what options, and sequences such as kitti/07, have before their name


class DataError(Exception):
    """Bad input: a file, a folder or an option that cannot be used.

    The message is a single line: the file and its line, if any, then the fault and the expected content. The
    `vo` command prints the message and exits with code 2.

    Parameters
    ----------
    message : the fault, and what is expected; a word of more than 120 characters loses its middle.
    path, line : the file and the line at fault; without a file, the line does not matter.
    """

    def __init__(self, message: str, path: str | Path | None = None, line: int | None = None):
        text = _LONG_WORD.sub(r"\1…\2", message)
        if path is not None:
            place = str(path) if line is None else f"{path}, line {line}"
            text = f"{place}: {text}"
        super().__init__("".join(letter if letter.isprintable() else " " for letter in text))


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """A question for an error message, with the valid name nearest to `name`; "" if no name is near.

    A blank follows the question, for the words behind it.
    """
    # Names are compared without what they all begin with, which would make short ones similar.
    words = {_PREFIX.sub("", valid).lower(): valid for valid in names}
    near = difflib.get_close_matches(_PREFIX.sub("", name).lower(), words, n=1)
    return f"did you mean {words[near[0]]}? " if near else ""
