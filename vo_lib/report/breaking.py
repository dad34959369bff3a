"""Long texts in lines: where a name, a list or a sentence may break, in a terminal and in a picture."""

from __future__ import annotations

import re
from collections.abc import Callable

GLUE = "\N{NO-BREAK SPACE}"
_PIECE = re.compile(r"[^,;/=_.+-]*[,;/=_.+-]*")

Width = Callable[[str], int]  # of a text in the terminal: some letters take two columns


def glued(text: str) -> str:
    """A text in which a number and its deviation, and a command between backquotes, have no usual blanks."""
    text = re.sub(r" ?± ?", lambda found: found[0].replace(" ", GLUE), text)
    return re.sub(r"`[^`\n]{1,60}`", lambda found: found[0].replace(" ", GLUE), text)


def broken(text: str, width: int, width_of: Width = len) -> str:
    """A text in lines of at most `width`, broken at blanks or, in a longer word, behind punctuation."""
    lines = []
    for line in text.split("\n"):
        current = ""
        for word in line.split(" "):
            if current and width_of(current) + 1 + width_of(word) <= width:
                current += f" {word}"
                continue
            if current:
                lines.append(current)
            *full, current = _broken_word(word, width, width_of)
            lines += full
        lines.append(current)
    return "\n".join(lines).replace(GLUE, " ")


def _broken_word(word: str, width: int, width_of: Width) -> list[str]:
    """A word in pieces of at most `width`: behind punctuation, or anywhere in a piece without it."""
    if width_of(word) <= width:
        return [word]
    lines = [""]
    for piece in _PIECE.findall(word):
        if width_of(lines[-1] + piece) <= width:
            lines[-1] += piece
            continue
        if lines[-1]:
            lines.append("")
        for letter in piece:
            if lines[-1] and width_of(lines[-1] + letter) > width:
                lines.append("")
            lines[-1] += letter
    return lines
