"""Errors of methods over seeds, and the sequences that may be averaged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..config import Config, PublishedConfig
from ..core.errors import DataError
from ..core.rows import joined
from ..core.types import Array
from ..data.sequence import KITTI
from ..evaluation.evaluate import SequenceResult, evaluate
from ..evaluation.kitti import KittiErrors, Measure, suitable_measure
from ..runs.runner import Run
from .paper import LEFT_OUT

FRONT_END_STAGES = ("wait_images", "matching", "cached_matches")
BENCHMARK = tuple(f"{KITTI}{number:02d}" for number in range(22))


@dataclass(frozen=True)
class Entry:
    """Errors of one method on one sequence with truth, over S seeds.

    Attributes
    ----------
    sequence, method : names; seeds : (S) seeds that ran.
    variant : `published` or `kit`; how : where matches and motion come from, in words.
    measure : the sub-sequences that TE and RE are taken over.
    results : (S) KITTI errors, ATE (SE3 alignment) and RPE of each seed.
    poses : (N, 4, 4) trajectory of the first seed; truth : (N, 4, 4).
    labels : whether the sequence has vehicle boxes.
    removed_share : share of the matches that boxes removed, first seed, in [0, 1].
    back_end_ms : mean time a frame of the method itself, without getting the matches, milliseconds.
    """

    sequence: str
    method: str
    variant: str
    how: tuple[str, str]
    seeds: tuple[int, ...]
    measure: Measure
    results: tuple[SequenceResult, ...]
    poses: Array
    truth: Array
    labels: bool
    removed_share: float
    back_end_ms: float

    @property
    def errors(self) -> Array:
        """TE and RE of each seed, (2, S), % and deg/100 m; NaN where no sub-sequence fits."""
        return te_and_re(result.kitti for result in self.results)

    @property
    def te(self) -> Array:
        """Translation error of each seed, (S,) %."""
        return np.asarray(self.errors[0])

    @property
    def re(self) -> Array:
        """Rotation error of each seed, (S,) deg/100 m."""
        return np.asarray(self.errors[1])

    @property
    def sub_sequences(self) -> KittiErrors:
        """Those of all seeds together."""
        return joined(result.kitti for result in self.results)


@dataclass(frozen=True)
class Group:
    """Sequences that may be averaged: KITTI's, or others, of one variant over the same sub-sequences.

    `entries` by (sequence, method); `kitti` says whether they are the benchmark's.
    """

    variant: str
    kitti: bool
    measure: Measure
    entries: dict[tuple[str, str], Entry]

    @property
    def sequences(self) -> list[str]:
        """Names in order."""
        return list(dict.fromkeys(sequence for sequence, _ in self.entries))

    @property
    def methods(self) -> list[str]:
        """Names in order."""
        return list(dict.fromkeys(method for _, method in self.entries))

    @property
    def words(self) -> str:
        """What the group is, for titles."""
        return f"{'KITTI' if self.kitti else 'other sequences'}, {self.measure.words}"

    @property
    def seeds(self) -> int:
        """How many seeds its numbers are over."""
        return max(len(entry.seeds) for entry in self.entries.values())

    def of_method(self, method: str) -> list[Entry]:
        """Entries of a method, in the order of the sequences."""
        return [entry for (_, name), entry in self.entries.items() if name == method]

    def of_sequence(self, sequence: str) -> list[Entry]:
        """Entries of a sequence, in the order of the methods."""
        return [entry for (name, _), entry in self.entries.items() if name == sequence]

    def mean(self, method: str) -> Array:
        """TE and RE of each seed, (2, S): the plain mean over the sequences, of KITTI without 01."""
        by_seed = [te_and_re(part for part in parts if len(part)) for parts in self._by_seed(method, True)]
        means = [part.mean(axis=1) if part.size else (np.nan, np.nan) for part in by_seed]
        return np.reshape(means, (-1, 2)).T

    def pooled(self, method: str, as_paper: bool = False) -> Array:
        """TE and RE of each seed, (2, S): over all sub-sequences together, as the devkit's total.

        `as_paper` : of KITTI without 01.
        """
        return te_and_re(joined(parts) for parts in self._by_seed(method, as_paper))

    def _by_seed(self, method: str, as_paper: bool) -> list[list[KittiErrors]]:
        """Errors on every sequence, for each seed that all of them have."""
        left_out = f"{KITTI}{LEFT_OUT}" if as_paper else None
        entries = [entry for entry in self.of_method(method) if entry.sequence != left_out]
        common = set.intersection(*(set(entry.seeds) for entry in entries)) if entries else set()
        return [[e.results[e.seeds.index(seed)].kitti for e in entries] for seed in sorted(common)]


def over_seeds(values: Iterable[float | None]) -> Array:
    """Numbers of seeds as an array, NaN for None."""
    return np.array(list(values), float)


def te_and_re(parts: Iterable[KittiErrors]) -> Array:
    """TE and RE of sets of sub-sequences, (2, S); NaN of an empty one."""
    return np.array([(part.te, part.re) for part in parts], float).reshape(-1, 2).T


def measure_runs(method: str, runs: list[Run], measure: Measure | None = None) -> Entry:
    """Errors of one method's runs, one a seed; without a measure, the one that suits the sequence."""
    sequence = runs[0].sequence
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth: nothing to compare")
    measure = suitable_measure(sequence.truth) if measure is None else measure
    pairs = [(sequence.name, sequence.truth, run.poses) for run in runs]
    return Entry(
        sequence=sequence.name,
        method=method,
        variant=runs[0].config.variant,
        how=in_words(runs[0].config),
        seeds=tuple(run.config.seed for run in runs),
        measure=measure,
        results=evaluate(
            pairs, measure.lengths, measure.step, times={sequence.name: sequence.times}
        ).sequences,
        poses=runs[0].poses,
        truth=sequence.truth,
        labels=sequence.labels is not None,
        removed_share=runs[0].removed_share,
        back_end_ms=float(np.mean([back_end_ms(run) for run in runs])),
    )


def in_words(config: PublishedConfig) -> tuple[str, str]:
    """Where the matches and the motion of a configuration come from."""
    kit = isinstance(config, Config)
    matches = "corners followed by Lucas-Kanade" if kit else "blobs and corners matched by their descriptors"
    if config.estimator == "reprojection":
        return matches, "one fit of the reprojection error"
    refined = isinstance(config, Config) and config.selection.mode == "refined"
    return matches, f"the five-point winner, {'refined on its inliers' if refined else 'as it is'}"


def made_by(entries: Iterable[Entry]) -> str:
    """Where matches and motion of a variant's table come from; motions that differ with their methods."""
    motions: dict[str, dict[str, None]] = {}
    for entry in entries:
        motions.setdefault(entry.how[1], {})[entry.method] = None
    words = [f"{each} ({', '.join(of)})" if len(motions) > 1 else each for each, of in motions.items()]
    return f"Matches: {entry.how[0]}. Motion: {'; '.join(words)}."


def back_end_ms(run: Run) -> float:
    """Mean milliseconds a frame of the method itself, without getting the matches."""
    return float(
        np.mean([sum(ms for s, ms in m.ms.items() if s not in FRONT_END_STAGES) for m in run.motions])
    )


def group_entries(entries: list[Entry]) -> list[Group]:
    """Entries that may be averaged together, in the order they come."""
    groups: dict[tuple[str, bool, Measure], Group] = {}
    for entry in entries:
        key = entry.variant, entry.sequence in BENCHMARK, entry.measure
        groups.setdefault(key, Group(*key, {})).entries[entry.sequence, entry.method] = entry
    return list(groups.values())
