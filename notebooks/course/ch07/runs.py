"""Chapter 7: runs of several methods and seeds, done here or read back from run folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vo_lib.config import VARIANTS, PublishedConfig, preset
from vo_lib.core.errors import DataError
from vo_lib.core.types import Progress
from vo_lib.data.drawn import cache_folder
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import SHORT_MEASURE
from vo_lib.runs.match_cache import CachedMatches
from vo_lib.runs.results import read_run, run_folder, write_run
from vo_lib.runs.runner import Run, run_methods
from vo_lib.tables.comparison import StoredRun, read_stored_run
from vo_lib.tables.entries import Entry, measure_runs
from vo_lib.tables.reproduce import job_folder

from ..frames import Memory, opened


@dataclass(frozen=True)
class Table:
    """Errors of the same runs twice: over what `vo reproduce` takes, and over short pieces."""

    suited: list[Entry]
    short: list[Entry]


LITERAL = "kit, literal"
WAYS = (*VARIANTS, LITERAL)
_tables: Memory[Table] = Memory(12)


@dataclass(frozen=True)
class Plan:
    """What the Run button does: each method with the seeds 0 … seeds - 1 over a whole sequence or a part.

    `variant` is one of `WAYS`.
    """

    sequence: Sequence
    methods: tuple[str, ...]
    seeds: int
    variant: str

    @property
    def key(self) -> tuple[object, ...]:
        """What decides the result."""
        sequence = self.sequence
        return sequence.folder, sequence.frames[0], len(sequence), self.methods, self.seeds, self.variant

    @property
    def folder(self) -> Path:
        """Where its run folders are written."""
        return cache_folder().parent / "runs" / "chapter7" / f"{len(self.sequence)}_frames"


def way(method: str, variant: str, seed: int = 0) -> PublishedConfig:
    """A method's configuration as `published`, the `kit`'s way, or that with its winner taken as it is."""
    if variant == LITERAL:
        return preset(method, mode="literal", seed=seed)
    return preset(method, variant=variant, seed=seed)


def known(plan: Plan) -> Table | None:
    """The errors of a plan that was run here, or None."""
    return _tables.get(plan.key, lambda: Table([], [])) if plan.key in _tables else None


def run_plan(plan: Plan, progress: Progress | None = None) -> Table:
    """All runs of a plan on the same matches, written into run folders once the last frame is done."""
    return _tables.get(plan.key, lambda: _run(plan, progress))


def _run(plan: Plan, progress: Progress | None) -> Table:
    names = {(method, seed): f"{method} {seed}" for method in plan.methods for seed in range(plan.seeds)}
    configs = {name: way(method, plan.variant, seed) for (method, seed), name in names.items()}
    first = next(iter(configs.values()))
    matches = CachedMatches(plan.sequence, first.features, first.matching)
    runs = run_methods(plan.sequence, configs, progress, matches)
    for (method, seed), name in names.items():
        with run_folder(job_folder(plan.folder, plan.variant, plan.sequence.name, method, seed)) as folder:
            write_run(folder, runs[name], method)
    by_method = {m: [runs[names[m, seed]] for seed in range(plan.seeds)] for m in plan.methods}
    return _measured(list(by_method.items()))


def _measured(runs: list[tuple[str, list[Run]]]) -> Table:
    """Errors of (method, its runs over seeds)."""
    return Table(
        [measure_runs(method, some) for method, some in runs],
        [measure_runs(method, some, SHORT_MEASURE) for method, some in runs],
    )


def load_folder(folder: str, here: Sequence | None, progress: Progress | None = None) -> Table:
    """Errors of all finished runs below a folder, such as that of `vo reproduce`.

    `here` is a sequence that is open; a folder of one's own is known by its name only.

    Raises
    ------
    DataError : no run is there, two runs have sequence, method and seed in common, or a sequence is not here.
    """
    places = sorted(path.parent for path in Path(folder).expanduser().rglob("config.json"))
    if not places:
        raise DataError("no run folder is below it: expected config.json, as `vo run` writes it", folder)
    together: dict[tuple[str, str, str], dict[int, Run]] = {}
    for count, place in enumerate(places, start=1):
        stored = read_stored_run(place)
        runs = together.setdefault((stored.sequence, stored.variant, stored.method), {})
        if stored.seed in runs:
            twice = f"{stored.sequence}, {stored.method}, seed {stored.seed}"
            raise DataError(f"a second run of {twice}: expected the runs of one table", place)
        runs[stored.seed] = read_run(place, _part_of(stored, here))
        if progress is not None:
            progress(count, len(places))
    return _measured(
        [(method, [runs[seed] for seed in sorted(runs)]) for (*_, method), runs in together.items()]
    )


def _part_of(stored: StoredRun, here: Sequence | None) -> Sequence:
    """The frames that were run."""
    is_open = here is not None and here.name == stored.sequence
    sequence = here if here is not None and is_open else opened(stored.sequence)
    first, last = stored.frames
    if not {first, last} <= set(sequence.frames):
        raise DataError(f"{sequence.name} has no frames {first} to {last}", stored.folder)
    return sequence.part(sequence.frames.index(first), sequence.frames.index(last) + 1)
