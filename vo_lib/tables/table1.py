"""Tables of methods over sequences and seeds, beside the paper's numbers."""

from __future__ import annotations

import numpy as np

from ..core.types import Array
from ..data.kitti import EXPECTED_FRAMES
from ..data.sequence import KITTI
from ..evaluation.kitti import KITTI_MEASURE, pooled
from .entries import Entry, Group, made_by
from .paper import (
    AVERAGE,
    CLAIMS,
    LEFT_OUT,
    PAPER_METHODS,
    PAPER_ROWS,
    PRINTED_NAMES,
    PROPOSAL,
    PaperTable,
    gain,
    printed_gains,
)
from .report import NONE, ReportTable, number, spread

METHOD_COLUMNS = ["method", "TE %", "RE deg/100 m", "removed", "back end ms"]
VARIANT_WORDS = {"published": "the paper as published", "kit": "the kit's way"}
NAMED = 4  # sequences that a sentence lists
DIGITS = 2, 3  # of the TE and RE that the paper prints
NOTHING: Array = np.zeros(0)
BOXED = ("feature_selection", "moving_selection")  # methods that need vehicle boxes


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
    return ReportTable(title, METHOD_COLUMNS, rows, [*notes, made_by(entries)])


def layout_tables(group: Group, paper: PaperTable | None = None, narrow: bool = False) -> list[ReportTable]:
    """A group in the layout of Table 1, what Feature selection gains, and apart the kit's own method.

    Parameters
    ----------
    paper : printed numbers, shown below ours where the group is KITTI's, by the benchmark's lengths.
    narrow : for a terminal of 80 columns: means alone, TE / RE in one cell, no gains.
    """
    paper = paper if group.kitti and group.measure == KITTI_MEASURE else None
    run = [method for method in PAPER_METHODS if method in group.methods]
    # As the paper prints it: every column, with dashes for ours where a system was not run.
    printed = list(PAPER_METHODS) if run and paper is not None else run
    own = [method for method in group.methods if method not in PAPER_METHODS]
    words = f"{VARIANT_WORDS[group.variant]}: {group.words}"
    tables = []
    if printed:
        rows, notes = _rows(group, printed, paper, narrow), _notes(group, paper, narrow)
        tables.append(ReportTable(f"Table 1, {words}", _columns(printed, narrow), rows, notes, _head(group)))
    if PROPOSAL in run and len(run) > 1 and not narrow:
        tables.append(gains_table(group, paper))
    if own:
        rows, notes = _rows(group, own, None, narrow), [_units(group, narrow) + "."]
        tables.append(ReportTable(f"Not in the paper, {words}", _columns(own, narrow), rows, notes))
    return tables


def _columns(methods: list[str], narrow: bool) -> list[str]:
    names = [PRINTED_NAMES.get(method, method) for method in methods]
    if narrow:
        return ["sequence", *(name.replace(" ", "\n") for name in names)]
    return ["sequence", *(f"{name} {kind}" for name in names for kind in ("TE", "RE"))]


def _units(group: Group, narrow: bool) -> str:
    if narrow:
        return "TE in % / RE in deg/100 m, means over seeds"
    return f"TE in %, RE in deg/100 m; {seeds_words(list(group.entries.values()))}"


def _rows(group: Group, methods: list[str], paper: PaperTable | None, narrow: bool) -> list[list[str]]:
    """The paper's rows, ours or dashes beside them; without its numbers the mean and what was run.

    The pooled mean and 01, which has no printed numbers, come last. Unless `narrow`, TE and RE have cells of
    their own, with the spread over seeds and the difference to the paper.
    """
    left_out = f"{KITTI}{LEFT_OUT}"
    several = len(group.sequences) > 1
    rows = []
    nothing = [(NOTHING, NOTHING)] * len(methods)
    means = [group.mean(m) for m in methods]
    if paper is not None:
        rows.append((AVERAGE, means if is_papers(group) else nothing, True))
    if several and not is_papers(group):
        rows.append((f"mean of {len(group.sequences) - (left_out in group.sequences)}", means, False))
    elif several and paper is None:
        rows.append((AVERAGE, means, True))
    known = [f"{KITTI}{row}" for row in PAPER_ROWS if row != AVERAGE] if paper is not None else []
    others = [name for name in group.sequences if name not in known]
    for name in [*known, *sorted(others, key=lambda name: group.kitti and name == left_out)]:
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
            if narrow:
                lines = [" / ".join(spread(o).split(" ±")[0] for o in ours)]
                lines += [" / ".join(map(number, printed, DIGITS))] if printed[0] is not None else []
                cells.append("\n".join(lines))
            else:
                cells += [_cell(o, p, d, whole) for o, p, d in zip(ours, printed, DIGITS, strict=True)]
        table.append([name, *cells])
    return table


def _cell(ours: Array, printed: float | None, digits: int, comparable: bool) -> str:
    """Ours with its spread; below it the printed number; below that our difference where they compare."""
    gap = difference(ours, printed) if comparable else None
    lines = [spread(ours), *([] if printed is None else [number(printed, digits)])]
    return "\n".join([*lines, *([] if gap is None else [f"{gap:+.3f}".replace("-", "−")])])


def _head(group: Group) -> list[str]:
    """What has to be known before a table is read: what made it, and whether there were boxes at all."""
    head = [*(partial_notes(group) if group.kitti else []), made_by(group.entries.values())]
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


def _notes(group: Group, paper: PaperTable | None, narrow: bool) -> list[str]:
    units = _units(group, narrow)
    if narrow:
        return [f"{units}; below, the paper's." if paper is not None else f"{units}."]
    notes = [f"{units}."]
    if paper is not None:
        compared = any(is_whole(entry) for entry in group.entries.values())
        notes[0] += " Below ours, the paper's number" + (
            "; below that ours less the paper's, of whole sequences." if compared else "."
        )
    if len(group.sequences) > 1:
        mean = "Avg or mean, without 01" if group.kitti else "mean"
        notes.append(
            f"{mean}: each sequence counts the same; pooled: each sub-sequence does, as on KITTI's server."
        )
    return notes


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
    return ReportTable(title, columns, rows, notes, partial_notes(group) if group.kitti else [])


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
