"""Table 1 as a list of records, and as tables with the paper's numbers next to ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..data.catalogue import KITTI
from ..evaluation.kitti import KITTI_MEASURE
from ..geometry.types import Array
from .entries import BENCHMARK_FRAMES, Entry, Group
from .page import (
    NO_CHANGE,
    ReportTable,
    change_limit,
    finite,
    mean_and_spread,
    number,
    plus_minus,
    seeds_text,
    signed,
)
from .printed import AVERAGE, CLAIMS, LEFT_OUT, PROPOSAL, PaperTable, gain

VARIANT_WORDS = {"published": "variant published", "kit": "variant kit"}
# Names of TE and RE in records and in tables, and the number of decimals in the paper.
ERROR_KINDS = {"te_percent": ("TE %", 2), "re_deg_per_100m": ("RE deg/100 m", 3)}


def table_records(groups: list[Group], paper: PaperTable) -> list[dict[str, Any]]:
    """Table 1 as a record per row and method, in the order of the rows; None for a missing number.

    Rows of a group: the mean (the paper's Avg, if all ten sequences are complete), each sequence (01 last),
    and the mean over all sub-sequences. Only complete sequences are compared with the paper's numbers.
    """
    return [record for group in groups for record in _records(group, paper)]


def _records(group: Group, paper: PaperTable) -> list[dict[str, Any]]:
    left_out, several = f"{KITTI}{LEFT_OUT}", len(group.sequences) > 1
    mean = AVERAGE if group.is_papers else f"mean of {len(group.averaged)}"
    records = [_record(group, paper, mean, method, group.mean(method)) for method in group.methods if several]
    for (sequence, method), entry in sorted(group.entries.items(), key=lambda item: item[0][0] == left_out):
        records.append(_record(group, paper, sequence, method, entry.errors))
    if several:
        records += [_record(group, paper, "pooled", name, group.pooled(name)) for name in group.methods]
    return records


def _record(group: Group, paper: PaperTable, row: str, method: str, errors: Array) -> dict[str, Any]:
    entry = group.entries.get((row, method))
    whole = group.is_papers if entry is None else entry.is_whole
    printed = paper.value(row.removeprefix(KITTI), method) if whole else (None, None)
    record: dict[str, Any] = {"variant": group.variant, "sequence": row, "method": method}
    record |= {"sub_sequences": group.measure.words, "seeds": errors.shape[1]}
    record |= {f"paper_{kind}": value for kind, value in zip(ERROR_KINDS, printed, strict=True)}
    return record | number_fields(errors, entry)


def number_fields(errors: Array, entry: Entry | None) -> dict[str, float | None]:
    """Fields of a record: mean and deviation of TE and RE (2, S) over seeds, and numbers from the entry."""
    fields: dict[str, float | None] = {}
    for kind, values in zip(ERROR_KINDS, errors, strict=True):
        fields[kind], fields[f"{kind}_std"] = map(finite, mean_and_spread(values))
    for name in ("removed_share", "back_end_ms"):
        fields[name] = getattr(entry, name, None)
    return fields


def layout_tables(group: Group, paper: PaperTable) -> list[ReportTable]:
    """Tables of a group's records: one table, or two (TE and RE) with the paper's numbers.

    A group without errors has no table.
    """
    records = [record for record in _records(group, paper) if record["te_percent"] is not None]
    if not records:
        return []
    several = len(group.sequences) > 1
    printed = any(record["paper_te_percent"] is not None for record in records)
    name = "KITTI" if group.kitti else f"{len(group.sequences)} sequences"
    title = f"{name if several else group.sequences[0]}, {VARIANT_WORDS[group.variant]}"
    tables = []
    for kinds in [[kind] for kind in ERROR_KINDS] if printed else [list(ERROR_KINDS)]:
        units = [ERROR_KINDS[kind][0] for kind in kinds]
        errors = [f"{units[0]}, ours", "paper", "difference"] if printed else units
        columns = ["method", *errors, "removed %"]
        rows = [
            [
                f"{record['sequence'].removeprefix(KITTI)} " * several + record["method"],
                *(cell for kind in kinds for cell in _cells(record, kind)[: 3 if printed else 1]),
                "" if record["removed_share"] is None else f"{100 * record['removed_share']:.1f}",
            ]
            for record in records
        ]
        heading = f"{title}, {units[0].split()[0]}" if printed else title
        tables.append(ReportTable(f"{heading}: sub-sequences of {group.measure.words}", columns, rows, []))
    tables[0].head.extend(caveats(group))
    seeds = seeds_text(max(record["seeds"] for record in records)).capitalize()
    notes = [f"{seeds}; removed %: share of the features that the box rule removes."]
    mean = "Avg and mean, without 01" if group.kitti else "mean"
    weights = f"{mean}: all sequences have equal weight; pooled: all sub-sequences, as on KITTI's server."
    tables[-1].notes.extend([*notes, *[weights] * several])
    return tables


def _cells(record: dict[str, Any], kind: str) -> list[str]:
    """Our mean ± deviation over the seeds, the paper's number, and the difference."""
    ours, printed, digits = record[kind], record[f"paper_{kind}"], ERROR_KINDS[kind][1]
    theirs = ["", ""] if printed is None else [number(printed, digits), signed(ours - printed, digits)]
    return [plus_minus(ours, record[f"{kind}_std"]), *theirs]


def caveats(group: Group) -> list[str]:
    """Warnings above a table: incomplete sequences, non-standard sub-sequences."""
    notes = []
    frames = {entry.sequence: len(entry.truth) for entry in group.entries.values() if group.kitti}
    parts = {name: n for name, n in frames.items() if n != BENCHMARK_FRAMES[name]}
    if parts:
        words = ", ".join(f"{name} ({n} of {BENCHMARK_FRAMES[name]} frames)" for name, n in parts.items())
        notes.append(f"Parts of sequences, not comparable with whole sequences: {words}.")
    if group.kitti and group.measure != KITTI_MEASURE:
        notes.append(f"Sub-sequences of {group.measure.words}: not comparable with the benchmark.")
    return notes


def results(groups: list[Group]) -> list[str]:
    """Sentences that compare the proposal with other methods, for each group.

    The other method is `solution_selection` and, in a group with the paper's sequences, also `mesvo_f`.
    """
    compared = ((group, other) for group in groups for other in list(CLAIMS)[: 2 if group.is_papers else 1])
    return [sentence for group, other in compared for sentence in _comparison(group, other)]


def _comparison(group: Group, other: str) -> list[str]:
    """A sentence on the mean errors of the proposal and of another method; none without boxes or errors."""
    by_seed = [group.mean(method) for method in (other, PROPOSAL)]
    if not all(np.isfinite(errors).all() and errors.size for errors in by_seed):
        return []
    if not any(entry.labels for entry in group.of_method(PROPOSAL)):
        return []
    parts = []
    for (kind, _), claim, *errors in zip(ERROR_KINDS.values(), CLAIMS[other], *by_seed, strict=True):
        (before, deviation), (after, new_deviation) = map(mean_and_spread, errors)
        if before == after:
            continue
        (name, unit), less = kind.split(" ", 1), float(gain(before, after))
        verb, change = "lowers" if less > 0 else "raises", f"{signed(-less, 1)} %"
        if abs(after - before) <= change_limit(before, deviation, new_deviation):
            verb, change = "changes", NO_CHANGE
        change += f", in the paper −{claim:g} %" if group.is_papers else ""
        parts.append(f"{verb} {name} from {number(before)} to {number(after)} {unit} ({change})")
    rows, changes = group.averaged, " and ".join(parts) or "changes neither TE nor RE"
    where = rows[0] if len(rows) == 1 else f"Mean of {len(rows)} sequences"
    result = f"{PROPOSAL}, which removes the features in vehicle boxes, {changes}"
    few = {1: "one seed", 2: "two seeds"}.get(by_seed[1].shape[1])
    seeds = f"; with {few}, a change may be due to chance" if few else ""
    return [f"{where}, {VARIANT_WORDS[group.variant]}: {result} compared with {other}{seeds}."]
