"""Table 1 for programs: CSV and JSON, with the paper's numbers beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.files import csv_text
from ..core.types import Array
from ..data.sequence import KITTI
from .entries import Entry, Group
from .paper import AVERAGE, PaperTable
from .table1 import difference, is_papers, is_whole

HEADING = ("variant", "sequence", "method", "sub_sequences", "seeds")
NUMBERS = ("te_percent", "te_std", "re_deg_per_100m", "re_std")
PAPER_HEADING = ("paper_te_percent", "te_difference", "paper_re_deg_per_100m", "re_difference")


def table_csv(groups: list[Group], paper: PaperTable) -> str:
    """Everything in one long table: a row for each sequence and method, then the averages."""
    rows = [[*HEADING, *NUMBERS, *PAPER_HEADING, "removed_share", "back_end_ms"]]
    for group in groups:
        words = group.measure.words
        for (sequence, method), e in group.entries.items():
            row = sequence.removeprefix(KITTI) if group.kitti else ""
            beside = _beside(paper.value(row, method), e.te, e.re, is_whole(e))
            more = _plain(e.removed_share), _plain(e.back_end_ms)
            rows.append([group.variant, sequence, method, words, *_csv_numbers(e.te, e.re), *beside, *more])
        if len(group.sequences) < 2:
            continue
        for method in group.methods:
            mean, total = group.mean(method), group.pooled(method)
            row = AVERAGE if is_papers(group) else ""
            beside = _beside(paper.value(row, method), *mean, is_papers(group))
            label = "mean_without_01" if group.kitti else "mean"
            rows.append([group.variant, label, method, words, *_csv_numbers(*mean), *beside, "", ""])
            rows.append([group.variant, "pooled", method, words, *_csv_numbers(*total), *[""] * 6])
    return csv_text(rows)


def _beside(printed: tuple[float | None, float | None], te: Array, re: Array, comparable: bool) -> list[str]:
    """The paper's TE and RE, each with our difference to it where the two can be compared."""
    gaps = [difference(ours, theirs) for ours, theirs in zip((te, re), printed, strict=True)]
    pairs = zip(printed, gaps if comparable else (None, None), strict=True)
    return [_plain(value) for pair in pairs for value in pair]


def _csv_numbers(te: Array, re: Array) -> list[str]:
    some = len(te) > 0
    numbers = [te.mean(), te.std(), re.mean(), re.std()] if some else [None] * 4
    return [str(len(te)), *map(_plain, numbers)]


def _plain(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.6f}"


def groups_json(groups: list[Group], paper: PaperTable) -> list[dict[str, Any]]:
    """Everything measured, for JSON: no NaN, None where there is no number."""
    return [
        {
            "variant": group.variant,
            "kitti": group.kitti,
            "lengths_m": list(group.measure.lengths),
            "step_frames": group.measure.step,
            "entries": [_entry_json(e, paper if group.kitti else None) for e in group.entries.values()],
            "averages": [
                {
                    "method": method,
                    "mean_without_01" if group.kitti else "mean": _seeds_json(*group.mean(method)),
                    "pooled": _seeds_json(*group.pooled(method)),
                }
                for method in group.methods
            ],
        }
        for group in groups
    ]


def _entry_json(entry: Entry, paper: PaperTable | None) -> dict[str, Any]:
    name = entry.sequence.removeprefix(KITTI)
    te, re = (None, None) if paper is None else paper.value(name, entry.method)
    first = entry.results[0]
    return {
        "sequence": entry.sequence,
        "method": entry.method,
        "how": "; ".join(entry.how),
        "frames": entry.frames,
        "distance_m": first.distance,
        "seeds": list(entry.seeds),
        **_seeds_json(entry.te, entry.re),
        "first_seed": first.kitti.to_tables(entry.measure.lengths),
        "ate": [result.ate.to_dict() for result in entry.results],
        "rpe": [result.rpe.to_dict() for result in entry.results],
        "removed_share": entry.removed_share,
        "back_end_ms": entry.back_end_ms,
        "whole_sequence": is_whole(entry),
        "paper": {"te_percent": te, "re_deg_per_100m": re},
    }


def _seeds_json(te: Array, re: Array) -> dict[str, Any]:
    return {
        name: {"seeds": [_finite(v) for v in values.tolist()], "mean": _finite(_mean(values))}
        for name, values in (("te_percent", te), ("re_deg_per_100m", re))
    }


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
