"""Sweeps: runs of methods over a grid of settings and several seeds, on each of several sequences.

Without ground truth, each path is compared with that of the reference: the runs of the same method in which
no axis changes a setting. Their settings are those of the preset, changed by --config if there is one.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import settings
from ..data.sequence import Sequence
from ..evaluation.kitti_errors import is_as_kitti, kitti_errors, subsequences_text, suitable_protocol
from ..evaluation.path_facts import PathDifference, path_difference, path_length
from ..evaluation.statistics import change_limit, mean_and_deviation
from ..geometry.types import Array
from ..paper.settings import MethodConfig
from ..runs.drive import Run
from ..runs.folder import read_run
from ..runs.jobs import Job, Outcome
from ..runs.run_quality import warnings_of
from .blocks import (
    Axes,
    Changes,
    changed,
    combinations,
    refuse_if_unused,
    settings_folder,
    settings_words,
)
from .breaking import broken
from .page import (
    NO_NUMBER,
    ReportTable,
    finite_or_none,
    format_number,
    plus_minus,
    seeds_text,
    without_empty_columns,
)
from .plots import LETTERS, LINE_HEIGHT, SMALL_PAGE, figure_page, letters_beside, png
from .table1 import (
    ERROR_KINDS,
    POSITION_NOTE,
    alike_warnings,
    back_end_ms,
    measure_runs,
    number_fields,
    too_short_words,
)
from .table1_plan import jobs_of, slug

if TYPE_CHECKING:
    from matplotlib.axes import Axes as PlotAxes
    from matplotlib.figure import Figure

NOT_USED = " (not used)"
CELLS = "cells"  # folder of the runs in the folder of a sweep
DEFAULT = "default"  # folder of the reference, if it is none of the combinations on the axes
# Fields of a record for a path without ground truth: how far it is from the path of the reference. It is the
# distance at the end, and the root mean square of all distances.
END_APART = "end_apart_m"
RMSE_APART = "rmse_apart_m"
# The same for a path with truth that is shorter than every sub-sequence: how far it is from the true path.
END_ERROR = "end_error_m"
RMSE_ERROR = "rmse_error_m"
# The columns in which tables show these fields.
APART_KINDS = {END_APART: "end apart m", RMSE_APART: "rmse apart m"}
POSITION_KINDS = {END_ERROR: "end error m", RMSE_ERROR: "rmse error m"}
METHOD_AXIS = "method"  # the name of the axis that several methods make
DEFAULT_SETTINGS = "the default settings"  # the reference in words, if it has the presets
SAME_PATH_M = 0.0005  # a smaller distance is printed as 0.000 m
# The heat map. Heights and widths are in inches.
LEAST_LETTERS = 12  # in a line of a value below it
COLUMN_WIDTH = 1.1  # of a value with so few letters
ROW_LETTERS = 24  # in a line of the values beside it
ROW_HEIGHT = 0.55  # of values in few lines
BESIDE_MAP = 1.5  # left and right of a map, for the label of its axis and the bar of its colours
ABOVE_AND_BELOW_MAP = 1.2  # for its ticks and the label of its axis
TITLE_HEIGHT = 0.8  # of the page
NO_COLOUR = "0.9"  # grey of the cells without a colour
LIGHT_TEXT_FROM = 0.6  # of the range of colours: darker cells have white text


class Measured(Enum):
    """What the numbers of a sweep on a sequence are."""

    ERRORS = "TE and RE of sub-sequences"
    POSITIONS = "distances from the true path, which is shorter than every sub-sequence"
    APART = "distances from the path of the reference, without ground truth"

    @property
    def kinds(self) -> dict[str, str]:
        """The fields of a record that are compared, and the columns that show them."""
        if self is Measured.ERRORS:
            return {kind: unit for kind, (unit, _) in ERROR_KINDS.items()}
        return POSITION_KINDS if self is Measured.POSITIONS else APART_KINDS


def measured_on(sequence: Sequence) -> Measured:
    """What can be measured on a sequence."""
    if sequence.truth is None:
        return Measured.APART
    if too_short_words(sequence.truth, suitable_protocol(sequence.truth)):
        return Measured.POSITIONS
    return Measured.ERRORS


@dataclass(frozen=True)
class Sweep:
    """The results on a grid, on one sequence.

    Attributes
    ----------
    axes : of the table; with several methods, the method is the first one.
    records : of each combination of the values, see below.
    outcomes : of all jobs, in order.
    measured : what the numbers are.
    notes : sentences below the table, beside those that follow from the records.
    reference_words : the settings of the reference in words.

    A record has the sequence, the method, the value of each axis as text, the number of successful seeds,
    errors (not without ground truth) and costs as in a record of Table 1, the names of the axes that have no
    effect with the other values, warnings, and the causes of failed runs. Where no errors are measured, it
    also has the length of the path and its distance from the true path or, without ground truth, from that of
    the reference.
    """

    title: str
    axes: Axes
    records: list[dict[str, Any]]
    outcomes: list[Outcome] = field(default_factory=list)
    measured: Measured = Measured.ERRORS
    notes: tuple[str, ...] = ()
    reference_words: str = DEFAULT_SETTINGS

    @property
    def has_numbers(self) -> bool:
        """Whether there is something to compare."""
        return any(record[kind] is not None for record in self.records for kind in self.measured.kinds)


@dataclass(frozen=True)
class _SweepCell:
    """The runs of a method on a sequence with values of the axes, one per seed.

    changes : these values; none for a reference that is no combination of them.
    config : the configuration with the changes.
    """

    sequence: Sequence
    method: str
    changes: Changes
    config: MethodConfig
    jobs: tuple[Job, ...]


# The cells of the reference, by sequence and method, of sequences without truth.
_ReferenceCells = dict[tuple[str, str], _SweepCell]


def refuse_unused(bases: Mapping[str, MethodConfig], axes: Axes, must_be_used: Iterable[str] = ()) -> None:
    """Raise `DataError` for a setting that no method uses in any combination of the values.

    bases : by method, its configuration before an axis changes it.
    must_be_used : names of settings in `bases` that at least one method has to use; those of an axis always
        have to.
    """
    for name in dict.fromkeys([*axes, *must_be_used]):
        reasons = []
        for method, base in bases.items():
            for changes in combinations(axes):
                reasons.append((method, settings.unused_because(changed(base, changes), name)))
        refuse_if_unused(name, reasons, "no method uses")


def run_sweep(
    sequences: list[str],
    bases: Mapping[str, MethodConfig],
    axes: Axes,
    seeds: int,
    folder: Path,
    opened: Callable[[str, MethodConfig], Sequence],
    run: Callable[[list[Job]], list[Outcome]],
    reference_words: str = DEFAULT_SETTINGS,
) -> list[Sweep]:
    """Run all combinations with seeds 0 … seeds - 1, each in its own folder in `folder`/cells.

    On a sequence without ground truth, the reference is run as well, and paths are compared with its path.

    Parameters
    ----------
    sequences : names.
    bases : by method, its configuration before an axis changes it: that of the reference.
    axes : the settings that vary, with their values.
    opened : gives the sequence of a name for a configuration, since the vehicle boxes of a detector depend on
        the classes in it (`filter.classes`).
    run : function that does the jobs, such as `jobs.run_jobs` with its options.
    reference_words : `bases` in words.

    Returns
    -------
    A sweep for each sequence.

    Raises
    ------
    DataError : no method uses a setting of an axis, or values contradict each other; and as `opened` and
        `run`.
    """
    refuse_unused(bases, axes)
    cells, reference_cells = _plan(sequences, bases, axes, seeds, folder, opened)
    outcomes = run(jobs_of([*cells, *reference_cells.values()]))
    error_of_job = {outcome.job.folder: outcome.error for outcome in outcomes}
    sweeps = []
    for name in sequences:
        cells_of_sequence = [cell for cell in cells if cell.sequence.name == name]
        sequence = cells_of_sequence[0].sequence
        records = []
        for cell in cells_of_sequence:
            reference_cell = reference_cells.get((name, cell.method))
            records.append(_record(cell, reference_cell, error_of_job))
        of_reference = [cell for cell in reference_cells.values() if cell.sequence.name == name]
        sweeps.append(
            Sweep(
                title=_title(sequence, bases, seeds),
                axes={METHOD_AXIS: tuple(bases)} | axes if len(bases) > 1 else axes,
                records=records,
                outcomes=[outcome for outcome in outcomes if outcome.job.sequence.name == name],
                measured=measured_on(sequence),
                notes=_notes(sequence, of_reference, error_of_job, reference_words),
                reference_words=reference_words,
            )
        )
    return sweeps


def planned_jobs(
    sequences: list[str],
    bases: Mapping[str, MethodConfig],
    axes: Axes,
    seeds: int,
    folder: Path,
    opened: Callable[[str, MethodConfig], Sequence],
) -> list[Job]:
    """The jobs that `run_sweep` does with these parameters."""
    cells, reference_cells = _plan(sequences, bases, axes, seeds, folder, opened)
    return jobs_of([*cells, *reference_cells.values()])


def _plan(
    sequences: list[str],
    bases: Mapping[str, MethodConfig],
    axes: Axes,
    seeds: int,
    folder: Path,
    opened: Callable[[str, MethodConfig], Sequence],
) -> tuple[list[_SweepCell], _ReferenceCells]:
    """The cells of a sweep, and those of the reference; a cell of the sweep may be one of them."""
    cells = list[_SweepCell]()
    reference_cells: _ReferenceCells = {}
    for name, (method, base) in itertools.product(sequences, bases.items()):
        cells_of_method = [
            _make_cell(opened, name, method, base, changes, seeds, folder) for changes in combinations(axes)
        ]
        cells += cells_of_method
        if cells_of_method[0].sequence.truth is None:
            with_base = [cell for cell in cells_of_method if cell.config == base]
            if not with_base:
                with_base = [_make_cell(opened, name, method, base, (), seeds, folder)]
            reference_cells[name, method] = with_base[0]
    return cells, reference_cells


def _make_cell(
    opened: Callable[[str, MethodConfig], Sequence],
    name: str,
    method: str,
    base: MethodConfig,
    changes: Changes,
    seeds: int,
    folder: Path,
) -> _SweepCell:
    """The cell of a method on a sequence with some changes, and its jobs."""
    config = changed(base, changes)
    sequence = opened(name, config)
    settings_name = settings_folder(changes) if changes else DEFAULT
    place = folder / CELLS / base.variant / slug(name) / method / settings_name
    words = settings_words(changes)
    jobs = []
    for seed in range(seeds):
        config_of_seed = dataclasses.replace(config, seed=seed)
        jobs.append(Job(sequence, method, config_of_seed, (place / f"seed{seed}").resolve(), words))
    return _SweepCell(sequence, method, changes, config, tuple(jobs))


def _finished_runs(cell: _SweepCell, error_of_job: Mapping[Path, str | None]) -> list[Run]:
    """The finished runs of a cell, read from their folders."""
    finished = [job for job in cell.jobs if error_of_job[job.folder] is None]
    return [read_run(job.folder, job.sequence) for job in finished]


def _record(
    cell: _SweepCell, reference_cell: _SweepCell | None, error_of_job: Mapping[Path, str | None]
) -> dict[str, Any]:
    """The record of a cell, see `Sweep`.

    reference_cell : the cell of the reference, for a path without truth.
    error_of_job : the cause of a failure by folder, None for success.
    """
    runs = _finished_runs(cell, error_of_job)
    record: dict[str, Any] = {"sequence": cell.sequence.name, METHOD_AXIS: cell.method}
    record |= {name: settings.as_typed(value) for name, value in cell.changes}
    record["seeds"] = len(runs)
    truth = cell.sequence.truth
    no_errors = np.zeros((2, 0))  # TE and RE of no seed
    if truth is None:
        reference_runs = [] if reference_cell is None else _finished_runs(reference_cell, error_of_job)
        record |= _fields_without_truth(runs, reference_runs)
    elif measured_on(cell.sequence) is Measured.POSITIONS:
        # `number_fields` gives None for TE, RE and the costs; `_fields_of_positions` then replaces the costs.
        record |= number_fields(no_errors, None) | _fields_of_positions(runs, truth)
    elif runs:
        entry = measure_runs(cell.method, runs, suitable_protocol(truth))
        record |= number_fields(entry.errors, entry)
    else:
        record |= number_fields(no_errors, None)
    unused = [name for name, _ in cell.changes if settings.unused_because(cell.config, name)]
    record["not_used"] = " ".join(unused)
    record["warnings"] = _warning_words(runs)
    failures = []
    for job in cell.jobs:
        if error_of_job[job.folder]:
            failures.append(f"seed {job.config.seed}: {error_of_job[job.folder]}")
    record["failed"] = "; ".join(failures)
    return record


def _warning_words(runs: list[Run]) -> str:
    """The warnings of a cell's runs; those that differ only in numbers are said once."""
    different = dict.fromkeys(warning for result in runs for warning in warnings_of(result))
    words = []
    for warnings in alike_warnings(different):
        numbers = " (for some seeds with other numbers)" if len(warnings) > 1 else ""
        words.append(f"{warnings[0]}{numbers}")
    return "; ".join(words)


def _fields_without_truth(runs: list[Run], reference_runs: list[Run]) -> dict[str, float | None]:
    """Length of the paths, and their distance from those of the reference with the same seeds."""
    reference_of_seed = {result.config.seed: result.poses for result in reference_runs}
    apart = []
    for result in runs:
        if result.config.seed in reference_of_seed:
            apart.append(path_difference(result.poses, reference_of_seed[result.config.seed]))
    return _fields_of_distances(runs, apart, END_APART, RMSE_APART)


def _fields_of_positions(runs: list[Run], truth: Array) -> dict[str, float | None]:
    """Length of the paths, and their distance from the true path (N, 4, 4), after a common start."""
    apart = [path_difference(truth, result.poses) for result in runs]
    return _fields_of_distances(runs, apart, END_ERROR, RMSE_ERROR)


def _fields_of_distances(
    runs: list[Run], apart: list[PathDifference], end_field: str, rmse_field: str
) -> dict[str, float | None]:
    """Mean and deviation over the seeds of the lengths and distances of paths, and the costs of their runs.

    apart : the distances of each path that has another one to be compared with.
    end_field, rmse_field : names of the fields for the distance at the end, and for the root mean square.
    """
    values_of = {
        "length_m": [path_length(result.poses) for result in runs],
        end_field: [difference.end for difference in apart],
        rmse_field: [difference.rmse for difference in apart],
    }
    fields: dict[str, float | None] = {}
    for name, values_of_seeds in values_of.items():
        mean, deviation = mean_and_deviation(values_of_seeds)
        fields[name] = finite_or_none(mean)
        fields[f"{name}_std"] = finite_or_none(deviation)
    fields["removed_share"] = runs[0].removed_share if runs else None
    fields["back_end_ms"] = back_end_ms(runs) if runs else None
    return fields


def _notes(
    sequence: Sequence,
    of_reference: list[_SweepCell],
    error_of_job: Mapping[Path, str | None],
    reference_words: str,
) -> tuple[str, ...]:
    """Why a sequence with truth has no TE and RE; without truth, how far two seeds are apart, by method.

    of_reference : the cells of the reference on the sequence, by which paths without truth are measured.
    """
    if sequence.truth is None:
        cells = [cell for cell in of_reference if len(cell.jobs) > 1]
        return tuple(_seeds_note(cell, error_of_job, reference_words) for cell in cells)
    short = too_short_words(sequence.truth, suitable_protocol(sequence.truth))
    return (f"No TE and RE, since {short}.",) if short else ()


def _seeds_note(cell: _SweepCell, error_of_job: Mapping[Path, str | None], reference_words: str) -> str:
    """A sentence on how far two seeds of a cell of the reference are apart, and what one run cannot show."""
    paths: list[Array] = [result.poses for result in _finished_runs(cell, error_of_job)]
    apart = [path_difference(first, second).rmse for first, second in itertools.combinations(paths, 2)]
    if not apart:
        return (
            f"{cell.method}: fewer than two runs of {reference_words} succeeded, so how far two seeds are "
            "apart is not known."
        )
    if max(apart) < SAME_PATH_M:
        return f"{cell.method}: all seeds of {reference_words} give the same path, to the millimetre."
    mean, deviation = mean_and_deviation(apart)
    return (
        f"{cell.method}: two seeds of {reference_words} are {plus_minus(mean, deviation)} m apart "
        "(rmse), so one run would not show a difference of this size."
    )


def _title(sequence: Sequence, bases: Mapping[str, MethodConfig], seeds: int) -> str:
    """The runs of a sweep on a sequence, and what the numbers are."""
    part = " (part of a sequence)" if sequence.is_part else ""
    variant = next(iter(bases.values())).variant  # that of all methods
    runs_text = f"{sequence.name}, {len(sequence)} frames{part}, {', '.join(bases)}, {variant}"
    if sequence.truth is None:
        return f"{runs_text}: no ground truth, so these numbers are no errors; {seeds_text(seeds)}"
    if measured_on(sequence) is Measured.POSITIONS:
        return f"{runs_text}: distances from the true path; {seeds_text(seeds)}"
    # Only to count the sub-sequences: the truth has no errors.
    protocol = suitable_protocol(sequence.truth)
    count = len(kitti_errors(sequence.truth, sequence.truth, protocol.lengths, protocol.step))
    protocol_words = protocol.words_with(is_as_kitti(protocol, count, not sequence.is_part))
    return f"{runs_text}: {subsequences_text(count)} of {protocol_words}; {seeds_text(seeds)}"


def sweep_table(sweep: Sweep) -> ReportTable:
    """A table with a row per combination; failed runs are in the notes.

    A terminal of 80 columns has no room for everything: with several methods or without errors, the costs are
    only in the records.
    """
    shows_lengths = sweep.measured is not Measured.ERRORS
    shows_costs = not shows_lengths and METHOD_AXIS not in sweep.axes
    columns = list(sweep.axes)
    if shows_lengths:
        columns.append("length m")
    columns += sweep.measured.kinds.values()
    if shows_costs:
        columns += ["removed", "back-end ms"]
    rows = list[list[str]]()
    for record in sweep.records:
        not_used = record.get("not_used", "").split()
        row = [f"{record[name]}{NOT_USED}" if name in not_used else record[name] for name in sweep.axes]
        if shows_lengths:
            row.append(format_number(record["length_m"], 2))
        row += [plus_minus(record[kind], record[f"{kind}_std"]) for kind in sweep.measured.kinds]
        if shows_costs:
            share = record["removed_share"]
            row.append(NO_NUMBER if share is None else f"{100 * share:.1f} %")
            row.append(format_number(record["back_end_ms"], 1))
        rows.append(row)
    notes = [*_notes_below(sweep), *sweep.notes]
    table = ReportTable(sweep.title, columns, rows, notes, name_columns=len(sweep.axes))
    return without_empty_columns(table)


def _notes_below(sweep: Sweep) -> list[str]:
    """Which runs failed or have a warning, and what the marks and numbers of the table mean."""
    notes = []
    for record in sweep.records:
        label = ", ".join(f"{name}={record[name]}" for name in sweep.axes)
        if record["failed"]:
            notes.append(f"Failed: {label}, {record['failed']}")
        if record.get("warnings"):
            notes.append(f"Warning: {label}: {record['warnings']}")
    if any(record.get("not_used") for record in sweep.records):
        notes.append(f"{NOT_USED.strip()}: the setting has no effect on the runs of this row.")
    if sweep.measured is Measured.POSITIONS:
        notes.append(POSITION_NOTE)
    if sweep.measured is Measured.APART:
        same = "method and seed" if METHOD_AXIS in sweep.axes else "seed"
        notes.append(
            f"apart: distance of the positions from those of {sweep.reference_words} with the same {same}, "
            "from the same start, at the end and as rmse. These are no errors: they do not tell "
            "which path is right."
        )
    return notes


def heat_map(sweep: Sweep) -> bytes:
    """PNG of TE and RE, or of distances between paths; the last setting is the horizontal axis.

    Dark is a large number, a cross no result. A cell with one seed is grey: one run shows no difference.
    """
    *down, across = sweep.axes
    values_across = [settings.as_typed(value) for value in sweep.axes[across]]
    letters = letters_beside(values_across, LEAST_LETTERS)
    columns = [broken(value, letters) for value in values_across]
    rows = []
    for values in itertools.product(*(sweep.axes[name] for name in down)):
        rows.append(broken(", ".join(map(settings.as_typed, values)), ROW_LETTERS))
    width, height = _map_size(rows, columns, letters)
    figure = figure_page(sweep.title, width, height)
    for axis, (kind, name) in zip(figure.subplots(2), sweep.measured.kinds.items(), strict=True):
        _draw_map(figure, axis, sweep, kind, name, len(rows))
        axis.set_xticks(range(len(columns)), columns)
        if down:
            axis.set_yticks(range(len(rows)), rows)
        else:
            axis.set_yticks([])
        axis.set(xlabel=across, ylabel=",\n".join(down))
    return png(figure)


def _map_size(rows: list[str], columns: list[str], letters: int) -> tuple[float, float]:
    """The width and the height, inches, of a page with two maps one above the other.

    rows, columns : the words beside and below a map, in lines; letters : in a line below.
    """
    letters_of_rows = max((len(line) for row in rows for line in row.split("\n")), default=0)
    column_width = letters / LEAST_LETTERS * COLUMN_WIDTH
    width = max(SMALL_PAGE[0], BESIDE_MAP + letters_of_rows / LETTERS + column_width * len(columns))
    row_height = max(ROW_HEIGHT, LINE_HEIGHT * (1 + max(row.count("\n") for row in rows)))
    below = LINE_HEIGHT * max(column.count("\n") for column in columns)
    height = 2 * (ABOVE_AND_BELOW_MAP + row_height * len(rows) + below) + TITLE_HEIGHT
    return width, height


def _draw_map(figure: Figure, axis: PlotAxes, sweep: Sweep, kind: str, name: str, rows: int) -> None:
    """Draw the numbers of a sweep in one field as colours and as text.

    kind, name : the field, and the words for it. rows : their number in the map.
    """
    from matplotlib import colormaps  # here, since its import takes half a second

    means = np.array([record[kind] for record in sweep.records], np.float64)
    deviations = np.array([record[f"{kind}_std"] for record in sweep.records], np.float64)
    coloured = np.where(np.isnan(deviations), np.nan, means).reshape(rows, -1)
    palest, darkest = _colour_range(means, deviations)
    colours = colormaps["YlGnBu"].with_extremes(bad=NO_COLOUR)
    image = axis.imshow(coloured, aspect="auto", cmap=colours, vmin=palest, vmax=darkest)
    meaning = f"from {sweep.reference_words}" if sweep.measured is Measured.APART else "lower is better"
    if np.isnan(deviations).all():
        axis.set_title(f"{name}, {meaning}; one seed: no colours", fontsize="medium")
    else:
        figure.colorbar(image, ax=axis, label=f"{name}\n{meaning}", format="%.4g")
    shades = np.asarray(image.norm(coloured), np.float64)  # from 0 to 1, NaN without a colour
    for (row, column), record in zip(np.ndindex(coloured.shape), sweep.records, strict=True):
        text = plus_minus(record[kind], record[f"{kind}_std"])
        text = text.replace(" ±", "\n±").replace(NO_NUMBER, "×")
        colour = "white" if shades[row, column] > LIGHT_TEXT_FROM else "black"
        axis.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")


def _colour_range(means: Array, deviations: Array) -> tuple[float, float]:
    """The numbers with the palest and the darkest colour, for cells (N,) with these means over the seeds.

    Cells with one seed, whose deviation is NaN, do not count. A difference that one run would not show has no
    strong colour: then the range is wider than the means.
    """
    known = ~np.isnan(deviations)
    if not known.any():
        return 0.0, 1.0
    low = float(means[known].min())
    high = float(means[known].max())
    deviation = float(deviations[known].mean())
    margin = max(0.0, change_limit(low, deviation, deviation) - (high - low)) / 2
    return low - margin, high + margin
