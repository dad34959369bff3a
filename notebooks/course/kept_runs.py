"""Paths of runs that are kept in memory, for the panels of chapters 6 and 7."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Array, Progress
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import Frame, MethodRun, frames, run_methods
from vo_lib.runs.match_cache import CachedMatches

from .memory import Memory

_poses: Memory[Array] = Memory(400)
_frames: Memory[list[Frame]] = Memory(4)


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


def frames_of(sequence: Sequence, config: MethodConfig) -> list[Frame]:
    """The matches and boxes of the frames of a short sequence, kept in memory: 0.1 MB a frame."""
    front_end = config.variant, config.features, config.matching
    key = sequence_key(sequence, *front_end, config.filter.uses_boxes, config.filter.classes)
    return _frames.get(key, lambda: list(frames(sequence, config, CachedMatches(sequence, config))))


def run_by_frame(
    sequence: Sequence, configs: Mapping[str, MethodConfig]
) -> Iterator[Callable[[], dict[str, Array]]]:
    """Runs over a short sequence, frame by frame, of the configurations that `poses_of` has not stored yet.

    Yields after each motion a function that returns the poses so far (n, 4, 4), or all stored poses, by name.
    After the last one, `poses_of` has stored the results. All configurations have the same front end and boxes.
    """
    missing = {
        config: MethodRun(sequence, config) for config in configs.values() if not has_run(sequence, config)
    }
    if not missing:
        return

    def so_far() -> dict[str, Array]:
        return {
            name: missing[config].result().poses if config in missing else poses_of(sequence, config)
            for name, config in configs.items()
        }

    for frame in frames_of(sequence, next(iter(missing))):
        for run in missing.values():
            if frame.index == 0:
                run.start(frame)
            else:
                run.step(frame)
        if frame.index > 0:
            yield so_far
    for config, run in missing.items():
        _keep(sequence, config, run.result().poses)


def _keep(sequence: Sequence, config: MethodConfig, poses: Array) -> None:
    """Store a result for `poses_of`."""
    _poses.get(sequence_key(sequence, config), lambda: poses)
