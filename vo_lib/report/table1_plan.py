"""The plan of the runs of Table 1: which sequences, and a folder for each run."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from ..data.catalogue import KITTI, SYNTHETIC, available, known_folder
from ..data.kitti import EXPECTED_FRAMES
from ..data.scenes import TABLE_SCENES
from ..data.sequence import Sequence
from ..errors import DataError
from ..paper.settings import MethodConfig
from ..runs.jobs import Job
from .blocks import Block, Changes, settings_folder, settings_words

RUNS = "runs"  # folder of the runs in the folder of the table


def default_sequences() -> list[str]:
    """Names of the benchmark's sequences on this machine or, if there are none, of drawn scenes."""
    folders = available()
    names = [f"{KITTI}{number}" for number in EXPECTED_FRAMES]
    of_benchmark = [name for name in names if name in folders]
    return of_benchmark or [f"{SYNTHETIC}{name}" for name in TABLE_SCENES]


def split_missing(names: list[str]) -> tuple[list[str], list[str]]:
    """Names of available sequences, and of missing KITTI sequences; `DataError` if all are missing."""
    missing = [name for name in names if name.startswith(KITTI) and known_folder(name) is None]
    present = [name for name in dict.fromkeys(names) if name not in missing]
    if not present:
        raise DataError(f"none of the sequences is on this machine: {', '.join(missing)}; see `vo check`")
    return present, missing


@dataclass(frozen=True)
class Cell:
    """The runs of a method on a sequence in a block, one per seed."""

    block: Block
    sequence: Sequence
    method: str
    jobs: tuple[Job, ...]


def plan_cells(
    blocks: Iterable[Block],
    methods: Mapping[str, list[str]],
    sequences: list[str],
    seeds: int,
    folder: Path,
    opened: Callable[[str, MethodConfig], Sequence],
) -> list[Cell]:
    """A cell for each block, sequence and method, with seeds 0 … seeds - 1.

    Where no change of a block has an effect on a method, the cell has the runs of the method's preset.

    methods : names by variant.
    sequences : names.
    opened : gives the sequence of a name for a configuration, since the vehicle boxes of a detector depend on
        the classes in it (`filter.classes`).

    Raises as `refuse_equal_names`.
    """
    refuse_equal_names(sequences)
    cells = []
    for block in blocks:
        for name, method in itertools.product(sequences, methods[block.variant]):
            config = block.config(method)
            sequence = opened(name, config)
            used = block.used(method)
            words = settings_words(used)
            jobs = []
            for seed in range(seeds):
                run_folder = job_folder(folder, block.variant, name, method, seed, used)
                jobs.append(Job(sequence, method, replace(config, seed=seed), run_folder, words))
            cells.append(Cell(block, sequence, method, tuple(jobs)))
    return cells


class _HasJobs(Protocol):
    """A cell of a table or of a sweep."""

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Its runs."""


def jobs_of(cells: Iterable[_HasJobs]) -> list[Job]:
    """The jobs of all cells, each once: cells may share them."""
    job_in = {}
    for cell in cells:
        for job in cell.jobs:
            job_in[job.folder] = job
    return list(job_in.values())


def job_folder(
    folder: Path, variant: str, sequence: str, method: str, seed: int, changes: Changes = ()
) -> Path:
    """The folder of a run in the folder of the table; `changes` : of the preset, those with an effect."""
    place = folder / RUNS / variant / slug(sequence) / method
    if changes:
        place /= settings_folder(changes)
    return place / f"seed_{seed}"


def refuse_equal_names(sequences: Iterable[str]) -> None:
    """Raise `DataError` for sequences whose results would have the same folder or file names (`slug`).

    Names that differ only in capital letters are refused as well: for some file systems, they are equal.
    """
    earlier_names: dict[str, str] = {}
    for name in sequences:
        place = slug(name).lower()
        if place in earlier_names:
            earlier = earlier_names[place]
            fault = f"two sequences have the name {name}"
            if earlier != name:
                fault = f"the results of {earlier} and {name} would have the same name, {slug(name)}"
            raise DataError(f"{fault}: call the command once for each of them")
        earlier_names[place] = name


def slug(name: str) -> str:
    """A sequence's name as a file name: "kitti/07" is kitti_07."""
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name)
