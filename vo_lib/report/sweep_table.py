"""A sweep: runs of one method on one sequence over a grid of settings and several seeds."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import settings
from ..config import SETTINGS, change
from ..data.sequence import Sequence
from ..errors import DataError, did_you_mean
from ..evaluation.kitti_errors import count_words, is_as_kitti, kitti_errors, suitable_protocol
from ..evaluation.statistics import change_limit
from ..paper.settings import MethodConfig
from ..runs.folder import read_run, warnings_of
from ..runs.jobs import Job, Outcome
from .page import (
    NO_NUMBER,
    ReportTable,
    format_number,
    plus_minus,
    seeds_text,
    without_empty_columns,
)
from .plots import SMALL_PAGE, figure_page, png
from .table1 import ERROR_KINDS, measure_runs, number_fields

NOT_USED = " (not used)"
CELLS = "cells"  # folder of the runs in the folder of a sweep
Axes = dict[str, tuple[Any, ...]]  # values of each setting, by dotted name; the last changes fastest


@dataclass(frozen=True)
class Sweep:
    """The results on a grid.

    The record of a combination has the value of each axis as text, the number of successful seeds, errors and
    costs as in a record of Table 1, the settings that the method does not use with the other values, and the
    causes of failed runs. `outcomes` : of all jobs, in order.
    """

    title: str
    axes: Axes
    records: list[dict[str, Any]]
    outcomes: list[Outcome] = dataclasses.field(default_factory=list)

    @property
    def has_errors(self) -> bool:
        """Whether a sub-sequence fits into the path of a run."""
        return any(record["te_percent"] is not None for record in self.records)


def parse_axis(text: str, config: MethodConfig) -> tuple[str, tuple[Any, ...]]:
    """Name and values in a text such as "selection.sets=50,100,200"; semicolons separate values with commas.

    config : a configuration of the variant that has the setting.

    Raises `DataError` for an unknown setting or an invalid value.
    """
    name, equals, rest = text.partition("=")
    item = (SETTINGS | {item.name: item for item in settings.declared(type(config))}).get(name)
    if name == "seed":
        raise DataError("--set seed: all cells have the same seeds; set the number of seeds with --seeds")
    if item is None or not equals:
        near = did_you_mean(name, SETTINGS) if item is None else ""
        page = f"`vo run --variant {config.variant} --help-settings`"
        raise DataError(f"--set {text!r}: {near}expected SETTING=VALUE,VALUE,… with a setting of {page}")
    values = tuple(item.parse(word) for word in rest.split(";" if isinstance(item.default, tuple) else ","))
    for value in values:
        change(config, name, value)  # raises for a setting or value of the other variant
    if len(set(values)) < len(values):
        raise DataError(f"--set {text!r}: a value is repeated")
    return name, values


def grid_of(base: MethodConfig, axes: Axes) -> list[tuple[dict[str, str], MethodConfig]]:
    """The combinations of the values: each setting's value as typed, by name, and the configuration."""
    grid = []
    for values in itertools.product(*axes.values()):
        config = base
        for name, value in zip(axes, values, strict=True):
            config = change(config, name, value)  # raises for settings that contradict each other
        words = dict(zip(axes, map(settings.as_typed, values), strict=True))
        grid.append((words, config))
    return grid


def refuse_unused(method: str, base: MethodConfig, axes: Axes) -> None:
    """Raise `DataError` for a setting that the method uses in no combination of the values."""
    configs = [config for _, config in grid_of(base, axes)]
    for name in axes:
        reasons = [settings.unused_because(config, name) for config in configs]
        if all(reasons):
            raise DataError(f"{name}: {method} does not use this setting, since {reasons[0]}")


def run_sweep(
    sequence: Sequence,
    method: str,
    base: MethodConfig,
    axes: Axes,
    seeds: int,
    folder: Path,
    run: Callable[[list[Job]], list[Outcome]],
) -> Sweep:
    """Run all combinations with seeds 0 … seeds - 1, each in its own folder in `folder`/cells.

    Parameters
    ----------
    sequence : a sequence with ground truth.
    base : the settings that are not on an axis.
    run : function that does the jobs, such as `jobs.run_jobs` with its options.
    """
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth, so a sweep has no errors to compare")
    refuse_unused(method, base, axes)
    grid = grid_of(base, axes)
    jobs = []
    for words, config in grid:
        cell = "+".join(f"{name}={word}" for name, word in words.items()).replace(",", "-")
        cell = re.sub(r"[^\w.=+-]+", "_", cell)  # a class name may have any letter
        for seed in range(seeds):
            place = folder / CELLS / base.variant / cell / f"seed{seed}"
            jobs.append(Job(sequence, method, dataclasses.replace(config, seed=seed), place))
    outcomes = run(jobs)
    remaining = iter(outcomes)
    measure = suitable_protocol(sequence.truth)
    records = list[dict[str, Any]]()
    for words, config in grid:
        done = list(itertools.islice(remaining, seeds))
        runs = [read_run(outcome.job.folder, sequence) for outcome in done if outcome.error is None]
        causes = [f"seed {outcome.job.config.seed}: {outcome.error}" for outcome in done if outcome.error]
        entry = measure_runs(method, runs, measure) if runs else None
        fields = number_fields(np.zeros((2, 0)) if entry is None else entry.errors, entry)
        not_used = [name for name in axes if settings.unused_because(config, name)]
        warnings = dict.fromkeys(warning for result in runs for warning in warnings_of(result))
        notes = {"not_used": " ".join(not_used), "warnings": "; ".join(warnings), "failed": "; ".join(causes)}
        records.append(words | {"seeds": len(runs)} | fields | notes)
    part = " (part of a sequence)" if sequence.is_part else ""
    runs_text = f"{sequence.name}, {len(sequence)} frames{part}, {method}, {base.variant}"
    count = len(kitti_errors(sequence.truth, sequence.truth, measure.lengths, measure.step))
    measure_words = measure.words_with(is_as_kitti(measure, count, not sequence.is_part))
    title = f"{runs_text}: {count_words(count)} of {measure_words}; {seeds_text(seeds)}"
    return Sweep(title, axes, records, outcomes)


def sweep_table(sweep: Sweep) -> ReportTable:
    """A table with a row per combination; failed runs are in the notes."""
    columns = [*sweep.axes, *(unit for unit, _ in ERROR_KINDS.values()), "removed", "back end ms"]
    rows = list[list[str]]()
    notes = list[str]()
    for record in sweep.records:
        share = record["removed_share"]
        errors = [plus_minus(record[kind], record[f"{kind}_std"]) for kind in ERROR_KINDS]
        removed = NO_NUMBER if share is None else f"{100 * share:.1f} %"
        not_used = record.get("not_used", "").split()
        rows.append(
            [
                *(f"{record[name]}{NOT_USED}" if name in not_used else record[name] for name in sweep.axes),
                *errors,
                removed,
                format_number(record["back_end_ms"], 1),
            ]
        )
        if record["failed"]:
            label = ", ".join(f"{name}={record[name]}" for name in sweep.axes)
            notes.append(f"Failed: {label}, {record['failed']}")
        if record.get("warnings"):
            label = ", ".join(f"{name}={record[name]}" for name in sweep.axes)
            notes.append(f"Warning: {label}: {record['warnings']}")
    if any(record.get("not_used") for record in sweep.records):
        notes.append(f"{NOT_USED.strip()}: the setting has no effect on the runs of this row.")
    if not sweep.has_errors:
        notes.append("No errors and no heat map: the path is shorter than every sub-sequence.")
    return without_empty_columns(ReportTable(sweep.title, columns, rows, notes))


def heat_map(sweep: Sweep) -> bytes:
    """PNG of TE and RE; the last setting is the horizontal axis; dark is a large error, a cross no result."""
    *down, across = sweep.axes
    columns = [*map(settings.as_typed, sweep.axes[across])]
    grid = itertools.product(*(sweep.axes[name] for name in down))
    rows = [", ".join(map(settings.as_typed, values)) for values in grid]
    width = max(SMALL_PAGE[0], 1.5 + 1.1 * len(columns))
    height = 2 * (1.2 + 0.55 * len(rows)) + 0.8
    figure = figure_page(sweep.title, width, height)
    for axis, (kind, (label, _)) in zip(figure.subplots(2), ERROR_KINDS.items(), strict=True):
        pairs = np.array([(record[kind], record[f"{kind}_std"]) for record in sweep.records], float)
        values = pairs[:, 0].reshape(len(rows), -1)
        # A difference that one run would not show has no strong colour.
        low = np.nanmin(values)
        high = np.nanmax(values)
        deviation = np.nan_to_num(pairs[:, 1]).mean()
        margin = max(0.0, change_limit(low, deviation, deviation) - (high - low)) / 2
        image = axis.imshow(values, "YlGnBu", aspect="auto", vmin=low - margin, vmax=high + margin)
        figure.colorbar(image, ax=axis, label=f"{label}\nlower is better", format="%.4g")
        axis.set_xticks(range(len(columns)), columns)
        axis.set_yticks(range(len(rows)) if down else [], rows if down else [])
        axis.set(xlabel=across, ylabel=",\n".join(down))
        for (row, column), record in zip(np.ndindex(values.shape), sweep.records, strict=True):
            text = plus_minus(record[kind], record[f"{kind}_std"])
            text = text.replace(" ±", "\n±").replace(NO_NUMBER, "×")
            colour = "white" if image.norm(values[row, column]) > 0.6 else "black"
            axis.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")
    return png(figure)
