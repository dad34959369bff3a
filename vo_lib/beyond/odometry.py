"""The method: matches and boxes of a frame in, its motion out."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..baseline.viso2 import ransac_motion, refit_motion
from ..core.boxes import Boxes
from ..core.camera import StereoCamera
from ..core.frame import Clock, Motion
from ..core.geometry import rigid
from ..core.matches import StereoMatches
from ..core.reprojection import fit_motion
from ..core.types import Array
from ..method.buckets import select_by_bucket
from .box_filter import BoxFilter, Filtered
from .calibration import StereoCalibration
from .config import Config
from .principal_point import PrincipalPoint
from .selection import estimate_essential
from .translation import solve_translation


class Odometry:
    """Motions from matches: filter, buckets, rotation by selection, translation by least squares.

    The `reprojection` estimator (VISO2) takes rotation and translation from one fit instead.

    Flags: `few_matches` and `no_motion` (the last motion is used again), `standstill`,
    `prior_dropped` (sharp turn or restart), `filter_off` (boxes would have left too few matches),
    `few_street` (too little outside the boxes to judge which of them move).
    """

    def __init__(self, camera: StereoCamera, config: Config):
        self.config = config
        self._frame = 0
        self._e: Array | None = None
        self._last = np.eye(4)
        self.filtered: Filtered | None = None  # what the box rule did in the last frame
        self._filter = BoxFilter(camera, config.filter)
        self._calibration = StereoCalibration(camera, config.calibration)
        self._centre = PrincipalPoint(camera, config.calibration)

    @property
    def camera(self) -> StereoCamera:
        """The stereo camera as known now."""
        return self._centre.camera

    def start(self, boxes: Boxes) -> None:
        """The first frame: nothing but its boxes is needed."""
        self._filter.start(boxes)

    def step(
        self, matches: StereoMatches, boxes: Boxes, on_moving: NDArray[np.bool_] | None = None
    ) -> Motion:
        """Motion of the next frame from its matches and the boxes in its left image.

        `on_moving` : (N,) matches known to be on moving things; the box rule `truth` needs it.
        """
        self._frame += 1
        clock = Clock()
        self._calibration.camera = camera = self.camera
        self._filter.use(camera)
        self._calibration.learn_rows(matches)
        corrected = self._calibration.correct(matches)
        self.filtered = filtered = self._filter.step(corrected, boxes, on_moving)
        chosen = corrected[filtered.keep]
        chosen = chosen[select_by_bucket(chosen.cur_left, chosen.age, chosen.strength, self.config.buckets)]
        clock.stage("filter")
        motion = self._motion(camera, chosen, clock)
        self._last = motion.T_cp
        return dataclasses.replace(
            motion,
            matches=len(matches),
            removed=int(np.count_nonzero(~filtered.keep)),
            used=len(chosen),
            centre=self._centre.pixels,
            flags=(*filtered.flags, *motion.flags),
            ms=clock.ms,
        )

    def _by_reprojection(
        self, camera: StereoCamera, chosen: StereoMatches, X_p: Array, flow: float, clock: Clock
    ) -> Motion:
        """VISO2: rotation and translation at once; standing still is no special case."""
        current = chosen.cur_left, chosen.cur_right
        rng = np.random.default_rng([self.config.seed, self._frame])
        found = ransac_motion(camera, X_p, *current, rng, self.config.reprojection)
        clock.stage("rotation")
        if found is None or np.count_nonzero(found[2]) < self.config.min_matches:
            return Motion(self._last, flags=("no_motion",))
        R_cp, t_cp, inliers = found
        if self.config.calibration.estimate:
            if flow >= self.config.selection.standstill_flow and np.any(t_cp):
                x_p, x_c = (camera.normalise(uv[inliers]) for uv in (chosen.prev_left, chosen.cur_left))
                self._centre.update(x_p, x_c, R_cp, t_cp / np.linalg.norm(t_cp))
            corrected = self._calibration.update(chosen, R_cp, t_cp)
            if corrected is not None:
                X_p = camera.triangulate(corrected.prev_left, corrected.prev_right)
                agreed = np.flatnonzero(inliers & np.isfinite(X_p[:, 2]))
                current = corrected.cur_left, corrected.cur_right
                R_cp, t_cp = refit_motion(camera, X_p, *current, agreed, R_cp, t_cp, self.config.reprojection)
            clock.stage("calibration")
        return Motion(
            rigid(R_cp, t_cp),
            offset=float(self._calibration.disparity[0]),
            inliers=int(np.count_nonzero(inliers)),
        )

    def _motion(self, camera: StereoCamera, chosen: StereoMatches, clock: Clock) -> Motion:
        if len(chosen) < self.config.min_matches:
            return Motion(self._last, flags=("few_matches",))
        X_p = camera.triangulate(chosen.prev_left, chosen.prev_right)
        flow = float(np.median(np.linalg.norm(chosen.cur_left - chosen.prev_left, axis=1)))
        if self.config.estimator == "reprojection":
            return self._by_reprojection(camera, chosen, X_p, flow, clock)
        if flow < self.config.selection.standstill_flow:
            # The essential matrix of a camera that stands still is undefined: its vector is kept.
            R, t, residual = fit_motion(
                camera, X_p, chosen.cur_left, chosen.cur_right, np.eye(3), np.zeros(3), scale=0.5
            )
            clock.stage("rotation")
            T_cp = np.eye(4) if flow < self.config.selection.rest_flow else rigid(R, t)
            return Motion(
                T_cp,
                inliers=int(np.count_nonzero(residual < self.config.translation.agreement)),
                flags=("standstill",),
            )
        x_p, x_c = camera.normalise(chosen.prev_left), camera.normalise(chosen.cur_left)
        rng = np.random.default_rng([self.config.seed, self._frame])
        estimate = estimate_essential(x_p, x_c, X_p, self._e, rng, self.config.selection, camera.f)
        clock.stage("rotation")
        if estimate is None:
            return Motion(self._last, flags=("no_motion",))
        solved = solve_translation(camera, chosen, estimate.R_cp, self.config.translation)
        clock.stage("translation")
        if (
            solved is None
            or np.count_nonzero(solved[1] < self.config.translation.agreement) < self.config.min_matches
        ):
            return Motion(self._last, flags=("no_motion",))
        self._e = estimate.e
        t_cp = solved[0]
        if self.config.calibration.estimate:
            self._centre.update(x_p, x_c, estimate.R_cp, estimate.direction)
            corrected = self._calibration.update(chosen, estimate.R_cp, t_cp)
            if corrected is not None:
                again = solve_translation(camera, corrected, estimate.R_cp, self.config.translation)
                t_cp = t_cp if again is None else again[0]
            clock.stage("calibration")
        return Motion(
            rigid(estimate.R_cp, t_cp),
            offset=float(self._calibration.disparity[0]),
            inliers=int(np.count_nonzero(estimate.inliers)),
            prior_angle=float(np.degrees(estimate.prior_angle)),
            flags=("prior_dropped",) if estimate.prior_dropped else (),
        )
