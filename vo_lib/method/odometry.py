"""The paper's method: matches and boxes of a frame in, its motion out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.boxes import Boxes, no_boxes
from ..core.camera import StereoCamera
from ..core.frame import Clock, Motion
from ..core.geometry import essential_angle, essential_vector, rigid
from ..core.matches import StereoMatches
from ..core.types import Array, Index
from .boxes import on_vehicles
from .buckets import select_by_bucket
from .config import MethodConfig
from .five_point import five_point
from .selection import draw_sets, nearest_to_prior, resolve_by_depth, sampson_inliers, truncated_errors
from .translation import solve_translation


class Odometry:
    """One method of the paper along a sequence, frame by frame.

    Flags of a frame: `standstill`, and `few_matches` or `no_motion`, where the last motion is used again.

    Attributes
    ----------
    e_prev : (9,) essential vector of the last frame that moved, the paper's E_prev; None before.
    """

    def __init__(self, camera: StereoCamera, config: MethodConfig):
        self.camera = camera
        self.config = config
        self.e_prev: Array | None = None
        self._boxes = no_boxes()
        self._frame = 0
        self._last = np.eye(4)

    def start(self, boxes: Boxes) -> None:
        """The first frame: nothing but its boxes is needed."""
        self._boxes = boxes

    def step(self, matches: StereoMatches, boxes: Boxes) -> Motion:
        """Motion of the next frame from its matches and the boxes in its left image."""
        self._frame += 1
        clock = Clock()
        static = self.without_boxes(matches, boxes)
        chosen = self.bucketed(static)
        clock.stage("filter")
        motion = self.guarded_motion(chosen, clock)
        self._last = motion.T_cp
        removed = len(matches) - len(static)
        return replace(motion, matches=len(matches), removed=removed, used=len(chosen), ms=clock.ms)

    def guarded_motion(self, chosen: StereoMatches, clock: Clock) -> Motion:
        """`motion`, and what to do where there can be none."""
        if len(chosen) < self.config.min_matches:
            return Motion(self._last, flags=("few_matches",))
        if self.stands_still(chosen):
            return Motion(np.eye(4), flags=("standstill",))
        motion = self.motion(chosen, clock)
        return Motion(self._last, flags=("no_motion",)) if motion is None else motion

    def stands_still(self, matches: StereoMatches) -> bool:
        """Whether the features move too little for an essential matrix; E_prev is kept then."""
        flow = np.median(np.linalg.norm(matches.cur_left - matches.prev_left, axis=1))
        return bool(flow < self.config.selection.standstill_flow)

    def motion(self, matches: StereoMatches, clock: Clock) -> Motion | None:
        """Rotation from the essential matrix, then the translation; None where the matches show none."""
        x_p, x_c = self.camera.normalise(matches.prev_left), self.camera.normalise(matches.cur_left)
        sets = self.draw_sets(len(matches))
        E, set_index = five_point(x_p[sets], x_c[sets])
        if len(E) == 0:
            return None
        winner = E[self.select(E, set_index, x_p, x_c)]
        inliers = sampson_inliers(winner, x_p, x_c, self.threshold)
        R_cp = self.rotation(winner, matches[inliers])
        clock.stage("rotation")
        solved = solve_translation(self.camera, matches[inliers], R_cp, self.config.translation)
        clock.stage("translation")
        if solved is None or np.count_nonzero(solved[1]) < self.config.min_matches:
            return None
        e, before = essential_vector(winner), self.e_prev
        self.e_prev = e
        angle = float("nan") if before is None else float(np.degrees(essential_angle(e, before)))
        return Motion(rigid(R_cp, solved[0]), inliers=int(np.count_nonzero(inliers)), prior_angle=angle)

    @property
    def threshold(self) -> float:
        """Largest Sampson distance of an inlier, in normalised points."""
        return self.config.selection.threshold / self.camera.f

    def without_boxes(self, matches: StereoMatches, boxes: Boxes) -> StereoMatches:
        """The matches outside vehicle boxes (section 3); `boxes` are those of the current frame."""
        before, self._boxes = self._boxes, boxes
        if self.config.filter.rule == "none":
            return matches
        return matches[~on_vehicles(matches, before, boxes, self.config.filter)]

    def bucketed(self, matches: StereoMatches) -> StereoMatches:
        """A few matches of each square of the image (section 1)."""
        kept = select_by_bucket(matches.cur_left, matches.age, matches.strength, self.config.buckets)
        return matches[kept]

    def random(self) -> np.random.Generator:
        """Random numbers of this frame: of the seed and the frame's number alone."""
        return np.random.default_rng([self.config.seed, self._frame])

    def draw_sets(self, number: int) -> Index:
        """Random five-point sets among `number` matches, (S, 5)."""
        return draw_sets(self.random(), number, self.config.selection.sets)

    def select(self, E: Array, set_index: Index, x_p: Array, x_c: Array) -> int:
        """Which candidate wins (section 2.2): the smallest error among those near the previous frame's."""
        errors = truncated_errors(E, x_p, x_c, self.threshold)
        if self.config.selection.prior and self.e_prev is not None:
            near = nearest_to_prior(E, set_index, self.e_prev, self.config.selection.keep)
            errors = np.where(near, errors, np.inf)
        return int(np.argmin(errors))

    def rotation(self, E: Array, matches: StereoMatches) -> Array:
        """R_cp of an essential matrix: of its four motions the one that agrees with stereo depth."""
        x_p, x_c = self.camera.normalise(matches.prev_left), self.camera.normalise(matches.cur_left)
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        return resolve_by_depth(E, x_p, x_c, X_p)[0]
