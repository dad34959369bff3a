"""Sweeps: runs of methods over a grid of settings and several seeds, on each of several sequences."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from .. import settings
from ..data.sequence import Sequence
from ..errors import DataError
from ..evaluation.kitti_errors import is_as_kitti, kitti_errors, subsequences_text, suitable_protocol
from ..evaluation.path_facts import PathDifference, path_difference, path_facts
from ..evaluation.statistics import change_limit, mean_and_deviation
from ..geometry.types import Array
from ..paper.settings import MethodConfig
from ..runs.drive import Run
from ..runs.folder import read_run, warnings_of
from ..runs.jobs import Job, Outcome
from .blocks import Axes, Changes, changed, combinations, reasons_words, settings_folder, settings_words
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
    back_end_ms,
    measure_runs,
    number_fields,
    slug,
    too_short_words,
)

NOT_USED = " (not used)"
CELLS = "cells"  # folder of the runs in the folder of a sweep
DEFAULT = "default"  # folder of the runs with the settings that are not changed
# Fields and columns for a path without ground truth: how far it is from that of the default settings.
APART_KINDS = {"end_apart_m": "end apart m", "rmse_apart_m": "rmse apart m"}
# The same for a path with truth that is shorter than every sub-sequence: how far it is from the true one.
POSITION_KINDS = {"end_error_m": "end error m", "rmse_error_m": "rmse error m"}
METHOD_AXIS = "method"
DEFAULT_SETTINGS = "the default settings"
LEAST_LETTERS = 12  # in a line of a value below the heat map, whose column is then 1.1 inches wide
ROW_LETTERS = 24  # in a line of the values beside it
SAME_PATH_M = 0.0005  # a smaller distance is printed as 0.000 m
NO_COLOUR = "0.9"  # grey of the cells without a colour in the heat map


class Measured(Enum):
    """What the numbers of a sweep on a sequence are: the field with each, and its name in tables."""

    ERRORS = "TE and RE of sub-sequences"
    POSITIONS = "distances from the true path, which is shorter than every sub-sequence"
    APART = "distances from the path of the default settings, without ground truth"

    @property
    def kinds(self) -> dict[str, str]:
        """The fields with what is compared, and their names in tables."""
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

    The record of a combination has the sequence, the method, the value of each axis as text, the number of
    successful seeds, errors and costs as in a record of Table 1, the settings that the method does not use
    with the other values, and the causes of failed runs; without errors, it also has the length of the path
    and its distance from the true path or, without ground truth, from the path of the settings that are not
    on an axis. `reference` : these settings in words. `axes` : of the table, with the methods if there are
    several. `measured` : what the numbers are. `notes` : sentences below the table. `outcomes` : of all
    jobs, in order.
    """

    title: str
    axes: Axes
    records: list[dict[str, Any]]
    outcomes: list[Outcome] = dataclasses.field(default_factory=list)
    measured: Measured = Measured.ERRORS
    notes: tuple[str, ...] = ()
    reference: str = DEFAULT_SETTINGS

    @property
    def kinds(self) -> dict[str, str]:
        """The fields with what is compared, and their names in tables."""
        return self.measured.kinds

    @property
    def has_numbers(self) -> bool:
        """Whether there is something to compare."""
        return any(record[kind] is not None for record in self.records for kind in self.kinds)


@dataclass(frozen=True)
class _SweepCell:
    """The runs of a method on a sequence with some changes, one per seed."""

    sequence: Sequence
    method: str
    changes: Changes
    config: MethodConfig
    jobs: list[Job]


def refuse_unused(bases: Mapping[str, MethodConfig], axes: Axes, more: Iterable[str] = ()) -> None:
    """Raise `DataError` for a setting that no method uses in any combination of the values.

    bases : by method, the settings that are not on an axis; more : names of those that a method must use.
    """
    for name in dict.fromkeys([*axes, *more]):
        reasons = []
        for method, base in bases.items():
            configs = [changed(base, changes) for changes in combinations(axes)]
            reasons += [(method, settings.unused_because(config, name)) for config in configs]
        if all(reason for _, reason in reasons):
            words = f"{next(iter(bases))} does not use" if len(bases) == 1 else "no method uses"
            raise DataError(f"{name}: {words} this setting, since {reasons_words(reasons)}")


def run_sweep(
    sequences: list[str],
    bases: Mapping[str, MethodConfig],
    axes: Axes,
    seeds: int,
    folder: Path,
    opened: Callable[[str, MethodConfig], Sequence],
    run: Callable[[list[Job]], list[Outcome]],
    reference: str = DEFAULT_SETTINGS,
) -> list[Sweep]:
    """Run all combinations with seeds 0 … seeds - 1, each in its own folder in `folder`/cells.

    Parameters
    ----------
    sequences : names; bases : by method, the settings that are not on an axis.
    opened : the sequence of a name for a configuration. Without ground truth, the settings of `bases` are run
        as well, and the paths are compared with theirs.
    run : function that does the jobs, such as `jobs.run_jobs` with its options.
    reference : the settings of `bases` in words.

    Returns
    -------
    A sweep for each sequence.
    """
    refuse_unused(bases, axes)
    cells, defaults = _plan(sequences, bases, axes, seeds, folder, opened)
    outcomes = run(_jobs_of(cells, defaults))
    errors = {outcome.job.folder: outcome.error for outcome in outcomes}
    sweeps = []
    for name in sequences:
        of_sequence = [cell for cell in cells if cell.sequence.name == name]
        sequence = of_sequence[0].sequence
        records = []
        for cell in of_sequence:
            default_cell = defaults.get((name, cell.method))
            records.append(_record(cell, default_cell, errors))
        title = _title(sequence, bases, seeds)
        table_axes = {METHOD_AXIS: tuple(bases)} | axes if len(bases) > 1 else axes
        notes = [
            _seeds_note(default, errors, reference)
            for (at, _), default in defaults.items()
            if at == name and seeds > 1
        ]
        if sequence.truth is not None:
            short = too_short_words(sequence.truth, suitable_protocol(sequence.truth))
            if short:
                notes.append(f"No TE and RE, since {short}.")
        done = [outcome for outcome in outcomes if outcome.job.sequence.name == name]
        measured = measured_on(sequence)
        sweeps.append(Sweep(title, table_axes, records, done, measured, tuple(notes), reference))
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
    return _jobs_of(*_plan(sequences, bases, axes, seeds, folder, opened))


def _plan(
    sequences: list[str],
    bases: Mapping[str, MethodConfig],
    axes: Axes,
    seeds: int,
    folder: Path,
    opened: Callable[[str, MethodConfig], Sequence],
) -> tuple[list[_SweepCell], dict[tuple[str, str], _SweepCell]]:
    """The cells of a sweep, and those of `bases` by sequence without truth and method."""
    cells = list[_SweepCell]()
    defaults: dict[tuple[str, str], _SweepCell] = {}
    for name, (method, base) in itertools.product(sequences, bases.items()):
        of_method = [
            _make_cell(opened, name, method, base, changes, seeds, folder) for changes in combinations(axes)
        ]
        cells += of_method
        if of_method[0].sequence.truth is None:
            same = [cell for cell in of_method if cell.config == base]
            default = same[0] if same else _make_cell(opened, name, method, base, (), seeds, folder)
            defaults[name, method] = default
    return cells, defaults


def _jobs_of(cells: list[_SweepCell], defaults: Mapping[tuple[str, str], _SweepCell]) -> list[Job]:
    """The jobs of cells, each once."""
    jobs = [job for cell in [*cells, *defaults.values()] for job in cell.jobs]
    return list({job.folder: job for job in jobs}.values())


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
    place = folder / CELLS / base.variant / slug(name) / method
    place /= settings_folder(changes) if changes else DEFAULT
    jobs = []
    for seed in range(seeds):
        of_seed = dataclasses.replace(config, seed=seed)
        jobs.append(
            Job(sequence, method, of_seed, (place / f"seed{seed}").resolve(), settings_words(changes))
        )
    return _SweepCell(sequence, method, changes, config, jobs)


def _read(cell: _SweepCell, errors: Mapping[Path, str | None]) -> list[Run]:
    """The finished runs of a cell."""
    return [read_run(job.folder, job.sequence) for job in cell.jobs if errors[job.folder] is None]


def _record(
    cell: _SweepCell, default: _SweepCell | None, errors: Mapping[Path, str | None]
) -> dict[str, Any]:
    """The numbers of a cell; `default` : the cell of the default settings, for a path without truth."""
    runs = _read(cell, errors)
    causes = [f"seed {job.config.seed}: {errors[job.folder]}" for job in cell.jobs if errors[job.folder]]
    record: dict[str, Any] = {"sequence": cell.sequence.name, METHOD_AXIS: cell.method}
    record |= {name: settings.as_typed(value) for name, value in cell.changes}
    record["seeds"] = len(runs)
    truth = cell.sequence.truth
    if truth is not None and measured_on(cell.sequence) is Measured.POSITIONS:
        record |= number_fields(np.zeros((2, 0)), None) | _fields_of_positions(runs, truth)
    elif truth is not None:
        entry = measure_runs(cell.method, runs, suitable_protocol(truth)) if runs else None
        record |= number_fields(np.zeros((2, 0)) if entry is None else entry.errors, entry)
    else:
        record |= _fields_without_truth(runs, [] if default is None else _read(default, errors))
    unused = [name for name, _ in cell.changes if settings.unused_because(cell.config, name)]
    warnings = dict.fromkeys(warning for result in runs for warning in warnings_of(result))
    notes = {"not_used": " ".join(unused), "warnings": "; ".join(warnings), "failed": "; ".join(causes)}
    return record | notes


def _fields_without_truth(runs: list[Run], defaults: list[Run]) -> dict[str, float | None]:
    """Length of the paths, and their distance from those of the default settings with the same seeds."""
    of_default = {result.config.seed: result.poses for result in defaults}
    lengths = [path_facts(result.poses, None).length for result in runs]
    pairs = [
        (result.poses, of_default[result.config.seed]) for result in runs if result.config.seed in of_default
    ]
    apart = [path_difference("a path", poses, "the default", default) for poses, default in pairs]
    distances = dict(zip(APART_KINDS, _ends_and_rmse(apart), strict=True))
    return _fields_of_seeds({"length_m": lengths} | distances, runs)


def _fields_of_positions(runs: list[Run], truth: Array) -> dict[str, float | None]:
    """Length of the paths, and their distance from the true path (N, 4, 4), after a common start."""
    lengths = [path_facts(result.poses, None).length for result in runs]
    apart = [path_difference("the truth", truth, "a path", result.poses) for result in runs]
    distances = dict(zip(POSITION_KINDS, _ends_and_rmse(apart), strict=True))
    return _fields_of_seeds({"length_m": lengths} | distances, runs)


def _ends_and_rmse(apart: list[PathDifference]) -> tuple[list[float], list[float]]:
    """The distances at the end, and the root mean squares."""
    ends = [each.end for each in apart]
    means = [each.rmse for each in apart]
    return ends, means


def _fields_of_seeds(values: Mapping[str, list[float]], runs: list[Run]) -> dict[str, float | None]:
    """Mean and deviation of values over seeds, by field, and the costs of the runs."""
    fields: dict[str, float | None] = {}
    for name, of_seeds in values.items():
        mean, deviation = mean_and_deviation(of_seeds)
        fields[name] = finite_or_none(mean)
        fields[f"{name}_std"] = finite_or_none(deviation)
    fields["removed_share"] = runs[0].removed_share if runs else None
    fields["back_end_ms"] = back_end_ms(runs) if runs else None
    return fields


def _seeds_note(default: _SweepCell, errors: Mapping[Path, str | None], reference: str) -> str:
    """A sentence on how far the seeds of the reference settings are apart, as a measure of chance."""
    paths: list[Array] = [result.poses for result in _read(default, errors)]
    apart = [
        path_difference("", first, "", second).rmse for first, second in itertools.combinations(paths, 2)
    ]
    if apart and max(apart) < SAME_PATH_M:
        return f"{default.method}: all seeds of {reference} give the same path, to the millimetre."
    mean, deviation = mean_and_deviation(apart)
    return (
        f"{default.method}: two seeds of {reference} are {plus_minus(mean, deviation)} m apart "
        "(rmse), so a difference of this size may be chance."
    )


def _title(sequence: Sequence, bases: Mapping[str, MethodConfig], seeds: int) -> str:
    """The runs of a sweep on a sequence, and the sub-sequences of its errors."""
    part = " (part of a sequence)" if sequence.is_part else ""
    variant = next(iter(bases.values())).variant
    runs_text = f"{sequence.name}, {len(sequence)} frames{part}, {', '.join(bases)}, {variant}"
    if sequence.truth is None:
        return f"{runs_text}: no ground truth, so these numbers are no errors; {seeds_text(seeds)}"
    if measured_on(sequence) is Measured.POSITIONS:
        return f"{runs_text}: distances from the true path; {seeds_text(seeds)}"
    measure = suitable_protocol(sequence.truth)
    count = len(kitti_errors(sequence.truth, sequence.truth, measure.lengths, measure.step))
    measure_words = measure.words_with(is_as_kitti(measure, count, not sequence.is_part))
    return f"{runs_text}: {subsequences_text(count)} of {measure_words}; {seeds_text(seeds)}"


def sweep_table(sweep: Sweep) -> ReportTable:
    """A table with a row per combination; failed runs are in the notes.

    A terminal of 80 columns has no room for everything: with several methods or without errors, the costs are
    only in the records.
    """
    has_errors = sweep.measured is Measured.ERRORS
    lengths = [] if has_errors else ["length m"]
    costs = ["removed", "back-end ms"] if has_errors and METHOD_AXIS not in sweep.axes else []
    columns = [*sweep.axes, *lengths, *sweep.kinds.values(), *costs]
    rows = list[list[str]]()
    notes = list[str]()
    for record in sweep.records:
        share = record["removed_share"]
        numbers = [plus_minus(record[kind], record[f"{kind}_std"]) for kind in sweep.kinds]
        if lengths:
            numbers.insert(0, format_number(record["length_m"], 2))
        if costs:
            numbers.append(NO_NUMBER if share is None else f"{100 * share:.1f} %")
            numbers.append(format_number(record["back_end_ms"], 1))
        not_used = record.get("not_used", "").split()
        values = [f"{record[name]}{NOT_USED}" if name in not_used else record[name] for name in sweep.axes]
        rows.append([*values, *numbers])
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
        notes.append(
            f"apart: distance of the positions from those of {sweep.reference} with the same seed, from "
            "the same start, at the end and as rmse. These are no errors: they do not tell "
            "which path is right."
        )
    table = ReportTable(sweep.title, columns, rows, [*notes, *sweep.notes], names=len(sweep.axes))
    return without_empty_columns(table)


def heat_map(sweep: Sweep) -> bytes:
    """PNG of TE and RE, or of distances between paths; the last setting is the horizontal axis.

    Dark is a large number, a cross no result. A cell with one seed is grey: one run shows no difference.
    """
    from matplotlib import colormaps  # here, since its import takes half a second

    *down, across = sweep.axes
    values_across = [*map(settings.as_typed, sweep.axes[across])]
    grid = itertools.product(*(sweep.axes[name] for name in down))
    letters = letters_beside(values_across, LEAST_LETTERS)
    columns = [broken(value, letters) for value in values_across]
    rows = [broken(", ".join(map(settings.as_typed, values)), ROW_LETTERS) for values in grid]
    beside = max((len(line) for row in rows for line in row.split("\n")), default=0)
    width = max(SMALL_PAGE[0], 1.5 + beside / LETTERS + letters / LEAST_LETTERS * 1.1 * len(columns))
    row_height = max(0.55, LINE_HEIGHT * (1 + max(row.count("\n") for row in rows)))
    below = LINE_HEIGHT * max(column.count("\n") for column in columns)
    height = 2 * (1.2 + row_height * len(rows) + below) + 0.8
    figure = figure_page(sweep.title, width, height)
    better = f"\nfrom {sweep.reference}" if sweep.measured is Measured.APART else "\nlower is better"
    colours = colormaps["YlGnBu"].with_extremes(bad=NO_COLOUR)
    for axis, (kind, label) in zip(figure.subplots(2), sweep.kinds.items(), strict=True):
        means = np.array([record[kind] for record in sweep.records], np.float64)
        deviations = np.array([record[f"{kind}_std"] for record in sweep.records], np.float64)
        values = np.where(np.isnan(deviations), np.nan, means).reshape(len(rows), -1)
        lowest, highest = _colour_range(means, deviations)
        image = axis.imshow(values, aspect="auto", cmap=colours, vmin=lowest, vmax=highest)
        if np.isnan(deviations).all():
            title = f"{label}{better}; one seed: no colours".replace("\n", ", ")
            axis.set_title(title, fontsize="medium")
        else:
            figure.colorbar(image, ax=axis, label=f"{label}{better}", format="%.4g")
        axis.set_xticks(range(len(columns)), columns)
        if down:
            axis.set_yticks(range(len(rows)), rows)
        else:
            axis.set_yticks([])
        axis.set(xlabel=across, ylabel=",\n".join(down))
        for (row, column), record in zip(np.ndindex(values.shape), sweep.records, strict=True):
            text = plus_minus(record[kind], record[f"{kind}_std"])
            text = text.replace(" ±", "\n±").replace(NO_NUMBER, "×")
            colour = "white" if image.norm(values[row, column]) > 0.6 else "black"
            axis.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")
    return png(figure)


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
