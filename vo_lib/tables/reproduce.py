"""Table 1 over sequences, methods and seeds: which runs it takes, and what they add up to."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..beyond.calibration import Calibration
from ..config import PublishedConfig, preset
from ..core.errors import DataError
from ..core.types import Array
from ..data.scenes import SCENES
from ..data.sequence import KITTI, SYNTHETIC, Sequence, available
from ..evaluation.kitti import Measure
from ..runs.jobs import Job, Outcome
from ..runs.results import read_run
from .entries import BENCHMARK, Entry, measure_runs

FAILURES_TOLD = 8  # a cause that all runs share fills no screen


@dataclass(frozen=True)
class Reproduction:
    """What the runs of a table add up to.

    Attributes
    ----------
    entries : errors by sequence and method, where there is truth.
    paths : by variant and sequence the truth, if known, and of each method the first seed's, (N, 4, 4) each.
    missing : KITTI sequences asked for that are not here.
    failed : (job, cause) of runs that gave nothing, in words.
    seeds : how many were asked for.
    calibrations : what the kit's way learnt on each sequence, with the first method and seed.
    doubts : what makes a sequence's input doubtful, as that run says it.
    """

    entries: list[Entry]
    paths: dict[tuple[str, str], tuple[Array | None, dict[str, Array]]]
    missing: list[str]
    failed: list[tuple[str, str]]
    seeds: int
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    doubts: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """What is not in the tables and why, and what is doubtful in them, a sentence each."""
        doubts = [f"Doubtful: {name}: {said}." for name, each in self.doubts.items() for said in each]
        absent = [f"Not found, so not run: {', '.join(self.missing)}."] if self.missing else []
        failed = [f"Failed: {job}: {cause}" for job, cause in self.failed[:FAILURES_TOLD]]
        more = len(self.failed) - len(failed)
        failed += [f"Failed: {more} runs more; metrics.json names them."] if more else []
        return absent + failed + doubts


def default_sequences() -> list[str]:
    """The benchmark's sequences that are here or, without any, the synthetic scenes."""
    found = available()
    return [name for name in BENCHMARK if name in found] or [f"{SYNTHETIC}{name}" for name in SCENES]


def split_missing(names: list[str]) -> tuple[list[str], list[str]]:
    """Names that can be opened, and KITTI sequences that are not here; `DataError` when none is left."""
    found = available()
    missing = [name for name in names if name.startswith(KITTI) and name not in found]
    present = [name for name in dict.fromkeys(names) if name not in missing]
    if not present:
        raise DataError(f"none of the sequences is here: {', '.join(missing)}; see `vo check`")
    return present, missing


def plan_jobs(
    sequences: list[Sequence],
    methods: Mapping[str, list[str]],
    seeds: int,
    folder: Path,
    config: PublishedConfig | None = None,
) -> list[Job]:
    """A run for each variant, sequence, method and seed 0 … seeds - 1.

    methods : names by variant. The runs are in runs/<variant>/<sequence>/<method>/seed_<n> of the folder.
    config : settings of the one method, where they are not its own.
    """
    names = [sequence.name for sequence in sequences]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise DataError(f"two sequences are called {twice[0]}: run them one after the other")
    jobs = []
    for variant, names_of in methods.items():
        for sequence, method, seed in itertools.product(sequences, names_of, range(seeds)):
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


def collect(
    outcomes: list[Outcome], missing: list[str], seeds: int, measure: Measure | None = None
) -> Reproduction:
    """The runs of finished jobs, read from their folders, as a table's numbers."""
    failed = [(o.job.name, o.error) for o in outcomes if o.error is not None]
    table = Reproduction([], {}, missing, failed, seeds)
    together: dict[tuple[str, str, str], list[Job]] = {}
    for job in (outcome.job for outcome in outcomes if outcome.error is None):
        together.setdefault((job.config.variant, job.sequence.name, job.method), []).append(job)
    for (variant, name, method), jobs in together.items():
        runs = []
        for job in jobs:
            try:
                runs.append(read_run(job.folder, job.sequence))
            except DataError as error:
                table.failed.append((job.name, str(error)))
        if not runs:
            continue
        first = runs[0]
        table.doubts.setdefault(name, first.doubts)
        if first.calibration is not None:
            table.calibrations.setdefault(name, first.calibration)
        table.paths.setdefault((variant, name), (first.sequence.truth, {}))[1][method] = first.poses
        if first.sequence.truth is not None:
            table.entries.append(measure_runs(method, runs, measure))
    return table
