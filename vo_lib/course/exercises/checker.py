"""The checker of all exercises: it runs an answer over the cases and says what is wrong with it."""

from __future__ import annotations

import copy
import html
import inspect
import json
import re
import traceback
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...core.types import Array
from .keep import keep

RIGHT, NOT_YET = "#009E73", "#D55E00"
RIGHT_CLASS, NOT_YET_CLASS = "vo-right", "vo-not-yet"  # tests look for them
SHORT = 6  # so many numbers are shown whole
LIBRARY = str(Path(__file__).parents[2])
Case = tuple[Any, ...]  # the inputs of a call
WORDS = json.loads(Path(__file__).with_name("words.json").read_text(encoding="utf-8"))


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


class Known:
    """A known mistake: answers that make it, each a function of a case's inputs or a value.

    With `when`, a test of (the first wrong result, *inputs), it is told by that, too. Where a panel is read
    `when` is a test of its facts, and the answers are facts that differ from the right ones.
    """

    def __init__(self, *answers: Any, when: Callable[..., Any] | None = None):
        self.answers, self.when = answers, when


def times(right: Callable[..., Any], *factors: Any) -> Callable[..., Any]:
    """A right answer whose result is too large by a factor; its results, by one factor each."""
    if len(factors) == 1:
        return lambda *inputs: factors[0] * right(*inputs)
    return lambda *inputs: [factor * each for factor, each in zip(factors, right(*inputs), strict=True)]


def any_order(indices: Array) -> Array:
    """The form of a result whose order is free."""
    return np.sort(indices, axis=None)


@dataclass(frozen=True)
class Unusable:
    """A result that cannot be compared; two are alike when their kind is, the name of an exception, say."""

    kind: str
    message: str = field(compare=False)
    hint: str = field(default="", compare=False)


class Exercise:
    """An exercise; called with an answer, and what the task needs beside it, it gives the `Verdict`.

    An answer is right when its results are those of `right` in every case. If not, it is compared with the
    known mistakes: the one that gives the same results beyond the first wrong one, and for longest, is named.

    Parameters
    ----------
    name : chapter and exercise, "ch03.angle": its task, praise and hints stand under it in `words.json`.
    right : a function of a case's inputs; a value; or, where a panel is read, facts of one that passes.
    cases : where the answer is a function, gives the inputs of its calls, simple ones first.
    also : other answers that are right.
    parts : names of the results, where there are several; they are judged in this order.
    form : what of a result is compared: `any_order`, say.
    atol, rtol : by how much a result may differ, in its unit and as a share of what is expected.
    mistakes : a `Known` by name; a lone function or value stands for a `Known` of it.
    """

    def __init__(
        self,
        name: str,
        right: Any,
        cases: Callable[[], list[Case]] | None = None,
        *,
        also: tuple[Any, ...] = (),
        parts: tuple[str, ...] = (),
        form: Callable[..., Any] = np.asarray,
        atol: float = 1e-9,
        rtol: float = 0.0,
        **mistakes: Any,
    ):
        chapter, own = name.split(".")
        self.words = WORDS[chapter][own]
        if list(mistakes) != list(self.words["mistakes"]):
            raise ValueError(f"{name}: words.json does not tell the same mistakes in the same order")
        self.right, self.cases, self.also, self.parts, self.form = right, cases, also, parts, form
        self.atol, self.rtol = atol, rtol
        self.mistakes = {key: m if isinstance(m, Known) else Known(m) for key, m in mistakes.items()}
        self.__doc__ = self.words["task"]

    def __call__(self, answer: Any, *given: Any) -> Verdict:
        if any(each is None or each is ... for each in (answer, *given)):
            return Verdict(False, "there is no answer, replace the dots.")
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                if isinstance(self.right, Mapping):
                    return self._judge_facts(answer)
                if self.cases is None:
                    return self._judge(lambda *_: answer, [given])
                if not callable(answer):
                    return Verdict(False, f"expected a function, got {type(answer).__name__}.")
                verdict = self._judge(answer, self.cases())
                return Verdict(True, verdict.message + keep(answer)) if verdict.passed else verdict
        except Exception as error:
            return Verdict(False, f"this cannot be judged, {type(error).__name__}: {error}.")

    def _judge_facts(self, answer: Any) -> Verdict:
        """The first mistake that the facts of a panel show; an unknown fact is NaN."""
        if not isinstance(answer, Mapping):
            return Verdict(False, f"expected the facts of a panel, got {type(answer).__name__}.")
        facts = defaultdict(lambda: float("nan"), answer)
        for name, mistake in self.mistakes.items():
            if mistake.when is not None and mistake.when(facts):
                return self._told(name, facts)
        return Verdict(True, self.words["right"].format_map(facts))

    def _judge(self, answer: Callable[..., Any], cases: list[Case]) -> Verdict:
        changed: list[int] = []
        got = self._results(answer, cases, changed)
        tables = [self._results(right, cases) for right in (self.right, *self.also)]
        right = max(tables, key=lambda table: self._agreed(got, table))
        first = self._agreed(got, right)
        if first == len(got):
            return self._passed(got, right, len(cases), changed)
        if isinstance(right[first], Unusable):
            return Verdict(False, right[first].message)
        facts = {"got": got[first], "right": right[first]}
        named, most = "", first
        for name, mistake in self.mistakes.items():
            for wrong in mistake.answers:
                agreed = self._agreed(got, self._results(wrong, cases))
                if agreed > most:
                    named, most = name, agreed
        if named:
            return self._told(named, facts)
        part, case = divmod(first, len(cases))
        what = self.parts[part] if self.parts else "the result"
        # A function that may give back None can do so in the wrong case.
        if not (got[first] is None and any(result is None for result in right)):
            unusable = _unusable(got[first], right[first], what)
            if unusable:
                return Verdict(False, unusable.message, unusable.hint)
        for name, mistake in self.mistakes.items():
            if mistake.when is not None and _holds(mistake.when, got[first], *cases[case]):
                return self._told(name, facts)
        if got[first] is not None and np.isnan(got[first]).any():
            return Verdict(False, f"{what} contains NaN.", "is something divided by zero?")
        difference = self._difference(got[first], right[first], what, cases[case])
        return Verdict(False, difference, self.words["hint"])

    def _passed(self, got: list[Any], right: list[Any], cases: int, changed: list[int]) -> Verdict:
        """Praise, with the results of the first case; unless a call changed its inputs."""
        if changed:
            name = [*inspect.signature(self.right).parameters][changed[0]]
            says = f"all is right, but the function changes its input `{name}`."
            return Verdict(False, says, "copy it first.")
        first = [table[::cases] if self.parts else table[0] for table in (got, right)]
        return Verdict(True, self.words["right"].format(got=first[0], right=first[1]))

    def _told(self, mistake: str, facts: Mapping[str, Any]) -> Verdict:
        says, hint = self.words["mistakes"][mistake]
        return Verdict(False, says.format_map(facts), hint)

    def _results(self, answer: Any, cases: list[Case], changed: list[int] | None = None) -> list[Any]:
        """What an answer gives, part by part and in a part case by case: arrays, None or `Unusable`.

        Every call has inputs of its own; `changed` gets the numbers of those that a call changed.
        """
        rows = []
        for inputs in cases:
            own = copy.deepcopy(inputs) if self.cases else inputs
            rows.append(self._split(_outcome(answer, own)))
            if changed is not None:
                changed += [i for i, pair in enumerate(zip(inputs, own, strict=True)) if _differ(*pair)]
        return [row[part] for part in range(len(rows[0])) for row in rows]

    def _split(self, outcome: Any) -> list[Any]:
        """The results that a call gave back: one, or one for each name in `parts`."""
        if not self.parts or outcome is None or isinstance(outcome, Unusable):
            return [_result(outcome)] * max(len(self.parts), 1)
        results = list(outcome) if np.iterable(outcome) else []
        if len(results) == len(self.parts):
            return [_result(each) for each in results]
        names = ", ".join(self.parts)
        message = f"the function should give back {len(self.parts)} results: {names}."
        return [Unusable("count", message, f"`return {names}`.")] * len(self.parts)

    def _agreed(self, got: list[Any], expected: list[Any]) -> int:
        """How many results are the same before the first that differs."""
        same = [self._same(*pair) for pair in zip(got, expected, strict=True)]
        return same.index(False) if False in same else len(same)

    def _same(self, got: Any, expected: Any) -> bool:
        if not (isinstance(got, np.ndarray) and isinstance(expected, np.ndarray)):
            return type(got) is type(expected) and bool(got == expected)
        if got.shape == expected.shape or _is_list(expected):
            got, expected = self.form(got), self.form(expected)
        return got.shape == expected.shape and np.allclose(
            got, expected, self.rtol, self.atol, equal_nan=True
        )

    def _difference(self, got: Any, expected: Any, what: str, inputs: Case) -> str:
        """What was got and what was expected, for the inputs of a case as far as they are short."""
        if self.cases is None:
            return f"{_shown(got)} is not it."
        if not (_shown(got) and _shown(expected)):
            wrong = ~np.isclose(got, expected, self.rtol, self.atol)
            place = tuple(np.argwhere(wrong)[0].tolist())
            numbers = f"it is {got[place]:.4g}, expected {expected[place]:.4g}"
            return f"{what} has {wrong.sum()} of {wrong.size} numbers wrong: at {list(place)} {numbers}."
        named = zip(inspect.signature(self.right).parameters, map(_shown, inputs), strict=False)
        told = ", ".join(f"{name} = {value}" for name, value in named if value)
        return f"{what} is {_shown(got)}, expected {_shown(expected)}{told and f' for {told}'}."


def _outcome(answer: Any, inputs: Case) -> Any:
    """What an answer gives for the inputs of a case; a value gives itself."""
    if not callable(answer):
        return answer
    try:
        return answer(*inputs)
    except Exception as error:
        # The innermost line that is the student's own.
        frames = traceback.extract_tb(error.__traceback__)
        own = [f.line for f in frames if "site-packages" not in f.filename and LIBRARY not in f.filename]
        where = f" in the line `{own[-1]}`" if own else ""
        kind = type(error).__name__
        return Unusable(kind, f"the code stopped with {kind}: {error}{where}.")


def _result(outcome: Any) -> Any:
    """A result as an array, a lone number with the shape (); None and `Unusable` as they are."""
    if outcome is None or isinstance(outcome, Unusable):
        return outcome
    try:
        value = np.asarray(outcome)
        if value.dtype.kind not in "iu":
            value = value.astype(np.float64, casting="same_kind" if value.dtype.kind == "c" else "unsafe")
    except (TypeError, ValueError):
        return Unusable("type", f"expected numbers, got {type(outcome).__name__}.")
    return value.reshape(()) if value.size == 1 else value


def _is_list(expected: Array) -> bool:
    """Whether a result is a list of indices, whose length is a part of the answer."""
    return expected.dtype.kind in "iu" and expected.ndim == 1


def _unusable(got: Any, expected: Any, what: str) -> Unusable | None:
    """Why a wrong result cannot even be compared with what is expected."""
    if isinstance(got, Unusable):
        return got
    if got is None:
        says = f"{what} is missing: the function gives back nothing."
        return Unusable("", says, "does it end with `return`?")
    if expected is None or got.shape == expected.shape or _is_list(expected):
        return None
    hint = "a transpose is missing." if got.shape == expected.shape[::-1] else ""
    return Unusable("", f"{what} has shape {got.shape}, expected {expected.shape or 'one number'}.", hint)


def _holds(test: Callable[..., Any], *given: Any) -> bool:
    """Whether a test of a result holds; not where the result is nothing that it can be made on."""
    try:
        return bool(test(*given))
    except (TypeError, ValueError, IndexError):
        return False


def _differ(one: Any, other: Any) -> bool:
    """Whether arrays, lists of them or dictionaries differ; other things are not looked into."""
    if isinstance(one, np.ndarray):
        return not np.array_equal(one, other, equal_nan=True)
    if isinstance(one, (list, tuple)):
        return len(one) != len(other) or any(map(_differ, one, other))
    return isinstance(one, dict) and bool(one != other)


def _shown(value: Any) -> str:
    """A number, a short array or a list of indices as text; else nothing."""
    if isinstance(value, np.ndarray) and value.ndim:
        short = value.size <= SHORT or _is_list(value)
        text = np.array2string(value, separator=", ", formatter={"all": "{:.4g}".format})
        return " ".join(text.split()) if short else ""
    if isinstance(value, (int, float, np.number, np.ndarray)):
        return f"{value:.5g}"
    return str(value) if value is None or isinstance(value, dict) else ""
