"""Long texts in lines: where a name, a list or a sentence may break, in a terminal and in a picture."""

from __future__ import annotations

import re
from collections.abc import Callable

GLUE = "\N{NO-BREAK SPACE}"  # a blank at which no line ends; `broken` makes it a usual one again
_NUMBER = re.compile(r" ?± ?|(?<=\d) (?=[A-Za-z%°])")  # the blanks around "±", or that before a unit
_COMMAND = re.compile(r"`[^`\n]{1,60}`|\bvo data( \S+){1,3}")  # between backquotes, or the words of `vo data`
_PIECE = re.compile(r"[^,;/=_.+-]*[,;/=_.+-]*")  # a part of a word, and the punctuation behind it

Width = Callable[[str], int]  # the columns that a text takes in the terminal: for some letters, two each


def glued(text: str) -> str:
    """A text in which a number, its deviation and unit, and a short command have no blanks that break."""
    for pattern in (_NUMBER, _COMMAND):
        text = pattern.sub(lambda found: found[0].replace(" ", GLUE), text)
    return text


def broken(text: str, width: int, width_of: Width = len) -> str:
    """A text in lines of at most `width` columns, broken at blanks; a longer word, behind punctuation."""
    lines = []
    for paragraph in text.split("\n"):
        line = ""
        for word in paragraph.split(" "):
            if line and width_of(line) + 1 + width_of(word) <= width:
                line += f" {word}"
                continue
            if line:
                lines.append(line)
            pieces = _broken_word(word, width, width_of)
            lines += pieces[:-1]
            line = pieces[-1]  # the next word may have room behind it
        lines.append(line)
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
