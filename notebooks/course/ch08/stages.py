"""Chapter 8: a call of one stage in the loop, with the frame and the reason if the stage fails."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from vo_lib.errors import DataError
from vo_lib.geometry.types import Array

from ..results import Unusable, result_of
from ..tasks import functions_to_write
from .limits import TooLong, within

Value = TypeVar("Value")

LIMIT_S = 20.0  # of a check, and of a call in the loop

Shape = tuple[int | None, ...]  # None: any length

# The shapes of the results of each stage of the loop, from its inputs.
SHAPES: Mapping[str, Callable[..., list[Shape]]] = {
    "keep_outside": lambda uv_p, *_: [np.shape(uv_p)[:1]],
    "buckets": lambda *_: [(None,)],
    "solve_five": lambda *_: [(None, 3, 3)],
    "epipolar_distance": lambda E, x_p, x_c: [np.shape(x_p)[:1]],
    "truncated_error": lambda *_: [()],
    "select": lambda *_: [()],
    "four_motions": lambda *_: [(4, 3, 4)],
    "choose_motion": lambda *_: [(3, 4)],
    "rows_of_one": lambda *_: [(8, 6), (8,)],
    "depth_weights": lambda Z: [np.shape(Z)],
    "translation_of_all": lambda *_: [(3,)],
    "weights": lambda r, s: [np.shape(r)],
    "chain": lambda motions: [(len(motions) + 1, 4, 4)],
    "all_errors": lambda *_: [(), ()],
}
# The shapes of the inputs of each stage, in the order of its parameters. A letter is a length, the same length for
# each input of a call; `MAY_BE_NONE` lists the letters of which there may be none at all. F: matches of a frame as they
# come or, for `buckets`, outside the boxes; B and C: boxes of the previous and of the current frame; N: matches that
# are used, all of them or the inliers; M: candidates; K: motions; T: poses.
INPUTS: Mapping[str, tuple[tuple[str | int, ...], ...]] = {
    "keep_outside": (("F", 2), ("F", 2), ("B", 4), ("C", 4)),
    "buckets": (("F", 2), ("F",), ("F",), (), ()),
    "solve_five": ((5, 2), (5, 2)),
    "epipolar_distance": ((3, 3), ("N", 2), ("N", 2)),
    "truncated_error": (("N",), ()),
    "select": (("M", 3, 3), ("M",), ("M",), (9,), ()),
    "four_motions": ((3, 3),),
    "choose_motion": ((4, 3, 4), ("N", 2), ("N", 2)),
    "rows_of_one": ((2,), (2,), (2,), (2,), (3, 3), ()),
    "depth_weights": (("N",),),
    "translation_of_all": (("N", 8, 3), ("N", 8, 3), ("N", 8), ("N",)),
    "weights": (("N",), ()),
    "chain": (("K", 4, 4),),
    "all_errors": (("T", 4, 4), ("T", 4, 4)),
}
MAY_BE_NONE = ("F", "B", "C", "K")
MASKS = ("keep_outside",)
INDICES = ("buckets", "select")  # among the entries of their first input


class StageError(DataError):
    """A stage that failed in the loop, or got a wrong input: the message names the frame, the stage, the reason."""

    def _render_traceback_(self) -> list[str]:
        """What a notebook shows: the message alone, as the lines of the course say nothing about the fault."""
        return [f"{type(self).__name__}: {self}"]


class Endless(Unusable):
    """The result of a call that was ended from outside, as it took too long, or that tried to end Python."""


def call_stage(
    name: str,
    whose: str,
    frame: int | None,
    function: Callable[..., Any],
    *inputs: Any,
    limit_s: float = LIMIT_S,
) -> Any:
    """The result of a stage as an array, or a pair of arrays, of the expected form.

    whose : "yours", or anything else for the library's function. frame : None outside the frames.

    Raises `StageError` for an exception, no end within `limit_s`, a result of another form, and numbers that
    are not finite.
    """
    given = result_within(limit_s, function, inputs)
    result = None
    if isinstance(given, Unusable):
        reason = given.message
    else:
        result, reason = in_form(name, given, inputs)
    if not reason:
        return result
    number, _ = functions_to_write()[name]
    owner = "your" if whose == "yours" else "the library's"
    when = "after the last frame" if frame is None else f"frame {frame}"
    advice = f"correct exercise {number}, or take the library's: own.join({name}=None)"
    if whose != "yours":
        advice = "look at the stages and lines before it, from which its inputs come"
    raise StageError(f"{when}: {owner} `{name}` {reason.rstrip('.')}. Remedy: {advice}")


def require_inputs(
    name: str, inputs: tuple[Any, ...], frame: int | None, before: str, sets: bool = False
) -> None:
    """Raise `StageError` if an input of a stage is not finite or has another shape than the stage is made for.

    The results of all stages are checked (`call_stage`), so such an input was made by the lines between two
    stages. before : the stage that was called before this one in the frame; "" if none was.
    sets : whether the inputs are those of several calls, with a first axis for the calls.
    """
    lengths = dict[str | int, int]()
    for (argument, value), shape in zip(named_inputs(name, inputs).items(), INPUTS[name], strict=False):
        wanted = ("S", *shape) if sets else shape
        if reason := _unfit(value, wanted, lengths):
            when = "after the last frame" if frame is None else f"frame {frame}"
            where = f"between `{before}` and `{name}`" if before else f"before `{name}`"
            raise StageError(
                f"{when}: the lines of the loop {where} make a wrong `{argument}`: it {reason}. Remedy: correct "
                "these lines; no stage is to blame"
            )


def _unfit(value: Any, wanted: tuple[str | int, ...], lengths: dict[str | int, int]) -> str:
    """Why a stage cannot use an input, as the end of a sentence; "" if it can. `lengths` are those of the call."""
    try:
        array = np.asarray(value)
    except ValueError:
        return "has rows of different lengths"
    if array.dtype.kind not in "biuf":
        return f"has no real numbers, but {'None' if value is None else type(value).__name__}"
    fits = array.ndim == len(wanted)
    for got, length in zip(array.shape, wanted, strict=False):
        if not fits:
            break
        if isinstance(length, str):
            length = lengths.setdefault(length, got)  # the first input with this letter says how long it is
        fits = got == length
    if not fits:
        expected = tuple(lengths.get(length, length) for length in wanted)
        return f"has the shape {array.shape}, not {_shape_in_words(expected)}"
    if array.size == 0 and not set(wanted) & set(MAY_BE_NONE):
        return "is empty: no feature is left"
    wrong = np.count_nonzero(~np.isfinite(array))
    return f"has NaN or infinity in {wrong} of {array.size} numbers" if wrong else ""


def _shape_in_words(shape: tuple[str | int, ...]) -> str:
    """A shape as numpy writes it, such as (N, 3) or (5,); "that of one number" for ()."""
    if not shape:
        return "that of one number"
    if len(shape) == 1:
        return f"({shape[0]},)"
    return f"({', '.join(map(str, shape))})"


def result_within(limit_s: float, function: Callable[..., Any], inputs: tuple[Any, ...]) -> Any:
    """The result of a call; `Unusable`, with the reason as the end of a sentence, if it fails or never ends."""
    given = ended_within(limit_s, result_of, function, inputs)
    if isinstance(given, Unusable) and not isinstance(given, Endless):
        return Unusable(False, given.message.replace("the code stopped", "stopped", 1))
    return given


def ended_within(limit_s: float, function: Callable[..., Value], *inputs: Any) -> Value | Endless:
    """The result of a call; `Endless`, with the reason as the end of a sentence, if it does not end by itself."""
    try:
        return within(limit_s, function, *inputs)
    except TooLong as error:
        return Endless(False, too_long(limit_s, error))
    except SystemExit:
        return Endless(False, "calls `exit`")


def too_long(limit_s: float, error: TooLong) -> str:
    """What is wrong with a function that was interrupted, as the end of a sentence."""
    if error.swallowed:
        why = "its `except:` catches even the interruption: write which error it is for, as in `except ValueError:`"
    else:
        why = "is there a loop without an end?"
    return f"does not end within {limit_s:g} s ({why})"


def in_form(name: str, given: Any, inputs: tuple[Any, ...]) -> tuple[Any, str]:
    """The result of a stage as arrays, and what is wrong with it; "" if it can be used."""
    shapes = SHAPES[name](*inputs)
    if given is None:
        return None, "returns None"
    parts = [given]
    if len(shapes) > 1:
        parts = list(given) if np.iterable(given) else []
    if len(parts) != len(shapes):
        return None, f"does not return {len(shapes)} results"
    arrays = []
    for part, shape in zip(parts, shapes, strict=True):
        array, reason = _as_array(part, shape)
        if reason:
            return None, reason
        arrays.append(array)
    if len(arrays) > 1:
        return tuple(arrays), ""
    (only,) = arrays
    if name in MASKS:
        return only.astype(bool), ""
    if name in INDICES:
        count = len(inputs[0])
        wrong = (only < 0) | (only >= count) | (only % 1 != 0)
        if wrong.any():
            return None, f"returns {only[wrong][0]:g}, which is no index of {count} entries"
        return only.astype(np.intp), ""
    return only, ""


def _as_array(part: Any, shape: Shape) -> tuple[Array, str]:
    """A result as an array of a shape, and what is wrong with it; "" if it can be used."""
    nothing = np.zeros(0)
    try:
        array = np.asarray(sorted(part) if isinstance(part, (set, frozenset)) else part)
    except ValueError:
        return nothing, "returns rows of different lengths"
    if array.dtype.kind not in "biuf":
        return nothing, f"returns no real numbers, but {type(part).__name__}"
    may_be_empty = None in shape or 0 in shape
    if array.size == 0 and may_be_empty:
        return array.reshape([0 if length is None else length for length in shape]), ""
    if shape == () and array.size == 1:
        array = array.reshape(())
    fits = array.ndim == len(shape) and all(
        want in (None, got) for got, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if length is None else str(length) for length in shape)
        return nothing, f"returns the shape {array.shape}, not ({wanted})"
    wrong = np.count_nonzero(~np.isfinite(array))
    if wrong:
        return nothing, f"returns NaN or infinity in {wrong} of {array.size} numbers"
    return array, ""


def named_inputs(name: str, inputs: tuple[Any, ...]) -> dict[str, Any]:
    """The inputs of a stage by the names of the exercise's parameters."""
    return dict(zip(_input_names(name), inputs, strict=False))


@functools.cache
def _input_names(name: str) -> tuple[str, ...]:
    """Names of the parameters of an exercise's function."""
    return tuple(inspect.signature(functions_to_write()[name][1].right).parameters)
