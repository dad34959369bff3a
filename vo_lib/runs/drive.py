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
from threadpoolctl import ThreadpoolController

from ..data.sequence import Sequence, at_pixels
from ..errors import DataError
from ..geometry.boxes import Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import inverse, nearest_rotation
from ..geometry.result import FrameResult
from ..geometry.types import Array, Image, Progress
from ..kit.settings import KitConfig
from ..paper.odometry import Odometry, StepResult
from ..paper.settings import FilterConfig, MethodConfig
from ..paper.viso2 import Viso2
from .front_end import TimedMatches, find_matches

# A published run imports nothing from vo_lib.kit but its settings, so the rest of it is imported where a run
# of variant `kit` needs it.
if TYPE_CHECKING:
    from ..kit.box_rules import OnMoving
    from ..kit.calibration import Calibration

FREED_FLOATS = 2**21  # 16 MB, see `_keep_freed_memory`


@dataclass(frozen=True, eq=False)
class Run:
    """Result of a run over N frames.

    Attributes
    ----------
    sequence : the input.
    config : the settings.
    poses : (N, 4, 4) T_w_c of the left camera, metres; the first pose is the identity.
    motions : N - 1 motions, from each frame to the next.
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
    ms : milliseconds of each stage before the odometry, by the stage's name.
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
    DataError : an image or a label file is invalid, or the classes of a rule with boxes do not fit the label
        folder (`boxes_for`); if the matches are computed from the images, also if frames are missing between
        the frames of the sequence.
    """
    read_boxes = boxes_for(sequence, config.filter)
    for index, (frame_matches, ms) in enumerate(_matches_outside_masks(sequence, config, matches)):
        yield Frame(index, frame_matches, read_boxes(index), ms)


def _matches_outside_masks(
    sequence: Sequence, config: MethodConfig, matches: Iterable[TimedMatches] | None
) -> Iterator[TimedMatches]:
    """The matches of each frame outside the masks: the given ones or, for None, computed from the images.

    BLAS and OpenCV use one thread from the first frame to the last, also in the caller's work between two
    frames: this generator waits inside the context.
    """
    _keep_freed_memory()
    with single_threaded():
        all_matches = find_matches(sequence, config) if matches is None else matches
        yield from unmasked(sequence, all_matches)


def boxes_for(sequence: Sequence, rule: FilterConfig) -> Callable[[int], Boxes]:
    """A function of a frame's index that returns the frame's boxes of the classes that count for a box rule.

    With a rule that needs no boxes, they only appear in pictures. So labels without such classes are no error
    there: the frames then have no boxes.

    Raises
    ------
    DataError : for a rule with boxes, if a class in the settings cannot be chosen from the label folder, if
        no class is chosen, or if the folder names no classes and has boxes, but none with a chosen number.
        Also if one of the files read for this is invalid.
    """
    if rule.uses_boxes:
        sequence.refuse_other_numbers(rule.classes)
        return sequence.boxes_of(rule.classes)
    try:
        return sequence.boxes_of(rule.classes)
    except DataError:
        return lambda index: no_boxes()


def _boxes_key(config: MethodConfig) -> tuple[bool, tuple[str, ...]]:
    """The settings that `boxes_for` depends on: methods with equal keys share the boxes of a frame."""
    return config.filter.uses_boxes, config.filter.classes


class MethodRun:
    """The odometry of one method on a sequence, and the motions computed so far."""

    def __init__(self, sequence: Sequence, config: MethodConfig, calibration: Calibration | None = None):
        self.sequence = sequence
        self.config = config
        on_moving = _truth_about_moving(sequence, config)
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
        """The result of the run, after all frames.

        Each pose follows from the one before: T_w_c(k) = T_w_c(k - 1) inverse(T_cp(k)).
        """
        poses = [np.eye(4)]
        for motion in self.motions:
            T_w_c = poses[-1] @ inverse(motion.T_cp)
            T_w_c[:3, :3] = nearest_rotation(T_w_c[:3, :3])  # rounding errors would add up
            poses.append(T_w_c)
        calibration = _estimated_calibration(self.odometry)
        return Run(self.sequence, self.config, np.array(poses), self.motions, calibration)


def _truth_about_moving(sequence: Sequence, config: MethodConfig) -> OnMoving | None:
    """The function that tells the matches on moving vehicles, for the box rule `truth`; otherwise None."""
    if config.filter.rule != "truth":
        return None
    from ..data.truth import matches_on_moving

    return functools.partial(matches_on_moving, sequence)


def _estimated_calibration(odometry: Odometry) -> Calibration | None:
    """The calibration errors that an odometry of variant `kit` has estimated; None for `published`."""
    if not isinstance(odometry.config, KitConfig):
        return None
    from ..kit.kit_odometry import SelfCalibratingOdometry

    return odometry.calibration if isinstance(odometry, SelfCalibratingOdometry) else None


def make_odometry(
    camera: StereoCamera,
    config: MethodConfig,
    calibration: Calibration | None = None,
    on_moving: OnMoving | None = None,
) -> Odometry:
    """The odometry for a configuration: the paper's method, VISO2, or a method of variant `kit`.

    Only variant `kit` uses the last two parameters, see `kit.kit_odometry`.

    Parameters
    ----------
    calibration : initial calibration errors.
    on_moving : tells which matches are on moving vehicles, for the box rule `truth`.
    """
    if isinstance(config, KitConfig):
        from ..kit.kit_odometry import make_kit_odometry

        return make_kit_odometry(camera, config, calibration, on_moving)
    if config.estimator == "reprojection":
        return Viso2(camera, config)
    return Odometry(camera, config)


def _keep_freed_memory() -> None:
    """Make the C library keep freed memory for the next frame; without an effect on the results.

    Usually glibc returns freed memory to the system and fetches it again page by page, which takes an eighth
    of the time of a frame with cached matches. It no longer does so after a block of 16 MB has been freed, so
    such a block is made here; it is freed at once, since nothing keeps it.
    """
    np.empty(FREED_FLOATS)


def unmasked(sequence: Sequence, timed_matches: Iterable[TimedMatches]) -> Iterator[TimedMatches]:
    """The matches of each frame that are outside the masks of the frame and of the previous frame."""
    if sequence.masks is None:
        yield from timed_matches
        return
    previous_mask: Image | None = None
    # A single mask for all frames is repeated endlessly, so the matches end first.
    for (matches, ms), mask in zip(timed_matches, sequence.mask_images(), strict=False):
        if previous_mask is not None:
            covered = at_pixels(previous_mask, matches.prev_left) | at_pixels(mask, matches.cur_left)
            matches = matches[covered == 0]
        previous_mask = mask
        yield matches, ms


def run(
    sequence: Sequence,
    config: MethodConfig,
    progress: Progress | None = None,
    *,
    calibration: Calibration | None = None,
) -> Run:
    """Visual odometry of one method over a sequence; arguments and exceptions as in `run_methods`."""
    (result,) = run_methods(sequence, {"method": config}, progress, calibration=calibration).values()
    return result


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
    DataError : an image or a label file is invalid, the classes of a rule with boxes do not fit the label
        folder (`boxes_for`), or frames are missing between the frames of the sequence.
    ValueError : the methods have different front ends.
    """
    sequence.require_unbroken()
    front_ends = {(config.variant, config.features, config.matching) for config in configs.values()}
    if len(front_ends) != 1:
        raise ValueError("the methods need the same feature and matching settings to share their matches")
    method_runs = {name: MethodRun(sequence, config, calibration) for name, config in configs.items()}
    # A label file is read once for all methods that take the same boxes from it.
    readers = {_boxes_key(config): boxes_for(sequence, config.filter) for config in configs.values()}
    any_config = next(iter(configs.values()))  # they have one front end
    for index, (frame_matches, ms) in enumerate(_matches_outside_masks(sequence, any_config, matches)):
        boxes_by_key = {key: read_boxes(index) for key, read_boxes in readers.items()}
        for method_run in method_runs.values():
            boxes = boxes_by_key[_boxes_key(method_run.config)]
            frame = Frame(index, frame_matches, boxes, ms)
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
                self._undo.enter_context(_libraries().limit(limits=1, user_api="blas"))

    def release(self) -> None:
        """Remove the limit, unless another run holds it."""
        with self._lock:
            self._holders -= 1
            if self._holders == 0:
                self._undo.close()


@functools.cache  # the search for them takes 2 ms; NumPy has loaded its BLAS by now
def _libraries() -> ThreadpoolController:
    """The libraries of this process that have threads of their own."""
    return ThreadpoolController()


_thread_limit = _ThreadLimit()  # one for the process, like the settings of both libraries


@contextmanager
def single_threaded() -> Iterator[None]:
    """A context without threads of BLAS and OpenCV, which slow down work on small matrices and images.

    The kit's own threads, which prepare the next frames (`front_end.stereo_ahead`), go on.
    """
    _thread_limit.acquire()
    try:
        yield
    finally:
        _thread_limit.release()
