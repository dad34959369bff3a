"""The loop over frames: a sequence in, poses out, several methods on the same matches."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import overload

import cv2
import numpy as np
from threadpoolctl import ThreadpoolController

from ..baseline.viso2 import Viso2
from ..beyond.calibration import Calibration
from ..beyond.focal import FocalCheck
from ..beyond.odometry import KitOdometry, KitViso2, Learning
from ..config import Config, PublishedConfig
from ..core.boxes import Boxes
from ..core.camera import StereoCamera
from ..core.frame import REPEATED, TIME_JUMP, Clock, FrameResult
from ..core.geometry import inverse, nearest_rotation
from ..core.matches import SAME, StereoMatches
from ..core.types import Array, Image, Progress
from ..core.vehicle import Vehicle
from ..data.sequence import Sequence, stereo_ahead
from ..front_end.front_end import make_front_end
from ..method.config import FeatureConfig, MatchingConfig
from ..method.odometry import Odometry

# For speed alone: until a block of 16 MB (never touched) was freed, glibc gives freed memory back to the
# system and fetches it again page by page, which is a third of the five-point solver's time.
np.empty(1 << 21)

SHORTEST, LONGEST = 1e-3, 10.0  # seconds from frame to frame; such as nanoseconds are beyond

# Matches of a frame with the one before, and the milliseconds of each stage that they took.
TimedMatches = tuple[StereoMatches, dict[str, float]]


@dataclass(frozen=True)
class Run:
    """Result of a run over N frames.

    Attributes
    ----------
    sequence : what was run; config : how.
    poses : (N, 4, 4) T_w_c of the left camera, first one the identity, metres.
    motions : (N - 1) motions, from each frame to the next.
    calibration : what was known of the cameras' errors at the end; None as published.
    doubts : what makes the input doubtful, a sentence each.
    """

    sequence: Sequence
    config: PublishedConfig
    poses: Array
    motions: list[FrameResult]
    calibration: Calibration | None = None
    doubts: tuple[str, ...] = ()

    @property
    def ms_per_frame(self) -> float:
        """Mean time of all stages of this method, milliseconds."""
        return float(np.mean([sum(motion.ms.values()) for motion in self.motions]))

    @property
    def removed_share(self) -> float:
        """Share of the matches that boxes removed, over all frames, in [0, 1]."""
        return sum(m.removed for m in self.motions) / max(sum(m.matches for m in self.motions), 1)

    @property
    def matches_per_frame(self) -> float:
        """Median number of matches of the frames that do not equal the one before; NaN where all do."""
        found = [motion.matches for motion in self.motions if REPEATED not in motion.flags]
        return float(np.median(found)) if found else float("nan")


class MethodRun:
    """One method along a sequence: its odometry and its motions so far, the last of which may change yet."""

    def __init__(self, sequence: Sequence, config: PublishedConfig):
        self.sequence = sequence
        self.config = config
        self.odometry = make_odometry(sequence.camera, config, sequence.calibration)
        self.motions: list[FrameResult] = []
        own = self.odometry
        self._vehicle = own.vehicle if isinstance(own, Learning) else Vehicle(config.vehicle, own.camera)
        self._focal = FocalCheck(own.camera)
        self._latest = 0  # frame that does not show the images of the one before

    def step(self, index: int, frame: TimedMatches, boxes: Boxes) -> None:
        """Take in a frame; the first one, 0, gives no motion."""
        if index == 0:
            self.odometry.start(boxes)
            return
        matches, ms = frame
        if matches is SAME:
            self.motions.append(FrameResult(np.eye(4), flags=(REPEATED,), ms=ms))
            return
        before, self._latest = self._latest, index
        seconds = float(self.sequence.times[index] - self.sequence.times[before])
        if isinstance(self.odometry, Learning):
            truth = self.config.filter.rule == "truth"
            on_moving = self.sequence.on_moving(index, matches) if truth else None
            motion = self.odometry.step(matches, boxes, on_moving, seconds)
        else:
            motion = self.odometry.step(matches, boxes)
            # As published, doubtful frames are flagged and no more.
            motion = self._vehicle.judge(motion, lambda: matches, seconds)
        if not motion.in_doubt:
            self._focal.update(matches, motion.T_cp)
        if self._vehicle.taken_back:
            last = self.motions[before - 1]
            flags = (*(flag for flag in last.flags if flag != TIME_JUMP), *self._vehicle.taken_back)
            T_cp = motion.T_cp if isinstance(self.odometry, Learning) else last.T_cp
            self.motions[before - 1] = dataclasses.replace(last, T_cp=T_cp, flags=flags)
        self.motions.append(dataclasses.replace(motion, ms={**ms, **motion.ms}))

    def result(self) -> Run:
        """The run, once all frames were taken in."""
        learnt = self.odometry.calibration if isinstance(self.odometry, Learning) else None
        poses = [np.eye(4)]
        for motion in self.motions:
            T_w_c = poses[-1] @ inverse(motion.T_cp)
            T_w_c[:3, :3] = nearest_rotation(T_w_c[:3, :3])
            poses.append(T_w_c)
        doubts = repeated_pairs(self.motions), odd_times(self.sequence.times), self._focal.doubt()
        found = tuple(filter(None, doubts))
        return Run(self.sequence, self.config, np.array(poses), self.motions, learnt, found)


@overload
def make_odometry(camera: StereoCamera, config: Config, known: Calibration | None = None) -> Learning: ...


@overload
def make_odometry(
    camera: StereoCamera, config: PublishedConfig, known: Calibration | None = None
) -> Odometry: ...


def make_odometry(
    camera: StereoCamera, config: PublishedConfig, known: Calibration | None = None
) -> Odometry:
    """The odometry that a configuration is of: the kit's, the paper's, or VISO2.

    known : what the kit's begin with; `DataError` where it is of another camera.
    """
    viso2 = config.estimator == "reprojection"
    if isinstance(config, Config):
        return KitViso2(camera, config, known) if viso2 else KitOdometry(camera, config, known)
    return Viso2(camera, config) if viso2 else Odometry(camera, config)


def run(sequence: Sequence, config: PublishedConfig, progress: Progress | None = None) -> Run:
    """Visual odometry over a sequence; `progress` as in `run_methods`."""
    return run_methods(sequence, {"": config}, progress)[""]


def run_methods(
    sequence: Sequence,
    configs: Mapping[str, PublishedConfig],
    progress: Progress | None = None,
    matches: Iterable[TimedMatches] | None = None,
) -> dict[str, Run]:
    """Several methods over one sequence, all on the same matches, which are found once.

    Parameters
    ----------
    configs : name and configuration of each method; their feature and matching settings must be equal.
    progress : called with (frames done, frames in all) after each frame.
    matches : of every frame, found with these settings, such as `match_cache.CachedMatches`; default: found
        here from the images.

    Raises
    ------
    DataError : an image or a label file is not as it should be.
    ValueError : the methods do not share one front end.
    """
    front_ends = {(config.features, config.matching) for config in configs.values()}
    if len(front_ends) != 1:
        raise ValueError("the methods need the same feature and matching settings to share their matches")
    method_runs = {name: MethodRun(sequence, config) for name, config in configs.items()}
    with single_threaded():
        frames = FoundMatches(sequence, *front_ends.pop()) if matches is None else matches
        for index, frame in enumerate(frames):
            boxes = sequence.boxes(index)
            for method_run in method_runs.values():
                method_run.step(index, frame, boxes)
            if progress is not None:
                progress(index + 1, len(sequence))
    return {name: method_run.result() for name, method_run in method_runs.items()}


# To look through all loaded libraries takes a millisecond or two.
_libraries = functools.cache(ThreadpoolController)


@contextmanager
def single_threaded() -> Iterator[None]:
    """A context without threads of BLAS and OpenCV: matrices and images are small, and frames are prepared in
    threads of ours; more of them only wait for each other."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with _libraries().limit(limits=1, user_api="blas"):
            yield
    finally:
        cv2.setNumThreads(threads)


class FoundMatches:
    """Matches of every frame with the one before, found from the images; the first are empty.

    Those of a pair that equals the one before are `SAME`, and the next are with the pair before these.
    """

    def __init__(self, sequence: Sequence, features: FeatureConfig, matching: MatchingConfig):
        self.sequence = sequence
        self.settings = features, matching

    def __iter__(self) -> Iterator[TimedMatches]:
        front_end = make_front_end(self.sequence.camera, *self.settings)
        before: tuple[Image, Image] | None = None
        # In no thread of its own: like what comes after it, it holds Python's lock half of the time.
        clock = Clock()
        for pair, prepared in stereo_ahead(self.sequence, lambda pair: (pair, front_end.prepare(pair))):
            clock.stage("wait_images")
            matches = SAME if before is not None and _equal(before, pair) else front_end.step(prepared)
            before = pair
            clock.stage("matching")
            yield matches, clock.ms
            clock = Clock()


def repeated_pairs(motions: list[FrameResult]) -> str | None:
    """In words, how many pairs equal the one before; None where none does."""
    repeated = np.array([REPEATED in motion.flags for motion in motions])
    number = int(np.count_nonzero(repeated))
    if not number:
        return None
    gaps = np.diff(np.flatnonzero(repeated))
    which = (
        "every second pair"
        if number > 2 and (gaps == 2).all() and 2 * number >= len(motions) - 1
        else "a pair"
    )
    return f"{which} equals the one before: {number} of {len(motions)}; the camera counts as standing there"


def odd_times(times: Array) -> str | None:
    """In words, times (N,) that are no seconds of a camera's frames; None where they may be."""
    seconds = float(np.median(np.diff(times)))
    if SHORTEST <= seconds <= LONGEST:
        return None
    return (
        f"times.txt has {seconds:.3g} s from frame to frame, which no camera has: speeds are wrong, and with "
        "them what motions are judged by"
    )


def _equal(one: tuple[Image, Image], other: tuple[Image, Image]) -> bool:
    """Whether two stereo pairs show the same, and something; a few rows tell nearly all that do not."""
    sides = list(zip(one, other, strict=True))
    same = all(np.array_equal(a[::32], b[::32]) for a, b in sides) and all(np.array_equal(*s) for s in sides)
    return same and bool(np.ptp(one[0]))
