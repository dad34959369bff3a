"""The checker of all exercises: calls of an answer with each case, and messages about mistakes."""

from __future__ import annotations

import copy
import inspect
import os
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array

from .records import answered_by, record
from .results import (
    SHORT,
    Unusable,
    Verdict,
    compared,
    differ,
    holds,
    is_list,
    not_indices,
    outcome,
    result,
    shown,
    unusable,
)
from .stored_answers import NAME as STORED
from .stored_answers import NOT_SAVED, handed_back, is_stub, store_answer

Case = tuple[Any, ...]  # the inputs of a call
LONGEST = 80  # maximal length of an input in a message, characters
TRIES = 3  # different wrong answers in a row, after which the line of code is shown
FLOAT32 = 1e-5  # relative tolerance of results in single precision
STRICT = "COURSE_STRICT"  # environment variable
NO_ANSWER = Verdict(False, "there is no answer: replace the dots.", tried=False)


def strict(on: bool = True) -> None:
    """Let the checks raise `NotRight` for an answer that is not right, in place of showing it.

    A program that gives marks to the cells that end without an error needs this. The environment variable
    COURSE_STRICT=1 does the same.
    """
    os.environ[STRICT] = "1" if on else "0"


class NotRight(AssertionError):
    """A wrong or missing answer, if the checks are strict."""


def decided(verdict: Verdict) -> Verdict:
    """The verdict; if the checks are strict and it is not right, `NotRight` is raised."""
    if not verdict.passed and os.environ.get(STRICT, "0") not in ("", "0"):
        raise NotRight(repr(verdict))
    return verdict


@dataclass(frozen=True)
class Condition:
    """A mistake that is recognised by a test: a function of the first wrong result and of its inputs."""

    test: Callable[..., Any]


def in_order(rows: Array) -> Array:
    """The same numbers or rows, sorted column by column."""
    return np.sort(rows, axis=0) if rows.ndim else rows


def _of_mask(make: Callable[[Array], Any]) -> Callable[[Array], Any]:
    return lambda right: make(right) if right.ndim and np.isin(right, (0, 1)).all() else None


# Slips that are possible in any exercise: the message, and the function from right to wrong results.
SLIPS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "sign": ("{what} has the wrong sign.", np.negative),
    "double": ("{what} is off by a factor of two.", lambda right: 2.0 * right),
    "half": ("{what} is off by a factor of two.", lambda right: 0.5 * right),
    "share": (
        "{what} is a hundredth of the right value: a share instead of per cent?",
        lambda right: right / 100,
    ),
    "radians": ("{what} is in radians; the task asks for degrees.", np.radians),
    "degrees": ("{what} is in degrees; the task asks for radians.", np.degrees),
    "inverse": ("{what} is the inverse of the right value.", lambda right: 1.0 / right),
    "square": ("{what} is the square of the right value.", np.square),
    "one more": ("{what} is too large by one: is the first index zero?", lambda right: right + 1),
    "one less": ("{what} is too small by one: is the first index zero?", lambda right: right - 1),
    "transposed": ("{what} is transposed.", lambda right: np.swapaxes(right, -1, -2)),
    "columns": ("{what} has its columns exchanged.", lambda right: right[:, ::-1]),
    "order": ("these are the right results in another order.", in_order),
    "indices": (
        "these are indices; the task asks for a mask, one True or False for each.",
        _of_mask(np.flatnonzero),
    ),
    "inverted": ("the mask is inverted: good and bad are exchanged.", _of_mask(lambda right: 1 - right)),
}


@dataclass(eq=False, repr=False)
class Exercise:
    """An exercise. A call with an answer, and with further data of the task, returns a `Verdict`.

    An answer is right if its results equal the results of `right` in all cases. A wrong answer gets the first
    message of this list that applies: a mistake with the same results in all cases, a slip, a mistake whose
    test is true, the `hint`. The third different wrong answer in a row also gets the `line` of code.

    Parameters
    ----------
    right : a function of the inputs of a case, a value, or, for a panel, the facts that pass.
    cases : function that returns the inputs of the calls, simple inputs first; only if `right` is a function.
    also : other right answers.
    praise, hint : messages for right answers and for other mistakes. Format fields of `praise` are `got` and
        `right`, which are results of the first case, or names of facts.
    line : the code of a right answer, shown after the third different failure; by default the hint.
    library : functions of the library that an answer must not call.
    mistakes : messages (fields as in `praise`) and their wrong answers. A wrong answer is a function of the
        inputs, a value or a `When`; for a panel, a function of the facts that returns True for the mistake.
    slips : messages by slip, in place of `SLIPS`; if `right` is a value, only these slips are tested.
    parts : names of several results, in the order of the comparison.
    form : function that prepares results for the comparison, such as `in_order`.
    atol, rtol : absolute tolerance in the unit of the result, and relative tolerance.
    """

    right: Any
    cases: Callable[[], list[Case]] | None = None
    _: KW_ONLY
    praise: str
    hint: str = ""
    line: str = ""
    library: tuple[str, ...] = ()
    mistakes: Mapping[str, Any] = field(default_factory=dict)
    slips: Mapping[str, str] = field(default_factory=dict)
    also: tuple[Any, ...] = ()
    parts: tuple[str, ...] = ()
    form: Callable[..., Any] = np.asarray
    atol: float = 1e-9
    rtol: float = 0.0

    def __post_init__(self) -> None:
        self.more = f"In code: `{self.line}`." if self.line else self.hint
        self.failures = set[str]()  # different failures in a row
        self._given = ""  # results of the last answer, as text
        usual = {name: says for name, (says, _) in SLIPS.items()} if self.cases else {}
        self.slips = {**usual, **self.slips}
        self.answers: dict[str, list[Any]] = {}
        self.tests: dict[str, Callable[..., Any]] = {}
        for says, examples in self.mistakes.items():
            several = examples if isinstance(examples, tuple) else (examples,)
            for each in several:
                if isinstance(each, Condition) or isinstance(self.right, Mapping):
                    self.tests[says] = each.test if isinstance(each, Condition) else each
                else:
                    self.answers.setdefault(says, []).append(each)

    def __call__(self, answer: Any, *data: Any) -> Verdict:
        if any(each is None or each is ... for each in (answer, *data)) or is_stub(answer):
            return decided(NO_ANSWER)
        self._given = ""
        verdict = self.grade(answer, *data)
        kept = self._kept(answer) if verdict.passed and self.cases else ""
        record(self, answer, verdict, kept)
        if verdict.passed:
            self.failures.clear()
            return Verdict(True, verdict.message + kept)
        # All answers that cannot be compared count as one.
        self.failures.add("" if isinstance(verdict, Unusable) else self._given)
        told_again = len(self.failures) >= TRIES and self.more != verdict.hint
        return decided(
            replace(verdict, hint=f"{verdict.hint} {self.more}".strip()) if told_again else verdict
        )

    def _kept(self, answer: Any) -> str:
        """Save a right function; a sentence that says where it is, or why it is not saved."""
        if other := answered_by(answer, self):
            name = answer.__name__
            return f" It {NOT_SAVED}: in `{STORED}`, `{name}` is the answer to {other}; give it another name."
        return store_answer(answer, self.grade)

    def grade(self, answer: Any, *data: Any) -> Verdict:
        """The verdict on an answer, without counting failures or saving functions."""
        if self.cases and not callable(answer):
            return Verdict(False, f"expected a function, got {type(answer).__name__}.")
        if self.cases and (name := handed_back(answer, self.library)):
            hint = "write it yourself, and compare both once yours passes."
            return Verdict(False, f"this hands the work to `{name}`.", hint)
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                if isinstance(self.right, Mapping):
                    return self._judge_facts(answer)
                if self.cases is None:
                    return self._judge(lambda *_: answer, [data])
                return self._judge(answer, self.cases())
        except Exception as error:
            return Verdict(False, f"this cannot be judged, {type(error).__name__}: {error}.")

    def _judge_facts(self, answer: Any) -> Verdict:
        """The verdict on the facts of a panel: praise or the first mistake. A missing fact is NaN."""
        if not isinstance(answer, Mapping):
            return Verdict(False, f"expected the facts of a panel, got {type(answer).__name__}.")
        if not answer:
            return Verdict(False, "the panel shows no numbers: choose another sequence.")
        self._given = str(answer)
        facts = defaultdict(lambda: float("nan"), answer)
        for says, test in self.tests.items():
            if test(facts):
                return Verdict(False, says.format_map(facts))
        return Verdict(True, self.praise.format_map(facts))

    def _judge(self, answer: Callable[..., Any], cases: list[Case]) -> Verdict:
        changed: list[int] = []
        got = self._results(answer, cases, changed)
        self._given = str([each.tolist() if isinstance(each, np.ndarray) else each for each in got])
        tables = [self._results(right, cases) for right in (self.right, *self.also)]
        right = max(tables, key=lambda table: self._agreed(got, table))
        first = self._agreed(got, right)
        if first == len(got):
            return self._passed(got, right, len(cases), changed)
        wrong = got[first]
        expected = right[first]
        if isinstance(expected, Unusable):
            return expected
        if self.parts and all(map(self._same, got, [*right[len(cases) :], *right[: len(cases)]])):
            return Verdict(False, f"{' and '.join(self.parts)} are exchanged.")
        part, case = divmod(first, len(cases))
        what = self.parts[part] if self.parts else "the result"
        lengths = {
            says: max(self._agreed(got, self._results(each, cases)) for each in answers)
            for says, answers in self.answers.items()
        }
        mistake = max(lengths, key=lengths.__getitem__, default="")
        if lengths.get(mistake, 0) < (part + 1) * len(cases):  # equal in some cases, perhaps by chance
            mistake = self._slip(got, right, part, len(cases)) or not_indices(wrong, expected)
        if not mistake:
            # A function that may return None can do so in the wrong case.
            missing = wrong is None and any(each is None for each in right)
            if not missing and (reason := unusable(wrong, expected, what, self.hint)):
                return reason
            tests = self.tests.items()
            mistake = next((says for says, test in tests if holds(test, wrong, *cases[case])), "")
        if mistake:
            return Verdict(False, mistake.format_map({"got": wrong, "right": expected, "what": what}))
        constant = first > 0 and not self.parts and all(self._same(each, got[0]) for each in got)
        if constant and expected is not None:
            hint = "compute the result from the inputs."
            return Verdict(False, "the result is the same for all inputs.", hint)
        if wrong is not None and np.isnan(wrong).any():
            return Verdict(False, f"{what} contains NaN.", "is there a division by zero?")
        return Verdict(False, self._difference(wrong, expected, what, cases[case]), self.hint)

    def _slip(self, got: list[Any], right: list[Any], part: int, cases: int) -> str:
        """The message of the slip that explains all results of a part; "" if there is none."""
        here = slice(part * cases, (part + 1) * cases)
        if not all(isinstance(each, np.ndarray) for each in (*got[here], *right[here])):
            return ""
        for name, says in self.slips.items():
            make = SLIPS[name][1]
            mine = map(make, got[here]) if make is in_order else got[here]
            if all(map(self._same, mine, [result(outcome(make, (each,))) for each in right[here]])):
                return says
        return ""

    def _passed(self, got: list[Any], right: list[Any], cases: int, changed: list[int]) -> Verdict:
        """Praise with the results of the first case, unless a call changed its inputs."""
        if changed:
            name = [*inspect.signature(self.right).parameters][changed[0]]
            says = f"the results are right, but the function changes its input `{name}`."
            return Verdict(False, says, "copy the input first.")
        first = [table[::cases] if self.parts else table[0] for table in (got, right)]
        return Verdict(True, self.praise.format(got=first[0], right=first[1]))

    def _results(self, answer: Any, cases: list[Case], changed: list[int] | None = None) -> list[Any]:
        """Results of an answer, ordered by part, then by case: arrays, None or `Unusable`.

        Each call gets a copy of the inputs; `changed` collects the positions of inputs that a call changed.
        """
        rows = []
        for inputs in cases:
            own = copy.deepcopy(inputs) if self.cases else inputs
            rows.append(self._split(outcome(answer, own)))
            if changed is not None:
                changed += [i for i, pair in enumerate(zip(inputs, own, strict=True)) if differ(*pair)]
        return [row[part] for part in range(len(rows[0])) for row in rows]

    def _split(self, data: Any) -> list[Any]:
        """The results of a call: a single result, or a result for each name in `parts`."""
        if not self.parts or data is None or isinstance(data, Unusable):
            return [result(data)] * max(len(self.parts), 1)
        results = list(data) if np.iterable(data) else []
        if len(results) == len(self.parts):
            return [result(each) for each in results]
        names = ", ".join(self.parts)
        message = f"expected {len(self.parts)} results: {names}."
        return [Unusable(False, message, f"`{names}`, in this order.")] * len(self.parts)

    def _agreed(self, got: list[Any], expected: list[Any]) -> int:
        """Number of equal results before the first different result."""
        same = [self._same(*pair) for pair in zip(got, expected, strict=True)]
        return same.index(False) if False in same else len(same)

    def _same(self, got: Any, expected: Any) -> bool:
        if not (isinstance(got, np.ndarray) and isinstance(expected, np.ndarray)):
            return type(got) is type(expected) and bool(got == expected)
        if got.shape == expected.shape or is_list(expected):
            got = self.form(got)
            expected = self.form(expected)
        rtol = self.rtol
        atol = self.atol
        if got.dtype == np.float32:
            rtol = max(rtol, FLOAT32)
            atol = max(atol, FLOAT32 * float(np.abs(expected).max(initial=0.0, where=np.isfinite(expected))))
        return got.shape == expected.shape and np.allclose(got, expected, rtol, atol, equal_nan=True)

    def _difference(self, got: Any, expected: Any, what: str, inputs: Case) -> str:
        """Text with the wrong and the expected result, and with the inputs if they are short."""
        if self.cases is None:
            return f"{what + ' = ' if self.parts else ''}{shown(got)} is wrong."  # the message hides the right value
        if is_list(expected) and (expected.size > SHORT or not shown(got)):
            others = np.setdiff1d(got, expected)
            example = f" (for example {others[0]:g})" if len(others) else ""
            size = "" if got.size == expected.size else f"; expected {expected.size} indices"
            wrong = f"{len(others)} of {got.size} indices wrong{example}"
            right = f"{got.size} right indices" if size else "the right indices at wrong positions"
            return f"{what} has {wrong if len(others) else right}{size}."
        if not (shown(got) and shown(expected)):
            wrong = ~np.isclose(got, expected, self.rtol, self.atol)
            place = tuple(np.argwhere(wrong)[0].tolist())
            numbers = compared(got[place], expected[place])
            return f"{what} has {wrong.sum()} of {wrong.size} numbers wrong: at {list(place)} it {numbers}."
        named_inputs = zip(inspect.signature(self.right).parameters, map(shown, inputs), strict=False)
        text = ", ".join(f"{name} = {value}" for name, value in named_inputs if 0 < len(value) < LONGEST)
        return f"{what} {compared(got, expected)}{text and f' for {text}'}."
