"""Chapter 7: the gain that the paper claims, as a change of errors paired over the sequences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vo_lib.errors import DataError
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.paper_unit import converted
from vo_lib.report.table1 import ERROR_KINDS

from ..intervals import Interval, changes_needed, means_without_each, paired_change, sign_flip_share
from .our_errors import OursByCell


@dataclass(frozen=True, eq=False)
class Gain:
    """The change of an error from one method to another over sequences.

    names : the sequences; changes : (N,); interval : of the mean change over sequences; share : of all choices of
    signs for the changes, those whose mean is at least as far from 0 (sign-flip test); without : (N,) means
    without each sequence.
    """

    names: tuple[str, ...]
    changes: Array
    interval: Interval
    share: float
    without: Array

    @property
    def half_width(self) -> float:
        """Half the width of the interval."""
        return self.interval.high - self.interval.mean

    @property
    def words(self) -> str:
        """The verdict on the question whether the change is general: a gain lowers the error."""
        mean = self.interval.mean
        if not np.any(self.changes):
            return "no change on any sequence"
        if mean == 0.0:
            return "gains and losses that cancel"
        kind = "gain" if mean < 0 else "loss"
        if self.interval.excludes(0.0):
            return f"a {kind} that is hardly chance"
        other = "loss" if mean < 0 else "gain"
        return f"a {kind}, but another set of sequences could show none or a {other}"

    @property
    def sequences_needed(self) -> int | None:
        """Sequences with which a t test would find this mean change in 80 % of the sets, or None."""
        return changes_needed(self.interval.mean, self.interval.deviation)


def gain_over_sequences(before: Mapping[str, float], after: Mapping[str, float]) -> Gain:
    """The gain paired over the sequences that both have, with interval, sign flips and leave-one-out.

    Raises `DataError` with fewer than two sequences, and for an error that is not a number.
    """
    names = tuple(name for name in before if name in after)
    if len(names) < 2:
        raise DataError(f"a gain over sequences needs two sequences or more, here {len(names)}")
    old = np.array([before[name] for name in names])
    new = np.array([after[name] for name in names])
    change = new - old
    if not np.isfinite(change).all():
        missing = [name for name, value in zip(names, change, strict=True) if not math.isfinite(value)]
        raise DataError(f"a gain over sequences needs errors on each sequence: none on {', '.join(missing)}")
    return Gain(names, change, paired_change(old, new), sign_flip_share(change), means_without_each(change))


def printed_column(paper: table1.PaperTable, method: str, kind: str) -> dict[str, float]:
    """The printed numbers of a method on the ten sequences, in the right unit."""
    place = list(ERROR_KINDS).index(kind)
    column = {}
    for row in table1.SUB_SEQUENCES:
        printed = paper.value(row, method)[place]
        if printed is not None:
            column[row] = converted(printed, method, kind)
    return column


def our_column(found: OursByCell, method: str, kind: str) -> dict[str, float]:
    """Our means of a method on the whole sequences of the table that `left_out` does not name."""
    out = left_out(found, method, kind)
    return {row: found[row, method, kind].mean for row in table1.SUB_SEQUENCES if row not in out}


def left_out(found: OursByCell, method: str, kind: str) -> dict[str, str]:
    """The sequences of the table whose errors say nothing about a gain, with the reason."""
    out = {}
    for row in table1.SUB_SEQUENCES:
        ours = found.get((row, method, kind))
        name = table1.PRINTED_NAMES[method]
        if ours is None:
            out[row] = f"no run of {name}"
        elif not ours.whole:
            out[row] = "part of the sequence"
        elif not math.isfinite(ours.mean):
            out[row] = f"a seed of {name} without errors"
        elif method == table1.PROPOSAL and not ours.boxes:
            out[row] = "no boxes"
    return out


def why_no_gain(found: OursByCell, methods: Sequence[str], kind: str) -> str:
    """Why our sequences give no gain from one method to another; "" if two or more of them give one."""
    reasons: dict[str, list[str]] = {}
    for row in table1.SUB_SEQUENCES:
        for method in methods:
            reason = left_out(found, method, kind).get(row)
            if reason:
                reasons.setdefault(reason, []).append(row)
                break  # the first reason is enough
    left = len(table1.SUB_SEQUENCES) - sum(map(len, reasons.values()))
    if left >= 2:
        return ""
    if not found:
        return "not measured"
    words = "; ".join(f"{reason}: {', '.join(rows)}" for reason, rows in reasons.items())
    return f"no answer, since it takes two whole sequences of both systems, and there are {left} ({words})"
