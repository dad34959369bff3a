"""The page of Table 1: sentences, tables and figures, and the files of `vo reproduce`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from ..data.catalogue import KITTI
from ..evaluation.kitti_errors import FEW_SUBSEQUENCES, KITTI_PROTOCOL, subsequences_text
from ..evaluation.path_facts import path_difference, path_length
from ..evaluation.statistics import COUNTED, NO_CHANGE, mean_and_deviation, one_run_shows
from ..files import write_atomic
from ..geometry.types import Array
from ..runs.folder import read_run, written_together
from ..runs.jobs import Outcome
from ..runs.match_cache import CachedMatches
from .blocks import Block, settings_folder
from .film import FILM_ENDING, poster, removal_image
from .page import (
    COUNT_COLUMN,
    FEW_NOTE,
    NO_NUMBER,
    Picture,
    ReportTable,
    ShownFilm,
    few_marked,
    format_number,
    markdown,
    plus_minus,
    records_csv,
    render_report,
    seeds_text,
    signed,
)
from .paper_unit import PAPERS_FACTOR, PAPERS_OWN, RE_KIND, RIGHT_FACTOR
from .plots import errors_figure, is_straight, jpeg, png, trajectories_figure
from .record import RECORD, record_json
from .table1 import (
    BENCHMARK_FRAMES,
    CLAIMS,
    ERROR_KINDS,
    POSITION_NOTE,
    PRINTED_NAMES,
    PROPOSAL,
    DrawnPaths,
    Group,
    PaperTable,
    Reproduction,
    gain,
    group_records,
    printed_cells,
    table_records,
    too_short_words,
)
from .table1_plan import job_folder, slug

TABLE = "table1.csv"
MARKDOWN = "table1.md"
REPORT = "report.html"
TWO_COLUMNS_IN = 6.0  # a wider figure, in inches, takes two columns of the report
VARIANT_WORDS = {"published": "variant published", "kit": "variant kit"}
RIGHT_UNIT_COLUMN = "printed, in the right unit"
UNIT_NOTE = (
    f"{RIGHT_UNIT_COLUMN}: the RE that the paper computed itself ({', '.join(PAPERS_OWN)}) times "
    f"{RIGHT_FACTOR:.1f} / {PAPERS_FACTOR:.1f}, since it was probably converted with the latter (chapter 6). "
    "The difference is ours minus this number."
)
FIGURE_4_SEQUENCES = (f"{KITTI}02", f"{KITTI}07")
REMARKS = (
    "The paper calls its numbers RMSE of 11 sequences. The numbers are means; Avg is the mean of ten rows.",
    "The paper's VISO2 average is shown as printed, 2.43 / 1.106; the mean of its rows is 2.10 / 1.247.",
    "The RE of the paper's other three columns is shown as printed. For each sequence it is a multiple of "
    f"1/180: radians were probably converted with {PAPERS_FACTOR:.1f} instead of {RIGHT_FACTOR:.1f}, so it "
    "is about 3 % too low.",
    "The paper names MESVO_F but does not describe it. In our interpretation, MESVO_F is RANSAC: no prior, "
    "and the candidate with the most inliers wins.",
)


def printed_table() -> ReportTable:
    """The paper's table as printed, with remarks."""
    columns = ["sequence"]
    for name in PRINTED_NAMES.values():
        columns += [f"{name} TE %", f"{name} RE deg/100 m"]
    return ReportTable("The paper's Table 1, as printed", columns, printed_cells(), list(REMARKS))


def layout_tables(group: Group, paper: PaperTable, differs: Iterable[str] = ()) -> list[ReportTable]:
    """Tables of a group's records: one table, or two (TE and RE) with the paper's numbers.

    A group without errors has no table. `differs` : sentences on what differs from the presets.
    """
    records = [record for record in group_records(group, paper) if record["te_percent"] is not None]
    if not records:
        return []
    if any(record["paper_te_percent"] is not None for record in records):
        tables = [_table_beside_paper(group, records, kind) for kind in ERROR_KINDS]
    else:
        tables = [_table_of_ours(group, records)]
    tables[0].head.extend(f"Settings: {sentence}" for sentence in differs)
    tables[0].head.extend(caveats(group))
    tables[-1].notes.extend(_notes_below(group, records))
    return tables


def _notes_below(group: Group, records: list[dict[str, Any]]) -> list[str]:
    """What the numbers and the rows of a group's tables mean."""
    seeds = max(record["seeds"] for record in records)
    notes = [f"{seeds_text(seeds).capitalize()}; removed %: share of the features that the box rule removes."]
    if len(group.sequences) > 1:
        mean = "Avg and mean, without 01" if group.is_kitti else "mean"
        notes.append(
            f"{mean}: all sequences have equal weight; pooled: all sub-sequences, as on KITTI's server."
        )
    if seeds > 1:
        notes.append(COUNTED)  # when a change counts: if one run would show it
    if any(record["sub_sequence_count"] < FEW_SUBSEQUENCES for record in records):
        notes.append(FEW_NOTE)
    return notes


def tables_by_settings(groups: list[Group]) -> list[ReportTable]:
    """For each set of sequences in several blocks, a table of each method with the settings of each block."""
    groups_of_set: dict[tuple[Any, ...], list[Group]] = {}
    for group in groups:
        key = (group.variant, group.is_kitti, group.protocol, tuple(group.sequences))
        groups_of_set.setdefault(key, []).append(group)
    tables = []
    for alike in groups_of_set.values():
        table = _table_by_settings(alike)
        if len(alike) > 1 and table.rows:
            tables.append(table)
    return tables


def _table_by_settings(groups: list[Group]) -> ReportTable:
    """The mean errors of each method with the settings of each group; the groups differ only in settings."""
    first = groups[0]
    most = max(len(group.averaged_entries(method)) for group in groups for method in group.methods)
    rows = []
    for method in first.methods:
        for group in groups:
            errors = [mean_and_deviation(errors_of_seeds) for errors_of_seeds in group.mean(method)]
            if np.isfinite([mean for mean, _ in errors]).all():
                is_used = not any(entry.unused for entry in group.of_method(method))
                label = _method_with_settings(method, group.settings, is_used)
                count = len(group.averaged_entries(method))
                if count < most:  # a run failed on the others
                    label += f" (mean of {count})"
                rows.append([label, *(plus_minus(mean, deviation) for mean, deviation in errors)])
    title = f"{_sequences_words(first)}, {VARIANT_WORDS[first.variant]}: each method by its settings"
    units = [unit for unit, _ in ERROR_KINDS.values()]
    notes = []
    if most > 1:
        notes.append(f"Means over {most} sequences of equal weight.")
    return ReportTable(title, ["method, settings", *units], rows, notes)


def _method_with_settings(method: str, settings: str, is_used: bool) -> str:
    """The name of a row: a method, the settings of its block as typed, and whether it uses them."""
    label = f"{method}, {settings or 'presets'}"
    return label if is_used else f"{label} (not used)"


def short_path_tables(result: Reproduction) -> list[ReportTable]:
    """For each block and each sequence that is too short for errors, how far each path is from the truth."""
    why_short: dict[tuple[str, tuple[str, str]], str] = {}
    for entry in result.entries:
        if not np.isfinite(entry.errors).any():
            why_short[entry.sequence, entry.block_key] = too_short_words(entry.truth, entry.protocol)
    tables = []
    for (block, name), (truth, paths) in result.paths.items():
        why = why_short.get((name, block.key))
        if truth is None or why is None:
            continue
        rows = []
        for method, poses in paths.items():
            apart = path_difference(truth, poses)
            numbers = (path_length(poses), apart.end, apart.rmse)
            rows.append([method, *(format_number(number, 3) for number in numbers)])
        notes = [
            f"No TE and RE, since {why}. The true path has {path_length(truth):.2f} m.",
            POSITION_NOTE,
        ]
        title = f"{name}, {block_words(block.variant, block.words)}, first seed: distances from the true path"
        tables.append(ReportTable(title, ["method", "length m", "end error m", "rmse error m"], rows, notes))
    return tables


def settings_tables_without_truth(result: Reproduction) -> list[ReportTable]:
    """For each sequence without truth in several blocks, how far the settings move each method's path."""
    paths_of_blocks: dict[tuple[str, str], dict[Block, dict[str, Array]]] = {}
    for (block, name), (truth, paths) in result.paths.items():
        if truth is None:
            paths_of_blocks.setdefault((block.variant, name), {})[block] = paths
    tables = []
    for (variant, name), paths_by_block in paths_of_blocks.items():
        if len(paths_by_block) > 1:
            tables.append(_settings_table_without_truth(variant, name, paths_by_block))
    return tables


def _settings_table_without_truth(
    variant: str, name: str, paths_by_block: dict[Block, dict[str, Array]]
) -> ReportTable:
    """How far each method's path on a sequence is, in each block, from its path in the first one.

    paths_by_block : each method's path (N, 4, 4), by block.
    """
    first = next(iter(paths_by_block))
    methods: dict[str, None] = {}  # of all blocks, each once
    for paths in paths_by_block.values():
        methods |= dict.fromkeys(paths)
    rows = []
    for method in methods:
        for block, paths in paths_by_block.items():
            if method not in paths:
                continue
            cells = [format_number(path_length(paths[method]), 2), NO_NUMBER, NO_NUMBER]
            if method in paths_by_block[first]:
                apart = path_difference(paths_by_block[first][method], paths[method])
                cells[1:] = [format_number(apart.end, 2), format_number(apart.rmse, 2)]
            label = _method_with_settings(method, block.words, is_used=not block.unused(method))
            rows.append([label, *cells])
    title = f"{name}, {VARIANT_WORDS[variant]}, each method by its settings: no ground truth, first seed"
    note = (
        f"apart: distance of the positions from those of the same method with {first.words or 'presets'}, "
        "from the same start, at the end and as rmse. These are no errors: they do not tell which path is "
        "right."
    )
    columns = ["method, settings", "length m", "end apart m", "rmse apart m"]
    return ReportTable(title, columns, rows, [note])


def _title(group: Group) -> str:
    """The sequences of a group and its variant."""
    return f"{_sequences_words(group)}, {block_words(group.variant, group.settings)}"


def _sequences_words(group: Group) -> str:
    """The sequences of a group."""
    if len(group.sequences) == 1:
        return group.sequences[0]
    return "KITTI" if group.is_kitti else f"{len(group.sequences)} sequences"


def block_words(variant: str, settings: str) -> str:
    """The variant and the settings of a block, such as "variant published, selection.threshold=1.0"."""
    return f"{VARIANT_WORDS[variant]}, {settings}" if settings else VARIANT_WORDS[variant]


def _table_of_ours(group: Group, records: list[dict[str, Any]]) -> ReportTable:
    """TE and RE of a group's records, side by side."""
    units = [unit for unit, _ in ERROR_KINDS.values()]
    rows = []
    for record in records:
        errors = [plus_minus(record[kind], record[f"{kind}_std"]) for kind in ERROR_KINDS]
        count = few_marked(record["sub_sequence_count"])
        rows.append([_row_name(group, record), *errors, count, _removed(record)])
    title = f"{_title(group)}: sub-sequences of {group.protocol_words}"
    return ReportTable(title, ["method", *units, COUNT_COLUMN, "removed %"], rows, [])


def _table_beside_paper(group: Group, records: list[dict[str, Any]], kind: str) -> ReportTable:
    """One kind of error, ours beside the paper's, with the difference where the paper has a number.

    A printed RE is also shown in the right unit (`paper_unit`), from which the difference is taken.
    """
    unit, digits = ERROR_KINDS[kind]
    compared = {"printed": f"paper_{kind}"}
    if kind == RE_KIND:
        compared[RIGHT_UNIT_COLUMN] = f"paper_{kind}_right_unit"
    rows = []
    for record in records:
        ours = plus_minus(record[kind], record[f"{kind}_std"])
        if record[f"paper_{kind}"] is None:
            beside = [""] * (len(compared) + 1)
        else:
            beside = [format_number(record[name], digits) for name in compared.values()]
            beside.append(signed(record[f"{kind}_difference"], digits))
        count = few_marked(record["sub_sequence_count"])
        rows.append([_row_name(group, record), ours, *beside, count, _removed(record)])
    title = f"{_title(group)}, {unit.split()[0]}: sub-sequences of {group.protocol_words}"
    columns = ["method", f"{unit}, ours", *compared, "difference", COUNT_COLUMN, "removed %"]
    notes = [UNIT_NOTE] if kind == RE_KIND else []
    return ReportTable(title, columns, rows, notes)


def _row_name(group: Group, record: dict[str, Any]) -> str:
    """The method of a row, after its sequence if the group has several."""
    method = str(record["method"])
    has_several = len(group.sequences) > 1
    return f"{record['sequence'].removeprefix(KITTI)} {method}" if has_several else method


def _removed(record: dict[str, Any]) -> str:
    """The share of the features that were removed, as a cell, %."""
    share = record["removed_share"]
    return "" if share is None else f"{100 * share:.1f}"


def caveats(group: Group) -> list[str]:
    """Warnings above a table: incomplete sequences, non-standard sub-sequences."""
    notes = []
    parts: dict[str, None] = {}  # each once
    if group.is_kitti:
        for entry in group.entries.values():
            all_frames = BENCHMARK_FRAMES[entry.sequence]
            if len(entry.truth) != all_frames:
                parts[f"{entry.sequence} ({len(entry.truth)} of {all_frames} frames)"] = None
    if parts:
        words = ", ".join(parts)
        notes.append(f"Parts of sequences, not comparable with whole sequences: {words}.")
    if group.protocol != KITTI_PROTOCOL:
        notes.append(f"Sub-sequences of {group.protocol.words}: not comparable with the benchmark.")
    return notes


def sentences_on_proposal(groups: list[Group]) -> list[str]:
    """Sentences that compare the proposal with other methods, for each group.

    They answer one question: would one run show the change? The other method is `solution_selection` and, in
    a group with the paper's sequences, also `mesvo_f`.
    """
    sentences = []
    for group in groups:
        others = list(CLAIMS) if group.is_papers(PROPOSAL) else ["solution_selection"]
        for other in others:
            sentences += _comparison(group, other)
    return sentences


def _comparison(group: Group, other: str) -> list[str]:
    """A sentence on the mean errors of the proposal and of another method.

    There is none without boxes or errors, nor if the means are over different sequences, since a run failed.
    """
    averaged = [entry.sequence for entry in group.averaged_entries(PROPOSAL)]
    if averaged != [entry.sequence for entry in group.averaged_entries(other)]:
        return []
    errors_of_other = group.mean(other)
    errors_of_proposal = group.mean(PROPOSAL)
    for errors in (errors_of_other, errors_of_proposal):
        if errors.size == 0 or not np.isfinite(errors).all():
            return []
    if not any(entry.has_boxes for entry in group.of_method(PROPOSAL)):
        return []
    changes = []
    for place, (error, _) in enumerate(ERROR_KINDS.values()):
        claim = CLAIMS[other][place] if group.is_papers(PROPOSAL) else None
        changes.append(_change(error, errors_of_other[place], errors_of_proposal[place], claim))
    words = " and ".join(change for change in changes if change) or "changes neither TE nor RE"
    where = averaged[0] if len(averaged) == 1 else f"Mean of {len(averaged)} sequences"
    sentence = (
        f"{where}, {block_words(group.variant, group.settings)}: {PROPOSAL}, which removes the features in "
        f"vehicle boxes, {words} compared with {other}"
    )
    count = sum(entry.subsequences for entry in group.averaged_entries(PROPOSAL))
    if count < FEW_SUBSEQUENCES:
        sentence += f", from {subsequences_text(count)}"
    seeds = min(errors_of_other.shape[1], errors_of_proposal.shape[1])
    if seeds == 1:
        sentence += "; one seed does not tell whether another run would show this"
    elif seeds == 2:
        sentence += "; two seeds give only a rough standard deviation"
    return [f"{sentence}."]


def _change(error: str, before: Array, after: Array, claim: float | None) -> str:
    """Words on the change of an error (S,) over seeds, such as "lowers TE from 1.6 to 0.5 % (−69.2 %)".

    An error is lowered or raised only if one run would show it; otherwise it "changes". Empty for equal
    means.

    error : its name and unit; claim : the paper's gain in %.
    """
    name, unit = error.split(" ", 1)
    mean, deviation = mean_and_deviation(before)
    new_mean, new_deviation = mean_and_deviation(after)
    if mean == new_mean:
        return ""
    gain_percent = float(gain(mean, new_mean))
    verb = "changes"
    change = f"{signed(-gain_percent, 1)} %"
    shown = one_run_shows(mean, deviation, new_mean, new_deviation)  # None for a single seed
    if shown:
        verb = "lowers" if gain_percent > 0 else "raises"
    elif shown is False:
        # Within 2 %, or two standard deviations of the difference between two runs.
        change = f"which one run would not show: {NO_CHANGE}"
    if claim is not None:
        change += f", in the paper −{claim:g} %"
    return f"{verb} {name} from {format_number(mean)} to {format_number(new_mean)} {unit} ({change})"


def write_table_files(
    folder: Path,
    result: Reproduction,
    groups: list[Group],
    paper: PaperTable,
    tables: list[ReportTable],
    conclusions: list[str],
    origin: list[str],
    removals: list[Picture],
    record: dict[str, Any],
) -> None:
    """Write tables, report, figures and the record; on a full disk, the files from before remain.

    Parameters
    ----------
    groups : of the result's entries; tables : all of the report, but for the paper's own.
    conclusions : sentences at the top.
    origin : command and duration.
    removals : images of frames with boxes and features.
    record : as in `reproduction_record`.

    Raises `DataError` if the folder cannot be written.
    """
    printed = [printed_table()] if any(group.is_kitti for group in groups) else []
    films = _films(folder, result)
    sentences = "".join(f"{line}\n\n" for line in [*conclusions, *result.problems])
    with written_together(folder) as draft:
        pictures = _pictures(draft, result, groups, removals)
        page = render_report(conclusions, tables, printed, pictures, origin, result.problems, films)
        write_atomic(draft / MARKDOWN, sentences + "\n".join(map(markdown, [*tables, *printed])))
        write_atomic(draft / TABLE, records_csv(table_records(groups, paper)))
        write_atomic(draft / RECORD, record_json(record))
        write_atomic(draft / REPORT, page)


def table_files(blocks: Iterable[Block], sequences: list[str]) -> list[str]:
    """Names of the files of `write_table_files` for these blocks and sequences."""
    names = [TABLE, MARKDOWN, RECORD, REPORT]
    for block in blocks:
        names.append(_figure_4_name(block))
        names += [_picture_name(block, sequence) for sequence in sequences]
    return names


def _picture_name(block: Block, sequence: str) -> str:
    """The name of the file with the paths of a block on a sequence."""
    return f"trajectory_{_block_name(block)}_{slug(sequence)}.png"


def _figure_4_name(block: Block) -> str:
    """The name of the file with the paths of a block on the sequences of the paper's Figure 4."""
    return f"figure4_{_block_name(block)}.png"


def _block_name(block: Block) -> str:
    """The part of a file's name that tells the block."""
    return f"{block.variant}_{settings_folder(block.changes)}" if block.changes else block.variant


def removal_pictures(outcomes: Iterable[Outcome], cache: Path | None = None) -> list[Picture]:
    """For each sequence, an image with boxes and features from the run of the proposal with the first seed.

    The image is that of the frame of which the run removed the most features. `cache` : the folder with the
    matches of the runs, by default in the user's cache folder.
    """
    pictures: dict[str, Picture] = {}
    for outcome in outcomes:
        job = outcome.job
        name = job.sequence.name
        if outcome.error is not None or job.method != PROPOSAL or job.config.seed != 0 or name in pictures:
            continue
        matches = CachedMatches(job.sequence, job.config, cache)
        found = removal_image(read_run(job.folder, job.sequence), matches)
        if found is not None:
            index, image = found
            caption = (
                f"{name}, frame {job.sequence.frames[index]}, of which {PROPOSAL} removes the most features: "
                "orange features are in vehicle boxes (white) and removed, blue features are kept."
            )
            pictures[name] = Picture(jpeg(image), caption, "wide")
    return list(pictures.values())


def _pictures(
    folder: Path, result: Reproduction, groups: list[Group], removals: list[Picture]
) -> list[Picture]:
    """Draw the pictures of the report, and write those of paths into the folder as well.

    The first ones are a frame, errors and a path. Figure 4 is among the others if one of its sequences was
    run.
    """
    bars = []
    paths = []
    for block in dict.fromkeys(block for block, _ in result.paths):
        for group in groups:
            if group.block_key == block.key:
                bars += _error_bars(group)
        panels = {name: panel for (of_block, name), panel in result.paths.items() if of_block == block}
        drawn = {name: png(trajectories_figure({name: panel})) for name, panel in panels.items()}
        for name, panel in panels.items():
            write_atomic(folder / _picture_name(block, name), drawn[name])
            paths.append(_path_picture(block, {name: panel}, drawn[name]))
        figure_4 = {name: panels[name] for name in FIGURE_4_SEQUENCES if name in panels}
        if figure_4:
            first, *others = figure_4
            data = png(trajectories_figure(figure_4)) if others else drawn[first]
            write_atomic(folder / _figure_4_name(block), data)
            paths.append(_path_picture(block, figure_4, data, "Figure 4: "))
    if removals:
        return [removals[0], *bars[:1], *paths[:1], *bars[1:], *removals[1:], *paths[1:]]
    return [*paths[:1], *bars, *paths[1:]]


def _error_bars(group: Group) -> list[Picture]:
    """A picture of a group's errors; none for a group without errors."""
    errors = {}
    for key, entry in group.entries.items():
        if np.isfinite(entry.errors).all():
            errors[key] = entry.errors
    if not errors:
        return []
    figure = errors_figure(f"sub-sequences of {group.protocol_words}", errors)
    caption = f"Errors, one bar per method; {block_words(group.variant, group.settings)}."
    place = "two" if figure.get_figwidth() > TWO_COLUMNS_IN else "tall"
    return [Picture(png(figure), caption, place)]


def _path_picture(block: Block, panels: dict[str, DrawnPaths], data: bytes, heading: str = "") -> Picture:
    """The drawn paths of the sequences in `panels` from above, with distances where there is truth.

    Of a straight drive, the first chart is the error to the side or, without truth, the distance to the side
    of a straight line.
    """
    names_by_chart: dict[str, list[str]] = {}
    for name, (truth, paths) in panels.items():
        names_by_chart.setdefault(_chart_words(truth, paths), []).append(name)
    if len(names_by_chart) == 1:
        charts = next(iter(names_by_chart))
    else:
        charts = " and ".join(f"{words} ({', '.join(names)})" for words, names in names_by_chart.items())
    caption = f"{heading}{' and '.join(panels)}: {charts}"
    has_truth = any(truth is not None for truth, _ in panels.values())
    if has_truth:
        caption += ", and distances from the truth"
    caption += f"; {block_words(block.variant, block.words)}, first seed."
    return Picture(data, caption, "two" if has_truth else "")


def _chart_words(truth: Array | None, estimates: Mapping[str, Array]) -> str:
    """What the first chart of a sequence shows."""
    if not is_straight(truth, estimates):
        return "paths from above"
    if truth is not None:
        return "errors to the side, magnified, since the drive is straight"
    first = next(iter(estimates))
    return (
        "distances to the side of the line from the start to the end of the path of "
        f"{first}, magnified, since the drive is straight"
    )


def _films(folder: Path, result: Reproduction) -> list[ShownFilm]:
    """The films in the run folders of the first seed."""
    films: dict[str, ShownFilm] = {}
    for (block, name), (_, methods) in result.paths.items():
        for method in methods:
            run_folder = job_folder(folder, block.variant, name, method, 0, block.used(method))
            for film in sorted(run_folder.glob(f"*{FILM_ENDING}")):
                caption = f"{name}, {method}; {block_words(block.variant, block.words)}, first seed."
                address = quote(film.relative_to(folder).as_posix())
                films.setdefault(address, ShownFilm(address, caption, poster(film)))  # blocks may share it
    return list(films.values())
