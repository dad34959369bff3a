"""Paths of runs that are kept in memory, for the panels of chapters 6 and 7."""

from __future__ import annotations

from collections.abc import Hashable

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Array, Progress
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import run_methods
from vo_lib.runs.match_cache import CachedMatches

from .memory import Memory

_poses: Memory[Array] = Memory(400)


def sequence_key(sequence: Sequence, *others: Hashable) -> tuple[Hashable, ...]:
    """Key of a result on a sequence, from all inputs."""
    return sequence.folder, sequence.labels, sequence.frames[0], len(sequence), *others


def has_run(sequence: Sequence, config: MethodConfig) -> bool:
    """Whether `poses_of` has stored the result."""
    return sequence_key(sequence, config) in _poses


def poses_of(sequence: Sequence, config: MethodConfig, progress: Progress | None = None) -> Array:
    """Poses (N, 4, 4) of a configuration; the matches are kept on disk, the poses in memory."""

    def run() -> Array:
        return run_methods(sequence, {"": config}, progress, CachedMatches(sequence, config))[""].poses

    return _poses.get(sequence_key(sequence, config), run)
