"""The checker of all exercises: calls of an answer with each case, and messages about mistakes."""

from __future__ import annotations

import copy
import inspect
import itertools
import os
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array

from .answer_log import answered_by, record
from .results import (
    SHORT,
    Unusable,
    Verdict,
    as_array,
    as_text,
    comparison,
    differ,
    holds,
    is_index_list,
    result_of,
    why_not_indices,
    why_unusable,
)
from .stored_answers import NAME as STORED
from .stored_answers import NOT_SAVED, is_stub, library_call_in, store_answer

Case = tuple[Any, ...]  # the inputs of a call
Results = list[list[Any]]  # of an answer, [part][case]: arrays, None or `Unusable`
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


def raise_if_strict(verdict: Verdict) -> Verdict:
    """The same verdict; if the checks are strict and it is not right, `NotRight` is raised."""
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


def _only_of_masks(make: Callable[[Array], Any]) -> Callable[[Array], Any]:
    """The function `make` for results that are masks; it returns None for all others."""

    def changed(right: Array) -> Any:
        is_mask = right.ndim > 0 and np.isin(right, (0, 1)).all()
        return make(right) if is_mask else None

    return changed


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
        _only_of_masks(np.flatnonzero),
    ),
    "inverted": (
        "the mask is inverted: good and bad are exchanged.",
        _only_of_masks(lambda right: 1 - right),
    ),
}


@dataclass(frozen=True, eq=False)
class _WrongResult:
    """The first result of an answer that is not right.

    what : its name in a message. inputs : of its case. got, expected : an array, None or `Unusable`.
    """

    what: str
    inputs: Case
    got: Any
    expected: Any


@dataclass(eq=False, repr=False)
class Exercise:
    """An exercise. A call with an answer, and with further data of the task, returns a `Verdict`.

    An answer is right if its results equal the results of `right` in all cases. A wrong answer gets the first
    message of this list that applies: the parts are exchanged; a mistake with the same results up to the end of
    the first wrong part; a slip; a result that is no list of indices, where the task asks for one; a result
    that cannot be compared, such as one of another shape; a mistake whose test is true; the result is the same
    for all inputs; NaN; the difference, with the `hint`. The third different wrong answer in a row also gets
    the `line` of code.

    Parameters
    ----------
    right : what a right answer returns: a function of the inputs of a case, or a value. For a panel, an example
        of facts that pass, which only tests use: facts pass if no mistake is true.
    cases : function that returns the inputs of the calls, simple inputs first; given if the answer is a function.
        Without `cases`, the answer is a value, and the further data of the call are the inputs of the only case:
        then `right` and wrong answers may be functions of these data (of nothing: a value that takes long).
    also : other right answers.
    praise, hint : messages for right answers and for other mistakes. Format fields of `praise` are `got` and
        `right`, which are results of the first case, or names of facts.
    line : the code of a right answer, shown after the third different failure; by default the hint.
    library : functions of the library that an answer must not call.
    mistakes : messages and their wrong answers. Format fields are `got` and `right`, the first wrong result and
        the right one for it, and `what`, its name; for a panel, names of facts. A wrong answer is a function of
        the inputs, a value or a `Condition`; for a panel, a function of the facts that returns True for the
        mistake.
    slips : messages by slip, in place of `SLIPS`; without `cases`, only these slips are tested.
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
        self.late_hint = f"In code: `{self.line}`." if self.line else self.hint
        self.failures = set[str]()  # the results of different failures in a row, as text
        if self.cases:
            usual = {name: says for name, (says, _) in SLIPS.items()}
            self.slips = {**usual, **self.slips}
        # The mistakes by message: those that are wrong answers, and those that are recognised by a test.
        self.answers: dict[str, list[Any]] = {}
        self.tests: dict[str, list[Callable[..., Any]]] = {}
        for says, examples in self.mistakes.items():
            several = examples if isinstance(examples, tuple) else (examples,)
            for each in several:
                if isinstance(each, Condition) or isinstance(self.right, Mapping):
                    test = each.test if isinstance(each, Condition) else each
                    self.tests.setdefault(says, []).append(test)
                else:
                    self.answers.setdefault(says, []).append(each)

    def __call__(self, answer: Any, *data: Any) -> Verdict:
        if any(each is None or each is ... for each in (answer, *data)) or is_stub(answer):
            return raise_if_strict(NO_ANSWER)
        verdict, results = self._graded(answer, *data)
        saved = self._save(answer) if verdict.passed and self.cases else ""
        record(self, answer, verdict, saved)
        if verdict.passed:
            self.failures.clear()
            return Verdict(True, verdict.message + saved)
        # All answers that cannot be compared count as one.
        self.failures.add("" if isinstance(verdict, Unusable) else results)
        if len(self.failures) >= TRIES and self.late_hint != verdict.hint:
            verdict = replace(verdict, hint=f"{verdict.hint} {self.late_hint}".strip())
        return raise_if_strict(verdict)

    def _save(self, answer: Any) -> str:
        """Save a right function; return a sentence that says where it is, or why it is not saved."""
        if other := answered_by(answer, self):
            name = answer.__name__
            return f" It {NOT_SAVED}: in `{STORED}`, `{name}` is the answer to {other}; give it another name."
        return store_answer(answer, self.grade)

    def grade(self, answer: Any, *data: Any) -> Verdict:
        """The verdict on an answer, without counting failures or saving functions."""
        verdict, _ = self._graded(answer, *data)
        return verdict

    def _graded(self, answer: Any, *data: Any) -> tuple[Verdict, str]:
        """The verdict on an answer, and its results as text, so that different failures can be counted."""
        if self.cases and not callable(answer):
            return Verdict(False, f"expected a function, got {type(answer).__name__}."), ""
        if self.cases and (name := library_call_in(answer, self.library)):
            hint = "write it yourself, and compare both once yours passes."
            return Verdict(False, f"this hands the work to `{name}`.", hint), ""
        as_given = ""
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                if isinstance(self.right, Mapping):
                    as_given = str(answer)
                    return self._judge_facts(answer), as_given
                function = answer if self.cases else _always(answer)
                cases = self.cases() if self.cases else [data]
                got, changed = self._results_and_changes(function, cases)
                given = itertools.chain.from_iterable(got)
                as_given = str([each.tolist() if isinstance(each, np.ndarray) else each for each in given])
                return self._judge(got, cases, changed), as_given
        except Exception as error:
            return Verdict(False, f"this cannot be judged, {type(error).__name__}: {error}."), as_given

    def _judge_facts(self, answer: Any) -> Verdict:
        """The verdict on the facts of a panel: praise or the first mistake. A missing fact is NaN."""
        if not isinstance(answer, Mapping):
            return Verdict(False, f"expected the facts of a panel, got {type(answer).__name__}.")
        if not answer:
            return Verdict(False, "the panel shows no numbers: choose another sequence.")
        facts = defaultdict(lambda: float("nan"), answer)
        for says, tests in self.tests.items():
            if any(test(facts) for test in tests):
                return Verdict(False, says.format_map(facts))
        return Verdict(True, self.praise.format_map(facts))

    def _judge(self, got: Results, cases: list[Case], changed: list[int]) -> Verdict:
        """The verdict on the results of an answer, compared with the nearest of the right answers.

        changed : positions of the inputs that the answer changed.
        """
        tables = [self._results(right, cases) for right in (self.right, *self.also)]
        right = max(tables, key=lambda table: self._agreed(got, table))
        agreed = self._agreed(got, right)
        if agreed == len(got) * len(cases):
            return self._passed(got, right, changed)
        part, case = divmod(agreed, len(cases))
        return self._failed(got, right, part, case, cases)

    def _failed(self, got: Results, right: Results, part: int, case: int, cases: list[Case]) -> Verdict:
        """What is wrong with the results of an answer, of which the first wrong one is `got[part][case]`.

        Mistakes come first that explain all results; then those that can be seen in the wrong result alone.
        """
        what = self.parts[part] if self.parts else "the result"
        wrong = _WrongResult(what, cases[case], got[part][case], right[part][case])
        if isinstance(wrong.expected, Unusable):
            return wrong.expected
        if self.parts and self._are_exchanged(got, right):
            return Verdict(False, f"{' and '.join(self.parts)} are exchanged.")
        mistake = (
            self._known_mistake(got, cases, part)
            or self._slip(got[part], right[part])
            or why_not_indices(wrong.got, wrong.expected)
        )
        if not mistake:
            # A function that may return None can do so in the wrong case.
            may_be_none = any(each is None for each in itertools.chain.from_iterable(right))
            missing = wrong.got is None and may_be_none
            if not missing and (reason := why_unusable(wrong.got, wrong.expected, what, self.hint)):
                return reason
            mistake = self._tested_mistake(wrong)
        if mistake:
            words = {"got": wrong.got, "right": wrong.expected, "what": what}
            return Verdict(False, mistake.format_map(words))
        is_constant = case > 0 and not self.parts and all(self._same(each, got[0][0]) for each in got[0])
        if is_constant and wrong.expected is not None:
            hint = "compute the result from the inputs."
            return Verdict(False, "the result is the same for all inputs.", hint)
        if wrong.got is not None and np.isnan(wrong.got).any():
            return Verdict(False, f"{what} contains NaN.", "is there a division by zero?")
        return Verdict(False, self._difference(wrong), self.hint)

    def _are_exchanged(self, got: Results, right: Results) -> bool:
        """Whether the first of the parts has the results of the second, and so on."""
        exchanged = [*right[1:], right[0]]
        return self._agreed(got, exchanged) == sum(map(len, got))

    def _known_mistake(self, got: Results, cases: list[Case], part: int) -> str:
        """The message of the wrong answer with the same results up to the end of a part; "" if there is none.

        Results that are equal only in some cases of the part may be equal by chance.
        """
        lengths = dict[str, int]()
        for says, answers in self.answers.items():
            for each in answers:
                if self._explains(each, got, cases, part):
                    length = self._agreed(got, self._results(each, cases))
                    lengths[says] = max(length, lengths.get(says, 0))
        return max(lengths, key=lengths.__getitem__, default="")

    def _explains(self, wrong_answer: Any, got: Results, cases: list[Case], part: int) -> bool:
        """Whether a wrong answer has these results up to the end of a part.

        Most wrong answers differ in the first case; then they are not called with the other cases.
        """
        for case, inputs in enumerate(cases):
            results = self._results(wrong_answer, [inputs])
            for of_part, expected in zip(got[: part + 1], results, strict=False):
                if not self._same(of_part[case], expected[0]):
                    return False
        return True

    def _tested_mistake(self, wrong: _WrongResult) -> str:
        """The message of the first mistake whose test is true; "" if there is none."""
        for says, tests in self.tests.items():
            if any(holds(test, wrong.got, *wrong.inputs) for test in tests):
                return says
        return ""

    def _slip(self, got: list[Any], right: list[Any]) -> str:
        """The message of the slip that explains the results of a part in all cases; "" if there is none."""
        if not all(isinstance(each, np.ndarray) for each in (*got, *right)):
            return ""
        for name, says in self.slips.items():
            make = SLIPS[name][1]
            slipped = [as_array(result_of(make, (each,))) for each in right]
            # Results in another order are compared when both are sorted.
            mine = map(make, got) if make is in_order else got
            if all(map(self._same, mine, slipped)):
                return says
        return ""

    def _passed(self, got: Results, right: Results, changed: list[int]) -> Verdict:
        """Praise with the results of the first case, unless a call changed its inputs."""
        if changed:
            names = list(inspect.signature(self.right).parameters)
            name = names[changed[0]]
            says = f"the results are right, but the function changes its input `{name}`."
            return Verdict(False, says, "copy the input first.")
        if self.parts:
            got_first = [of_part[0] for of_part in got]
            right_first = [of_part[0] for of_part in right]
            return Verdict(True, self.praise.format(got=got_first, right=right_first))
        return Verdict(True, self.praise.format(got=got[0][0], right=right[0][0]))

    def _results(self, answer: Any, cases: list[Case]) -> Results:
        """Results of an answer in all cases."""
        results, _ = self._results_and_changes(answer, cases)
        return results

    def _results_and_changes(self, answer: Any, cases: list[Case]) -> tuple[Results, list[int]]:
        """The results as in `_results`, and the positions of the inputs that a call changed.

        Each call gets a copy of its inputs.
        """
        by_case = []
        changed = []
        for inputs in cases:
            own = copy.deepcopy(inputs) if self.cases else inputs
            by_case.append(self._split(result_of(answer, own)))
            for position, (before, after) in enumerate(zip(inputs, own, strict=True)):
                if differ(before, after):
                    changed.append(position)
        by_part = [list(of_part) for of_part in zip(*by_case, strict=True)]
        return by_part, changed

    def _split(self, data: Any) -> list[Any]:
        """The results of a call: a single result, or a result for each name in `parts`."""
        if not self.parts or data is None or isinstance(data, Unusable):
            return [as_array(data)] * max(len(self.parts), 1)
        results = list(data) if np.iterable(data) else []
        if len(results) == len(self.parts):
            return [as_array(each) for each in results]
        names = ", ".join(self.parts)
        message = f"expected {len(self.parts)} results: {names}."
        return [Unusable(False, message, f"`{names}`, in this order.")] * len(self.parts)

    def _agreed(self, got: Results, expected: Results) -> int:
        """Number of equal results before the first different result, part by part."""
        same = list[bool]()
        for got_part, expected_part in zip(got, expected, strict=True):
            same += map(self._same, got_part, expected_part)
        return same.index(False) if False in same else len(same)

    def _same(self, got: Any, expected: Any) -> bool:
        if not (isinstance(got, np.ndarray) and isinstance(expected, np.ndarray)):
            return type(got) is type(expected) and bool(got == expected)
        if got.shape == expected.shape or is_index_list(expected):
            got = self.form(got)
            expected = self.form(expected)
        rtol = self.rtol
        atol = self.atol
        if got.dtype == np.float32:
            rtol = max(rtol, FLOAT32)
            atol = max(atol, FLOAT32 * float(np.abs(expected).max(initial=0.0, where=np.isfinite(expected))))
        return got.shape == expected.shape and np.allclose(got, expected, rtol, atol, equal_nan=True)

    def _difference(self, wrong: _WrongResult) -> str:
        """Text with the wrong and the expected result, and with the inputs if they are short."""
        what = wrong.what
        got = wrong.got
        expected = wrong.expected
        if self.cases is None:  # the message hides the right value
            name = f"{what} = " if self.parts else ""
            return f"{name}{as_text(got)} is wrong."
        if is_index_list(expected) and (expected.size > SHORT or not as_text(got)):
            return f"{what} has {_wrong_indices(got, expected)}."
        if not (as_text(got) and as_text(expected)):
            differs = ~np.isclose(got, expected, self.rtol, self.atol)
            place = tuple(np.argwhere(differs)[0].tolist())
            numbers = comparison(got[place], expected[place])
            return (
                f"{what} has {differs.sum()} of {differs.size} numbers wrong: at {list(place)} it {numbers}."
            )
        names = inspect.signature(self.right).parameters
        texts = []
        for name, value in zip(names, map(as_text, wrong.inputs), strict=False):
            if 0 < len(value) < LONGEST:
                texts.append(f"{name} = {value}")
        inputs = f" for {', '.join(texts)}" if texts else ""
        return f"{what} {comparison(got, expected)}{inputs}."


def _always(value: Any) -> Callable[..., Any]:
    """The function that returns a value for all inputs."""
    return lambda *_: value


def _wrong_indices(got: Array, expected: Array) -> str:
    """How a list of indices differs from the expected one, as the end of a sentence."""
    size = "" if got.size == expected.size else f"; expected {expected.size} indices"
    others = np.setdiff1d(got, expected)
    if len(others):
        return f"{len(others)} of {got.size} indices wrong (for example {others[0]:g}){size}"
    if size:
        return f"{got.size} right indices{size}"
    return "the right indices at wrong positions"
