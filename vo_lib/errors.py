"""The exception for bad input, which names the file and line at fault."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

MAX_TYPED = 80  # largest number of characters that a message shows of a typed value
_PREFIX = re.compile("^(--|.*/)")  # what options, and sequences such as kitti/07, have before their name


def shorten(text: str) -> str:
    """A text of at most `MAX_TYPED` characters: of a longer text, the middle is left out."""
    gap = " … "
    if len(text) <= MAX_TYPED:
        return text
    end = (MAX_TYPED - len(gap)) // 2
    beginning = MAX_TYPED - len(gap) - end
    return text[:beginning] + gap + text[-end:]


class DataError(Exception):
    """Bad input: a file, a folder or an option that cannot be used.

    The message is a single line: the file and its line, if any, then the fault and the expected content. The
    `vo` command prints the message and exits with code 2.

    Parameters
    ----------
    message : the fault, and what is expected.
    path, line : the file and the line at fault; without a file, the line does not matter.
    remedy : what would help, as a key of `commands.console.REMEDIES` ("fresh", "variant kit", …), which says
        how to type it; "" for none.
    """

    def __init__(
        self, message: str, path: str | Path | None = None, line: int | None = None, *, remedy: str = ""
    ):
        self.remedy = remedy
        if path is None:
            text = message
        elif line is None:
            text = f"{path}: {message}"
        else:
            text = f"{path}, line {line}: {message}"
        super().__init__(text.replace("\n", " "))


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """A question for an error message, with the valid name nearest to `name`; "" if no name is near.

    A blank follows the question, for the words behind it.
    """
    # Names are compared without what they all begin with, which would make short ones similar.
    words = {_PREFIX.sub("", valid).lower(): valid for valid in names}
    near = difflib.get_close_matches(_PREFIX.sub("", name).lower(), words, n=1)
    return f"did you mean {words[near[0]]}? " if near else ""
