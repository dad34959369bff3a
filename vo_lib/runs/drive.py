"""The loop over frames, from a sequence to poses, for several methods on the same matches."""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from ..data.sequence import Sequence, at_pixels
from ..errors import DataError
from ..geometry.boxes import Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import inverse, nearest_rotation
from ..geometry.result import FrameResult
from ..geometry.types import Array, BoolArray, Image, Progress
from ..kit.settings import KitConfig
from ..paper.odometry import Odometry, StepResult
from ..paper.settings import FilterConfig, MethodConfig
from ..paper.viso2 import Viso2
from .front_end import TimedMatches, find_matches

# A published run imports nothing from vo_lib.kit but its settings.
if TYPE_CHECKING:
    from ..kit.calibration import Calibration


@dataclass(frozen=True, eq=False)
class Run:
    """Result of a run over N frames.

    Attributes
    ----------
    sequence : the input; config : the settings.
    poses : (N, 4, 4) T_w_c of the left camera, metres; the first pose is the identity.
    motions : (N - 1) motions from each frame to the next.
    calibration : calibration errors estimated up to the last frame; None for `published`.
    """

    sequence: Sequence
    config: MethodConfig
    poses: Array
    motions: list[FrameResult]
    calibration: Calibration | None = None

    @property
    def ms_per_frame(self) -> float:
        """Mean time per frame of all stages together, milliseconds."""
        return float(np.mean([sum(motion.ms.values()) for motion in self.motions]))

    @property
    def removed_share(self) -> float:
        """Share of matches removed in boxes, over all frames, in [0, 1]."""
        removed = sum(motion.removed for motion in self.motions)
        matches = sum(motion.matches for motion in self.motions)
        return removed / max(matches, 1)

    @property
    def matches_per_frame(self) -> float:
        """Median number of matches per frame."""
        return float(np.median([motion.matches for motion in self.motions]))


@dataclass(frozen=True, eq=False)
class Frame:
    """What the odometry needs from a frame.

    Attributes
    ----------
    index : number of the frame in the sequence, from 0.
    matches : matches with the previous frame, outside the masks; frame 0 has none.
    boxes : boxes of the chosen classes in the left image.
    ms : milliseconds of each stage so far.
    """

    index: int
    matches: StereoMatches
    boxes: Boxes
    ms: dict[str, float]


def frames(
    sequence: Sequence, config: MethodConfig, matches: Iterable[TimedMatches] | None = None
) -> Iterator[Frame]:
    """The frames of a sequence, one after the other, for `Odometry.start` and `Odometry.step`.

    Until the last frame, BLAS and OpenCV use one thread, see `single_threaded`.

    matches : matches of every frame with the settings of `config`, such as `CachedMatches`; by default
        computed here.

    Raises
    ------
    DataError : an image or a label file is invalid, or the label folder has no box of a chosen class.
    """
    boxes_of = boxes_for(sequence, config.filter)
    for index, (given, ms) in enumerate(_matches(sequence, config, matches)):
        yield Frame(index, given, boxes_of(index), ms)


def _matches(
    sequence: Sequence, config: MethodConfig, matches: Iterable[TimedMatches] | None
) -> Iterator[TimedMatches]:
    """The given or computed matches of each frame, outside the masks."""
    _keep_freed_memory()
    with single_threaded():
        yield from unmasked(sequence, find_matches(sequence, config) if matches is None else matches)


def boxes_for(sequence: Sequence, rule: FilterConfig) -> Callable[[int], Boxes]:
    """A function that returns the boxes of a frame that count for a box rule, by index.

    For a rule without boxes, they serve for pictures only; a label folder without vehicles has none.

    Raises `DataError` as `Sequence.require_boxes` and `Sequence.boxes_of`.
    """
    if rule.uses_boxes:
        sequence.require_boxes(rule.classes)
        return sequence.boxes_of(rule.classes)
    try:
        return sequence.boxes_of(rule.classes)
    except DataError:
        return lambda index: no_boxes()


def _boxes_key(config: MethodConfig) -> tuple[bool, tuple[str, ...]]:
    """What decides about the boxes of a method: methods with equal keys share them."""
    return config.filter.uses_boxes, config.filter.classes


class MethodRun:
    """The odometry of one method on a sequence, and the motions computed so far."""

    def __init__(self, sequence: Sequence, config: MethodConfig, calibration: Calibration | None = None):
        self.sequence = sequence
        self.config = config
        on_moving = None
        if config.filter.rule == "truth":
            from ..data.truth import matches_on_moving

            on_moving = functools.partial(matches_on_moving, sequence)
        self.odometry = make_odometry(sequence.camera, config, calibration, on_moving)
        self.motions: list[FrameResult] = []

    def start(self, frame: Frame) -> None:
        """Process frame 0, which gives no motion."""
        self.odometry.start(frame.boxes)

    def step(self, frame: Frame) -> StepResult:
        """Process the next frame."""
        result = self.odometry.step(frame.matches, frame.boxes)
        self.motions.append(dataclasses.replace(result.motion, ms={**frame.ms, **result.motion.ms}))
        return result

    def result(self) -> Run:
        """The result of the run, after all frames."""
        poses = [np.eye(4)]
        for motion in self.motions:
            T_w_c = poses[-1] @ inverse(motion.T_cp)
            T_w_c[:3, :3] = nearest_rotation(T_w_c[:3, :3])
            poses.append(T_w_c)
        calibration = getattr(self.odometry, "calibration", None)  # only variant `kit` has a calibration
        return Run(self.sequence, self.config, np.array(poses), self.motions, calibration)


def make_odometry(
    camera: StereoCamera,
    config: MethodConfig,
    calibration: Calibration | None = None,
    on_moving: Callable[[int, StereoMatches], BoolArray] | None = None,
) -> Odometry:
    """The odometry for a configuration: the paper's method, VISO2, or a method of variant `kit`.

    Variant `kit` uses initial calibration errors, and the truth about moving vehicles for the box rule
    `truth`; see `kit.kit_odometry`.
    """
    if isinstance(config, KitConfig):
        from ..kit.kit_odometry import make_kit_odometry

        return make_kit_odometry(camera, config, calibration, on_moving)
    if config.estimator == "reprojection":
        return Viso2(camera, config)
    return Odometry(camera, config)


def _keep_freed_memory() -> None:
    """Make the C library keep freed memory for the next frame; without an effect on the results.

    After one block of 16 MB has been freed, glibc no longer returns freed memory to the system and fetches it
    again page by page, which takes an eighth of the time of a frame with cached matches.
    """
    np.empty(1 << 21)


def unmasked(sequence: Sequence, given: Iterable[TimedMatches]) -> Iterator[TimedMatches]:
    """The matches of each frame that are outside the masks of the frame and of the previous frame."""
    if sequence.masks is None:
        yield from given
        return
    before: Image | None = None
    for (matches, ms), mask in zip(given, sequence.mask_images(), strict=False):
        if before is not None:
            covered = at_pixels(before, matches.prev_left) | at_pixels(mask, matches.cur_left)
            matches = matches[covered == 0]
        before = mask
        yield matches, ms


def run(
    sequence: Sequence,
    config: MethodConfig,
    progress: Progress | None = None,
    *,
    calibration: Calibration | None = None,
) -> Run:
    """Visual odometry over a sequence; arguments as in `run_methods`."""
    return run_methods(sequence, {"": config}, progress, calibration=calibration)[""]


def run_methods(
    sequence: Sequence,
    configs: Mapping[str, MethodConfig],
    progress: Progress | None = None,
    matches: Iterable[TimedMatches] | None = None,
    calibration: Calibration | None = None,
) -> dict[str, Run]:
    """Runs of several methods over one sequence; the matches are computed once for all methods.

    Parameters
    ----------
    configs : name and configuration of each method; variant, feature and matching settings must be equal.
    progress : called with (frames done, total frames) after each frame.
    matches : matches of every frame with these settings, such as `CachedMatches`; by default computed here.
    calibration : initial calibration errors of variant `kit`, see `kit.calibration`.

    Raises
    ------
    DataError : an image or a label file is invalid, the label folder has no box of a chosen class, or frames
        are missing between the frames of the sequence.
    ValueError : the methods have different front ends.
    """
    sequence.require_unbroken()
    front_ends = {(config.variant, config.features, config.matching) for config in configs.values()}
    if len(front_ends) != 1:
        raise ValueError("the methods need the same feature and matching settings to share their matches")
    method_runs = {name: MethodRun(sequence, config, calibration) for name, config in configs.items()}
    boxes_of = {_boxes_key(config): boxes_for(sequence, config.filter) for config in configs.values()}
    any_config = next(iter(configs.values()))
    for index, (given, ms) in enumerate(_matches(sequence, any_config, matches)):
        boxes = {key: of_frame(index) for key, of_frame in boxes_of.items()}
        for method_run in method_runs.values():
            frame = Frame(index, given, boxes[_boxes_key(method_run.config)], ms)
            if index == 0:
                method_run.start(frame)
            else:
                method_run.step(frame)
        if progress is not None:
            progress(index + 1, len(sequence))
    return {name: method_run.result() for name, method_run in method_runs.items()}


class _ThreadLimit:
    """The limit of one thread for BLAS and OpenCV in this process, held by any number of runs.

    Runs of several threads begin and end in any order: the first one sets the limit, the last one removes it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holders = 0
        self._undo = ExitStack()

    def acquire(self) -> None:
        """Set the limit, unless another run holds it."""
        with self._lock:
            self._holders += 1
            if self._holders == 1:
                self._undo.callback(cv2.setNumThreads, cv2.getNumThreads())
                cv2.setNumThreads(1)
                self._undo.enter_context(threadpool_limits(limits=1, user_api="blas"))

    def release(self) -> None:
        """Remove the limit, unless another run holds it."""
        with self._lock:
            self._holders -= 1
            if self._holders == 0:
                self._undo.close()


_thread_limit = _ThreadLimit()  # one for the process, like the settings of both libraries


@contextmanager
def single_threaded() -> Iterator[None]:
    """A context without threads of BLAS and OpenCV, which slow down work on small matrices and images.

    The kit itself prepares frames in threads.
    """
    _thread_limit.acquire()
    try:
        yield
    finally:
        _thread_limit.release()
