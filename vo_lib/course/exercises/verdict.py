"""What a check says, and the comparisons that checks are made of."""

from __future__ import annotations

import functools
import html
import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.types import Array

RIGHT, NOT_YET = "#009E73", "#D55E00"
RIGHT_CLASS, NOT_YET_CLASS = "vo-right", "vo-not-yet"  # tests look for them


class Wrong(Exception):
    """An answer is not right: what is wrong with it, and a hint."""

    def __init__(self, message: str, hint: str = ""):
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True)
class Verdict:
    """The result of a check, shown by a notebook as a line in green or orange."""

    passed: bool
    message: str
    hint: str = ""

    def __repr__(self) -> str:
        word = "right" if self.passed else "not yet"
        return f"{word}: {self.message}" + (f" Hint: {self.hint}" if self.hint else "")

    def _repr_html_(self) -> str:
        colour, word = (RIGHT, "✓ Right:") if self.passed else (NOT_YET, "✗ Not yet:")
        name = RIGHT_CLASS if self.passed else NOT_YET_CLASS
        hint = f"<br><i>Hint: {_marked(self.hint)}</i>" if self.hint else ""
        style = f"border-left:4px solid {colour};padding:4px 10px;max-width:940px"
        return f'<div class="{name}" style="{style}"><b>{word}</b> {_marked(self.message)}{hint}</div>'


def _marked(text: str) -> str:
    """Text as HTML; what stands between backticks is code."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", html.escape(text))


def exercise(check: Callable[..., str]) -> Callable[..., Verdict]:
    """A check made into one that returns a `Verdict`, whatever the answer does."""

    @functools.wraps(check)
    def judged(*answers: Any) -> Verdict:
        if any(answer is None or answer is Ellipsis for answer in answers):
            return Verdict(False, "there is no answer, replace the dots.")
        try:
            return Verdict(True, check(*answers))
        except Wrong as wrong:
            return Verdict(False, str(wrong), wrong.hint)
        except Exception as error:
            # The last line of the traceback that is the student's own.
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f" in the line `{frame.line}`" if frame.line else ""
            return Verdict(False, f"the code stopped with {type(error).__name__}: {error}{where}.")

    return judged


def as_number(answer: Any) -> float:
    """The answer as one number."""
    _given(answer, "the result")
    try:
        value = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise Wrong(f"expected a number, got {type(answer).__name__}.") from None
    if value.size != 1:
        raise Wrong(f"expected one number, got an array of shape {value.shape}.")
    return float(value.reshape(()))


def as_array(answer: Any, shape: tuple[int, ...], what: str = "the result") -> Array:
    """The answer as an array of this shape without NaN."""
    _given(answer, what)
    try:
        value = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise Wrong(f"{what} should be numbers, but is {type(answer).__name__}.") from None
    if value.shape != shape:
        hint = "a transpose is missing." if value.shape == shape[::-1] else ""
        raise Wrong(f"{what} has shape {value.shape}, expected {shape}.", hint)
    if np.isnan(value).any():
        raise Wrong(f"{what} contains NaN.", "is something divided by zero?")
    return value


def _given(answer: Any, what: str) -> None:
    if answer is None or answer is Ellipsis:
        raise Wrong(f"{what} is missing: the function gives back nothing.", "does it end with `return`?")


def differs(got: Array, expected: Array, tolerance: float) -> bool:
    """Whether two arrays differ by more than `tolerance` anywhere."""
    return bool(np.max(np.abs(got - expected), initial=0.0) > tolerance)
