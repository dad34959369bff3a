"""A grid over settings: one method on one sequence with every combination of values, over several seeds."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Config, PublishedConfig, change, preset
from ..core import settings
from ..core.errors import DataError
from ..core.files import csv_text
from ..core.types import Array
from ..data.sequence import Sequence
from ..evaluation.kitti import Measure, suitable_measure
from ..runs.jobs import Job, Outcome
from ..runs.results import read_run
from .entries import Entry, measure_runs
from .error_plots import heat_map_figure
from .plots import png
from .report import NONE, ReportTable, mean_and_spread, number, seeds_words, spread


@dataclass(frozen=True)
class Axis:
    """A setting by its dotted name, and the values it takes."""

    name: str
    values: tuple[Any, ...]


@dataclass(frozen=True)
class Cell:
    """One combination of values: what its runs gave, None where none ran.

    `values` of each axis, as they are typed; `failed` "seed 3: cause" of each run that failed.
    """

    values: tuple[str, ...]
    entry: Entry | None
    failed: tuple[str, ...]

    @property
    def errors(self) -> Array:
        """TE and RE of the seeds that ran, (2, S); NaN where no sub-sequence fits."""
        return np.zeros((2, 0)) if self.entry is None else self.entry.errors

    @property
    def costs(self) -> tuple[float, float]:
        """Share of the matches that boxes removed, and the back end's ms a frame; NaN where none ran."""
        return (np.nan, np.nan) if self.entry is None else (self.entry.removed_share, self.entry.back_end_ms)


@dataclass(frozen=True)
class Sweep:
    """All cells of a grid, the last axis changing fastest; `title` says what was run and measured."""

    title: str
    axes: tuple[Axis, ...]
    cells: list[Cell]
    notes: tuple[str, ...]


def parse_axis(text: str) -> Axis:
    """The axis of "selection.sets=50,100,200"; values that are lists themselves are parted by semicolons.

    Raises `DataError` for an unknown setting, or a value it cannot take.
    """
    name, equals, rest = text.partition("=")
    item = {item.name: item for item in settings.declared(Config)}.get(name)
    if name == "seed":
        raise DataError("--set seed: every cell runs with the same seeds; choose their number with --seeds")
    if item is None or not equals:
        raise DataError(
            f"--set {text!r}: expected SETTING=VALUE,VALUE,… with a setting of `vo run --help-settings`"
        )
    values = tuple(item.parse(word) for word in rest.split(";" if isinstance(item.default, tuple) else ","))
    for value in values:
        item.check(value)
    if len(set(values)) < len(values):
        raise DataError(f"--set {text!r}: a value is given twice")
    return Axis(name, values)


def run_sweep(
    sequence: Sequence,
    method: str,
    axes: tuple[Axis, ...],
    seeds: int,
    folder: Path,
    run: Callable[[list[Job]], list[Outcome]],
    base: PublishedConfig | None = None,
) -> Sweep:
    """Run all combinations with seeds 0 … seeds - 1, each in a run folder under `folder`/cells.

    Parameters
    ----------
    sequence : with truth.
    base : the settings where the axes do not say otherwise; the method's own by default.
    run : does the jobs, such as `jobs.run_jobs` with its options set.
    """
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth: a sweep has nothing to compare")
    if len({axis.name for axis in axes}) < len(axes):
        raise DataError("--set: a setting is given twice")
    measure, base = suitable_measure(sequence.truth), base or preset(method)
    grid: dict[tuple[str, ...], list[Job]] = {}
    for values in itertools.product(*(axis.values for axis in axes)):
        config = base
        for axis, value in zip(axes, values, strict=True):
            config = change(config, axis.name, value)  # refuses settings that do not go together
        words = tuple(map(_word, values))
        name = "+".join(f"{axis.name}={word}" for axis, word in zip(axes, words, strict=True))
        place = folder / "cells" / base.variant / name.replace(",", "-")
        configs = {f"seed{seed}": dataclasses.replace(config, seed=seed) for seed in range(seeds)}
        grid[words] = [Job(sequence, method, each, place / seed) for seed, each in configs.items()]
    outcomes = iter(run([job for jobs in grid.values() for job in jobs]))
    cells = [_cell(words, list(itertools.islice(outcomes, seeds)), measure) for words in grid]
    bare = sequence.labels is None and base.filter.rule != "none"
    label = method if base.variant == "kit" else f"{method}, {base.variant}"
    title = f"{sequence.name}, {label}: {measure.words}; {seeds_words(seeds)}"
    return Sweep(title, axes, cells, ("The sequence has no labels: boxes remove nothing.",) * bare)


def sweep_table(sweep: Sweep) -> ReportTable:
    """A row for each cell, and what failed."""
    # A long name takes two lines, so that the table fits into a terminal.
    names = [axis.name.replace(".", ".\n") for axis in sweep.axes]
    columns = [*names, "TE %", "RE deg/100 m", "removed", "back\nend ms"]
    rows, notes = [], [*sweep.notes]
    for cell in sweep.cells:
        share, ms = cell.costs
        removed = NONE if np.isnan(share) else f"{100 * share:.1f} %"
        rows.append([*cell.values, *map(spread, cell.errors), removed, number(ms, 1)])
        place = ", ".join(f"{a.name}={v}" for a, v in zip(sweep.axes, cell.values, strict=True))
        notes += [f"Failed: {place}, {cause}" for cause in cell.failed]
    return ReportTable(sweep.title, columns, rows, notes)


def sweep_csv(sweep: Sweep) -> str:
    """The table as CSV, numbers with all their digits; empty where there is none."""
    numbers = ["te_percent", "te_std", "re_deg_per_100m", "re_std", "removed_share", "back_end_ms"]
    rows: list[list[object]] = [[*(axis.name for axis in sweep.axes), "seeds", *numbers, "errors"]]
    for cell in sweep.cells:
        values = [value for each in cell.errors for value in mean_and_spread(each)] + [*cell.costs]
        words = ["" if np.isnan(value) else repr(float(value)) for value in values]
        rows.append([*cell.values, cell.errors.shape[1], *words, "; ".join(cell.failed)])
    return csv_text(rows)


def heat_map(sweep: Sweep) -> bytes:
    """TE and RE of a grid of two settings as PNG."""
    (down, rows), (across, columns) = ((axis.name, [*map(_word, axis.values)]) for axis in sweep.axes)
    numbers = np.array([[mean_and_spread(values) for values in cell.errors] for cell in sweep.cells])
    te, re = np.moveaxis(numbers.reshape(len(rows), len(columns), 2, 2), 2, 0)
    return png(
        heat_map_figure(sweep.title, (down, rows), (across, columns), {"TE [%]": te, "RE [deg/100 m]": re})
    )


def _cell(words: tuple[str, ...], outcomes: list[Outcome], measure: Measure) -> Cell:
    """What the runs of a cell add up to."""
    runs = [read_run(each.job.folder, each.job.sequence) for each in outcomes if each.error is None]
    errors = tuple(f"seed {o.job.config.seed}: {o.error}" for o in outcomes if o.error is not None)
    return Cell(words, measure_runs(outcomes[0].job.method, runs, measure) if runs else None, errors)


def _word(value: Any) -> str:
    """A value as it is typed."""
    if isinstance(value, bool):
        return "on" if value else "off"
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
