"""The student's function on a frame: run beside the library's, which steps in where there is no answer yet."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array

from .results import Unusable, as_text, result_of
from .stored_answers import is_stub

EQUAL = 1e-9  # relative difference of results that are called equal


class OwnFunction:
    """A student's function with the library's for the same task; a call runs the student's wherever it can.

    A wrong answer runs as it is, so that its picture and its numbers show what is wrong. Only where there is
    nothing to draw (the body is still `...`, the function stops with an error, or its result has another form
    than the library's, is empty or has values that are not finite) the result is the library's, and a printed
    line says so, once for each reason.
    """

    def __init__(self, own: Any, library: Callable[..., Any]) -> None:
        self.library = library
        self.empty = not callable(own) or is_stub(own)
        self.own = own
        self.name = str(getattr(own, "__name__", library.__name__))
        self.told = set[str]()
        self.calls = 0
        self.replaced = 0  # calls whose result is the library's
        if self.empty:
            self._tell(f"{self.name} has no answer yet, so the library's function runs here.")

    def __call__(self, *inputs: Any) -> Any:
        self.calls += 1
        right = self.library(*inputs)
        if not self.empty:
            got = result_of(self.own, copy.deepcopy(inputs))
            if isinstance(got, Unusable):
                self._tell(
                    f"your {self.name} cannot run here, so the library's result is used: {got.message}"
                )
            elif fault := _other_form(got, right):
                self._tell(f"your {self.name} {fault}, so the library's result is used here.")
            else:
                return got
        self.replaced += 1
        return right

    @property
    def whose(self) -> str:
        """Whose results the calls gave so far: "yours", "the library's", or how many of them are the library's."""
        if self.empty or (self.calls and self.replaced == self.calls):
            return "the library's"
        if self.replaced:
            return f"partly yours ({self.replaced} of {self.calls} results are the library's)"
        return "yours"

    def _tell(self, line: str) -> None:
        if line not in self.told:
            self.told.add(line)
            print(line)


def own_or_library(own: Any, library: Callable[..., Any]) -> OwnFunction:
    """The student's function, ready to run on data, with the function of the library for the same task.

    rows = own_or_library(my_rows, epipolar_rows)
    A = rows(x_p, x_c)
    print(f"{rows.whose}: {apart(A, epipolar_rows(x_p, x_c))}")
    """
    return OwnFunction(own, library)


def apart(own: Any, library: Any, unit: str = "") -> str:
    """How far two results are apart, in a few words for `print`.

    Masks and lists of indices: how many entries differ, each compared with the one at the same place. Numbers
    and arrays: the largest difference, in `unit`. Lists of different lengths: both lengths.
    """
    mine = np.asarray(own)
    theirs = np.asarray(library)
    if _is_list(mine) and _is_list(theirs) and len(mine) == len(theirs):
        return f"{np.count_nonzero(mine != theirs)} of {len(theirs)} differ"
    if mine.shape != theirs.shape:
        return f"{_count(mine)} against {_count(theirs)}"
    if mine.dtype.kind == theirs.dtype.kind == "b":
        return f"{np.count_nonzero(mine != theirs)} of {theirs.size} differ"
    if not np.isfinite(mine).all():
        return f"{np.count_nonzero(~np.isfinite(mine))} of {mine.size} numbers are not finite"
    difference = np.abs(mine.astype(float) - theirs.astype(float))
    largest = float(difference.max(initial=0.0))
    if largest == 0.0:
        return "equal"
    if largest <= EQUAL * max(1.0, float(np.abs(theirs).max(initial=0.0))):
        return f"equal, within {largest:.0e}"
    return f"apart by up to {as_text(largest, 3)} {unit}".rstrip()


def chosen_apart(own: Any, library: Any) -> str:
    """How far two choices are apart, each a list of the indices of what is kept, in a few words for `print`.

    The order is no part of a choice: what counts is how many indices are in only one of the lists.
    """
    mine = np.unique(np.asarray(own))
    theirs = np.unique(np.asarray(library))
    return f"{len(np.setxor1d(mine, theirs))} of {len(np.union1d(mine, theirs))} differ"


def _is_list(values: Array) -> bool:
    """Whether these are integers in one row, such as indices."""
    return values.ndim == 1 and values.dtype.kind in "iu"


def _count(values: Array) -> str:
    """How many results there are, in words."""
    if values.ndim == 0:
        return "one number"
    return "1 result" if len(values) == 1 else f"{len(values)} results"


def _other_form(got: Any, right: Any) -> str:
    """What is different about the form of a result, as the end of a sentence; "" if it can be used.

    A result with another number of rows is a wrong answer that can be drawn. Not so a mask of another length,
    which does not fit the features; no rows at all; and values that are not finite, where the library's all are.
    """
    if got is None:
        return "" if right is None else "returns None"
    if isinstance(right, tuple):
        is_number = isinstance(got, np.ndarray) and got.ndim == 0
        is_several = isinstance(got, (tuple, list, np.ndarray)) and not is_number
        if not is_several or len(got) != len(right):
            return f"does not return {len(right)} results"
        for own_part, right_part in zip(got, right, strict=True):
            fault = _other_form(own_part, right_part)
            if fault:
                return fault
        return ""
    try:
        mine = np.asarray(got)
    except ValueError:
        return "returns rows of different lengths"
    theirs = np.asarray(right)
    if mine.dtype.kind not in "biuf" or theirs.dtype.kind not in "biuf":
        return "" if isinstance(got, type(right)) else f"returns {type(got).__name__}"
    fixed = mine.shape == theirs.shape
    rows_differ = mine.ndim == theirs.ndim > 0 and mine.shape[1:] == theirs.shape[1:]
    if not fixed and (not rows_differ or theirs.dtype.kind == "b"):
        return f"returns the shape {mine.shape}, not {theirs.shape}"
    if theirs.dtype.kind == "b" and mine.dtype.kind != "b":
        return "returns no mask of True and False"
    if theirs.size and not mine.size:
        return "returns no result"
    if np.isfinite(theirs).all() and not np.isfinite(mine).all():
        return "has values that are not finite"
    return ""
