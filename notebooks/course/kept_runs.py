"""Paths of runs that are kept in memory, for the panels of chapters 6 and 7."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Array, Progress
from vo_lib.paper.five_point import Candidates
from vo_lib.paper.odometry import Odometry
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import Frame, MethodRun, frames, run_methods
from vo_lib.runs.match_cache import CachedMatches

from .memory import Memory

_poses: Memory[Array] = Memory(400)
_frames: Memory[list[Frame]] = Memory(4)
_candidates: Memory[Candidates] = Memory(120)  # of frames, each of 0.1 MB


def sequence_key(sequence: Sequence, *others: Hashable) -> tuple[Hashable, ...]:
    """Key of a result on a sequence, from all inputs."""
    return sequence.folder, sequence.labels, sequence.frames[0], len(sequence), *others


def has_run(sequence: Sequence, config: MethodConfig) -> bool:
    """Whether `poses_of` has stored the result."""
    return sequence_key(sequence, config) in _poses


def poses_of(sequence: Sequence, config: MethodConfig, progress: Progress | None = None) -> Array:
    """Poses (N, 4, 4) of a configuration; the matches are kept on disk, the poses in memory."""

    def run() -> Array:
        matches = CachedMatches(sequence, config)
        runs = run_methods(sequence, {"only": config}, progress, matches)
        return runs["only"].poses

    return _poses.get(sequence_key(sequence, config), run)


def frames_of(sequence: Sequence, config: MethodConfig) -> list[Frame]:
    """The matches and boxes of the frames of a short sequence, kept in memory: 0.1 MB a frame."""
    key = sequence_key(
        sequence,
        config.variant,
        config.features,
        config.matching,
        config.filter.uses_boxes,
        config.filter.classes,
    )
    return _frames.get(key, lambda: list(frames(sequence, config, CachedMatches(sequence, config))))


def run_by_frame(
    sequence: Sequence, configs: Mapping[str, MethodConfig]
) -> Iterator[Callable[[], dict[str, Array]]]:
    """Runs over a short sequence, frame by frame, of the configurations that `poses_of` has not stored yet.

    Yields after each motion a function that returns the poses so far (n, 4, 4), or all stored poses, by name.
    After the last one, `poses_of` has stored the results. All configurations must have the same front end
    and boxes.
    """
    runs: dict[MethodConfig, MethodRun] = {}
    for config in configs.values():
        if not has_run(sequence, config):
            runs[config] = _run_with_memory(sequence, config)
    if not runs:
        return

    def so_far() -> dict[str, Array]:
        poses = {}
        for name, config in configs.items():
            poses[name] = runs[config].result().poses if config in runs else poses_of(sequence, config)
        return poses

    any_config = next(iter(runs))
    for frame in frames_of(sequence, any_config):
        for run in runs.values():
            if frame.index == 0:
                run.start(frame)
            else:
                run.step(frame)
        if frame.index > 0:
            yield so_far
    for config, run in runs.items():
        _poses.keep(sequence_key(sequence, config), run.result().poses)


class RememberingOdometry(Odometry):
    """The paper's method; the candidates of a frame come from memory if an odometry has computed them before.

    They take half of the time of a run, and depend on the features, their number of sets and the seed alone: a
    run with another threshold has the same ones.
    """

    def candidates(self, x_p: Array, x_c: Array) -> Candidates:
        random = self.random().bytes(16)  # stands for the seed and the number of the frame
        key = random, self.config.selection.sets, x_p.tobytes(), x_c.tobytes()
        return _candidates.get(key, lambda: super(RememberingOdometry, self).candidates(x_p, x_c))


def _run_with_memory(sequence: Sequence, config: MethodConfig) -> MethodRun:
    """A run that computes no candidates twice, if it is one of the paper's method.

    For the others, it is an ordinary run. VISO2 has no candidates. In variant `kit`, each run corrects its features
    by the calibration errors that it has estimated so far: with another threshold these are other ones, so that
    the memory would have the candidates of hardly any frame.
    """
    run = MethodRun(sequence, config)
    if type(run.odometry) is Odometry:
        run.odometry = RememberingOdometry(sequence.camera, config)
    return run
