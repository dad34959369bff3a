"""The kit's own odometry: whole steps of the paper's replaced by better ones.

`Learning` adds what both estimators share: what is wrong with the calibration is learnt, boxes are judged.
`KitOdometry` refines the winner and solves a robust translation; `KitViso2` is VISO2 on the same matches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..baseline.viso2 import Viso2, refit_motion
from ..core.boxes import Boxes
from ..core.camera import StereoCamera
from ..core.frame import LOST, TIME_JUMP, FrameResult
from ..core.geometry import rigid
from ..core.matches import StereoMatches, empty_matches
from ..core.reprojection import fit_motion
from ..core.rows import joined
from ..core.types import Array, Index, Mask
from ..core.vehicle import Vehicle
from ..method.odometry import Odometry, Rotation, median_flow
from ..method.selection import sampson_inliers
from .box_filter import BoxFilter, Filtered
from .calibration import Calibration
from .config import Config
from .moving import AGREES_CHI2, background_noise, point_steps
from .rig import Rig
from .selection import choose, motion_of_winner, sample_sets
from .translation import solve_translation

# Sets without an outlier: with 200 in every frame TE and RE are no better.
ENOUGH = 50
# Matches within so many thresholds of the last essential matrix are taken for inliers of this one.
AS_BEFORE = 3.0


class Learning(Odometry):
    """A frame's matches corrected by what is known of the calibration, and boxes judged by a rule of the kit.

    Further flags: `filter_off` (boxes would have left too few matches), `few_background` (too little
    outside the boxes to judge which of them move), those of `Vehicle`: a doubtful motion is not believed.

    Attributes
    ----------
    rig : what is known of the cameras' errors.
    filtered : what the box rule did in the last frame.
    vehicle : judges the motions.
    """

    config: Config

    def __init__(self, camera: StereoCamera, config: Config, known: Calibration | None = None):
        super().__init__(camera, config)
        self.filtered: Filtered | None = None
        self.rig = Rig(camera, config.calibration)
        if known is not None:
            known.check(camera)
            self.rig.know(known.estimate, known.covariance_on_another_drive())
        self._on_moving: Mask | None = None
        self._seen = empty_matches()
        self._filter = BoxFilter(camera, config.filter)
        self.vehicle = Vehicle(config.vehicle, camera)
        self._good, self._jumped = self._last, False
        self._unsure = self._known()

    @property
    def calibration(self) -> Calibration:
        """What is known of the cameras' errors now."""
        return Calibration(self.camera, self.rig.estimate, self.rig.covariance)

    def start(self, boxes: Boxes) -> None:
        """The first frame: nothing but its boxes is needed."""
        self._filter.start(boxes)

    def step(
        self, matches: StereoMatches, boxes: Boxes, on_moving: Mask | None = None, seconds: float = 0.0
    ) -> FrameResult:
        """As the paper's, on corrected matches; what no vehicle does needs evidence.

        on_moving : (N,) matches known to be on moving things; the box rule `truth` needs it.
        seconds : since the previous frame, 0 where it is not known.
        """
        self._on_moving = on_moving
        before = self._known()
        if self.config.calibration.estimate:
            self.rig.learn_rows(matches)
        self._seen = self.rig.correct(matches)
        motion = super().step(self._seen, boxes)
        assert self.filtered is not None
        motion = replace(motion, flags=(*self.filtered.flags, *motion.flags))
        keep = self.filtered.keep
        # What this frame taught may be in the motion, so the matches are judged corrected by it too.
        motion = self.vehicle.judge(motion, lambda: self.rig.correct(matches)[keep], seconds)
        if not motion.in_doubt:
            if self.vehicle.waiting:
                self._unsure = before
            jump = TIME_JUMP in motion.flags
            if not jump or self._jumped:  # the way of one gap does not go on; of two in a row it does
                self._good = motion.T_cp
            self._jumped = jump
            return motion
        # Nothing is learnt from it, or from one taken back. The last good motion goes on, but not for ever.
        if self.vehicle.taken_back:
            before, self._jumped = self._unsure, False
        self.e_prev, self._good, *of_rig = before
        self.rig.know(*of_rig)
        self._last = np.eye(4) if LOST in motion.flags else self._good
        return replace(motion, T_cp=self._last)

    def _known(self) -> tuple[Array | None, Array, Array, Array]:
        """All that a motion in doubt must not change: prior, last good motion, the cameras' errors."""
        return self.e_prev, self._good, self.rig.estimate, self.rig.covariance

    def without_boxes(self, matches: StereoMatches, boxes: Boxes) -> StereoMatches:
        """The matches that the kit's box rule leaves."""
        self.filtered = self._filter.step(matches, boxes, self._on_moving)
        return matches[self.filtered.keep]

    def learn(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> StereoMatches | None:
        """Learn the rig from a frame's motion; matches without what it taught, None if it is little.

        What boxes removed teaches too where it stands still as the rest does: parked cars are near.
        """
        assert self.filtered is not None
        seen, removed = matches, self.bucketed(self._seen[~self.filtered.keep])
        if len(removed):
            seen = joined([matches, removed])
            used = np.arange(len(seen)) < len(matches)
            error = point_steps(self.camera, seen, rigid(R_cp, t_cp)).squared_error(np.zeros(3))
            noise = background_noise(error, used, self.config.filter.moving)
            seen = seen[used | (error < AGREES_CHI2 * noise)]
        more = self.rig.update(seen, R_cp, t_cp)
        return None if more is None else self.rig.correct(matches, more)


class KitOdometry(Learning):
    """Rotation from a refined winner, then a weighted robust translation.

    Further flag: `prior_dropped` (sharp turn or restart: the prior's best was clearly worse than the best).
    """

    _dropped = False

    def remember(self, rotation: Rotation, t_cp: Array) -> FrameResult:
        """As the paper's; says where the prior was dropped."""
        return replace(super().remember(rotation, t_cp), flags=("prior_dropped",) * self._dropped)

    def rest(self, matches: StereoMatches) -> FrameResult:
        """The small motion that stereo depth shows, or none at all."""
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        current = matches.cur_left, matches.cur_right
        R, t, residual = fit_motion(self.camera, X_p, *current, np.eye(3), np.zeros(3), scale=0.5)
        T_cp = np.eye(4) if median_flow(matches) < self.config.selection.rest_flow else rigid(R, t)
        inliers = int(np.count_nonzero(residual < self.config.translation.agreement))
        return FrameResult(T_cp, inliers=inliers, flags=("standstill",))

    def draw_sets(self, x_p: Array, x_c: Array) -> Index:
        """Every other set takes its features from all sides of the image.

        Of the n sets no more are drawn than leave ENOUGH without an outlier, where an outlier is far from the
        last frame's geometry: the winner is but the start of the refinement. `literal` keeps the winner, and
        there, as on a sharp turn, all are drawn.
        """
        config, sides = self.config.selection, np.arctan2(x_c[:, 1], x_c[:, 0])
        sets = config.sets
        if config.mode == "refined" and self.e_prev is not None:
            near = sampson_inliers(self.e_prev.reshape(3, 3), x_p, x_c, AS_BEFORE * self.threshold)
            sets = min(sets, int(ENOUGH / max(float(np.mean(near)), 0.1) ** 5))
        return sample_sets(self.random(), len(x_p), sets, sides)

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
        """All features weighted, robustly; solved again with what this frame shows of the calibration."""
        config, R_cp = self.config.translation, rotation.R_cp
        solved = solve_translation(self.camera, matches, R_cp, config)
        self.clock.stage("translation")
        if solved is None or np.count_nonzero(solved[1] < config.agreement) < self.config.min_matches:
            return None
        if not self.config.calibration.estimate:
            return solved[0]
        corrected = self.learn(matches, R_cp, solved[0])
        again = None if corrected is None else solve_translation(self.camera, corrected, R_cp, config)
        self.clock.stage("calibration")
        return (again or solved)[0]


class KitViso2(Learning, Viso2):
    """VISO2, fitted again with what the frame shows of the calibration."""

    config: Config

    def fit(self, matches: StereoMatches) -> tuple[Array, Array, Mask] | None:
        """Rotation, translation and inliers (N,); None where too few matches agree on them."""
        found = super().fit(matches)
        self.clock.stage("rotation")
        if found is None or not self.config.calibration.estimate:
            return found
        R_cp, t_cp, inliers = found
        corrected = self.learn(matches, R_cp, t_cp)
        if corrected is not None:
            agreed = corrected[inliers & (corrected.prev_left[:, 0] > corrected.prev_right[:, 0])]
            R_cp, t_cp = refit_motion(self.camera, agreed, R_cp, t_cp, self.config.reprojection)
        self.clock.stage("calibration")
        return R_cp, t_cp, inliers
