"""Tables of methods over sequences and seeds, beside the paper's numbers."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..core.types import Array
from ..data.sequence import KITTI
from ..evaluation.ate_rpe import rmse
from ..evaluation.kitti import KITTI_MEASURE
from .entries import Entry, Group, made_by, over_seeds
from .paper import CLAIMS, PAPER_METHODS, PRINTED_NAMES, PROPOSAL, PaperTable, gain, printed_gains
from .report import NONE, ReportTable, mean_and_spread, minus, number, seeds_words, spread, te_re
from .table1_data import WHOLE, Row, difference, group_rows, is_whole, papers_numbers, printed_numbers

METHOD_COLUMNS = ["method", "TE %", "RE deg/100 m", "removed", "back end ms"]
VARIANT_WORDS = {"published": "the paper as published", "kit": "the kit's way"}
NAMED = 4  # sequences that a sentence lists
DIGITS = 2, 3  # of the TE and RE that the paper prints
BOXED = ("feature_selection", "moving_selection")  # methods that need vehicle boxes
NOTHING: Array = np.zeros((2, 0))


def method_table(entries: list[Entry]) -> ReportTable:
    """The methods on one sequence, a row each."""
    rows = [
        [e.method, spread(e.te), spread(e.re), f"{100 * e.removed_share:.1f} %", f"{e.back_end_ms:.1f}"]
        for e in entries
    ]
    over = seeds_words(max(len(entry.seeds) for entry in entries))
    notes = [f"TE and RE over sub-sequences of {entries[0].measure.words}, as far as the path goes; {over}."]
    title = f"{entries[0].sequence}, {VARIANT_WORDS[entries[0].variant]}"
    return ReportTable(title, METHOD_COLUMNS, rows, [*notes, made_by(entries)])


def layout_tables(group: Group, paper: PaperTable, narrow: bool = False) -> list[ReportTable]:
    """A group in the layout of Table 1, what Feature selection gains, and apart the kit's own method.

    Parameters
    ----------
    paper : printed numbers, shown below ours where the group is KITTI's, by the benchmark's lengths.
    narrow : for a terminal of 80 columns: means alone, TE / RE in one cell, no gains.
    """
    theirs = papers_numbers(group, paper)
    rows = group_rows(group, theirs)
    run = [method for method in PAPER_METHODS if method in group.methods]
    # As the paper prints it: every column, with dashes for ours where a system was not run.
    printed = list(PAPER_METHODS) if run and theirs is not None else run
    own = [method for method in group.methods if method not in PAPER_METHODS]
    words = f"{VARIANT_WORDS[group.variant]}: {group.words}"
    units = "TE in % / RE in deg/100 m, means over seeds" if narrow else "TE in %, RE in deg/100 m; "
    units += "" if narrow else seeds_words(group.seeds)
    tables = []
    if printed:
        title = f"{'Table 1' if group.kitti else 'The systems of Table 1'}, {words}"
        cells = [_cells(row, printed, theirs, narrow) for row in rows]
        notes = _notes(group, units, theirs, narrow)
        tables.append(ReportTable(title, _columns(printed, narrow), cells, notes, caveats(group)))
    if PROPOSAL in run and len(run) > 1 and not narrow and np.isfinite(group.mean(PROPOSAL)).any():
        tables.append(gains_table(group, theirs))
    if own:
        cells = [_cells(row, own, None, narrow) for row in rows if {*own} & {*row.errors}]
        title = f"Not in the paper, {words}"
        tables.append(ReportTable(title, _columns(own, narrow), cells, [f"{units}."]))
    return tables


def _columns(methods: list[str], narrow: bool) -> list[str]:
    names = [PRINTED_NAMES.get(method, method) for method in methods]
    if narrow:
        return ["sequence", *(name.replace(" ", "\n") for name in names)]
    return ["sequence", *(f"{name} {kind}" for name in names for kind in ("TE", "RE"))]


def _cells(row: Row, methods: list[str], paper: PaperTable | None, narrow: bool) -> list[str]:
    """The row's name; of each method TE and RE over the printed numbers over the differences of whole runs.

    Narrow, both in one cell, and no differences.
    """
    cells = [row.name.removeprefix(KITTI)]
    for method in methods:
        ours, printed = row.errors.get(method, NOTHING), printed_numbers(paper, row, method)
        lines = [[number(mean_and_spread(values)[0]) if narrow else spread(values) for values in ours]]
        if printed != (None, None):
            lines.append([number(*each) for each in zip(printed, DIGITS, strict=True)])
        gaps = [difference(*each) for each in zip(ours, printed, strict=True)]
        if row.comparable and not narrow and gaps != [None, None]:
            lines.append([NONE if gap is None else minus(f"{gap:+.3f}") for gap in gaps])
        cells += (
            ["\n".join(" / ".join(line) for line in lines)]
            if narrow
            else map("\n".join, zip(*lines, strict=True))
        )
    return cells


def caveats(group: Group) -> list[str]:
    """What has to be known before a table is read: what is no whole sequence, and where no boxes were."""
    said = []
    frames = {entry.sequence: len(entry.truth) for entry in group.entries.values() if group.kitti}
    short = [f"{name} ({n} of {WHOLE[name]} frames)" for name, n in frames.items() if n != WHOLE[name]]
    if short:
        said.append(f"Parts of a sequence, not comparable with whole ones: {', '.join(short)}.")
    if group.kitti and group.measure != KITTI_MEASURE:
        said.append(f"Not the benchmark's sub-sequences, but {group.measure.words}: not comparable with it.")
    without = [name for name in group.sequences if not all(e.labels for e in group.of_sequence(name))]
    if without and any(method in group.methods for method in BOXED):
        names = ", ".join(without) if len(without) <= NAMED else f"{len(without)} sequences"
        said.append(
            f"No vehicle boxes on {names}: Feature selection removes nothing there and equals Solution "
            "selection. `--detector MODEL` finds boxes."
        )
    return said


def _notes(group: Group, units: str, paper: PaperTable | None, narrow: bool) -> list[str]:
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
    return [*notes, made_by(group.entries.values())]


def gains_table(group: Group, paper: PaperTable | None) -> ReportTable:
    """By how much Feature selection is better than Solution selection and MESVO_F: printed, and ours."""
    columns = ["Feature selection over"]
    if paper is not None:
        columns += ["paper says", "printed Avg", "printed rows, mean", "printed rows, pooled"]
    several = len(group.sequences) > 1
    columns += ["ours, mean", "ours, pooled"] if several else ["ours"]
    rows = []
    for other, claims in CLAIMS.items():
        for k, kind in enumerate(("TE", "RE") if other in group.methods else ()):
            cells = [f"{PRINTED_NAMES[other]}, {kind}"]
            if paper is not None:
                printed = [claims[k], *(pair[k] for pair in printed_gains(paper, other))]
                cells += [_percent(np.array([value], float)) for value in printed]
            for average in (group.mean, partial(group.pooled, as_paper=True))[: 1 + several]:
                before, after = average(other)[k], average(PROPOSAL)[k]
                cells.append(_percent(gain(before, after) if len(before) == len(after) else np.zeros(0)))
            rows.append(cells)
    notes = ["How much smaller the error is; minus: larger."]
    if paper is not None or several:
        notes[0] += " Pooled: rows weighted by their numbers of sub-sequences, as the benchmark's total does"
        notes[0] += "; 01 left out." if group.kitti else "."
    title = f"What Feature selection gains, {VARIANT_WORDS[group.variant]}"
    return ReportTable(title, columns, rows, notes, caveats(group))


def _percent(values: Array) -> str:
    text = minus(spread(values, 1))
    return text if text == NONE else f"{text} %"


def length_table(group: Group) -> ReportTable:
    """TE / RE of each sequence and method by the sub-sequence lengths that there are, all seeds together."""
    parts = {f"{e.sequence}, {e.method}": e.sub_sequences for e in group.entries.values()}
    found = {float(at) for part in parts.values() for at in part.length}
    lengths = [at for at in group.measure.lengths if at in found]
    rows = [[name, *(te_re(at) for at in part.by_length(lengths).values())] for name, part in parts.items()]
    columns = ["sequence, method", *(f"{length:g} m" for length in lengths)]
    notes = ["TE in % / RE in deg/100 m, mean over seeds."]
    return ReportTable(f"By length, {VARIANT_WORDS[group.variant]}: {group.words}", columns, rows, notes)


def trajectory_table(group: Group) -> ReportTable:
    """ATE and RPE beside the KITTI errors."""
    rows, entries = [], list(group.entries.values())
    for entry in entries:
        ate = over_seeds(rmse(result.ate.distance) for result in entry.results)
        step = 1e3 * over_seeds(rmse(result.rpe.translation) for result in entry.results)
        turn = np.degrees(over_seeds(rmse(result.rpe.rotation) for result in entry.results))
        rows.append([f"{entry.sequence}, {entry.method}", spread(ate), spread(step, 2), spread(turn, 4)])
    columns = ["sequence, method", "ATE m", "RPE mm a frame", "RPE deg a frame"]
    notes = [f"Root mean squares. ATE {entries[0].results[0].ate.alignment.words}; RPE needs none."]
    return ReportTable(f"ATE and RPE, {VARIANT_WORDS[group.variant]}", columns, rows, notes)
