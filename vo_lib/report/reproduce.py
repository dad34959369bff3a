"""Table 1 over sequences, methods and seeds: the runs, their errors, and the files of `vo reproduce`."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from urllib.parse import quote

import numpy as np

from ..config import preset
from ..data.catalogue import KITTI, SYNTHETIC, available
from ..data.scenes import TABLE_SCENES
from ..data.sequence import Sequence
from ..errors import DataError
from ..evaluation.kitti import Measure
from ..files import write_atomic
from ..geometry.types import Array
from ..paper.settings import MethodConfig
from ..runs.folder import read_run
from ..runs.jobs import Job, Outcome
from .entries import BENCHMARK_FRAMES, Entry, Group, measure_runs
from .film import FILM_ENDING
from .page import Picture, ReportTable, markdown, records_csv, render_report
from .plots import errors_figure, png, trajectories_figure
from .printed import PaperTable, printed_table
from .table1 import VARIANT_WORDS, table_records

FIGURE_4_SEQUENCES = (f"{KITTI}02", f"{KITTI}07")


@dataclass(frozen=True)
class Reproduction:
    """Errors and paths of the runs of a table.

    Attributes
    ----------
    missing : KITTI sequences that are not on this machine.
    failed : names of failed runs, by cause.
    entries : errors by sequence and method, for sequences with ground truth.
    paths : for each variant and sequence, the truth or None, and each method's path for the first seed, all
        (N, 4, 4).
    """

    missing: list[str]
    failed: dict[str, list[str]]
    entries: list[Entry] = field(default_factory=list)
    paths: dict[tuple[str, str], tuple[Array | None, dict[str, Array]]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """Sentences on missing sequences, on sequences without truth, and on each cause of failed runs."""
        sentences = [f"Not found, so not run: {', '.join(self.missing)}."] if self.missing else []
        if bare := sorted({name for (_, name), (truth, _) in self.paths.items() if truth is None}):
            sentences.append(
                f"No ground truth, so no errors: {', '.join(bare)}; the poses are in the folder runs."
            )
        if short := dict.fromkeys(e.sequence for e in self.entries if not np.isfinite(e.errors).any()):
            sentences.append(f"Shorter than every sub-sequence, so no errors: {', '.join(short)}.")
        for cause, (job, *others) in self.failed.items():
            sentences.append(f"Failed: {job}{f' and {len(others)} more' if others else ''}: {cause}")
        return sentences


def default_sequences() -> list[str]:
    """The benchmark's sequences on this machine or, if there are none, drawn scenes."""
    names = available()
    return [name for name in BENCHMARK_FRAMES if name in names] or [
        f"{SYNTHETIC}{name}" for name in TABLE_SCENES
    ]


def split_missing(names: list[str]) -> tuple[list[str], list[str]]:
    """Names of available sequences, and of missing KITTI sequences; `DataError` if all are missing."""
    folders = available()
    missing = [name for name in names if name.startswith(KITTI) and name not in folders]
    present = [name for name in dict.fromkeys(names) if name not in missing]
    if not present:
        raise DataError(f"none of the sequences is on this machine: {', '.join(missing)}; see `vo check`")
    return present, missing


def plan_jobs(
    sequences: list[Sequence],
    methods: Mapping[str, list[str]],
    seeds: int,
    folder: Path,
    config: MethodConfig | None = None,
) -> list[Job]:
    """A job for each variant, sequence, method and seed 0 … seeds - 1.

    methods : names by variant; config : settings of a single method, in place of its preset.
    """
    names = [sequence.name for sequence in sequences]
    duplicates = [name for name in names if names.count(name) > 1]
    if duplicates:
        raise DataError(f"two sequences have the name {duplicates[0]}: run them separately")
    jobs = []
    for variant, of_variant in methods.items():
        for sequence, method, seed in itertools.product(sequences, of_variant, range(seeds)):
            settings = replace(config or preset(method, variant=variant), seed=seed)
            path = job_folder(folder, variant, sequence.name, method, seed)
            jobs.append(Job(sequence, method, settings, path))
    return jobs


def job_folder(folder: Path, variant: str, sequence: str, method: str, seed: int) -> Path:
    """The run folder of a job, inside the folder of the table."""
    return folder / "runs" / variant / slug(sequence) / method / f"seed_{seed}"


def slug(name: str) -> str:
    """A sequence's name as a file name: "kitti/07" is kitti_07."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name)


def collect(outcomes: list[Outcome], missing: list[str], measure: Measure | None = None) -> Reproduction:
    """Errors and paths of finished jobs, read from their folders."""
    table = Reproduction(missing, {})
    jobs_of: dict[tuple[str, str, str], list[Job]] = {}
    for job, error in ((outcome.job, outcome.error) for outcome in outcomes):
        if error is not None:
            table.failed.setdefault(error, []).append(job.name)
        else:
            jobs_of.setdefault((job.config.variant, job.sequence.name, job.method), []).append(job)
    for (variant, name, method), jobs in jobs_of.items():
        runs = [read_run(job.folder, job.sequence) for job in jobs]
        truth = runs[0].sequence.truth
        table.paths.setdefault((variant, name), (truth, {}))[1][method] = runs[0].poses
        if truth is not None:
            table.entries.append(measure_runs(method, runs, measure))
    return table


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
