"""The checker of all exercises: it runs an answer over the cases and says what is wrong with it."""

from __future__ import annotations

import copy
import inspect
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array

from .keep import handed_back, is_stub, keep
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

Case = tuple[Any, ...]  # the inputs of a call
LONGEST = 80  # characters of an input that a message tells
TRIES = 3  # different wrong answers before the line of code is told
FLOAT32 = 1e-5  # share by which results of single precision may differ
NO_ANSWER = Verdict(False, "there is no answer, replace the dots.", tried=False)


@dataclass(frozen=True)
class When:
    """A mistake that is told by a test of (the first wrong result, *inputs)."""

    test: Callable[..., Any]


def in_order(rows: Array) -> Array:
    """The same numbers or rows, sorted column by column."""
    return np.sort(rows, axis=0) if rows.ndim else rows


def _of_mask(make: Callable[[Array], Any]) -> Callable[[Array], Any]:
    return lambda right: make(right) if right.ndim and np.isin(right, (0, 1)).all() else None


# Slips that any exercise may be answered with: words, and what a right result becomes.
SLIPS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "sign": ("{what} has the wrong sign.", np.negative),
    "double": ("{what} is off by a factor of two.", lambda right: 2.0 * right),
    "half": ("{what} is off by a factor of two.", lambda right: 0.5 * right),
    "share": (
        "{what} is a hundredth of what is asked for: a share, not per cent?",
        lambda right: right / 100,
    ),
    "radians": ("{what} is in radians; degrees are asked for.", np.radians),
    "degrees": ("{what} is in degrees; radians are asked for.", np.degrees),
    "inverse": ("{what} is one divided by what is asked for.", lambda right: 1.0 / right),
    "square": ("{what} is the square of what is asked for.", np.square),
    "one more": ("{what} is too large by one: where does counting begin?", lambda right: right + 1),
    "one less": ("{what} is too small by one: where does counting begin?", lambda right: right - 1),
    "transposed": ("{what} is transposed.", lambda right: np.swapaxes(right, -1, -2)),
    "columns": ("{what} has its columns exchanged.", lambda right: right[:, ::-1]),
    "order": ("these are the right ones in another order.", in_order),
    "indices": (
        "these are indices; a mask was asked for, one True or False for each.",
        _of_mask(np.flatnonzero),
    ),
    "inverted": ("the mask is upside down: good and bad are exchanged.", _of_mask(lambda right: 1 - right)),
}


def any_order(indices: Array) -> Array:
    """The form of a result whose order is free."""
    return np.sort(indices, axis=None) if indices.ndim < 2 else indices


@dataclass(eq=False, repr=False)
class Exercise:
    """An exercise; called with an answer, and what the task needs beside it, it gives the `Verdict`.

    An answer is right when its results are those of `right` in every case. If not, it is compared with the
    known mistakes: the one that gives the same results beyond the first wrong one, and for longest, is named;
    else a slip, and else a mistake whose test holds. A failure is told the idea (the mistake or the `hint`); the
    third different wrong answer in a row also the `line` of code.

    Parameters
    ----------
    right : a function of a case's inputs; a value; or, where a panel is read, facts of one that passes.
    cases : where the answer is a function, gives the inputs of its calls, simple ones first.
    also : other answers that are right.
    task, praise, hint : what is to be done; what is said of a right answer, and of one that is wrong in a way
        not known. Of `got` and `right`, results of the first case, or of facts, by their names.
    line : what is to be written, told from the third different failure on; the hint where there is none.
    library : the library's functions that an answer must not call.
    mistakes : by the words they are told in, of `got` and `right` or of facts: answers that make the mistake,
        functions of a case's inputs or values, one or several, and `When`. Of facts, a test each.
    slips : words for slips of `SLIPS`, by name, that say more than the usual ones. Of a value only these are told.
    parts : names of the results, where there are several; they are judged in this order.
    form : what of a result is compared: `any_order`, say.
    atol, rtol : by how much a result may differ, in its unit and as a share of what is expected.
    """

    right: Any
    cases: Callable[[], list[Case]] | None = None
    _: KW_ONLY
    task: str
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
        self.__doc__ = self.task
        self.more = f"In code: `{self.line}`." if self.line else self.hint
        self.failures = set[str]()  # the different ones in a row
        self._given = ""  # results of the last answer, as text
        usual = {name: says for name, (says, _) in SLIPS.items()} if self.cases else {}
        self.slips = {**usual, **self.slips}
        self.answers: dict[str, list[Any]] = {}
        self.tests: dict[str, Callable[..., Any]] = {}
        for says, known in self.mistakes.items():
            for each in known if isinstance(known, tuple) else (known,):
                if isinstance(each, When) or isinstance(self.right, Mapping):
                    self.tests[says] = each.test if isinstance(each, When) else each
                else:
                    self.answers.setdefault(says, []).append(each)

    def __call__(self, answer: Any, *given: Any) -> Verdict:
        if any(each is None or each is ... for each in (answer, *given)) or is_stub(answer):
            return NO_ANSWER
        self._given = ""
        verdict = self.judge(answer, *given)
        if verdict.passed:
            self.failures.clear()
            return Verdict(True, verdict.message + keep(answer, self.judge)) if self.cases else verdict
        # Answers that cannot be compared are of one kind.
        self.failures.add("" if isinstance(verdict, Unusable) else self._given)
        told_again = len(self.failures) >= TRIES and self.more != verdict.hint
        return replace(verdict, hint=f"{verdict.hint} {self.more}".strip()) if told_again else verdict

    def judge(self, answer: Any, *given: Any) -> Verdict:
        """The verdict on an answer; no failure is counted, and nothing is kept."""
        if self.cases and not callable(answer):
            return Verdict(False, f"expected a function, got {type(answer).__name__}.")
        if self.cases and (name := handed_back(answer, self.library)):
            hint = "writing it yourself is the point here; compare the two once yours passes."
            return Verdict(False, f"this hands the work to `{name}`.", hint)
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                if isinstance(self.right, Mapping):
                    return self._judge_facts(answer)
                if self.cases is None:
                    return self._judge(lambda *_: answer, [given])
                return self._judge(answer, self.cases())
        except Exception as error:
            return Verdict(False, f"this cannot be judged, {type(error).__name__}: {error}.")

    def _judge_facts(self, answer: Any) -> Verdict:
        """The first mistake that the facts of a panel show; an unknown fact is NaN."""
        if not isinstance(answer, Mapping):
            return Verdict(False, f"expected the facts of a panel, got {type(answer).__name__}.")
        if not answer:
            return Verdict(False, "the panel shows no numbers: choose a sequence that opens.")
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
        wrong, expected = got[first], right[first]
        if isinstance(expected, Unusable):
            return expected
        if self.parts and all(map(self._same, got, [*right[len(cases) :], *right[: len(cases)]])):
            return Verdict(False, f"{' and '.join(self.parts)} have changed places.")
        part, case = divmod(first, len(cases))
        what = self.parts[part] if self.parts else "the result"
        lengths = {
            says: max(self._agreed(got, self._results(each, cases)) for each in answers)
            for says, answers in self.answers.items()
        }
        named = max(lengths, key=lengths.__getitem__, default="")
        if lengths.get(named, 0) < (part + 1) * len(cases):  # what explains the whole part comes first
            partly = named if lengths.get(named, 0) > first else not_indices(wrong, expected)
            named = self._slip(got, right, part, len(cases)) or partly
        if not named:
            # A function that may give back None can do so in the wrong case.
            missing = wrong is None and any(each is None for each in right)
            if not missing and (reason := unusable(wrong, expected, what, self.hint)):
                return reason
            tests = self.tests.items()
            named = next((says for says, test in tests if holds(test, wrong, *cases[case])), "")
        if named:
            return Verdict(False, named.format_map({"got": wrong, "right": expected, "what": what}))
        constant = first > 0 and not self.parts and all(self._same(each, got[0]) for each in got)
        if constant and expected is not None:
            return Verdict(False, "the result is the same whatever the inputs are.", "compute it from them.")
        if wrong is not None and np.isnan(wrong).any():
            return Verdict(False, f"{what} contains NaN.", "is something divided by zero?")
        return Verdict(False, self._difference(wrong, expected, what, cases[case]), self.hint)

    def _slip(self, got: list[Any], right: list[Any], part: int, cases: int) -> str:
        """Words for what has been made of all right results of a part; "" where it is nothing known."""
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
        """Praise, with the results of the first case; unless a call changed its inputs."""
        if changed:
            name = [*inspect.signature(self.right).parameters][changed[0]]
            says = f"all is right, but the function changes its input `{name}`."
            return Verdict(False, says, "copy it first.")
        first = [table[::cases] if self.parts else table[0] for table in (got, right)]
        return Verdict(True, self.praise.format(got=first[0], right=first[1]))

    def _results(self, answer: Any, cases: list[Case], changed: list[int] | None = None) -> list[Any]:
        """What an answer gives, part by part and in a part case by case: arrays, None or `Unusable`.

        Every call has inputs of its own; `changed` gets the numbers of those that a call changed.
        """
        rows = []
        for inputs in cases:
            own = copy.deepcopy(inputs) if self.cases else inputs
            rows.append(self._split(outcome(answer, own)))
            if changed is not None:
                changed += [i for i, pair in enumerate(zip(inputs, own, strict=True)) if differ(*pair)]
        return [row[part] for part in range(len(rows[0])) for row in rows]

    def _split(self, given: Any) -> list[Any]:
        """The results that a call gave back: one, or one for each name in `parts`."""
        if not self.parts or given is None or isinstance(given, Unusable):
            return [result(given)] * max(len(self.parts), 1)
        results = list(given) if np.iterable(given) else []
        if len(results) == len(self.parts):
            return [result(each) for each in results]
        names = ", ".join(self.parts)
        message = f"the function should give back {len(self.parts)} results: {names}."
        return [Unusable(False, message, f"`return {names}`.")] * len(self.parts)

    def _agreed(self, got: list[Any], expected: list[Any]) -> int:
        """How many results are the same before the first that differs."""
        same = [self._same(*pair) for pair in zip(got, expected, strict=True)]
        return same.index(False) if False in same else len(same)

    def _same(self, got: Any, expected: Any) -> bool:
        if not (isinstance(got, np.ndarray) and isinstance(expected, np.ndarray)):
            return type(got) is type(expected) and bool(got == expected)
        if got.shape == expected.shape or is_list(expected):
            got, expected = self.form(got), self.form(expected)
        rtol, atol = self.rtol, self.atol
        if got.dtype == np.float32:
            rtol = max(rtol, FLOAT32)
            atol = max(atol, FLOAT32 * float(np.abs(expected).max(initial=0.0, where=np.isfinite(expected))))
        return got.shape == expected.shape and np.allclose(got, expected, rtol, atol, equal_nan=True)

    def _difference(self, got: Any, expected: Any, what: str, inputs: Case) -> str:
        """What was got and what was expected, for the inputs of a case as far as they are short."""
        if self.cases is None:
            return f"{shown(got)} is not it."  # the right value stays unsaid
        if is_list(expected) and (expected.size > SHORT or not shown(got)):
            others = np.setdiff1d(got, expected)
            named = f" ({others[0]:g} for one)" if len(others) else ""
            strangers = f"{len(others)} of them do not belong there{named}"
            return f"{what} has {got.size} indices, expected {expected.size}; {strangers}."
        if not (shown(got) and shown(expected)):
            wrong = ~np.isclose(got, expected, self.rtol, self.atol)
            place = tuple(np.argwhere(wrong)[0].tolist())
            numbers = compared(got[place], expected[place])
            return f"{what} has {wrong.sum()} of {wrong.size} numbers wrong: at {list(place)} it {numbers}."
        named_inputs = zip(inspect.signature(self.right).parameters, map(shown, inputs), strict=False)
        told = ", ".join(f"{name} = {value}" for name, value in named_inputs if 0 < len(value) < LONGEST)
        return f"{what} {compared(got, expected)}{told and f' for {told}'}."
