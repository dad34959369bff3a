"""The odometry of variant `kit`, which replaces whole steps of the paper's odometry.

`SelfCalibratingOdometry` has the additions for both estimators: estimation of the calibration errors and box
rules. `KitOdometry` refines the winner and solves a robust translation; `KitViso2` is VISO2 on the same
matches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import essential_angle, essential_from_motion, essential_vector, rigid
from ..geometry.reprojection import stereo_residuals
from ..geometry.result import Flag
from ..geometry.types import Array, Index
from ..paper.odometry import Odometry, Rotation, Solution, StepResult, Winner
from ..paper.selection import WINNER_CRITERIA, sampson_inliers
from ..paper.settings import ReprojectionConfig
from ..paper.viso2 import Viso2, ransac_motion
from .box_rules import KitBoxFilter, OnMoving
from .calibration import Calibration
from .refined_selection import choose_candidate, motion_of_candidate, sample_sets
from .rig import Rig
from .settings import KitConfig
from .weighted_translation import papers_translation, robust_translation

# Largest Sampson distance of an inlier of the previous frame's essential matrix, as a multiple of
# `threshold`; above 1, since the motion has changed since.
PREVIOUS_INLIER_RATIO = 3.0
MIN_INLIER_SHARE = 0.1  # lower bound of the share of inliers that is estimated in this way
# After a motion that stereo contradicts, so many of the best candidates are tried. Their essential vectors
# differ from each other by more than this angle, radians.
CANDIDATES_TRIED = 4
MIN_ANGLE_BETWEEN = np.radians(5.0)
FIT_WITHOUT_E = ReprojectionConfig()  # of the fit that is tried beside these candidates
SUPPORT_QUANTILE = 0.75  # of the reprojection errors of all matches; see `KitOdometry.support_error`


class SelfCalibratingOdometry(Odometry):
    """Odometry with estimated calibration errors and box rules, for both estimators.

    The motion of a corrected frame comes from `super().step`: from the paper's seven steps in `KitOdometry`,
    from VISO2 in `KitViso2`.

    Parameters
    ----------
    camera : the stereo camera of calib.txt; config : settings of a method of variant `kit`.
    calibration : initial calibration errors; None: no errors, with the prior covariance.
    on_moving : the truth about moving objects, for the box rule `truth`.

    Attributes
    ----------
    rig : the estimated calibration errors.

    Raises
    ------
    DataError : `calibration` is that of another camera.
    ValueError : the box rule `truth` without `on_moving`.
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
        self._motion_to_repeat = np.eye(4)  # T_cp of the last frame in which the camera was seen to move

    @property
    def calibration(self) -> Calibration:
        """The estimated calibration errors."""
        return Calibration(self.camera, self.rig.estimate, self.rig.covariance)

    def step(self, matches: StereoMatches, boxes: Boxes) -> StepResult:
        """The motion from corrected matches; then the motion teaches the calibration.

        A frame without a measured motion repeats the last one that was not a standstill, since a repeated
        image looks like a standstill. Only a frame that says something new changes the calibration.

        Parameters
        ----------
        matches : matches of the new frame with the previous one, not corrected.
        boxes : boxes in the left image of the new frame.
        """
        estimate_before = self.rig.estimate
        covariance_before = self.rig.covariance
        learns = self.config.calibration.estimate
        if learns:
            # Row differences need no motion, so they improve the correction of this same frame.
            self.rig.update_from_rows(matches)
        result = super().step(self.rig.correct(matches), boxes)
        motion = result.motion
        if not motion.measured:
            motion = replace(motion, T_cp=self._motion_to_repeat)
        elif not motion.still:
            self._motion_to_repeat = motion.T_cp
        # A still camera sees the same errors again and again: that is no new information on the calibration.
        # A motion that stereo contradicts would teach a calibration that agrees with it.
        contradicted = Flag.CONTRADICTS_STEREO in motion.flags
        teaches = motion.measured and not motion.still and not contradicted
        if not teaches:
            self.rig.set_estimate(estimate_before, covariance_before)
        elif learns:
            self.rig.update(result.used, R_cp=motion.T_cp[:3, :3], t_cp=motion.T_cp[:3, 3])
            self.clock.stage("calibration")
        return replace(result, motion=replace(motion, ms=self.clock.ms))


class KitOdometry(SelfCalibratingOdometry):
    """Rotation from a refined winner, then a robust weighted translation.

    Additional flag: `prior_dropped` (the prior's best candidate is clearly worse than the overall best, as in
    a sharp turn or after a restart).
    """

    # See `Odometry`. Less than for the method as published, since the motions are more precise: the largest
    # ratio seen for a right one is 1.3.
    fit_gain = 2.0

    def solve(self, matches: StereoMatches) -> Solution | None:
        """The solution of the steps or, if stereo contradicts it, the alternative that stereo supports best.

        Without an alternative whose `support_error` is `fit_gain` times smaller, the contradicted solution
        and its flag stay. None without a solution.
        """
        solution = super().solve(matches)
        if solution is None or Flag.CONTRADICTS_STEREO not in solution.flags:
            return solution
        flags = tuple(flag for flag in solution.flags if flag != Flag.CONTRADICTS_STEREO)
        others = self.other_solutions(matches, flags)
        if not others:
            return solution
        best = min(others, key=lambda other: self.support_error(matches, other))
        error = self.support_error(matches, solution)
        is_clearly_better = self.fit_gain * self.support_error(matches, best) <= error
        return best if is_clearly_better else solution

    def next_prior(self, e: Array, flags: tuple[Flag, ...]) -> Array | None:
        """E_prev (9,) for the next frame: that of the winner, e; if stereo contradicts it, still the old one.

        None as long as stereo has contradicted every winner.
        """
        return self.e_prev if Flag.CONTRADICTS_STEREO in flags else e

    def other_solutions(self, matches: StereoMatches, flags: tuple[Flag, ...]) -> list[Solution]:
        """The motions of the frame's best candidates that clearly differ, and of a fit, all with these flags.

        Two essential matrices fit the images of a plane, so one of the candidates may be the right one. The
        fit, of the reprojection error, needs no essential matrix.
        """
        solutions = []
        x_p, x_c = self.points(matches)
        # The frame's random generator begins anew, so these are the candidates among which the winner was.
        E, _ = self.candidates(x_p, x_c)
        errors = WINNER_CRITERIA[self.config.selection.winner](E, x_p, x_c, self.threshold)
        for candidate in distinct_candidates(E, errors, CANDIDATES_TRIED):
            rotation = self.rotation(candidate, matches)
            t_cp = self.translate(matches, rotation)
            if t_cp is not None:
                solutions.append(Solution(rotation, t_cp, flags))
        fitted = ransac_motion(self.camera, matches, self.random(), FIT_WITHOUT_E)
        if fitted is not None:
            R_cp, t_cp, _ = fitted
            E_fitted = essential_from_motion(R_cp, t_cp)
            inliers = sampson_inliers(E_fitted, x_p, x_c, self.threshold)
            solutions.append(Solution(Rotation(R_cp, E_fitted, inliers), t_cp, flags))
        return solutions

    def support_error(self, matches: StereoMatches, solution: Solution) -> float:
        """The reprojection error, pixels, that three quarters of all matches stay below for a solution.

        The median would not do: if most matches are on traffic that drives in one direction, the motion
        relative to that traffic would have the least error. Where alternatives are needed, at a wall or
        another plane, nearly all matches support the right motion, so a higher share does no harm.
        """
        T_cp = rigid(solution.rotation.R_cp, solution.t_cp)
        residuals = stereo_residuals(self.camera, matches, T_cp)
        return float(np.quantile(residuals, SUPPORT_QUANTILE, method="higher"))

    def five_point_sets(self, x_p: Array, x_c: Array) -> Index:
        """Five-point sets, indices (S, 5) of matches: as many as should give `clean_sets` without an outlier.

        Few sets are sufficient, since the winner is refined. A set has no outlier with the probability s⁵, if
        s is the share of inliers, which is estimated with the previous essential matrix. At most
        `config.sets` are drawn, and all of them in mode `literal`, in the first frame, and in a sharp turn,
        where s is small.
        """
        config = self.config.selection
        sets = config.sets
        if config.mode == "refined" and self.e_prev is not None:
            E_prev = self.e_prev.reshape(3, 3)
            inliers = sampson_inliers(E_prev, x_p, x_c, PREVIOUS_INLIER_RATIO * self.threshold)
            inlier_share = max(float(np.mean(inliers)), MIN_INLIER_SHARE)
            sets = min(sets, int(config.clean_sets / inlier_share**5))
        return sample_sets(self.random(), len(x_p), sets)

    def select(self, E: Array, set_index: Index, x_p: Array, x_c: Array) -> Winner:
        """The paper's winner, but without the prior if the prior is clearly wrong."""
        config = self.config.selection
        winner, prior_dropped = choose_candidate(E, set_index, x_p, x_c, self.e_prev, config, self.camera.f)
        if prior_dropped:
            return Winner(winner, (Flag.PRIOR_DROPPED,))
        return Winner(winner)

    def rotation(self, E: Array, matches: StereoMatches) -> Rotation:
        """The rotation of a candidate E (3, 3), which is refined on its inliers, unless in mode `literal`."""
        x_p, x_c = self.points(matches)
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        R, _, E, inliers = motion_of_candidate(E, x_p, x_c, X_p, self.config.selection, self.camera.f)
        return Rotation(R, E, inliers)

    def translate(self, matches: StereoMatches, rotation: Rotation) -> Array | None:
        """The robust weighted translation t_cp (3,), metres; None with too few inliers."""
        config = self.config.translation
        if "robust-solution" in config.without:
            solution = papers_translation(self.camera, matches, rotation.R_cp, config)
        else:
            solution = robust_translation(self.camera, matches, rotation.R_cp, config)
        if solution is None:
            return None
        t_cp, residual = solution
        inliers = np.count_nonzero(residual < config.agreement)
        return t_cp if inliers >= self.config.min_matches else None


def distinct_candidates(E: Array, errors: Array, number: int) -> list[Array]:
    """Up to `number` candidates (3, 3) of E (M, 3, 3), by their errors (M,); all clearly differ."""
    chosen: list[Array] = []
    vectors: list[Array] = []
    for index in np.argsort(errors, kind="stable"):
        e = essential_vector(E[index])
        if all(essential_angle(e, other) > MIN_ANGLE_BETWEEN for other in vectors):
            chosen.append(E[index])
            vectors.append(e)
        if len(chosen) == number:
            break
    return chosen


class KitViso2(SelfCalibratingOdometry, Viso2):
    """VISO2 with estimation of the calibration errors."""


def make_kit_odometry(
    camera: StereoCamera,
    config: KitConfig,
    calibration: Calibration | None = None,
    on_moving: OnMoving | None = None,
) -> SelfCalibratingOdometry:
    """The odometry of variant `kit` for a configuration; arguments and errors as in its base class."""
    if config.estimator == "reprojection":
        return KitViso2(camera, config, calibration, on_moving)
    return KitOdometry(camera, config, calibration, on_moving)
