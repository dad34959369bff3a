"""Results of an answer as arrays, as text and as a verdict."""

from __future__ import annotations

import html
import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import vo_lib
from vo_lib.errors import DataError

RIGHT = "#009E73"
NOT_YET = "#D55E00"
UNANSWERED = "#999999"
# Classes of CSS; tests search for both.
RIGHT_CLASS = "vo-right"
NOT_YET_CLASS = "vo-not-yet"
SHORT = 6  # maximal size of an array whose numbers are all shown
DIGITS = (5, 7, 9)  # of two numbers: the first choice that distinguishes the numbers
COMPLEX = "drop values with an imaginary part and take `.real` of the others; `eigh` and `svd` stay real."
MASKS = "join masks by `&` and `|`, not by `and`, with brackets round each comparison: `(a < b) & (c < d)`."
DOMAIN = (
    "rounding can make a number a little larger than 1, such as 1 + 1e-16: limit it first, by `min(x, 1)`."
)
# Code comes first: its asterisks are none of the text, and those of a product such as a*b*c neither.
_MARKS = re.compile(r"`([^`]+)`|(?<![\w*])\*([^\W\d_](?:[\w -]*\w)?)\*(?![\w*])")
# Parts of the paths of code that is not the student's.
NOT_OWN = (str(Path(__file__).parent), str(Path(vo_lib.__path__[0])), "site-packages")


@dataclass(frozen=True)
class Verdict:
    """The result of a check, shown by a notebook as a line in green or orange."""

    passed: bool
    message: str
    hint: str = ""
    tried: bool = True

    def __repr__(self) -> str:
        word = "right" if self.passed else "not yet"
        return f"{word}: {self.message}" + (f" Hint: {self.hint}" if self.hint else "")

    def _repr_html_(self) -> str:
        colour = NOT_YET
        word = "✗ Not yet:"
        name = NOT_YET_CLASS
        if self.passed:
            colour = RIGHT
            word = "✓ Right:"
            name = RIGHT_CLASS
        elif not self.tried:
            colour = UNANSWERED
            word = "Not yet:"
        hint = f"<br><i>Hint: {marked(self.hint)}</i>" if self.hint else ""
        style = f"border-left:4px solid {colour};padding:4px 10px;max-width:940px"
        return f'<div class="{name}" style="{style}"><b>{word}</b> {marked(self.message)}{hint}</div>'


def marked(text: str) -> str:
    """Text as HTML; text between backticks is code, words between asterisks are in italics."""
    return _MARKS.sub(_as_html, html.escape(text))


def _as_html(found: re.Match[str]) -> str:
    code, words = found.groups()
    return f"<i>{words}</i>" if code is None else f"<code>{code}</code>"


class Unusable(Verdict):
    """A result that cannot be compared. Such results are equal if their messages agree before the colon."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Unusable) and self.message.split(":")[0] == other.message.split(":")[0]

    __hash__ = None  # type: ignore[assignment]


def result_of(answer: Any, inputs: tuple[Any, ...]) -> Any:
    """The result of an answer for the inputs of a case; an answer that is a value is the result itself."""
    if not callable(answer):
        return answer
    try:
        return answer(*inputs)
    except Exception as error:
        line = _own_line(error)
        where = f" in the line `{line}`" if line else ""
        stop = "" if isinstance(error, DataError) else f"the code stopped with {type(error).__name__}: "
        return Unusable(False, f"{stop}{error}{where}.", hint_for(error))


def _own_line(error: Exception) -> str:
    """The innermost line of the student's own code that led to an error; "" if there is none."""
    line = ""
    for step in traceback.extract_tb(error.__traceback__):
        is_own = not any(place in step.filename for place in NOT_OWN)
        if is_own:
            line = step.line or ""
    return line


def hint_for(error: Exception) -> str:
    """A hint for an error that stops many answers; "" for others."""
    words = str(error)
    if "truth value of an array" in words or "'bitwise_" in words:
        return MASKS
    # Python 3.14 says "expected a number in range from -1 up to 1".
    if "math domain error" in words or "in range from -1 up to 1" in words:
        return DOMAIN
    return ""


def as_array(result: Any) -> Any:
    """A result as an array, of shape () for a single number; None and `Unusable` do not change."""
    if result is None or isinstance(result, Unusable):
        return result
    try:
        value = np.asarray(sorted(result) if isinstance(result, (set, frozenset)) else result)
        if value.dtype.kind == "c":
            return Unusable(False, "expected real numbers, got complex ones.", COMPLEX)
        if value.dtype.kind in "SU":
            raise TypeError
        if value.dtype.kind not in "iu" and value.dtype != np.float32:
            value = value.astype(np.float64)
    except (TypeError, ValueError):
        got = f"expected numbers, got {type(result).__name__}"
        return Unusable(False, f"{got}: `np.asarray` makes no array of numbers from it.")
    return value.reshape(()) if value.size == 1 else value


def is_index_list(expected: Any) -> bool:
    """Whether a result is a list of indices, whose length is part of the answer."""
    return isinstance(expected, np.ndarray) and expected.dtype.kind in "iu" and expected.ndim == 1


def why_not_indices(got: Any, expected: Any) -> str:
    """A sentence about a result that does not have the form of the expected indices; else ""."""
    if not (is_index_list(expected) and isinstance(got, np.ndarray) and np.isfinite(got).all()):
        return ""
    if got.size > 2 and np.isin(got, (0, 1)).all():
        return "this looks like a mask; the task asks for indices."
    if got.ndim == 2 and got.shape[1] == 1:
        return "each index has a row of its own: `np.flatnonzero` gives a flat list, `np.argwhere` does not."
    if got.ndim > 1 or np.mod(got, 1).any():
        return "the task asks for indices, not for values."
    return ""


def why_unusable(got: Any, expected: Any, what: str, hint: str) -> Unusable | None:
    """The reason why a result cannot be compared with the expected result; `hint` is for a wrong size."""
    if isinstance(got, Unusable):
        return got
    if got is None:
        says = f"{what} is missing: the function returns None."
        return Unusable(False, says, "does it end with `return`?")
    if expected is None or got.shape == expected.shape or is_index_list(expected):
        return None
    if got.size == expected.size:
        transposed = got.shape == expected.shape[::-1] and expected.ndim > 1
        hint = "a transpose is missing." if transposed else f"`np.reshape(…, {expected.shape})` is missing."
    form = f"has shape {got.shape}" if got.shape else "is one number"
    return Unusable(False, f"{what} {form}, expected {expected.shape or 'one number'}.", hint)


def holds(test: Callable[..., Any], *inputs: Any) -> bool:
    """Whether a result passes a test; False if the test raises an error."""
    try:
        return bool(test(*inputs))
    except (TypeError, ValueError, IndexError):
        return False


def differ(one: Any, other: Any) -> bool:
    """Whether arrays, lists of arrays or dictionaries differ; False for other objects."""
    if isinstance(one, np.ndarray):
        return not np.array_equal(one, other, equal_nan=True)
    if isinstance(one, (list, tuple)):
        return len(one) != len(other) or any(map(differ, one, other))
    return isinstance(one, dict) and bool(one != other)


def as_text(value: Any, digits: int = DIGITS[0]) -> str:
    """A number, a short array or a list of indices as text; else ""."""
    if isinstance(value, np.ndarray) and value.ndim:
        if value.size > SHORT and not is_index_list(value):
            return ""
        text = np.array2string(value, separator=", ", formatter={"all": f"{{:.{digits - 1}g}}".format})
        return " ".join(text.split())
    if isinstance(value, (int, float, np.number, np.ndarray)):
        return f"{value:.{digits}g}"
    return str(value) if value is None or isinstance(value, dict) else ""


def comparison(got: Any, expected: Any) -> str:
    """Text of both numbers with enough of `DIGITS` to distinguish them, else text of the difference."""
    for digits in DIGITS:
        if as_text(got, digits) != as_text(expected, digits):
            return f"is {as_text(got, digits)}, expected {as_text(expected, digits)}"
    largest = float(np.abs(np.subtract(got, expected)).max())
    return f"differs by {largest:.1g} from {as_text(expected)}: is something rounded on the way?"
