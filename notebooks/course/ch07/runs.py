"""Chapter 7: the part of a sequence that is run, and runs of several methods and seeds on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vo_lib.config import preset
from vo_lib.data.catalogue import KITTI, available, open_sequence
from vo_lib.data.drawn import cache_folder
from vo_lib.data.sequence import Sequence
from vo_lib.detection.labels import labelled_sequence
from vo_lib.detection.models import list_detectors
from vo_lib.evaluation.kitti import KITTI_MEASURE, suitable_measure
from vo_lib.geometry.types import Progress
from vo_lib.report.entries import Entry, measure_runs
from vo_lib.runs.drive import run_methods
from vo_lib.runs.folder import run_folder, write_run
from vo_lib.runs.identity import run_identity
from vo_lib.runs.matches import CachedMatches

from ..frames import Memory, opened

STREET, STREET_FRAMES = "synthetic/traffic", 130  # the frames that make 100 m, and a little more
WHOLE = "kitti/04"  # the shortest sequence of Table 1, 271 frames
FIRST = {"kitti/00": 16}  # where a part begins: the true steps before are wrong by up to 20 cm

_entries: Memory[list[Entry]] = Memory(12)


@dataclass(frozen=True)
class Plan:
    """What the Run button does: each method with the seeds 0 … seeds - 1 over a sequence with truth."""

    sequence: Sequence
    methods: tuple[str, ...]
    seeds: int
    variant: str

    @property
    def key(self) -> tuple[object, ...]:
        """What decides the result."""
        sequence = self.sequence
        place = sequence.folder, sequence.labels, sequence.frames[0], len(sequence)
        return *place, self.methods, self.seeds, self.variant

    @property
    def folder(self) -> Path:
        """Where its run folders are written."""
        return cache_folder().parent / "runs" / "chapter7" / f"{len(self.sequence)}_frames"

    @property
    def is_run(self) -> bool:
        """Whether `run_plan` has been called with it."""
        return self.key in _entries


def part_of(sequence: Sequence, frames: int, first: int | None = None) -> Sequence:
    """So many frames of a sequence, all where it has no more; by default the first ones with a good truth."""
    if frames >= len(sequence):
        return sequence
    first = min(FIRST.get(sequence.name, 0) if first is None else first, len(sequence) - frames)
    return sequence.part(first, first + frames)


def clip(
    frames: int, detector: str = "", progress: Progress | None = None, first: int | None = None
) -> Sequence:
    """`WHOLE` where it is found; else a part of the first KITTI sequence with truth and 100 m, else of the street.

    `first` : the part's first frame, as in `part_of`.

    Its boxes are the labels beside its images, else those of a detector, a name or the path of an ONNX file;
    by default of the first that was fetched. Without one there are none.
    """
    names = sorted((name for name in available() if name.startswith(KITTI)), key=lambda name: name != WHOLE)
    opened_ones = ((name, open_sequence(name)) for name in names)
    parts = (each if name == WHOLE else part_of(each, frames, first) for name, each in opened_ones)
    found = (p for p in parts if p.truth is not None and suitable_measure(p.truth) == KITTI_MEASURE)
    sequence = next(found, None) or part_of(opened(STREET, progress), STREET_FRAMES)
    detector = detector or next(iter(list_detectors()), "")
    if sequence.labels is not None or not detector:
        return sequence
    return labelled_sequence(sequence, detector, progress=progress)


def run_plan(plan: Plan, progress: Progress | None = None) -> list[Entry]:
    """Errors of each method, all run on the same matches; run folders are written once the last frame is done.

    They are taken over KITTI's sub-sequences where the path holds one, else over shorter ones.
    """
    return _entries.get(plan.key, lambda: _run(plan, progress))


def _run(plan: Plan, progress: Progress | None) -> list[Entry]:
    names = {(method, seed): f"{method} {seed}" for method in plan.methods for seed in range(plan.seeds)}
    configs = {name: preset(m, variant=plan.variant, seed=seed) for (m, seed), name in names.items()}
    first = next(iter(configs.values()))
    matches = CachedMatches(plan.sequence, first)
    runs = run_methods(plan.sequence, configs, progress, matches)
    place = plan.folder / plan.variant / plan.sequence.folder.name
    for (method, seed), name in names.items():
        with run_folder(place / method / f"seed_{seed}") as folder:
            write_run(folder, runs[name], run_identity(plan.sequence, configs[name], method))
    return [measure_runs(m, [runs[names[m, seed]] for seed in range(plan.seeds)]) for m in plan.methods]
