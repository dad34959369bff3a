"""A grid over settings: one method on one sequence with every combination of values, over several seeds."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Config, PublishedConfig, change, preset
from ..core import settings
from ..core.errors import DataError
from ..core.types import Array
from ..data.sequence import Sequence
from ..evaluation.kitti import Measure, kitti_errors, suitable_measure
from ..runs.jobs import Job, Outcome
from ..runs.results import read_run
from .entries import back_end_ms, over_seeds
from .report import ReportTable
from .table1 import NONE, number, spread


@dataclass(frozen=True)
class Axis:
    """A setting by its dotted name, and the values it takes."""

    name: str
    values: tuple[Any, ...]

    @property
    def words(self) -> list[str]:
        """The values as they are typed."""
        return [_word(value) for value in self.values]


@dataclass(frozen=True)
class Cell:
    """One combination of values.

    Attributes
    ----------
    values : of each axis, as they are typed.
    te, re : (S,) %, deg/100 m, of the seeds that ran; NaN where no sub-sequence fits.
    removed_share : share of the matches that boxes removed, first seed; NaN where none ran.
    back_end_ms : mean time a frame without getting the matches, milliseconds; NaN where none ran.
    errors : "seed 3: cause" of each run that failed.
    """

    values: tuple[str, ...]
    te: Array
    re: Array
    removed_share: float
    back_end_ms: float
    errors: tuple[str, ...]


@dataclass(frozen=True)
class Sweep:
    """All cells of a grid, the last axis changing fastest.

    `measure` is what TE and RE are taken over; `labels` is False where the method wants vehicle boxes and the
    sequence has none.
    """

    sequence: str
    method: str
    axes: tuple[Axis, ...]
    cells: list[Cell]
    seeds: int
    measure: Measure
    labels: bool

    @property
    def title(self) -> str:
        """What was run and measured."""
        over = "one seed" if self.seeds == 1 else f"mean ± standard deviation over {self.seeds} seeds"
        return f"{self.sequence}, {self.method}: {self.measure.words}; {over}"


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
    variant: str = "kit",
) -> Sweep:
    """Run all combinations with seeds 0 … seeds - 1, each in a run folder under `folder`/cells.

    Parameters
    ----------
    sequence : with truth.
    run : does the jobs, such as `jobs.run_jobs` with its options set.
    """
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth: a sweep has nothing to compare")
    if len({axis.name for axis in axes}) < len(axes):
        raise DataError("--set: a setting is given twice")
    measure = suitable_measure(sequence.truth)
    grid = [
        _jobs(sequence, preset(method, variant=variant), method, axes, values, seeds, folder)
        for values in _combinations(axes)
    ]
    outcomes = iter(run([job for cell in grid for job in cell]))
    cells = [
        _cell(tuple(map(_word, values)), list(itertools.islice(outcomes, seeds)), measure)
        for values in _combinations(axes)
    ]
    labels = sequence.labels is not None or preset(method, variant=variant).filter.rule == "none"
    label = method if variant == "kit" else f"{method}, {variant}"
    return Sweep(sequence.name, label, axes, cells, seeds, measure, labels)


def sweep_table(sweep: Sweep) -> ReportTable:
    """A row for each cell, and what failed."""
    # A long name takes two lines, so that the table fits into a terminal.
    names = [axis.name.replace(".", ".\n") for axis in sweep.axes]
    columns = [*names, "TE %", "RE deg/100 m", "removed", "back\nend ms"]
    rows = []
    notes = [] if sweep.labels else ["The sequence has no labels: boxes remove nothing."]
    for cell in sweep.cells:
        removed = NONE if np.isnan(cell.removed_share) else f"{100 * cell.removed_share:.1f} %"
        rows.append([*cell.values, spread(cell.te), spread(cell.re), removed, number(cell.back_end_ms, 1)])
        place = ", ".join(f"{a.name}={v}" for a, v in zip(sweep.axes, cell.values, strict=True))
        notes += [f"Failed: {place}, {error}" for error in cell.errors]
    return ReportTable(sweep.title, columns, rows, notes)


def sweep_csv(sweep: Sweep) -> str:
    """The table as CSV, numbers with all their digits; empty where there is none."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    numbers = ["te_percent", "te_std", "re_deg_per_100m", "re_std", "removed_share", "back_end_ms"]
    writer.writerow([*(axis.name for axis in sweep.axes), "seeds", *numbers, "errors"])
    for cell in sweep.cells:
        te, re = mean_and_spread(cell.te), mean_and_spread(cell.re)
        values = [*te, *re, cell.removed_share, cell.back_end_ms]
        words = ["" if np.isnan(value) else repr(float(value)) for value in values]
        writer.writerow([*cell.values, len(cell.te), *words, "; ".join(cell.errors)])
    return buffer.getvalue()


def mean_and_spread(values: Array) -> tuple[float, float]:
    """Mean and standard deviation over seeds; NaN where there is none."""
    return (float(values.mean()), float(values.std())) if len(values) else (np.nan, np.nan)


def _combinations(axes: tuple[Axis, ...]) -> list[tuple[Any, ...]]:
    return list(itertools.product(*(axis.values for axis in axes)))


def _jobs(
    sequence: Sequence,
    base: PublishedConfig,
    method: str,
    axes: tuple[Axis, ...],
    values: tuple[Any, ...],
    seeds: int,
    folder: Path,
) -> list[Job]:
    """The runs of one cell; settings that do not go together raise `DataError`."""
    jobs = []
    name = "+".join(f"{a.name}={_word(v)}" for a, v in zip(axes, values, strict=True)).replace(",", "-")
    for seed in range(seeds):
        config = dataclasses.replace(base, seed=seed)
        for axis, value in zip(axes, values, strict=True):
            config = change(config, axis.name, value)
        jobs.append(Job(sequence, method, config, folder / "cells" / base.variant / name / f"seed{seed}"))
    return jobs


def _cell(words: tuple[str, ...], outcomes: list[Outcome], measure: Measure) -> Cell:
    """What the runs of a cell add up to."""
    runs, errors = [], []
    for outcome in outcomes:
        if outcome.error is None:
            runs.append(read_run(outcome.job.folder, outcome.job.sequence))
        else:
            errors.append(f"seed {outcome.job.config.seed}: {outcome.error}")
    truth = outcomes[0].job.sequence.truth
    assert truth is not None
    found = [kitti_errors(truth, run.poses, measure.lengths, measure.step) for run in runs]
    return Cell(
        values=words,
        te=over_seeds(e.te for e in found),
        re=over_seeds(e.re for e in found),
        removed_share=runs[0].removed_share if runs else np.nan,
        back_end_ms=float(np.mean([back_end_ms(run) for run in runs])) if runs else np.nan,
        errors=tuple(errors),
    )


def _word(value: Any) -> str:
    """A value as it is typed."""
    if isinstance(value, bool):
        return "on" if value else "off"
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
