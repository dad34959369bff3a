"""The odometry of variant `kit`, which replaces whole steps of the paper's odometry.

`SelfCalibratingOdometry` has the additions for both estimators: estimation of the calibration errors, box
rules, and flags for motions beyond a vehicle's limits. `KitOdometry` refines the winner and solves a robust
translation; `KitViso2` is VISO2 on the same matches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.result import Flag
from ..geometry.types import Array, Index
from ..paper.odometry import Odometry, Rotation, StepResult, Winner
from ..paper.selection import sampson_inliers
from ..paper.viso2 import Viso2
from .box_rules import KitBoxFilter, OnMoving
from .calibration import Calibration
from .refined_selection import choose_candidate, motion_of_winner, sample_sets
from .rig import Rig
from .settings import KitConfig
from .vehicle import Vehicle
from .weighted_translation import papers_translation, robust_translation

# Largest Sampson distance of an inlier of the previous essential matrix, as a multiple of the threshold.
PREVIOUS_INLIER_THRESHOLDS = 3.0
MIN_INLIER_SHARE = 0.1  # lower bound of the estimated share of matches without an error


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
        super().__init__(camera, config, KitBoxFilter(camera, config.filter, on_moving))
        self.rig = Rig(camera, config.calibration)
        if calibration is not None:
            calibration.check(camera)
            self.rig.set_estimate(calibration.estimate, calibration.covariance_on_another_drive())
        self._intervals = None if times is None else np.diff(times)
        self._vehicle = Vehicle(config.vehicle)

    @property
    def calibration(self) -> Calibration:
        """The estimated calibration errors."""
        return Calibration(self.camera, self.rig.estimate, self.rig.covariance)

    def step(self, matches: StereoMatches, boxes: Boxes) -> StepResult:
        """The paper's step on corrected matches, with the vehicle check; then the calibration is learnt.

        A motion that is in doubt changes neither E_prev nor the calibration.
        """
        e_prev = self.e_prev
        estimate = self.rig.estimate
        covariance = self.rig.covariance
        learns = self.config.calibration.estimate
        if learns:
            self.rig.update_from_rows(matches)
        result = super().step(self.rig.correct(matches), boxes)
        seconds = 0.0 if self._intervals is None else float(self._intervals[self._frame - 1])
        motion = self._vehicle.check_vehicle(result.motion, seconds)
        if motion.in_doubt:
            self.e_prev = e_prev
        # A still camera sees the same errors again and again: that is no new information on the calibration.
        if motion.in_doubt or motion.still:
            self.rig.set_estimate(estimate, covariance)
        elif learns:
            self.rig.update(result.used, motion.T_cp[:3, :3], motion.T_cp[:3, 3])
            self.clock.stage("calibration")
        return replace(result, motion=replace(motion, ms=self.clock.ms))


class KitOdometry(SelfCalibratingOdometry):
    """Rotation from a refined winner, then a robust weighted translation.

    Additional flag: `prior_dropped` (the prior's best candidate is clearly worse than the overall best, as in
    a sharp turn or after a restart).
    """

    def draw_sets(self, x_p: Array, x_c: Array) -> Index:
        """Five-point sets: at most n, and only as many as should give `clean_sets` sets without an outlier.

        Few sets are sufficient, since the winner is refined. The share of outliers is estimated with the
        previous essential matrix. In mode `literal`, and in a sharp turn, all n sets are drawn.
        """
        config = self.config.selection
        sets = config.sets
        if config.mode == "refined" and self.e_prev is not None:
            E_prev = self.e_prev.reshape(3, 3)
            near = sampson_inliers(E_prev, x_p, x_c, PREVIOUS_INLIER_THRESHOLDS * self.threshold)
            inlier_share = max(float(np.mean(near)), MIN_INLIER_SHARE)
            sets = min(sets, int(config.clean_sets / inlier_share**5))
        return sample_sets(self.random(), len(x_p), sets)

    def select(self, E: Array, set_index: Index, x_p: Array, x_c: Array) -> Winner:
        """The paper's winner, but without the prior if the prior is clearly wrong."""
        config = self.config.selection
        winner, dropped = choose_candidate(E, set_index, x_p, x_c, self.e_prev, config, self.camera.f)
        return Winner(winner, (Flag.PRIOR_DROPPED,) if dropped else ())

    def rotation(self, E: Array, matches: StereoMatches) -> Rotation:
        """The winner refined on its inliers."""
        x_p, x_c = self.points(matches)
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        R, _, E, inliers = motion_of_winner(E, x_p, x_c, X_p, self.config.selection, self.camera.f)
        return Rotation(R, E, inliers)

    def translate(self, matches: StereoMatches, rotation: Rotation) -> Array | None:
        """The robust weighted translation; None with too few inliers."""
        config = self.config.translation
        solve = papers_translation if "robust-solution" in config.without else robust_translation
        solution = solve(self.camera, matches, rotation.R_cp, config)
        if solution is None:
            return None
        t_cp, residual = solution
        return t_cp if np.count_nonzero(residual < config.agreement) >= self.config.min_matches else None


class KitViso2(SelfCalibratingOdometry, Viso2):
    """VISO2 with estimation of the calibration errors."""


def make_kit_odometry(
    camera: StereoCamera,
    config: KitConfig,
    calibration: Calibration | None = None,
    times: Array | None = None,
    on_moving: OnMoving | None = None,
) -> SelfCalibratingOdometry:
    """The odometry of variant `kit` for a configuration; arguments as in `SelfCalibratingOdometry`."""
    kind = KitViso2 if config.estimator == "reprojection" else KitOdometry
    return kind(camera, config, calibration, times, on_moving)
