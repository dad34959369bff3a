"""Table 1: one list of records, and one layout of it with the paper's numbers below ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..data.catalogue import KITTI
from ..evaluation.kitti import KITTI_MEASURE
from ..geometry.types import Array
from .entries import BENCHMARK_FRAMES, Entry, Group
from .page import NO_NUMBER, ReportTable, finite, mean_and_spread, number, plus_minus, seeds_words
from .printed import AVERAGE, CLAIMS, LEFT_OUT, PRINTED_NAMES, PROPOSAL, PaperTable, gain

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


def layout_table(group: Group, paper: PaperTable) -> ReportTable:
    """The records of a group in the layout of Table 1.

    A row for TE, RE and removed features of each sequence, a column for each method.
    """
    records, sequences = _records(group, paper), "KITTI" if group.kitti else "other sequences"
    title = f"The systems of Table 1, {VARIANT_WORDS[group.variant]}: {sequences}, {group.measure.words}"
    notes = [f"{seeds_words(max(record['seeds'] for record in records)).capitalize()}."]
    if any(record["paper_te_percent"] is not None for record in records):
        notes[0] += " Below ours, the paper's number."
    if len(group.sequences) > 1:
        mean = "Avg and mean, without 01" if group.kitti else "mean"
        notes.append(
            f"{mean}: each sequence counts the same; pooled: each sub-sequence does, as on KITTI's server."
        )
    cells = {(record["sequence"], record["method"]): record for record in records}
    rows = []
    for name in dict.fromkeys(record["sequence"] for record in records):
        of_row = [cells.get((name, method), {}) for method in group.methods]
        label = name.removeprefix(KITTI)
        for kind, (unit, digits) in ERROR_KINDS.items():
            rows.append([f"{label} {unit}", *(_cell(record, kind, digits) for record in of_row)])
        shares = [record.get("removed_share") for record in of_row]
        if any(shares):
            removed = [NO_NUMBER if share is None else f"{100 * share:.1f}" for share in shares]
            rows.append([f"{label} removed %", *removed])
    names = [PRINTED_NAMES.get(method, method).replace(" ", "\n") for method in group.methods]
    notes += _comparison(group, "mesvo_f")
    return ReportTable(title, ["sequence", *names], rows, notes, caveats(group))


def _cell(record: dict[str, Any], kind: str, digits: int) -> str:
    """Our mean ± deviation over the seeds; the paper's number in a line of its own."""
    ours, printed = plus_minus(record.get(kind), record.get(f"{kind}_std")), record.get(f"paper_{kind}")
    return ours if printed is None else f"{ours}\n{number(printed, digits)}"


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
            f"No vehicle boxes on {', '.join(without)}: Feature selection removes nothing there and equals "
            "Solution selection. `--detector MODEL` finds boxes."
        )
    return notes


def results(groups: list[Group]) -> list[str]:
    """A sentence for each group: the proposal against the same method without the removal."""
    return [sentence for group in groups for sentence in _comparison(group, "solution_selection")]


def _comparison(group: Group, other: str) -> list[str]:
    """A sentence on the mean errors of the proposal and of another method; none where they are equal."""
    parts = []
    for (kind, _), claim, *errors in zip(
        ERROR_KINDS.values(), CLAIMS[other], group.mean(other), group.mean(PROPOSAL), strict=True
    ):
        before, after = (mean_and_spread(values)[0] for values in errors)
        less = float(gain(before, after))
        if np.isfinite(less) and less != 0.0:
            name, unit = kind.split(" ", 1)
            theirs = f", in the paper −{claim:g} %" if group.is_papers else ""
            change = f"{-less:+.1f} %".replace("-", "−") + theirs
            verb = "lowers" if less > 0 else "raises"
            parts.append(f"{verb} {name} from {number(before)} to {number(after)} {unit} ({change})")
    rows = [name for name in group.sequences if name != f"{KITTI}{LEFT_OUT}"]
    where = rows[0] if len(rows) == 1 else f"mean of {len(rows)} sequences"
    said = f"{PROPOSAL}, which removes the features in vehicle boxes, {' and '.join(parts)} against {other}"
    return [f"{where}, {VARIANT_WORDS[group.variant]}: {said}."] if parts else []
