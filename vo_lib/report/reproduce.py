"""Table 1 over sequences, methods and seeds: its runs, their errors, and the files of `vo reproduce`."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from collections.abc import Sequence as Items
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
from .entries import BENCHMARK_FRAMES, Entry, Group, group_entries, measure_runs
from .film import FILM_ENDING
from .page import Picture, markdown, records_csv, render_report
from .plots import errors_figure, png, trajectories_figure
from .printed import PaperTable, printed_table
from .table1 import VARIANT_WORDS, layout_tables, table_records

FIGURE_4_SEQUENCES = (f"{KITTI}02", f"{KITTI}07")
TABLE_FILES = ("table1.md", "table1.csv", "report.html")


@dataclass(frozen=True)
class Reproduction:
    """Errors and paths of the runs of a table.

    Attributes
    ----------
    missing : KITTI sequences asked for that are not here.
    failed : names of the runs that failed, by cause.
    entries : errors by sequence and method, where there is truth.
    paths : by variant and sequence the truth, if any, and the first seed's path by method, (N, 4, 4) each.
    """

    missing: list[str]
    failed: dict[str, list[str]]
    entries: list[Entry] = field(default_factory=list)
    paths: dict[tuple[str, str], tuple[Array | None, dict[str, Array]]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """Sentences on missing sequences, on those without truth, and on each cause of failed runs."""
        sentences = [f"Not found, so not run: {', '.join(self.missing)}."] if self.missing else []
        if bare := sorted({name for (_, name), (truth, _) in self.paths.items() if truth is None}):
            sentences.append(
                f"No ground truth, so poses in the folder runs, but no errors: {', '.join(bare)}."
            )
        for cause, (job, *others) in self.failed.items():
            sentences.append(f"Failed: {job}{f' and {len(others)} more' if others else ''}: {cause}")
        return sentences


def default_sequences() -> list[str]:
    """The benchmark's sequences that are here or, without any, the synthetic scenes."""
    names = available()
    return [name for name in BENCHMARK_FRAMES if name in names] or [
        f"{SYNTHETIC}{name}" for name in TABLE_SCENES
    ]


def split_missing(names: list[str]) -> tuple[list[str], list[str]]:
    """Names that can be opened, and KITTI sequences that are not here; `DataError` when none is left."""
    folders = available()
    missing = [name for name in names if name.startswith(KITTI) and name not in folders]
    present = [name for name in dict.fromkeys(names) if name not in missing]
    if not present:
        raise DataError(f"none of the sequences is here: {', '.join(missing)}; see `vo check`")
    return present, missing


def plan_jobs(
    sequences: list[Sequence],
    methods: Mapping[str, list[str]],
    seeds: int,
    folder: Path,
    config: MethodConfig | None = None,
) -> list[Job]:
    """A run for each variant, sequence, method and seed 0 … seeds - 1.

    methods : names by variant; config : settings of the one method, where they are not its own.
    """
    names = [sequence.name for sequence in sequences]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise DataError(f"two sequences are called {twice[0]}: run them one after the other")
    jobs = []
    for variant, of_variant in methods.items():
        for sequence, method, seed in itertools.product(sequences, of_variant, range(seeds)):
            settings = replace(config or preset(method, variant=variant), seed=seed)
            place = job_folder(folder, variant, sequence.name, method, seed)
            jobs.append(Job(sequence, method, settings, place))
    return jobs


def job_folder(folder: Path, variant: str, sequence: str, method: str, seed: int) -> Path:
    """The run folder of a job under the folder of the table."""
    return folder / "runs" / variant / slug(sequence) / method / f"seed_{seed}"


def slug(name: str) -> str:
    """A sequence's name as a file name: "kitti/07" is kitti_07."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name)


def collect(outcomes: list[Outcome], missing: list[str], measure: Measure | None = None) -> Reproduction:
    """Errors and paths of finished jobs, read from their folders."""
    table = Reproduction(missing, {})
    together: dict[tuple[str, str, str], list[Job]] = {}
    for job, error in ((outcome.job, outcome.error) for outcome in outcomes):
        if error is not None:
            table.failed.setdefault(error, []).append(job.name)
        else:
            together.setdefault((job.config.variant, job.sequence.name, job.method), []).append(job)
    for (variant, name, method), jobs in together.items():
        runs = [read_run(job.folder, job.sequence) for job in jobs]
        truth = runs[0].sequence.truth
        table.paths.setdefault((variant, name), (truth, {}))[1][method] = runs[0].poses
        if truth is not None:
            table.entries.append(measure_runs(method, runs, measure))
    return table


def write_table_files(
    folder: Path, result: Reproduction, paper: PaperTable, said: Items[str], made: list[str]
) -> None:
    """Write `TABLE_FILES` and figures; `said` are the results in sentences, `made` command and duration."""
    groups = group_entries(result.entries)
    tables = [table for group in groups for table in layout_tables(group, paper)]
    printed = [printed_table()] if any(group.kitti for group in groups) else []
    pictures, films = _pictures(folder, result, groups), _films(folder, result)
    sentences = "".join(f"{line}\n\n" for line in [*said, *result.problems])
    contents = (
        sentences + "\n".join(map(markdown, [*tables, *printed])),
        records_csv(table_records(groups, paper)),
        render_report(said, tables, printed, pictures, made, result.problems, films),
    )
    for name, content in zip(TABLE_FILES, contents, strict=True):
        write_atomic(folder / name, content)


def _pictures(folder: Path, result: Reproduction, groups: list[Group]) -> list[Picture]:
    """Of each variant the errors, Figure 4 where one of its sequences is there, and each sequence's paths."""
    pictures = []
    for variant in dict.fromkeys(variant for variant, _ in result.paths):
        words = VARIANT_WORDS[variant]
        for group in (each for each in groups if each.variant == variant):
            errors = {key: e.errors for key, e in group.entries.items() if np.isfinite(e.te).all()}
            if errors:
                figure = errors_figure(f"sub-sequences of {group.measure.words}", errors)
                pictures.append(Picture(png(figure), f"Errors, a bar for each method; {words}."))
        panels = {name: panel for (each, name), panel in result.paths.items() if each == variant}
        figure_4 = {name: panels[name] for name in FIGURE_4_SEQUENCES if name in panels}
        figures = {f"figure4_{variant}": figure_4} if figure_4 else {}
        figures |= {f"trajectory_{variant}_{slug(name)}": {name: panel} for name, panel in panels.items()}
        for file, shown in figures.items():
            caption = (
                f"{'Figure 4: ' if shown is figure_4 else ''}{' and '.join(shown)}, paths from above and, "
            )
            caption += f"with truth, their distance from it; {words}, first seed."
            pictures.append(Picture(png(trajectories_figure(shown)), caption))
            write_atomic(folder / f"{file}.png", pictures[-1].data)
    return pictures


def _films(folder: Path, result: Reproduction) -> list[tuple[str, str]]:
    """Addresses in the report, and captions, of the films in the run folders of the first seed."""
    films = []
    for (variant, name), (_, methods) in result.paths.items():
        for method in methods:
            for film in sorted(job_folder(folder, variant, name, method, 0).glob(f"*{FILM_ENDING}")):
                caption = f"{name}, {method}; {VARIANT_WORDS[variant]}, first seed."
                films.append((quote(film.relative_to(folder).as_posix()), caption))
    return films
