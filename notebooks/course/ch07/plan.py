"""Chapter 7: the part of a sequence that is run, and the runs of several methods and seeds on this part."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path

from vo_lib.config import VARIANTS, preset
from vo_lib.data.catalogue import KITTI, available, open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import with_all_labels
from vo_lib.detection.models import list_detectors
from vo_lib.errors import DataError
from vo_lib.evaluation.kitti_errors import KITTI_PROTOCOL, suitable_protocol
from vo_lib.geometry.types import Progress
from vo_lib.report.table1 import Entry, measure_runs
from vo_lib.report.table1_durations import kitti_seconds
from vo_lib.runs.drive import run_methods
from vo_lib.runs.durations import HOUR_S, Durations
from vo_lib.runs.jobs import Job, run_jobs
from vo_lib.runs.match_cache import CachedMatches

from ..frames import longest_piece, opened
from ..kept_runs import sequence_key
from ..memory import Memory

STREET = "synthetic/traffic"
STREET_FRAMES = 130  # enough for a path of 100 m
WHOLE = "kitti/04"  # the shortest sequence of Table 1, 271 frames
# Number of the first frame of a part: the truth of earlier steps has errors of up to 20 cm.
FIRST = {"kitti/00": 16}

_entries: Memory[list[Entry]] = Memory(12)


@dataclass(frozen=True)
class Plan:
    """The work of the Run button: each method with seeds 0 … seeds - 1 over a sequence with truth."""

    sequence: Sequence
    methods: tuple[str, ...]
    seeds: int
    variant: str

    @property
    def key(self) -> tuple[Hashable, ...]:
        """Key of the result, from all inputs."""
        return sequence_key(self.sequence, self.methods, self.seeds, self.variant)

    @property
    def is_run(self) -> bool:
        """Whether `run_plan` has stored the result."""
        return self.key in _entries


def part_of(sequence: Sequence, frames: int, first: int | None = None) -> Sequence:
    """A part of `frames` frames, at most the whole; by default, the first frames with a good truth."""
    if frames >= len(sequence):
        return sequence
    if first is None:
        first = 0
        if sequence.name in FIRST:
            # The sequence may be a part itself, which begins there already.
            first = max(FIRST[sequence.name] - int(sequence.frames[0]), 0)
    first = min(first, len(sequence) - frames)
    return sequence.part(first, first + frames)


def clip(
    frames: int, detector: str = "", progress: Progress | None = None, first: int | None = None
) -> Sequence:
    """`WHOLE` if available, else a part of a KITTI sequence with truth over 100 m, else a part of the street.

    Parameters
    ----------
    frames : number of frames of a part of KITTI; the part of the street has `STREET_FRAMES`.
    first : index of the first frame of the part of KITTI, by default as in `part_of`.
    detector : a name or the path of an ONNX file, for a sequence whose images do not all have labels; by default,
        the first detector on this machine. Without a detector, there are no boxes.
    """
    sequence = _kitti_part(frames, first)
    if sequence is None:
        sequence = part_of(opened(STREET, progress), STREET_FRAMES)
    if not detector:
        detector = next(iter(list_detectors()), "")
    if not detector:
        return sequence
    return with_all_labels(sequence, detector, progress=progress)


def _kitti_part(frames: int, first: int | None) -> Sequence | None:
    """`WHOLE` if available, else a part of another KITTI sequence with truth over 100 m; None without one."""
    names = [name for name in available() if name.startswith(KITTI)]
    if WHOLE in names:
        names.remove(WHOLE)
        names.insert(0, WHOLE)
    for name in names:
        sequence = longest_piece(open_sequence(name))
        if name != WHOLE:
            sequence = part_of(sequence, frames, first)
        if sequence.truth is not None and suitable_protocol(sequence.truth) == KITTI_PROTOCOL:
            return sequence
    return None


def table_hours(
    sequence: Sequence, seeds: int, workers: int, progress: Progress | None = None
) -> dict[str, float]:
    """Hours of Table 1 on all of KITTI 00-10 by variant, by the rule of `vo reproduce`.

    All methods are run on the sequence with one seed, in `workers` processes at the same time, since processes
    slow each other down; then all frames and seeds are extrapolated from their durations.
    """
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        jobs = []
        for variant, methods in VARIANTS.items():
            for method, seed in itertools.product(methods, range(seeds)):
                config = preset(method, variant=variant, seed=seed)
                jobs.append(Job(sequence, method, config, folder / variant / method / f"seed_{seed}"))
        durations = Durations()
        first = [job for job in jobs if job.config.seed == 0]
        outcomes = run_jobs(first, workers, progress, folder / "cache", durations=durations)
    failed = [outcome.error for outcome in outcomes if outcome.error is not None]
    if failed:
        raise DataError(f"a run for the estimate failed: {failed[0]}")
    hours = {}
    for variant in VARIANTS:
        seconds = kitti_seconds([job for job in jobs if job.config.variant == variant], durations)
        if seconds is not None:
            hours[variant] = seconds / HOUR_S
    return hours


def run_plan(plan: Plan, progress: Progress | None = None) -> list[Entry]:
    """Errors of each method; all methods are run on the same matches.

    The errors are over KITTI's sub-sequences or, on a short path, over shorter sub-sequences.
    """

    def run() -> list[Entry]:
        seeds = range(plan.seeds)
        configs = {}
        for method, seed in itertools.product(plan.methods, seeds):
            configs[f"{method} {seed}"] = preset(method, variant=plan.variant, seed=seed)
        any_config = next(iter(configs.values()))
        matches = CachedMatches(plan.sequence, any_config)
        runs = run_methods(plan.sequence, configs, progress, matches)
        entries = []
        for method in plan.methods:
            of_method = [runs[f"{method} {seed}"] for seed in seeds]
            entries.append(measure_runs(method, of_method))
        return entries

    return _entries.get(plan.key, run)
