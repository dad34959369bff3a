"""Tables of methods over sequences and seeds, beside the paper's numbers."""

from __future__ import annotations

import numpy as np

from ..core.types import Array
from ..data.kitti_check import EXPECTED_FRAMES
from ..data.sequence import KITTI
from ..evaluation.kitti import KITTI_MEASURE, pooled
from .entries import Entry, Group
from .paper import (
    AVERAGE,
    CLAIMS,
    LEFT_OUT,
    PAPER_METHODS,
    PAPER_ROWS,
    PRINTED_NAMES,
    PROPOSAL,
    REMARKS,
    PaperTable,
    gain,
    printed_gains,
)
from .report import ReportTable

METHOD_COLUMNS = ["method", "TE %", "RE deg/100 m", "removed", "back end ms"]
NONE = "–"
NAMED = 4  # sequences that a sentence lists
DIGITS = 2, 3  # of the TE and RE that the paper prints
NOTHING: Array = np.zeros(0)
BOXED = ("feature_selection", "moving_selection")  # methods that need vehicle boxes


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
    title = f"{entries[0].sequence}, {VARIANT_WORDS[entries[0].variant]}"
    how = " / ".join(dict.fromkeys(entry.how for entry in entries))
    return ReportTable(title, METHOD_COLUMNS, rows, [*notes, f"Made by: {how}."])


def layout_tables(group: Group, paper: PaperTable | None = None) -> list[ReportTable]:
    """A group in the layout of Table 1, what Feature selection gains, and apart the kit's own method.

    Parameters
    ----------
    paper : printed numbers, shown below ours where the group is KITTI's.
    """
    paper = paper if group.kitti else None
    own = [method for method in group.methods if method not in PAPER_METHODS]
    printed = [method for method in PAPER_METHODS if method in group.methods]
    tables = []
    if printed:
        title = f"Table 1, {VARIANT_WORDS[group.variant]}: {group.words}"
        rows = _rows(group, printed, paper, split=True)
        columns = [f"{PRINTED_NAMES[method]} {kind}" for method in printed for kind in ("TE", "RE")]
        tables.append(ReportTable(title, ["sequence", *columns], rows, _notes(group, paper), _head(group)))
    if PROPOSAL in printed and len(printed) > 1:
        tables.append(gains_table(group, paper))
    if own:
        title = f"Not in the paper, {VARIANT_WORDS[group.variant]}: {group.words}"
        columns = [f"{method} {kind}" for method in own for kind in ("TE", "RE")]
        notes = [f"TE in %, RE in deg/100 m; {seeds_words(list(group.entries.values()))}."]
        tables.append(ReportTable(title, ["sequence", *columns], _rows(group, own, None, split=True), notes))
    return tables


def terminal_tables(group: Group, paper: PaperTable | None = None) -> list[ReportTable]:
    """A group in 80 columns: means, TE / RE in one cell, the paper's below; the kit's own methods apart."""
    paper = paper if group.kitti else None
    tables = []
    for of_paper in (True, False):
        methods = [method for method in group.methods if (method in PAPER_METHODS) == of_paper]
        if not methods:
            continue
        names = [PRINTED_NAMES.get(method, method).replace(" ", "\n") for method in methods]
        words = VARIANT_WORDS[group.variant].capitalize()
        title = f"{words}: {group.words}" if of_paper else f"{words}, not in the paper"
        below = "; below, the paper's." if paper and of_paper else "."
        notes = [f"TE in % / RE in deg/100 m, means over seeds{below}"]
        rows = _rows(group, methods, paper, split=False)
        tables.append(ReportTable(title, ["sequence", *names], rows, notes, _head(group) if of_paper else []))
    return tables


VARIANT_WORDS = {"published": "the paper as published", "kit": "the kit's way"}


def _rows(group: Group, methods: list[str], paper: PaperTable | None, split: bool) -> list[list[str]]:
    """A row for the mean, each sequence and the pooled mean; 01, which has no printed numbers, comes last.

    `split` : TE and RE in cells of their own, with the spread over seeds and the difference to the paper.
    """
    left_out = f"{KITTI}{LEFT_OUT}"
    sequences = sorted(group.sequences, key=lambda name: group.kitti and name == left_out)
    several = len(sequences) > 1
    rows = []
    if several:
        name = AVERAGE if is_papers(group) else f"mean of {len(sequences) - (left_out in sequences)}"
        rows.append((name, [group.mean(m) for m in methods], True))
    for name in sequences:
        entries = [group.entries.get((name, method)) for method in methods]
        whole = all(entry is None or is_whole(entry) for entry in entries)
        numbers = [(NOTHING, NOTHING) if entry is None else (entry.te, entry.re) for entry in entries]
        rows.append((name.removeprefix(KITTI) if group.kitti else name, numbers, whole))
    if several:
        rows.append(("pooled", [group.pooled(m) for m in methods], False))
    table = []
    for name, numbers, whole in rows:
        cells = []
        for method, ours in zip(methods, numbers, strict=True):
            printed = (None, None) if paper is None else paper.value(name, method)
            if split:
                cells += [_cell(o, p, d, whole) for o, p, d in zip(ours, printed, DIGITS, strict=True)]
            else:
                below = (
                    ""
                    if printed[0] is None
                    else f"\n{number(printed[0], DIGITS[0])} / {number(printed[1], DIGITS[1])}"
                )
                cells.append(" / ".join(spread(o).split(" ±")[0] for o in ours) + below)
        table.append([name, *cells])
    return table


def _cell(ours: Array, printed: float | None, digits: int, comparable: bool) -> str:
    """Ours with its spread and, a line below, the printed number with our difference where they compare."""
    gap = difference(ours, printed) if comparable else None
    below = "" if printed is None else f"\n{number(printed, digits)}"
    return spread(ours) + below + ("" if gap is None else f" ({gap:+.3f})")


def _head(group: Group) -> list[str]:
    """What has to be known before a table is read: what made it, and whether there were boxes at all."""
    head = [f"Made by: {' / '.join(group.how)}."]
    without = [name for name in group.sequences if not all(e.labels for e in group.of_sequence(name))]
    if without and any(method in group.methods for method in BOXED):
        head.insert(
            0,
            f"No vehicle boxes on {_few(without)}: Feature selection removes nothing there and equals "
            "Solution selection. `--detector MODEL` finds boxes.",
        )
    return head


def _few(names: list[str]) -> str:
    """Names in a row, or how many there are."""
    return ", ".join(names) if len(names) <= NAMED else f"{len(names)} sequences"


def _notes(group: Group, paper: PaperTable | None) -> list[str]:
    over = seeds_words(list(group.entries.values()))
    notes = [f"TE in %, RE in deg/100 m; {over}."]
    if paper is not None:
        notes[0] += " Below ours, the paper's number and ours less the paper's."
        notes += [*REMARKS, "A difference is given for whole sequences measured as the benchmark does it."]
    if len(group.sequences) > 1:
        mean = "Avg or mean, without 01" if group.kitti else "mean"
        notes.append(
            f"{mean}: each sequence counts the same; pooled: each sub-sequence does, as on KITTI's server."
        )
    return notes + (partial_notes(group) if group.kitti else [])


def gains_table(group: Group, paper: PaperTable | None) -> ReportTable:
    """By how much Feature selection is better than Solution selection and MESVO_F: printed, and ours."""
    columns = ["Feature selection over"]
    if paper is not None:
        columns += ["paper says", "printed Avg", "printed rows, mean", "printed rows, pooled"]
    columns += ["ours, mean", "ours, pooled"]
    rows = []
    for other, claims in CLAIMS.items():
        if other not in group.methods:
            continue
        for k, kind in enumerate(("TE", "RE")):
            cells = [f"{PRINTED_NAMES[other]}, {kind}"]
            if paper is not None:
                cells += [_percent(claims[k]), *(_percent(pair[k]) for pair in printed_gains(paper, other))]
            for average in (group.mean, group.pooled_as_paper):
                before, after = average(other)[k], average(PROPOSAL)[k]
                gains = gain(before, after) if len(before) == len(after) else NOTHING
                cells.append(
                    spread(gains, 1).replace("-", "−")
                    + (" %" if np.isfinite(gains).all() and len(gains) else "")
                )
            rows.append(cells)
    notes = [
        "How much smaller the error is; minus: larger. Pooled: rows weighted by their numbers of "
        "sub-sequences, as the benchmark's total does; 01 left out."
    ]
    title = f"What Feature selection gains, {VARIANT_WORDS[group.variant]}"
    return ReportTable(title, columns, rows, notes)


def _percent(value: float | None) -> str:
    return NONE if value is None else f"{value:.1f} %".replace("-", "−")


def difference(ours: Array, printed: float | None) -> float | None:
    """Our mean over seeds less the printed number; None where either is not there."""
    if printed is None or len(ours) == 0 or not np.isfinite(ours).all():
        return None
    return float(ours.mean()) - printed


def is_whole(entry: Entry) -> bool:
    """Whether the benchmark's whole sequence was run and measured as the benchmark does it."""
    expected = EXPECTED_FRAMES.get(entry.sequence.removeprefix(KITTI))
    return entry.sequence.startswith(KITTI) and entry.frames == expected and entry.measure == KITTI_MEASURE


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
    return ReportTable(f"By length, {VARIANT_WORDS[group.variant]}: {group.words}", columns, rows, notes)


def trajectory_table(group: Group) -> ReportTable:
    """ATE and RPE beside the KITTI errors."""
    rows, entries = [], list(group.entries.values())
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
        f"ATE and RPE, {VARIANT_WORDS[group.variant]}",
        columns,
        rows,
        [f"Root mean squares. ATE {alignment.words}; RPE needs none."],
    )


RPE_PARTS = (("translation", "m"), ("rotation", "deg"))


def markdown(table: ReportTable) -> str:
    """A table with its title and notes in Markdown."""
    lines = [table.columns, ["---", *["---:"] * (len(table.columns) - 1)], *table.rows]
    rows = "".join("| " + " | ".join(cell.replace("\n", "<br>") for cell in line) + " |\n" for line in lines)
    head = "".join(f"{line}\n\n" for line in table.head)
    return f"## {table.title}\n\n{head}{rows}" + "".join(f"\n{note}\n" for note in table.notes)
