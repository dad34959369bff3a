"""The kit's own odometry: whole steps of the paper's replaced by better ones.

`SelfCalibratingOdometry` adds what both estimators share: the errors of the calibration are learnt, boxes are
judged, motions beyond a vehicle's limits are flagged. `KitOdometry` refines the winner and solves a robust
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
from ..paper.odometry import Odometry, Rotation, median_flow
from ..paper.selection import sampson_inliers
from ..paper.settings import MethodConfig
from ..paper.viso2 import Viso2
from .boxes import BoxFilter, Filtered
from .calibration import Calibration
from .rig import Rig
from .selection import choose, motion_of_winner, sample_sets
from .settings import KitConfig
from .translation import robust_translation
from .vehicle import Vehicle

# Sets without an outlier: with 200 in every frame TE and RE are no better.
CLEAN_SETS = 50
# Matches within so many thresholds of the last essential matrix count as its inliers.
PREVIOUS_INLIER_THRESHOLDS = 3.0
# Frame number and its matches in, (M,) bool out.
OnMoving = Callable[[int, StereoMatches], BoolArray]


class SelfCalibratingOdometry(Odometry):
    """Matches corrected by the learnt errors of the calibration, boxes judged by a rule of the kit.

    Parameters
    ----------
    calibration : errors of the cameras to start from; `DataError` if they are another camera's.
    times : (N,) seconds of all frames; None: unknown, and no motion is flagged.
    on_moving : for the box rule `truth`, which matches (M,) of a frame are on moving things.

    Attributes
    ----------
    rig : the learnt errors of the cameras.
    filtered : what the box rule did in the last frame.
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
            self.rig.know(calibration.estimate, calibration.covariance_on_another_drive())
        self._times, self._on_moving = times, on_moving
        self._still = False
        self._filter = BoxFilter(camera, config.filter)
        self._vehicle = Vehicle(config.vehicle)

    @property
    def calibration(self) -> Calibration:
        """The learnt errors of the cameras."""
        return Calibration(self.camera, self.rig.estimate, self.rig.covariance)

    def start(self, boxes: Boxes) -> None:
        """The first frame: nothing but its boxes is needed."""
        self._filter.start(boxes)

    def step(self, matches: StereoMatches, boxes: Boxes) -> FrameResult:
        """The paper's step on corrected matches, with the vehicle check."""
        before = self.e_prev, self.rig.estimate, self.rig.covariance
        # A camera that stands still shows the same features with the same errors again: nothing is learnt.
        still_flow = self.config.selection.standstill_flow
        self._still = len(matches) > 0 and median_flow(matches) < still_flow
        if self.config.calibration.estimate and not self._still:
            self.rig.learn_rows(matches)
        motion = super().step(self.rig.correct(matches), boxes)
        assert self.filtered is not None
        motion = replace(motion, flags=(*self.filtered.flags, *motion.flags))
        seconds = 0.0 if self._times is None else float(np.diff(self._times)[self._frame - 1])
        motion = self._vehicle.judge(motion, seconds, self._still)
        if motion.in_doubt:
            self.e_prev, *errors = before
            self.rig.know(*errors)
        return motion

    def without_boxes(self, matches: StereoMatches, boxes: Boxes) -> StereoMatches:
        """The matches that the kit's box rule leaves."""
        on_moving = None if self._on_moving is None else self._on_moving(self._frame, matches)
        self.filtered = self._filter.step(matches, boxes, on_moving)
        return matches[self.filtered.keep]

    def learn(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> None:
        """Learn the rig from a frame's motion: the next frame's matches are corrected by it."""
        if self.config.calibration.estimate and not self._still:
            self.rig.update(matches, R_cp, t_cp)
            self.clock.stage("calibration")


class KitOdometry(SelfCalibratingOdometry):
    """Rotation from a refined winner, then a weighted robust translation.

    Further flag: `prior_dropped` (sharp turn or restart: the prior's best was clearly worse than the best).
    """

    _dropped = False

    def remember(self, rotation: Rotation, t_cp: Array) -> FrameResult:
        """As the paper's; says where the prior was dropped."""
        return replace(super().remember(rotation, t_cp), flags=(Flag.PRIOR_DROPPED,) * self._dropped)

    def draw_sets(self, x_p: Array, x_c: Array) -> Index:
        """Of the n sets no more are drawn than leave CLEAN_SETS without an outlier.

        An outlier is far from the last frame's geometry; the winner is but the start of the refinement.
        `literal` keeps the winner, and there, as on a sharp turn, all are drawn.
        """
        config, sets = self.config.selection, self.config.selection.sets
        if config.mode == "refined" and self.e_prev is not None:
            near = sampson_inliers(
                self.e_prev.reshape(3, 3), x_p, x_c, PREVIOUS_INLIER_THRESHOLDS * self.threshold
            )
            sets = min(sets, int(CLEAN_SETS / max(float(np.mean(near)), 0.1) ** 5))
        return sample_sets(self.random(), len(x_p), sets)

    def select(self, E: Array, set_index: Index, x_p: Array, x_c: Array) -> int:
        """As the paper's, but the prior is dropped where it is clearly wrong."""
        config, f = self.config.selection, self.camera.f
        winner, self._dropped = choose(E, set_index, x_p, x_c, self.e_prev, config, f)
        return winner

    def rotation(self, E: Array, matches: StereoMatches) -> Rotation:
        """The winner refined on its inliers."""
        x_p, x_c = self.points(matches)
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        R, _, E, inliers = motion_of_winner(E, x_p, x_c, X_p, self.config.selection, self.camera.f)
        return Rotation(R, E, inliers)

    def translate(self, matches: StereoMatches, rotation: Rotation) -> Array | None:
        """All features weighted, robustly."""
        config, R_cp = self.config.translation, rotation.R_cp
        solved = robust_translation(self.camera, matches, R_cp, config)
        self.clock.stage("translation")
        if solved is None or np.count_nonzero(solved[1] < config.agreement) < self.config.min_matches:
            return None
        self.learn(matches, R_cp, solved[0])
        return solved[0]


class KitViso2(SelfCalibratingOdometry, Viso2):
    """VISO2, from which the calibration is learnt too."""

    def fit(self, matches: StereoMatches) -> tuple[Array, Array, BoolArray] | None:
        """Rotation, translation and inliers (N,); None where too few matches agree on them."""
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
    """The kit's odometry of a configuration's estimator; arguments as in `SelfCalibratingOdometry`."""
    assert isinstance(config, KitConfig)
    kind = KitViso2 if config.estimator == "reprojection" else KitOdometry
    return kind(camera, config, calibration, times, on_moving)
