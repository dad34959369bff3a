"""The method: matches and boxes of a frame in, its motion out."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .calibration import DisparityOffset, without_offset
from .camera import StereoCamera
from .config import Config
from .detection import Boxes, no_boxes
from .essential import estimate_essential
from .features import select_by_bucket
from .filtering import static_matches
from .geometry import rigid
from .matching import StereoMatches
from .reprojection import fit_motion
from .translation import solve_translation

Array = NDArray[np.float64]

# A feature agrees with a motion when its eight rows leave less than this, pixels.
AGREEMENT = 2.0
# A smaller change of the disparity offset moves a step by less than a thousandth, pixels.
SMALL_OFFSET = 0.01
# Median flow under which even a slow creep is below a millimetre a frame, pixels.
STILL_FLOW = 0.05


@dataclass(frozen=True)
class Motion:
    """Motion of one frame and how it came about.

    Attributes
    ----------
    T_cp : (4, 4) motion from the previous to the current left camera, metres.
    matches : matches found; removed : matches removed by boxes; used : left after bucketing.
    inliers : matches in use that agree with the epipolar geometry.
    offset : disparity offset known after the frame, pixels; NaN where the frame did not get that far.
    prior_angle : angle to the previous essential vector, degrees; NaN without one.
    flags : words such as "standstill"; empty when nothing was unusual.
    ms : milliseconds of each stage.
    """

    T_cp: Array
    matches: int = 0
    removed: int = 0
    used: int = 0
    inliers: int = 0
    offset: float = float("nan")
    prior_angle: float = float("nan")
    flags: tuple[str, ...] = ()
    ms: dict[str, float] = field(default_factory=dict)


class Odometry:
    """Motions from matches: filter, buckets, rotation by selection, translation by least squares.

    Flags: `few_matches` and `no_motion` (the last motion is used again), `standstill`,
    `prior_dropped` (sharp turn or restart), `filter_off` (boxes would have left too few matches).
    """

    def __init__(self, camera: StereoCamera, config: Config):
        self.camera = camera
        self.config = config
        self._frame = 0
        self._e: Array | None = None
        self._last = np.eye(4)
        self._boxes = no_boxes()
        self._offset = DisparityOffset(config.calibration)

    def start(self, boxes: Boxes) -> None:
        """The first frame: nothing but its boxes is needed."""
        self._boxes = boxes

    def step(self, matches: StereoMatches, boxes: Boxes) -> Motion:
        """Motion of the next frame from its matches and the boxes in its left image."""
        self._frame += 1
        clock = Clock()
        keep, off = static_matches(matches, self._boxes, boxes, self.config.filter)
        self._boxes = boxes
        chosen = matches[keep]
        chosen = chosen[select_by_bucket(chosen.cur_left, chosen.age, chosen.strength, self.config.buckets)]
        chosen = self._offset.correct(chosen)
        clock.stage("filter")
        motion = self._motion(chosen, clock)
        self._last = motion.T_cp
        return dataclasses.replace(
            motion,
            matches=len(matches),
            removed=int(np.count_nonzero(~keep)),
            used=len(chosen),
            flags=(*(("filter_off",) if off else ()), *motion.flags),
            ms=clock.ms,
        )

    def _calibrate(self, chosen: StereoMatches, R_cp: Array, t_cp: Array) -> Array:
        """Update the disparity offset; the translation is solved again where that changed the matches."""
        before = self._offset.offset
        self._offset.update(self.camera, chosen, R_cp, t_cp)
        change = self._offset.offset - before
        if abs(change) < SMALL_OFFSET:
            return t_cp
        corrected = without_offset(chosen, change)
        solved = solve_translation(self.camera, corrected, R_cp, self.config.translation)
        return t_cp if solved is None else solved[0]

    def _motion(self, chosen: StereoMatches, clock: Clock) -> Motion:
        if len(chosen) < self.config.min_matches:
            return Motion(self._last, flags=("few_matches",))
        X_p = self.camera.triangulate(chosen.prev_left, chosen.prev_right)
        flow = float(np.median(np.linalg.norm(chosen.cur_left - chosen.prev_left, axis=1)))
        if flow < self.config.selection.standstill_flow:
            # The essential matrix of a camera that stands still is undefined: its vector is kept.
            R, t, residual = fit_motion(
                self.camera, X_p, chosen.cur_left, chosen.cur_right, np.eye(3), np.zeros(3), scale=0.5
            )
            clock.stage("rotation")
            T_cp = np.eye(4) if flow < STILL_FLOW else rigid(R, t)
            return Motion(T_cp, inliers=int(np.count_nonzero(residual < AGREEMENT)), flags=("standstill",))
        estimate = estimate_essential(
            self.camera.normalise(chosen.prev_left),
            self.camera.normalise(chosen.cur_left),
            X_p,
            self._e,
            np.random.default_rng([self.config.seed, self._frame]),
            self.config.selection,
            self.camera.f,
        )
        clock.stage("rotation")
        if estimate is None:
            return Motion(self._last, flags=("no_motion",))
        solved = solve_translation(self.camera, chosen, estimate.R_cp, self.config.translation)
        clock.stage("translation")
        if solved is None or np.count_nonzero(solved[1] < AGREEMENT) < self.config.min_matches:
            return Motion(self._last, flags=("no_motion",))
        self._e = estimate.e
        t_cp = solved[0]
        if self.config.calibration.estimate:
            t_cp = self._calibrate(chosen, estimate.R_cp, t_cp)
            clock.stage("calibration")
        return Motion(
            rigid(estimate.R_cp, t_cp),
            offset=self._offset.offset,
            inliers=int(np.count_nonzero(estimate.inliers)),
            prior_angle=float(np.degrees(estimate.prior_angle)),
            flags=("prior_dropped",) if estimate.prior_dropped else (),
        )


class Clock:
    """Milliseconds of stages, each measured from the end of the one before."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = time.perf_counter()

    def stage(self, name: str) -> None:
        now = time.perf_counter()
        self.ms[name] = 1e3 * (now - self._last)
        self._last = now
