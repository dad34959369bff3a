"""The loop over frames: a sequence in, poses out, several methods on the same matches."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from .config import Config, FeatureConfig, MatchingConfig
from .front_end import make_front_end
from .geometry import inverse, nearest_rotation
from .matching import StereoMatches
from .odometry import Clock, Motion, Odometry
from .sequence import Progress, Sequence, stereo_ahead

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """Result of a run over N frames.

    Attributes
    ----------
    sequence : what was run; config : how.
    poses : (N, 4, 4) T_w_c of the left camera, first one the identity, metres.
    motions : (N - 1) motions, from each frame to the next.
    """

    sequence: Sequence
    config: Config
    poses: Array
    motions: list[Motion]

    @property
    def ms_per_frame(self) -> float:
        """Mean time of all stages of this method, milliseconds."""
        return float(np.mean([sum(motion.ms.values()) for motion in self.motions]))

    @property
    def removed_share(self) -> float:
        """Share of the matches that boxes removed, over all frames, in [0, 1]."""
        return sum(m.removed for m in self.motions) / max(sum(m.matches for m in self.motions), 1)


def run(sequence: Sequence, config: Config, progress: Progress | None = None) -> Run:
    """Visual odometry over a sequence; `progress` as in `run_methods`."""
    return run_methods(sequence, {"": config}, progress)[""]


def run_methods(
    sequence: Sequence, configs: dict[str, Config], progress: Progress | None = None
) -> dict[str, Run]:
    """Several methods over one sequence, all on the same matches, which are found once.

    Parameters
    ----------
    configs : name and configuration of each method; their feature and matching settings must be equal.
    progress : called with (frames done, frames in all) after each frame.

    Raises
    ------
    DataError : an image or a label file is not as it should be.
    ValueError : the methods do not share one front end.
    """
    front_ends = {(config.features, config.matching) for config in configs.values()}
    if len(front_ends) != 1:
        raise ValueError("the methods need the same feature and matching settings to share their matches")
    features, matching = front_ends.pop()
    chains = {name: Odometry(sequence.camera, config) for name, config in configs.items()}
    poses = {name: np.tile(np.eye(4), (len(sequence), 1, 1)) for name in configs}
    motions: dict[str, list[Motion]] = {name: [] for name in configs}
    # The matrices are small: more BLAS threads only wait for each other and for the image threads.
    with threadpool_limits(limits=1, user_api="blas"):
        frames = match_stream(sequence, features, matching)
        for index, (matches, ms) in enumerate(frames):
            boxes = sequence.boxes(index)
            for name, odometry in chains.items():
                if index == 0:
                    odometry.start(boxes)
                    continue
                motion = odometry.step(matches, boxes)
                T_w_c = poses[name][index - 1] @ inverse(motion.T_cp)
                T_w_c[:3, :3] = nearest_rotation(T_w_c[:3, :3])
                poses[name][index] = T_w_c
                motions[name].append(dataclasses.replace(motion, ms={**ms, **motion.ms}))
            if progress is not None:
                progress(index + 1, len(sequence))
    return {name: Run(sequence, configs[name], poses[name], motions[name]) for name in configs}


def match_stream(
    sequence: Sequence, features: FeatureConfig, matching: MatchingConfig
) -> Iterator[tuple[StereoMatches, dict[str, float]]]:
    """Matches of every frame with the one before, and the milliseconds they took; the first are empty."""
    front_end = make_front_end(sequence.camera, features, matching)
    clock = Clock()
    for pair in stereo_ahead(sequence, front_end.prepare):
        clock.stage("wait_images")
        matches = front_end.step(pair)
        clock.stage("matching")
        yield matches, clock.ms
        clock = Clock()
