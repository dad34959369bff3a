"""Table 1: one list of records, and one layout of it with the paper's numbers beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..data.catalogue import KITTI
from ..evaluation.kitti import KITTI_MEASURE
from ..geometry.types import Array
from .entries import BENCHMARK_FRAMES, Entry, Group
from .page import ReportTable, finite, mean_and_spread, number, plus_minus, seeds_words, signed
from .printed import AVERAGE, CLAIMS, LEFT_OUT, PROPOSAL, PaperTable, gain

VARIANT_WORDS = {"published": "the paper as published", "kit": "the kit's way"}
# Names of TE and RE in records, in tables, and the digits that the paper prints.
ERROR_KINDS = {"te_percent": ("TE %", 2), "re_deg_per_100m": ("RE deg/100 m", 3)}
BOX_METHODS = ("feature_selection", "moving_selection")  # need vehicle boxes


def table_records(groups: list[Group], paper: PaperTable) -> list[dict[str, Any]]:
    """Table 1: a record for each row and method, in the order of the rows; None where there is no number.

    The rows of a group: the mean, which is the paper's Avg over whole runs of its ten sequences; each
    sequence, 01 last; all sub-sequences pooled. Printed numbers stand beside whole sequences alone.
    """
    return [record for group in groups for record in _records(group, paper)]


def _records(group: Group, paper: PaperTable) -> list[dict[str, Any]]:
    left_out, several = f"{KITTI}{LEFT_OUT}", len(group.sequences) > 1
    mean = AVERAGE if group.is_papers else f"mean of {len(group.sequences) - (left_out in group.sequences)}"
    records = [_record(group, paper, mean, method, group.mean(method)) for method in group.methods if several]
    for (sequence, method), entry in sorted(group.entries.items(), key=lambda item: item[0][0] == left_out):
        records.append(_record(group, paper, sequence, method, entry.errors))
    if several:
        records += [_record(group, paper, "pooled", each, group.pooled(each)) for each in group.methods]
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
    """Fields of a record: mean and deviation of TE and RE of seeds (2, S), and an entry's other numbers."""
    fields: dict[str, float | None] = {}
    for kind, values in zip(ERROR_KINDS, errors, strict=True):
        fields[kind], fields[f"{kind}_std"] = map(finite, mean_and_spread(values))
    for name in ("removed_share", "back_end_ms"):
        fields[name] = getattr(entry, name, None)
    return fields


def layout_tables(group: Group, paper: PaperTable) -> list[ReportTable]:
    """The records of a group, a row each: one table or, with the paper's numbers, one of TE and one of RE."""
    records, several = _records(group, paper), len(group.sequences) > 1
    printed = any(record["paper_te_percent"] is not None for record in records)
    name = "KITTI" if group.kitti else f"{len(group.sequences)} sequences"
    title = f"{name if several else group.sequences[0]}, {VARIANT_WORDS[group.variant]}"
    tables = []
    for kinds in [[kind] for kind in ERROR_KINDS] if printed else [list(ERROR_KINDS)]:
        units = [ERROR_KINDS[kind][0] for kind in kinds]
        columns = [
            "method",
            *([f"{units[0]}, ours", "paper", "difference"] if printed else units),
            "removed %",
        ]
        rows = [
            [
                f"{record['sequence'].removeprefix(KITTI)} " * several + record["method"],
                *(cell for kind in kinds for cell in _cells(record, kind)[: 3 if printed else 1]),
                "" if record["removed_share"] is None else f"{100 * record['removed_share']:.1f}",
            ]
            for record in records
        ]
        what = f"{title}, {units[0].split()[0]}" if printed else title
        tables.append(ReportTable(f"{what}: sub-sequences of {group.measure.words}", columns, rows, []))
    tables[0].head.extend(caveats(group))
    notes = [f"{seeds_words(max(record['seeds'] for record in records)).capitalize()}."]
    mean = "Avg and mean, without 01" if group.kitti else "mean"
    weights = f"{mean}: each sequence counts the same; pooled: each sub-sequence does, as on KITTI's server."
    tables[-1].notes.extend([*notes, *[weights] * several, *_comparison(group, "mesvo_f")])
    return tables


def _cells(record: dict[str, Any], kind: str) -> list[str]:
    """Our mean ± deviation over the seeds, the paper's number, the difference."""
    ours, printed, digits = record[kind], record[f"paper_{kind}"], ERROR_KINDS[kind][1]
    theirs = ["", ""] if printed is None else [number(printed, digits), signed(ours - printed, digits)]
    return [plus_minus(ours, record[f"{kind}_std"]), *theirs]


def caveats(group: Group) -> list[str]:
    """What has to be known before a table is read: parts of sequences, and sequences without boxes."""
    notes = []
    frames = {entry.sequence: len(entry.truth) for entry in group.entries.values() if group.kitti}
    parts = {name: n for name, n in frames.items() if n != BENCHMARK_FRAMES[name]}
    if parts:
        words = ", ".join(f"{name} ({n} of {BENCHMARK_FRAMES[name]} frames)" for name, n in parts.items())
        notes.append(f"Parts of a sequence, not comparable with whole ones: {words}.")
    if group.kitti and group.measure != KITTI_MEASURE:
        notes.append(f"Not the benchmark's sub-sequences, but {group.measure.words}: not comparable with it.")
    without = list(dict.fromkeys(e.sequence for e in group.entries.values() if not e.labels))
    if without and any(method in group.methods for method in BOX_METHODS):
        notes.append(
            f"No vehicle boxes on {', '.join(without)}: feature_selection removes nothing there and equals "
            "solution_selection. `--detector MODEL` finds boxes."
        )
    return notes


def results(groups: list[Group]) -> list[str]:
    """A sentence for each group: the proposal against the same method without the removal."""
    return [sentence for group in groups for sentence in _comparison(group, "solution_selection")]


def _comparison(group: Group, other: str) -> list[str]:
    """A sentence on the mean errors of the proposal and of another method; none where they are equal."""
    parts, means = [], (group.mean(other), group.mean(PROPOSAL))
    for (kind, _), claim, *errors in zip(ERROR_KINDS.values(), CLAIMS[other], *means, strict=True):
        before, after = (mean_and_spread(values)[0] for values in errors)
        less, (name, unit) = float(gain(before, after)), kind.split(" ", 1)
        if np.isfinite(less) and less != 0.0:
            change = f"{signed(-less, 1)} %" + (f", in the paper −{claim:g} %" if group.is_papers else "")
            verb = "lowers" if less > 0 else "raises"
            parts.append(f"{verb} {name} from {number(before)} to {number(after)} {unit} ({change})")
    rows = [name for name in group.sequences if name != f"{KITTI}{LEFT_OUT}"]
    where = rows[0] if len(rows) == 1 else f"Mean of {len(rows)} sequences"
    said = f"{PROPOSAL}, which removes the features in vehicle boxes, {' and '.join(parts)} against {other}"
    return [f"{where}, {VARIANT_WORDS[group.variant]}: {said}."] if parts else []
