"""The page of Table 1: sentences, tables and figures, and the files of `vo reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from ..data.catalogue import KITTI
from ..evaluation.kitti_errors import KITTI_PROTOCOL
from ..files import write_atomic
from .film import FILM_ENDING
from .page import (
    NO_CHANGE,
    Picture,
    ReportTable,
    change_limit,
    format_number,
    markdown,
    mean_and_spread,
    plus_minus,
    records_csv,
    render_report,
    seeds_text,
    signed,
)
from .plots import errors_figure, png, trajectories_figure
from .table1 import (
    BENCHMARK_FRAMES,
    CLAIMS,
    ERROR_KINDS,
    PRINTED_NAMES,
    PROPOSAL,
    Group,
    PaperTable,
    Reproduction,
    gain,
    group_records,
    job_folder,
    printed_cells,
    slug,
    table_records,
)

VARIANT_WORDS = {"published": "variant published", "kit": "variant kit"}
FIGURE_4_SEQUENCES = (f"{KITTI}02", f"{KITTI}07")
REMARKS = (
    "The paper calls its numbers RMSE of 11 sequences. The numbers are means; Avg is the mean of ten rows.",
    "The paper's VISO2 average is shown as printed, 2.43 / 1.106; the mean of its rows is 2.10 / 1.247.",
    "The RE of the paper's other three columns is shown as printed. All these values are multiples of 1/180: "
    "radians were probably converted with 5555.6 instead of 5729.6, so the RE is about 3 % too low.",
    "The paper names MESVO_F but does not describe it. In our interpretation, MESVO_F is RANSAC: no prior, "
    "and the candidate with the most inliers wins.",
)


def printed_table() -> ReportTable:
    """The paper's table as printed, with remarks."""
    columns = [f"{name} {kind}" for name in PRINTED_NAMES.values() for kind in ("TE %", "RE deg/100 m")]
    return ReportTable(
        "The paper's Table 1, as printed", ["sequence", *columns], printed_cells(), list(REMARKS)
    )


def layout_tables(group: Group, paper: PaperTable) -> list[ReportTable]:
    """Tables of a group's records: one table, or two (TE and RE) with the paper's numbers.

    A group without errors has no table.
    """
    records = [record for record in group_records(group, paper) if record["te_percent"] is not None]
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
    theirs = ["", ""] if printed is None else [format_number(printed, digits), signed(ours - printed, digits)]
    return [plus_minus(ours, record[f"{kind}_std"]), *theirs]


def caveats(group: Group) -> list[str]:
    """Warnings above a table: incomplete sequences, non-standard sub-sequences."""
    notes = []
    frames = {entry.sequence: len(entry.truth) for entry in group.entries.values() if group.kitti}
    parts = {name: n for name, n in frames.items() if n != BENCHMARK_FRAMES[name]}
    if parts:
        words = ", ".join(f"{name} ({n} of {BENCHMARK_FRAMES[name]} frames)" for name, n in parts.items())
        notes.append(f"Parts of sequences, not comparable with whole sequences: {words}.")
    if group.kitti and group.measure != KITTI_PROTOCOL:
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
        parts.append(
            f"{verb} {name} from {format_number(before)} to {format_number(after)} {unit} ({change})"
        )
    rows, changes = group.averaged, " and ".join(parts) or "changes neither TE nor RE"
    where = rows[0] if len(rows) == 1 else f"Mean of {len(rows)} sequences"
    result = f"{PROPOSAL}, which removes the features in vehicle boxes, {changes}"
    few = {1: "one seed", 2: "two seeds"}.get(by_seed[1].shape[1])
    seeds = f"; with {few}, a change may be due to chance" if few else ""
    return [f"{where}, {VARIANT_WORDS[group.variant]}: {result} compared with {other}{seeds}."]


def write_table_files(
    folder: Path,
    result: Reproduction,
    groups: list[Group],
    paper: PaperTable,
    tables: list[ReportTable],
    conclusions: list[str],
    origin: list[str],
) -> None:
    """Write tables, report and figures; `conclusions` : sentences; `origin` : command and duration."""
    printed = [printed_table()] if any(group.kitti for group in groups) else []
    pictures, films = _pictures(folder, result, groups), _films(folder, result)
    sentences = "".join(f"{line}\n\n" for line in [*conclusions, *result.problems])
    page = render_report(conclusions, tables, printed, pictures, origin, result.problems, films)
    write_atomic(folder / "table1.md", sentences + "\n".join(map(markdown, [*tables, *printed])))
    write_atomic(folder / "table1.csv", records_csv(table_records(groups, paper)))
    write_atomic(folder / "report.html", page)


def _pictures(folder: Path, result: Reproduction, groups: list[Group]) -> list[Picture]:
    """Pictures: the first path, errors, the other paths, and Figure 4 if one of its sequences was run."""
    bars, paths = list[Picture](), list[Picture]()
    for variant in dict.fromkeys(variant for variant, _ in result.paths):
        words = VARIANT_WORDS[variant]
        for group in (group for group in groups if group.variant == variant):
            errors = {key: e.errors for key, e in group.entries.items() if np.isfinite(e.errors).all()}
            if errors:
                figure = errors_figure(f"sub-sequences of {group.measure.words}", errors)
                bars.append(Picture(png(figure), f"Errors, one bar per method; {words}."))
        panels = {name: panel for (key, name), panel in result.paths.items() if key == variant}
        figure_4 = {name: panels[name] for name in FIGURE_4_SEQUENCES if name in panels}
        figures = {f"trajectory_{variant}_{slug(name)}": {name: panel} for name, panel in panels.items()}
        figures |= {f"figure4_{variant}": figure_4} if figure_4 else {}
        for file, rows in figures.items():
            caption = f"{'Figure 4: ' * (rows is figure_4)}{' and '.join(rows)}, paths from above"
            has_truth = any(truth is not None for truth, _ in rows.values())
            caption += f"{', and distances from the truth' * has_truth}; {words}, first seed."
            paths.append(Picture(png(trajectories_figure(rows)), caption))
            write_atomic(folder / f"{file}.png", paths[-1].data)
    return [*paths[:1], *bars, *paths[1:]]


def _films(folder: Path, result: Reproduction) -> list[tuple[str, str]]:
    """Addresses, relative to the report, and captions of the films in the run folders of the first seed."""
    films = []
    for (variant, name), (_, methods) in result.paths.items():
        for method in methods:
            for film in sorted(job_folder(folder, variant, name, method, 0).glob(f"*{FILM_ENDING}")):
                caption = f"{name}, {method}; {VARIANT_WORDS[variant]}, first seed."
                films.append((quote(film.relative_to(folder).as_posix()), caption))
    return films
