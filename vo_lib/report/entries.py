"""Errors of methods over seeds, and groups of sequences that may be averaged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..data.catalogue import KITTI
from ..data.kitti import EXPECTED_FRAMES
from ..errors import DataError
from ..evaluation.evaluate import PathErrors, evaluate
from ..evaluation.kitti import KITTI_MEASURE, KittiErrors, Measure, suitable_measure
from ..geometry.rows import joined
from ..geometry.types import Array
from ..runs.drive import Run
from .printed import LEFT_OUT, PAPER_ROWS

FRONT_END_STAGES = ("wait_images", "matching", "cached_matches")
BENCHMARK_FRAMES = {f"{KITTI}{number}": frames for number, frames in EXPECTED_FRAMES.items()}


@dataclass(frozen=True)
class Entry:
    """Errors of one method on one sequence with truth, over S seeds.

    Attributes
    ----------
    sequence, method : names; seeds : (S) seeds of the runs; variant : `published` or `kit`.
    measure : the sub-sequences of TE and RE.
    results : (S) KITTI errors, ATE (SE3 alignment) and RPE of each seed.
    poses : (N, 4, 4) trajectory of the first seed; truth : (N, 4, 4).
    labels : whether the sequence has vehicle boxes.
    removed_share : share of matches removed in boxes for the first seed, in [0, 1].
    back_end_ms : mean time per frame of the back end (everything after the matches), milliseconds.
    """

    sequence: str
    method: str
    variant: str
    seeds: tuple[int, ...]
    measure: Measure
    results: tuple[PathErrors, ...]
    poses: Array
    truth: Array
    labels: bool
    removed_share: float
    back_end_ms: float

    @property
    def errors(self) -> Array:
        """TE and RE of each seed, (2, S), % and deg/100 m; NaN without a sub-sequence."""
        return te_and_re(result.kitti for result in self.results)

    @property
    def is_whole(self) -> bool:
        """Whether the sequence is a complete sequence of the benchmark, with the benchmark's measure."""
        return len(self.truth) == BENCHMARK_FRAMES.get(self.sequence) and self.measure == KITTI_MEASURE


@dataclass(frozen=True)
class Group:
    """Entries that may be averaged: equal variant and measure; either all from KITTI or none.

    `entries` : entries by (sequence, method); `kitti` : whether the sequences are from the benchmark.
    """

    variant: str
    kitti: bool
    measure: Measure
    entries: dict[tuple[str, str], Entry]

    @property
    def sequences(self) -> list[str]:
        """Names of the sequences, in order."""
        return list(dict.fromkeys(sequence for sequence, _ in self.entries))

    @property
    def averaged(self) -> list[str]:
        """Names of the sequences in the mean: all except KITTI's 01, or 01 if it is the only sequence."""
        return [name for name in self.sequences if name != f"{KITTI}{LEFT_OUT}"] or self.sequences

    @property
    def methods(self) -> list[str]:
        """Names of the methods, in order."""
        return list(dict.fromkeys(method for _, method in self.entries))

    @property
    def is_papers(self) -> bool:
        """Whether the group has complete runs of the paper's ten sequences, so the means are comparable."""
        complete = {entry.sequence for entry in self.entries.values() if entry.is_whole}
        return {f"{KITTI}{row}" for row in PAPER_ROWS[1:]} <= complete

    def of_method(self, method: str) -> list[Entry]:
        """Entries of a method, in the order of the sequences."""
        return [entry for (_, name), entry in self.entries.items() if name == method]

    def mean(self, method: str) -> Array:
        """Unweighted mean of TE and RE over the averaged sequences, for each seed, (2, S)."""
        entries = [e for e in self.of_method(method) if e.sequence in self.averaged]
        by_seed = [te_and_re(part for part in parts if len(part)) for parts in _by_seed(entries)]
        means = [part.mean(axis=1) if part.size else (np.nan, np.nan) for part in by_seed]
        return np.reshape(means, (-1, 2)).T

    def pooled(self, method: str) -> Array:
        """TE and RE of each seed, (2, S), over all sub-sequences together, as on KITTI's server."""
        return te_and_re(joined(parts) for parts in _by_seed(self.of_method(method)))


def _by_seed(entries: list[Entry]) -> list[list[KittiErrors]]:
    """For each seed that all entries have, the errors on every sequence."""
    common = set.intersection(*(set(entry.seeds) for entry in entries)) if entries else set()
    return [[e.results[e.seeds.index(seed)].kitti for e in entries] for seed in sorted(common)]


def te_and_re(parts: Iterable[KittiErrors]) -> Array:
    """TE and RE of S sets of sub-sequences, (2, S); NaN for an empty set."""
    return np.array([(part.te, part.re) for part in parts], float).reshape(-1, 2).T


def measure_runs(method: str, runs: list[Run], measure: Measure | None = None) -> Entry:
    """Errors of a method's runs, one per seed; the default measure is from `suitable_measure`."""
    sequence = runs[0].sequence
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth, so there are no errors")
    measure = suitable_measure(sequence.truth) if measure is None else measure
    estimates = {f"seed {run.config.seed}": run.poses for run in runs}
    errors = evaluate(sequence.truth, estimates, measure, sequence.times)
    back_end_ms = [
        sum(ms for stage, ms in motion.ms.items() if stage not in FRONT_END_STAGES)
        for run in runs
        for motion in run.motions
    ]
    return Entry(
        sequence=sequence.name,
        method=method,
        variant=runs[0].config.variant,
        seeds=tuple(run.config.seed for run in runs),
        measure=measure,
        results=errors.paths,
        poses=runs[0].poses,
        truth=sequence.truth,
        labels=sequence.labels is not None,
        removed_share=runs[0].removed_share,
        back_end_ms=float(np.mean(back_end_ms)),
    )


def group_entries(entries: list[Entry]) -> list[Group]:
    """Groups of entries that may be averaged, in the order of the entries."""
    groups: dict[tuple[str, bool, Measure], Group] = {}
    for entry in entries:
        key = entry.variant, entry.sequence in BENCHMARK_FRAMES, entry.measure
        groups.setdefault(key, Group(*key, {})).entries[entry.sequence, entry.method] = entry
    return list(groups.values())
