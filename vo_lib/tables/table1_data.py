"""Table 1 as rows with the paper's numbers beside ours; the same for programs, in JSON and CSV."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.files import csv_text
from ..core.types import Array
from ..data.kitti import EXPECTED_FRAMES
from ..data.sequence import KITTI
from ..evaluation.kitti import KITTI_MEASURE
from .entries import Entry, Group
from .paper import AVERAGE, LEFT_OUT, PAPER_ROWS, PaperTable
from .report import mean_and_spread

KINDS = "te_percent", "re_deg_per_100m"
WHOLE = {f"{KITTI}{name}": frames for name, frames in EXPECTED_FRAMES.items()}


@dataclass(frozen=True)
class Row:
    """A line of Table 1.

    `errors` : TE and RE of each seed, (2, S), by method; `comparable` : whether the paper's are of the same.
    """

    name: str
    errors: dict[str, Array]
    comparable: bool


def group_rows(group: Group, paper: PaperTable | None) -> list[Row]:
    """The paper's rows, with its numbers those that were not run too; else the mean and what was run.

    The pooled mean and 01, which has no printed numbers, come last.
    """
    left_out, several = f"{KITTI}{LEFT_OUT}", len(group.sequences) > 1
    rows = []
    mean = {method: group.mean(method) for method in group.methods}
    if paper is not None or is_papers(group):
        rows.append(Row(AVERAGE, mean if is_papers(group) else {}, True))
    if several and not is_papers(group):
        rows.append(Row(f"mean of {len(group.sequences) - (left_out in group.sequences)}", mean, False))
    known = [f"{KITTI}{row}" for row in PAPER_ROWS[1:]] if paper is not None else []
    others = [name for name in group.sequences if name not in known]
    for name in [*known, *sorted(others, key=lambda name: name == left_out)]:
        entries = group.of_sequence(name)
        rows.append(Row(name, {e.method: e.errors for e in entries}, all(map(is_whole, entries))))
    if several:
        rows.append(Row("pooled", {method: group.pooled(method) for method in group.methods}, False))
    return rows


def papers_numbers(group: Group, paper: PaperTable) -> PaperTable | None:
    """The printed numbers where they may stand below a group's: KITTI's, over the benchmark's lengths."""
    return paper if group.kitti and group.measure == KITTI_MEASURE else None


def printed_numbers(paper: PaperTable | None, row: Row, method: str) -> tuple[float | None, float | None]:
    """The TE and RE that the paper prints for a row and a method."""
    return (None, None) if paper is None else paper.value(row.name.removeprefix(KITTI), method)


def table_records(groups: list[Group], paper: PaperTable) -> list[dict[str, Any]]:
    """Table 1 for programs, a record for each row and method that was run; None where there is no number."""
    records = []
    for group in groups:
        theirs = papers_numbers(group, paper)
        for row in group_rows(group, theirs):
            for method, errors in row.errors.items():
                record: dict[str, Any] = {"variant": group.variant, "sequence": row.name, "method": method}
                record |= {"sub_sequences": group.measure.words, "seeds": errors.shape[1]}
                printed = printed_numbers(theirs, row, method)
                for kind, values, their in zip(KINDS, errors, printed, strict=True):
                    mean, deviation = (v if np.isfinite(v) else None for v in mean_and_spread(values))
                    record |= {kind: mean, f"{kind}_std": deviation, f"paper_{kind}": their}
                    gap = difference(values, their) if row.comparable else None
                    record |= {f"{kind}_difference": gap}
                entry = group.entries.get((row.name, method))
                record["removed_share"] = None if entry is None else entry.removed_share
                record["back_end_ms"] = None if entry is None else entry.back_end_ms
                records.append(record)
    return records


def records_csv(records: list[dict[str, Any]]) -> str:
    """Records as CSV, empty where there is no number."""
    rows = [
        ["" if v is None else f"{v:.6f}" if isinstance(v, float) else v for v in each.values()]
        for each in records
    ]
    return csv_text([list(records[0]) if records else [], *rows])


def difference(ours: Array, printed: float | None) -> float | None:
    """Our mean over seeds less the printed number; None where either is not there."""
    gap = mean_and_spread(ours)[0] - (np.nan if printed is None else printed)
    return gap if np.isfinite(gap) else None


def is_whole(entry: Entry) -> bool:
    """Whether the benchmark's whole sequence was run and measured as the benchmark does it."""
    return len(entry.truth) == WHOLE.get(entry.sequence) and entry.measure == KITTI_MEASURE


def is_papers(group: Group) -> bool:
    """Whether the group's mean is over what the paper's is: whole runs of its ten sequences."""
    whole = {entry.sequence for entry in group.entries.values() if is_whole(entry)}
    return {f"{KITTI}{row}" for row in PAPER_ROWS[1:]} <= whole
