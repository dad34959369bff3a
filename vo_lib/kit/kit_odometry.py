"""The odometry of variant `kit`, which replaces whole steps of the paper's odometry.

`SelfCalibratingOdometry` has the additions for both estimators: estimation of the calibration errors and box
rules. `KitOdometry` refines the winner and solves a robust translation; `KitViso2` is VISO2 on the same
matches.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import essential_angle, essential_from_motion, essential_vector, rigid
from ..geometry.reprojection import stereo_residuals
from ..geometry.result import Flag
from ..geometry.types import Array, Index
from ..paper.five_point import five_point
from ..paper.odometry import Odometry, Rotation, Solution, StepResult, Winner
from ..paper.selection import WINNER_CRITERIA, sampson_inliers
from ..paper.settings import ReprojectionConfig
from ..paper.viso2 import Viso2, ransac_motion
from .box_rules import KitBoxFilter, OnMoving
from .calibration import Calibration
from .refined_selection import choose_candidate, motion_of_winner, sample_sets
from .rig import Rig
from .settings import KitConfig
from .weighted_translation import papers_translation, robust_translation

# Largest Sampson distance of an inlier of the previous essential matrix, as a multiple of the threshold.
PREVIOUS_INLIER_THRESHOLDS = 3.0
# After a motion that stereo contradicts, so many other candidates are tried, which differ at least by this.
ALTERNATIVES = 4
DISTINCT_ANGLE = np.radians(5.0)
SUPPORTED_FIT = ReprojectionConfig()  # the fit that needs no essential matrix
SUPPORT = 0.75  # share of all matches that must agree with an alternative in both images of the current pair
MIN_INLIER_SHARE = 0.1  # lower bound of the estimated share of matches without an error


class SelfCalibratingOdometry(Odometry):
    """Odometry with estimated calibration errors and box rules.

    Parameters
    ----------
    calibration : initial calibration errors; `DataError` for the errors of another camera.
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
        on_moving: OnMoving | None = None,
    ):
        super().__init__(camera, config, KitBoxFilter(camera, config.filter, on_moving))
        self.rig = Rig(camera, config.calibration)
        if calibration is not None:
            calibration.check(camera)
            self.rig.set_estimate(calibration.estimate, calibration.covariance_on_another_drive())
        self._moving = np.eye(4)  # the last measured motion of a moving camera

    @property
    def calibration(self) -> Calibration:
        """The estimated calibration errors."""
        return Calibration(self.camera, self.rig.estimate, self.rig.covariance)

    def step(self, matches: StereoMatches, boxes: Boxes) -> StepResult:
        """The paper's step on corrected matches; then the calibration is learnt from the motion.

        A frame without a measured motion repeats the last one that was not a standstill, since a repeated
        image looks like a standstill. Such a frame does not change the calibration.
        """
        estimate = self.rig.estimate
        covariance = self.rig.covariance
        learns = self.config.calibration.estimate
        if learns:
            self.rig.update_from_rows(matches)
        result = super().step(self.rig.correct(matches), boxes)
        motion = result.motion
        if not motion.measured:
            motion = replace(motion, T_cp=self._moving)
        elif not motion.still:
            self._moving = motion.T_cp
        # A still camera sees the same errors again and again: that is no new information on the calibration.
        # A motion that stereo contradicts would teach a calibration that agrees with it.
        contradicted = Flag.CONTRADICTS_STEREO in motion.flags
        if motion.still or contradicted or not motion.measured:
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

    fit_gain = 2.0  # the motions are more precise than those of the paper's method: right ones reach 1.3

    def solve(self, matches: StereoMatches) -> Solution | None:
        """The paper's solution or, if stereo contradicts it, the alternative that stereo supports best."""
        solution = super().solve(matches)
        if solution is None or Flag.CONTRADICTS_STEREO not in solution.flags:
            return solution
        flags = tuple(flag for flag in solution.flags if flag != Flag.CONTRADICTS_STEREO)
        others = [Solution(rotation, t_cp, flags) for rotation, t_cp in self.alternatives(matches)]
        best = min(others, key=lambda other: self.error(matches, other), default=solution)
        is_clearly_better = self.fit_gain * self.error(matches, best) <= self.error(matches, solution)
        return best if is_clearly_better else solution

    def next_prior(self, e: Array, flags: tuple[Flag, ...]) -> Array | None:
        """The winner, but not one that stereo contradicts: then the prior stays."""
        return self.e_prev if Flag.CONTRADICTS_STEREO in flags else e

    def alternatives(self, matches: StereoMatches) -> Iterator[tuple[Rotation, Array]]:
        """Rotation and translation t_cp (3,) of other motions: of the best other candidates, and of a fit.

        Two essential matrices fit the images of a plane, so one of the candidates may be the right one. The
        fit, of the reprojection error, needs no essential matrix.
        """
        x_p, x_c = self.points(matches)
        sets = self.draw_sets(x_p, x_c)
        E, _ = five_point(x_p[sets], x_c[sets])
        errors = WINNER_CRITERIA[self.config.selection.winner](E, x_p, x_c, self.threshold)
        for candidate in distinct_candidates(E, errors, ALTERNATIVES):
            rotation = self.rotation(candidate, matches)
            t_cp = self.translate(matches, rotation)
            if t_cp is not None:
                yield rotation, t_cp
        fitted = ransac_motion(self.camera, matches, self.random(), SUPPORTED_FIT)
        if fitted is not None:
            R_cp, t_cp, _ = fitted
            E_fitted = essential_from_motion(R_cp, t_cp)
            inliers = sampson_inliers(E_fitted, x_p, x_c, self.threshold)
            yield Rotation(R_cp, E_fitted, inliers), t_cp

    def error(self, matches: StereoMatches, solution: Solution) -> float:
        """The `support_error` of a solution, pixels."""
        return support_error(self.camera, matches, rigid(solution.rotation.R_cp, solution.t_cp))

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


def distinct_candidates(E: Array, errors: Array, number: int) -> list[Array]:
    """The `number` candidates (3, 3) with the smallest errors (M,) that differ clearly from each other."""
    chosen: list[Array] = []
    vectors: list[Array] = []
    for place in np.argsort(errors, kind="stable"):
        e = essential_vector(E[place])
        if all(essential_angle(e, other) > DISTINCT_ANGLE for other in vectors):
            chosen.append(E[place])
            vectors.append(e)
        if len(chosen) == number:
            break
    return chosen


def support_error(camera: StereoCamera, matches: StereoMatches, T_cp: Array) -> float:
    """The reprojection error, pixels, that three quarters of all matches stay below for a motion.

    If most matches are on traffic that drives in one direction, their median supports the motion relative to
    that traffic. On a wall, nearly all matches support the right motion.
    """
    return float(np.quantile(stereo_residuals(camera, matches, T_cp), SUPPORT, method="higher"))


class KitViso2(SelfCalibratingOdometry, Viso2):
    """VISO2 with estimation of the calibration errors."""


def make_kit_odometry(
    camera: StereoCamera,
    config: KitConfig,
    calibration: Calibration | None = None,
    on_moving: OnMoving | None = None,
) -> SelfCalibratingOdometry:
    """The odometry of variant `kit` for a configuration; arguments as in `SelfCalibratingOdometry`."""
    kind = KitViso2 if config.estimator == "reprojection" else KitOdometry
    return kind(camera, config, calibration, on_moving)
