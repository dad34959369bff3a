"""The odometry of variant `kit`, which replaces whole steps of the paper's odometry.

`SelfCalibratingOdometry` has the additions for both estimators: estimation of the calibration errors, box
rules, and flags for motions beyond a vehicle's limits. `KitOdometry` refines the winner and solves a robust
translation; `KitViso2` is VISO2 on the same matches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.result import Flag, FrameResult
from ..geometry.types import Array, BoolArray, Index
from ..paper.odometry import Odometry, Rotation
from ..paper.selection import sampson_inliers
from ..paper.settings import MethodConfig
from ..paper.viso2 import Viso2
from .box_rules import BoxFilter, Filtered
from .calibration import Calibration
from .refined_selection import choose_candidate, motion_of_winner, sample_sets
from .rig import Rig
from .settings import KitConfig
from .vehicle import Vehicle
from .weighted_translation import robust_translation

# Expected number of sets without an outlier; to use all n sets in every frame does not improve TE and RE.
CLEAN_SETS = 50
# Largest Sampson distance of an inlier of the previous essential matrix, as a multiple of the threshold.
PREVIOUS_INLIER_THRESHOLDS = 3.0
# Function of a frame's number and M matches; returns a mask (M,) of the matches on moving objects.
OnMoving = Callable[[int, StereoMatches], BoolArray]


class SelfCalibratingOdometry(Odometry):
    """Odometry with estimated calibration errors, box rules and vehicle check.

    Parameters
    ----------
    calibration : initial calibration errors; `DataError` for the errors of another camera.
    times : (N,) times of all frames, seconds; if None, the vehicle check is off.
    on_moving : function for the box rule `truth`.

    Attributes
    ----------
    rig : the estimated calibration errors.
    filtered : effect of the box rule on the last frame.
    """

    config: KitConfig

    def __init__(
        self,
        camera: StereoCamera,
        config: KitConfig,
        calibration: Calibration | None = None,
        times: Array | None = None,
        on_moving: OnMoving | None = None,
    ):
        super().__init__(camera, config)
        self.filtered: Filtered | None = None
        self.rig = Rig(camera, config.calibration)
        if calibration is not None:
            calibration.check(camera)
            self.rig.set_estimate(calibration.estimate, calibration.covariance_on_another_drive())
        self._times, self._on_moving = times, on_moving
        self._filter = BoxFilter(camera, config.filter)
        self._vehicle = Vehicle(config.vehicle)

    @property
    def calibration(self) -> Calibration:
        """The estimated calibration errors."""
        return Calibration(self.camera, self.rig.estimate, self.rig.covariance)

    def start(self, boxes: Boxes) -> None:
        """Store the boxes of the first frame."""
        self._filter.start(boxes)

    def step(self, matches: StereoMatches, boxes: Boxes) -> FrameResult:
        """The paper's step on corrected matches, with the vehicle check."""
        e_prev = self.e_prev
        estimate = self.rig.estimate
        covariance = self.rig.covariance
        if self.config.calibration.estimate:
            self.rig.update_from_rows(matches)
        motion = super().step(self.rig.correct(matches), boxes)
        assert self.filtered is not None
        motion = replace(motion, flags=(*self.filtered.flags, *motion.flags))
        seconds = 0.0 if self._times is None else float(np.diff(self._times)[self._frame - 1])
        motion = self._vehicle.check_vehicle(motion, seconds)
        if motion.in_doubt:
            self.e_prev = e_prev
        # A still camera sees the same errors again and again: that is no new information on the calibration.
        if motion.in_doubt or motion.still:
            self.rig.set_estimate(estimate, covariance)
        return motion

    def without_boxes(self, matches: StereoMatches, boxes: Boxes) -> StereoMatches:
        """The matches that the box rule keeps."""
        on_moving = None if self._on_moving is None else self._on_moving(self._frame, matches)
        self.filtered = self._filter.step(matches, boxes, on_moving)
        return matches[self.filtered.keep]

    def learn(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> None:
        """Update the calibration errors from a frame's motion, for the correction of the next frame."""
        if self.config.calibration.estimate:
            self.rig.update(matches, R_cp, t_cp)
            self.clock.stage("calibration")


class KitOdometry(SelfCalibratingOdometry):
    """Rotation from a refined winner, then a robust weighted translation.

    Additional flag: `prior_dropped` (the prior's best candidate is clearly worse than the overall best, as in
    a sharp turn or after a restart).
    """

    _dropped = False

    def finish_frame(self, rotation: Rotation, t_cp: Array) -> FrameResult:
        """The paper's result, with a flag if the prior was dropped."""
        return replace(super().finish_frame(rotation, t_cp), flags=(Flag.PRIOR_DROPPED,) * self._dropped)

    def draw_sets(self, x_p: Array, x_c: Array) -> Index:
        """Five-point sets: at most n, and only as many as should give `CLEAN_SETS` sets without an outlier.

        Few sets are sufficient, since the winner is refined. The share of outliers is estimated with the
        previous essential matrix. In mode `literal`, and in a sharp turn, all n sets are drawn.
        """
        config, sets = self.config.selection, self.config.selection.sets
        if config.mode == "refined" and self.e_prev is not None:
            near = sampson_inliers(
                self.e_prev.reshape(3, 3), x_p, x_c, PREVIOUS_INLIER_THRESHOLDS * self.threshold
            )
            sets = min(sets, int(CLEAN_SETS / max(float(np.mean(near)), 0.1) ** 5))
        return sample_sets(self.random(), len(x_p), sets)

    def select(self, E: Array, set_index: Index, x_p: Array, x_c: Array) -> int:
        """The paper's winner, but without the prior if the prior is clearly wrong."""
        config, f = self.config.selection, self.camera.f
        winner, self._dropped = choose_candidate(E, set_index, x_p, x_c, self.e_prev, config, f)
        return winner

    def rotation(self, E: Array, matches: StereoMatches) -> Rotation:
        """The winner refined on its inliers."""
        x_p, x_c = self.points(matches)
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        R, _, E, inliers = motion_of_winner(E, x_p, x_c, X_p, self.config.selection, self.camera.f)
        return Rotation(R, E, inliers)

    def translate(self, matches: StereoMatches, rotation: Rotation) -> Array | None:
        """The robust weighted translation; None with too few inliers."""
        config, R_cp = self.config.translation, rotation.R_cp
        solution = robust_translation(self.camera, matches, R_cp, config)
        self.clock.stage("translation")
        if solution is None or np.count_nonzero(solution[1] < config.agreement) < self.config.min_matches:
            return None
        self.learn(matches, R_cp, solution[0])
        return solution[0]


class KitViso2(SelfCalibratingOdometry, Viso2):
    """VISO2 with estimation of the calibration errors."""

    def fit(self, matches: StereoMatches) -> tuple[Array, Array, BoolArray] | None:
        """Rotation, translation and inliers (N,); None with too few inliers."""
        solution = super().fit(matches)
        self.clock.stage("rotation")
        if solution is not None:
            self.learn(matches, *solution[:2])
        return solution


def make_kit_odometry(
    camera: StereoCamera,
    config: MethodConfig,
    calibration: Calibration | None = None,
    times: Array | None = None,
    on_moving: OnMoving | None = None,
) -> SelfCalibratingOdometry:
    """The odometry of variant `kit` for a configuration; arguments as in `SelfCalibratingOdometry`."""
    assert isinstance(config, KitConfig)
    kind = KitViso2 if config.estimator == "reprojection" else KitOdometry
    return kind(camera, config, calibration, times, on_moving)
