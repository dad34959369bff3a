"""Table 1 for programs: JSON, and the same as one long table in CSV, with the paper's numbers beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.files import csv_text
from ..core.types import Array
from ..data.sequence import KITTI
from .entries import Entry, Group
from .paper import AVERAGE, PaperTable
from .report import mean_and_spread
from .table1 import difference, is_papers, is_whole

HEADING = ["variant", "sequence", "method", "sub_sequences", "seeds", "te_percent", "te_std"]
HEADING += ["re_deg_per_100m", "re_std", "paper_te_percent", "te_difference", "paper_re_deg_per_100m"]
HEADING += ["re_difference", "removed_share", "back_end_ms"]
KINDS = "te_percent", "re_deg_per_100m"
Printed = tuple[float | None, float | None]


def groups_json(groups: list[Group], paper: PaperTable) -> list[dict[str, Any]]:
    """Everything measured, for JSON: no NaN, None where there is no number."""
    return [
        {
            "variant": group.variant,
            "kitti": group.kitti,
            "lengths_m": list(group.measure.lengths),
            "step_frames": group.measure.step,
            "sub_sequences": group.measure.words,
            "entries": [_entry(e, paper if group.kitti else None) for e in group.entries.values()],
            "averages": [_averages(group, method, paper) for method in group.methods],
        }
        for group in groups
    ]


def table_csv(groups: list[dict[str, Any]]) -> str:
    """What `groups_json` holds in one table: a row for each sequence and method, then the averages."""
    rows: list[list[Any]] = [HEADING]
    for group in groups:
        several = len({entry["sequence"] for entry in group["entries"]}) > 1
        averages = [
            {"sequence": name, "method": average["method"], **average[name]}
            for average in (group["averages"] if several else [])
            for name in list(average)[1:]
        ]
        for row in (*group["entries"], *averages):
            te, re = (row[kind] for kind in KINDS)
            numbers = [te["mean"], te["std"], re["mean"], re["std"], te["paper"], te["difference"]]
            numbers += [re["paper"], re["difference"], row.get("removed_share"), row.get("back_end_ms")]
            names = [group["variant"], row["sequence"], row["method"], group["sub_sequences"]]
            plain = ["" if value is None else f"{value:.6f}" for value in numbers]
            rows.append([*names, str(len(te["seeds"])), *plain])
    return csv_text(rows)


def _entry(entry: Entry, paper: PaperTable | None) -> dict[str, Any]:
    name = entry.sequence.removeprefix(KITTI)
    printed = (None, None) if paper is None else paper.value(name, entry.method)
    first = entry.results[0]
    return {
        "sequence": entry.sequence,
        "method": entry.method,
        "how": "; ".join(entry.how),
        "frames": entry.frames,
        "distance_m": first.distance,
        **_numbers(entry.te, entry.re, printed, is_whole(entry)),
        "first_seed": first.kitti.to_tables(entry.measure.lengths),
        "ate": [result.ate.to_dict() for result in entry.results],
        "rpe": [result.rpe.to_dict() for result in entry.results],
        "removed_share": entry.removed_share,
        "back_end_ms": entry.back_end_ms,
        "seeds": list(entry.seeds),
        "whole_sequence": is_whole(entry),
    }


def _averages(group: Group, method: str, paper: PaperTable) -> dict[str, Any]:
    """The mean, of KITTI without 01, beside the paper's where it is over the same; and the pooled mean."""
    printed = paper.value(AVERAGE, method) if is_papers(group) else (None, None)
    mean = _numbers(*group.mean(method), printed, True)
    pooled = _numbers(*group.pooled(method), (None, None), False)
    return {"method": method, "mean_without_01" if group.kitti else "mean": mean, "pooled": pooled}


def _numbers(te: Array, re: Array, printed: Printed, comparable: bool) -> dict[str, Any]:
    """TE and RE of the seeds, their mean and spread, the paper's, and our difference where they compare."""
    return {
        kind: {
            "seeds": [_finite(value) for value in values.tolist()],
            **dict(zip(("mean", "std"), map(_finite, mean_and_spread(values)), strict=True)),
            "paper": theirs,
            "difference": difference(values, theirs) if comparable else None,
        }
        for kind, values, theirs in zip(KINDS, (te, re), printed, strict=True)
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
