"""Tables of methods over sequences and seeds, beside the paper's numbers."""

from __future__ import annotations

import numpy as np

from ..core.types import Array
from ..data.kitti_check import EXPECTED_FRAMES
from ..data.sequence import KITTI
from ..evaluation.kitti import KITTI_MEASURE, pooled
from .entries import Entry, Group
from .paper import AVERAGE, PAPER_METHODS, PAPER_ROWS, REMARKS, PaperTable
from .report import ReportTable

METHOD_COLUMNS = ["method", "TE %", "RE deg/100 m", "removed", "back end ms"]
NONE = "–"


def number(value: float | None, digits: int = 3) -> str:
    """A number, or a dash where there is none."""
    return NONE if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def spread(values: Array, digits: int = 3) -> str:
    """Mean ± standard deviation over seeds; the number alone of one seed; a dash where there is none."""
    if len(values) == 0 or not np.isfinite(values).all():
        return NONE
    if len(values) == 1:
        return number(float(values[0]), digits)
    return f"{values.mean():.{digits}f} ± {values.std():.{digits}f}"


def seeds_words(entries: list[Entry]) -> str:
    """What the numbers of a table are over, in words."""
    seeds = max(len(entry.seeds) for entry in entries)
    return "one seed" if seeds == 1 else f"mean ± standard deviation over {seeds} seeds"


def method_table(entries: list[Entry]) -> ReportTable:
    """The methods on one sequence, a row each."""
    rows = [
        [e.method, spread(e.te), spread(e.re), f"{100 * e.removed_share:.1f} %", f"{e.back_end_ms:.1f}"]
        for e in entries
    ]
    over = seeds_words(entries)
    notes = [f"TE and RE over sub-sequences of {entries[0].measure.words}, as far as the path goes; {over}."]
    return ReportTable(f"Errors on {entries[0].sequence}", METHOD_COLUMNS, rows, notes)


def layout_table(group: Group) -> ReportTable:
    """Table 1 in the paper's layout: a row for each sequence, TE and RE of each method, averages below."""
    columns = ["sequence", *(f"{method} {kind}" for method in group.methods for kind in ("TE", "RE"))]
    rows = []
    for sequence in group.sequences:
        cells = []
        for method in group.methods:
            entry = group.entries.get((sequence, method))
            cells += [NONE, NONE] if entry is None else [spread(entry.te), spread(entry.re)]
        rows.append([sequence, *cells])
    notes = [f"TE in %, RE in deg/100 m; {seeds_words(list(group.entries.values()))}."]
    if len(group.sequences) > 1:
        label = "mean without 01" if group.kitti else "plain mean"
        for name, average in ((label, group.mean), ("pooled", group.pooled)):
            pairs = [average(method) for method in group.methods]
            rows.append([name, *(spread(values) for pair in pairs for values in pair)])
        notes.append("mean: each sequence counts the same, as in the paper; pooled: each sub-sequence does.")
    if group.kitti:
        notes += partial_notes(group)
    unlabelled = [name for name in group.sequences if not all(e.labels for e in group.of_sequence(name))]
    if unlabelled:
        notes.append(f"No vehicle boxes, so no method removed features: {', '.join(unlabelled)}.")
    return ReportTable(f"Table 1: {group.words}", columns, rows, notes)


def short_layouts(group: Group, columns: int = 3) -> list[ReportTable]:
    """`layout_table` for a terminal: a row for each method, TE / RE in one cell, a few sequences a table."""
    full = layout_table(group)
    tables = []
    for first in range(0, len(full.rows), columns):
        part = full.rows[first : first + columns]
        rows = [
            [method, *(f"{_alone(row[1 + 2 * k])} / {_alone(row[2 + 2 * k])}" for row in part)]
            for k, method in enumerate(group.methods)
        ]
        tables.append(ReportTable(full.title, ["TE / RE", *(row[0] for row in part)], rows, []))
    tables[-1].notes.extend(full.notes[1:])
    return tables


def _alone(cell: str) -> str:
    """The mean of a cell without its spread."""
    return cell.split(" ±")[0]


def paper_table(group: Group, paper: PaperTable) -> ReportTable:
    """Our numbers beside the paper's, and the difference where both are over the same sub-sequences."""
    columns = ["sequence, method", "TE ours", "TE paper", "difference", "RE ours", "RE paper", "difference"]
    rows = []
    for name, method, ours, comparable in _beside(group):
        cells = []
        for values, printed in zip(ours, paper.value(name, method), strict=True):
            gap = difference(values, printed) if comparable else None
            cells += [spread(values), number(printed), NONE if gap is None else f"{gap:+.3f}"]
        rows.append([f"{name}, {method}", *cells])
    notes = [*REMARKS, "A difference is given for whole sequences measured as the benchmark does it."]
    if paper.missing:
        notes.append(
            f"{paper.missing} of the paper's {2 * len(paper.te)} numbers are not in the kit's data file and "
            "shown as –. A CSV file completed from the paper is taken with --paper."
        )
    return ReportTable("Beside the paper's Table 1", columns, rows, notes)


def difference(ours: Array, printed: float | None) -> float | None:
    """Our mean over seeds less the printed number; None where either is not there."""
    if printed is None or len(ours) == 0 or not np.isfinite(ours).all():
        return None
    return float(ours.mean()) - printed


def _beside(group: Group) -> list[tuple[str, str, tuple[Array, Array], bool]]:
    """Rows of the comparison: paper's row, method, our TE and RE over seeds, whether they can be compared."""
    rows = []
    for (sequence, method), entry in group.entries.items():
        name = sequence.removeprefix(KITTI)
        if method in PAPER_METHODS and name in PAPER_ROWS:
            rows.append((name, method, (entry.te, entry.re), is_whole(entry)))
    nothing = np.zeros(0), np.zeros(0)
    whole = is_papers(group)
    averages = [(AVERAGE, m, group.mean(m) if whole else nothing, whole) for m in PAPER_METHODS]
    return rows + [row for row in averages if row[1] in group.methods]


def is_whole(entry: Entry) -> bool:
    """Whether the benchmark's whole sequence was run and measured as the benchmark does it."""
    expected = EXPECTED_FRAMES.get(entry.sequence.removeprefix(KITTI))
    return entry.frames == expected and entry.measure == KITTI_MEASURE


def is_papers(group: Group) -> bool:
    """Whether the group's mean is over what the paper's is: whole runs of its ten sequences."""
    whole = [name for name in group.sequences if all(map(is_whole, group.of_sequence(name)))]
    return {f"{KITTI}{row}" for row in PAPER_ROWS if row != AVERAGE} <= set(whole)


def partial_notes(group: Group) -> list[str]:
    """What keeps the group's rows from being compared with those of the paper, in words."""
    parts = {e.sequence: e.frames for e in group.entries.values() if not is_whole(e)}
    notes = []
    short = [
        f"{name} ({frames} of {EXPECTED_FRAMES[name.removeprefix(KITTI)]} frames)"
        for name, frames in parts.items()
        if frames != EXPECTED_FRAMES.get(name.removeprefix(KITTI))
    ]
    if short:
        notes.append(f"Parts of a sequence, not comparable with whole ones: {', '.join(short)}.")
    if group.measure != KITTI_MEASURE:
        notes.append(f"Not the benchmark's sub-sequences, but {group.measure.words}: not comparable with it.")
    return notes


def length_table(group: Group) -> ReportTable:
    """TE / RE of each sequence and method by the sub-sequence lengths that there are, all seeds together."""
    parts = {
        f"{sequence}, {method}": pooled(result.kitti for result in entry.results)
        for (sequence, method), entry in group.entries.items()
    }
    lengths = [
        at for at in group.measure.lengths if any((part.length == at).any() for part in parts.values())
    ]
    rows = [
        [name, *(f"{number(at.te)} / {number(at.re)}" for at in part.by_length(lengths).values())]
        for name, part in parts.items()
    ]
    columns = ["sequence, method", *(f"{length:g} m" for length in lengths)]
    notes = ["TE in % / RE in deg/100 m, mean over seeds."]
    return ReportTable(f"By length: {group.words}", columns, rows, notes)


def trajectory_table(entries: list[Entry]) -> ReportTable:
    """ATE and RPE beside the KITTI errors."""
    rows = []
    for entry in entries:
        ate = [result.ate.to_dict()["rmse_m"] for result in entry.results]
        rpe = [result.rpe.to_dict() for result in entry.results]
        parts = [ate, *([part[kind][f"rmse_{unit}"] for part in rpe] for kind, unit in RPE_PARTS)]
        metres, step, turn = (np.array([np.nan if v is None else v for v in part]) for part in parts)
        cells = spread(metres), spread(1e3 * step, 2), spread(turn, 4)
        rows.append([f"{entry.sequence}, {entry.method}", *cells])
    alignment = entries[0].results[0].ate.alignment
    columns = ["sequence, method", "ATE m", "RPE mm a frame", "RPE deg a frame"]
    return ReportTable(
        "ATE and RPE", columns, rows, [f"Root mean squares. ATE {alignment.words}; RPE needs none."]
    )


RPE_PARTS = (("translation", "m"), ("rotation", "deg"))


def markdown(table: ReportTable) -> str:
    """A table with its title and notes in Markdown."""
    lines = [table.columns, ["---", *["---:"] * (len(table.columns) - 1)], *table.rows]
    rows = "".join("| " + " | ".join(line) + " |\n" for line in lines)
    return f"## {table.title}\n\n{rows}" + "".join(f"\n{note}\n" for note in table.notes)
