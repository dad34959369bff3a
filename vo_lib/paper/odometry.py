"""The paper's method: the motion of a frame from its matches and boxes, in seven steps.

1. Remove the features in vehicle boxes (section 3).
2. Select features by bucket, age and strength, as in earlier work that section 1 describes.
3. Draw five-point sets and compute all their essential matrices (section 2.1).
4. Select one of these candidates, near the previous frame's essential vector (section 2.2).
5. Take its rotation, by SVD as in Nistér's paper, which section 2.2 refers to; section 2.1 names a linear
   equation instead.
6. Solve the linear system for the translation (equations 2 and 3).
7. Store the winner's essential vector for the next frame (section 2.2).

The paper leaves the order of steps 1 and 2 open. Here the boxes come first, so that other features take the
places in the buckets.

Three additions are no part of any step of the paper: at a standstill, the motion is the identity; a frame
without a result repeats the last motion; and a motion that contradicts the stereo depths gets a flag, which
changes nothing else. What we add within a step is said in the module of the step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import DEVIATION_OVER_MEDIAN, essential_angle, essential_vector, rigid
from ..geometry.reprojection import fit_motion, stereo_residuals
from ..geometry.result import Clock, Flag, FrameResult
from ..geometry.types import Array, BoolArray, Index
from .box_removal import BoxFilter, Removal
from .buckets import select_by_bucket
from .five_point import Candidates, five_point
from .selection import WINNER_CRITERIA, candidates_near_prior, draw_sets, resolve_by_depth, sampson_inliers
from .settings import MethodConfig
from .translation import PairBefore, solve_translation

# Limits of the check of a motion against the stereo depths (`contradicts_stereo`), as multiples of the noise
# of the matches, or in pixels. Above the limit of suspicion, a motion is compared with a fit; above the limit
# of contradiction, the error of the fit itself shows that the matches contradict each other, and that no
# motion is right.
SUSPICION_OVER_NOISE = 5.0  # unless the setting `stereo_limit` is less
LEAST_SUSPICION_PX = 0.05  # for images without noise
CONTRADICTION_OVER_NOISE = 15.0  # unless `stereo_limit` is less
LEAST_CONTRADICTION_OVER_NOISE = 3.0  # for very noisy images
LEAST_CONTRADICTION_PX = 0.3  # for images without noise


@dataclass(frozen=True, eq=False)
class StepResult:
    """What `Odometry.step` returns: the motion, what the box rule did, and the matches used.

    Attributes
    ----------
    motion : of the frame, with counts, flags and times.
    removal : what the box rule did to the matches.
    used : the matches from which the motion was computed, after box rule and bucketing.
    """

    motion: FrameResult
    removal: Removal
    used: StereoMatches


class Winner(NamedTuple):
    """Which of a frame's candidates E (M, 3, 3) has won, as an index, and remarks on the choice.

    Only variant `kit` has such a remark: the flag `prior_dropped`.
    """

    candidate: int
    flags: tuple[Flag, ...] = ()


class Rotation(NamedTuple):
    """What the winner gives: its rotation R_cp (3, 3), its E (3, 3), and a mask (N,) of its inliers."""

    R_cp: Array
    E: Array
    inliers: BoolArray


class Solution(NamedTuple):
    """A frame's rotation, its translation t_cp (3,) in metres, and remarks on both."""

    rotation: Rotation
    t_cp: Array
    flags: tuple[Flag, ...] = ()


class Odometry:
    """The paper's method on a sequence: `start` with the first frame, then `step` with each further frame.

    A frame may have a flag: `standstill`; `contradicts_stereo`, for a motion that the stereo depths do not
    support; `few_matches` or `no_motion`, if the motion of the previous frame is repeated.

    Attributes
    ----------
    e_prev : (9,) essential vector of the last winner that led to a motion, the paper's E_prev; None before
        the first one.
    clock : times of the current frame's stages.
    fit_gain : a motion contradicts stereo if its error is more than this many times that of a fit to the
        depths. For right motions of the method as published, the largest ratio seen on drawn and real drives
        is 3.8.
    """

    fit_gain = 4.0

    def __init__(self, camera: StereoCamera, config: MethodConfig, box_filter: BoxFilter | None = None):
        self.camera = camera
        self.config = config
        self.box_filter = BoxFilter(config.filter) if box_filter is None else box_filter
        self.e_prev: Array | None = None
        self.clock = Clock()
        self._frame = 0
        # The motion of the previous frame.
        self._last_motion = np.eye(4)
        # The matches and the motion of the previous frame, from which step 6 makes the rows of a third frame
        # (`earlier_rows`); None if that motion is repeated or a standstill.
        self._pair_before: PairBefore | None = None

    def start(self, boxes: Boxes) -> None:
        """Remember the boxes in the first frame's left image."""
        self.box_filter.start(boxes)

    def step(self, matches: StereoMatches, boxes: Boxes) -> StepResult:
        """Motion of the next frame from its matches (N) and the boxes (K) in its left image."""
        self._frame += 1
        self.clock = Clock()
        removal = self.box_filter.step(matches, boxes)  # step 1
        static = matches[removal.kept]
        used = self.bucketed(static)  # step 2
        self.clock.stage("filter")
        if len(used) < self.config.min_matches:
            motion = FrameResult(self._last_motion, flags=(Flag.FEW_MATCHES,))
        elif self.stands_still(used):
            motion = replace(self.stationary_motion(used), still=True)
        else:
            motion = self.motion_or_previous(used)  # steps 3 to 7, in `solve` and `finish_frame`
        self._last_motion = motion.T_cp
        # Rows of a third frame need a precise motion, so neither a repeated one nor that of a standstill. A
        # motion with the flag `contradicts_stereo` is used like any other. All static matches are kept, since
        # a feature that is used in the next frame need not be used in this one.
        precise = motion.measured and not motion.still
        self._pair_before = PairBefore(static, motion.T_cp) if precise else None
        motion = replace(
            motion,
            matches=len(matches),
            removed=len(matches) - len(static),
            used=len(used),
            flags=(*removal.flags, *motion.flags),
            ms=self.clock.ms,
        )
        return StepResult(motion, removal, used)

    def motion_or_previous(self, matches: StereoMatches) -> FrameResult:
        """The motion from the matches; without a result, the previous frame's motion with a flag."""
        motion = self.motion(matches)
        if motion is None:
            return FrameResult(self._last_motion, flags=(Flag.NO_MOTION,))
        return motion

    def motion(self, matches: StereoMatches) -> FrameResult | None:
        """Steps 3 to 7; None without a result."""
        solution = self.solve(matches)
        return None if solution is None else self.finish_frame(solution)  # step 7

    def solve(self, matches: StereoMatches) -> Solution | None:
        """Steps 3 to 6: rotation from the essential matrix, then the translation; None without a result."""
        x_p, x_c = self.points(matches)
        E, set_index = self.candidates(x_p, x_c)  # step 3
        if len(E) == 0:
            return None
        winner = self.select(E, set_index, x_p, x_c)  # step 4
        rotation = self.rotation(E[winner.candidate], matches)  # step 5
        self.clock.stage("rotation")
        t_cp = self.translate(matches, rotation)  # step 6
        if t_cp is None:
            self.clock.stage("translation")
            return None
        flags = winner.flags
        if self.contradicts_stereo(matches, rotation, t_cp):
            flags = (*flags, Flag.CONTRADICTS_STEREO)
        self.clock.stage("translation")
        return Solution(rotation, t_cp, flags)

    def bucketed(self, matches: StereoMatches) -> StereoMatches:
        """Step 2: the selected matches of each bucket, as in earlier work that section 1 describes."""
        selected = select_by_bucket(matches.cur_left, matches.age, matches.strength, self.config.buckets)
        return matches[selected]

    def candidates(self, x_p: Array, x_c: Array) -> Candidates:
        """Step 3 (section 2.1): all essential matrices of five-point sets of points x_p and x_c (N, 2)."""
        sets = self.five_point_sets(x_p, x_c)
        return five_point(x_p[sets], x_c[sets])

    def five_point_sets(self, x_p: Array, x_c: Array) -> Index:
        """Random five-point sets, indices (S, 5) of matches, for `five_point`.

        The points (N, 2) are given for variant `kit`, which overrides this and draws fewer sets if the
        previous E fits most points. Here only their number N is needed.
        """
        return draw_sets(self.random(), len(x_p), self.config.selection.sets)

    def select(self, E: Array, set_index: Index, x_p: Array, x_c: Array) -> Winner:
        """Step 4 (section 2.2): the best of the candidates E (M, 3, 3) that are near the previous frame's E.

        set_index : (M,) the five-point set of each candidate; x_p, x_c : `points`.
        """
        errors = WINNER_CRITERIA[self.config.selection.winner](E, x_p, x_c, self.threshold)
        near_prior = candidates_near_prior(E, set_index, self.e_prev, self.config.selection)
        return Winner(int(np.argmin(np.where(near_prior, errors, np.inf))))

    def rotation(self, E: Array, matches: StereoMatches) -> Rotation:
        """Step 5 (sections 2.1 and 2.2): the rotation of the winner E (3, 3), by SVD.

        Section 2.2 refers to Nistér's paper, which has the SVD; section 2.1 names a linear equation instead.
        The paper leaves open which of the four motions of E is right. Here, it is the one that agrees with
        the stereo depths.
        """
        x_p, x_c = self.points(matches)
        inliers = sampson_inliers(E, x_p, x_c, self.threshold)
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        R_cp, _ = resolve_by_depth(E, x_c[inliers], X_p[inliers])
        return Rotation(R_cp, E, inliers)

    def translate(self, matches: StereoMatches, rotation: Rotation) -> Array | None:
        """Step 6 (equations 2 and 3): t_cp (3,), metres, from the rotation's inliers.

        None if too few of them fit t_cp.
        """
        config = self.config.translation
        before = self._pair_before if config.pairs == 3 else None
        solution = solve_translation(self.camera, matches[rotation.inliers], rotation.R_cp, config, before)
        if solution is None:
            return None
        t_cp, inliers = solution
        enough = np.count_nonzero(inliers) >= self.config.min_matches
        return t_cp if enough else None

    def finish_frame(self, solution: Solution) -> FrameResult:
        """The result of the frame. Step 7 (section 2.2): its winner becomes E_prev."""
        rotation = solution.rotation
        e = essential_vector(rotation.E)
        angle = np.nan if self.e_prev is None else np.degrees(essential_angle(e, self.e_prev))
        self.e_prev = self.next_prior(e, solution.flags)
        return FrameResult(
            rigid(rotation.R_cp, solution.t_cp),
            inliers=int(np.count_nonzero(rotation.inliers)),
            prior_angle=float(angle),
            flags=solution.flags,
            e=e,
        )

    def next_prior(self, e: Array, flags: tuple[Flag, ...]) -> Array | None:
        """E_prev (9,) of the next frame: the winner's vector e (9,).

        The flags are given for variant `kit`, which overrides this: it keeps the old E_prev if stereo
        contradicts the winner.
        """
        return e

    def stands_still(self, matches: StereoMatches) -> bool:
        """Whether the camera stands still: the median flow of the used features in the left image is small.

        Traffic may pass a camera at rest; with a box rule, its features are already left out.
        """
        flow = np.linalg.norm(matches.cur_left - matches.prev_left, axis=1)  # pixels
        return float(np.median(flow)) < self.config.selection.standstill_flow

    def contradicts_stereo(self, matches: StereoMatches, rotation: Rotation, t_cp: Array) -> bool:
        """Whether the stereo depths speak against a motion (not in the paper).

        Two essential matrices fit the images of a plane, and several fit those of a repeated pattern. A wrong
        one has inliers like the right one, but the depths disagree with it: the median reprojection error of
        the inliers is many times that of a motion fitted to the depths, or no motion fits them at all. Which
        errors are normal depends on the noise of the matches (`row_noise`).
        """
        agreeing = matches[rotation.inliers]
        noise = row_noise(agreeing)
        limit = self.config.stereo_limit
        T_cp = rigid(rotation.R_cp, t_cp)
        error = float(np.median(stereo_residuals(self.camera, agreeing, T_cp)))
        if error <= suspicion_limit(noise, limit):
            return False
        X_p = self.camera.triangulate(agreeing.prev_left, agreeing.prev_right)
        # A match without depth, which only a corrected calibration leaves, has an infinite residual for every
        # motion. It counts against the motion in `error`, but it says nothing of the fit.
        with_depth = agreeing[np.flatnonzero(np.isfinite(X_p).all(axis=1))]
        fitted = float(np.median(fit_motion(self.camera, with_depth, start=T_cp).residual))
        return error > self.fit_gain * fitted or fitted > contradiction_limit(noise, limit)

    def stationary_motion(self, matches: StereoMatches) -> FrameResult:
        """The motion of a camera at rest: the identity; E_prev is kept.

        At rest, E = [t]× R is zero, so noise would determine the winner.
        """
        return FrameResult(np.eye(4), flags=(Flag.STANDSTILL,))

    def points(self, matches: StereoMatches) -> tuple[Array, Array]:
        """Normalised points x_p and x_c (N, 2) of the previous and the current left image."""
        return self.camera.normalise(matches.prev_left), self.camera.normalise(matches.cur_left)

    def random(self) -> np.random.Generator:
        """Random generator of this frame, from the seed and the frame number."""
        return np.random.default_rng([self.config.seed, self._frame])

    @property
    def threshold(self) -> float:
        """Largest Sampson distance of an inlier, in the unit of normalised points."""
        return self.config.selection.threshold / self.camera.f


def row_noise(matches: StereoMatches) -> float:
    """Noise of the matches, pixels: standard deviation of the row differences between left and right images.

    Without noise, rows are equal. The deviation comes from the median, which a few wrong matches do not move.
    """
    before = matches.prev_left[:, 1] - matches.prev_right[:, 1]
    now = matches.cur_left[:, 1] - matches.cur_right[:, 1]
    return DEVIATION_OVER_MEDIAN * float(np.median(np.abs(np.concatenate([before, now]))))


def suspicion_limit(noise: float, stereo_limit: float) -> float:
    """Median error of a motion, pixels, above which it is compared with a fit.

    noise : `row_noise`, pixels; stereo_limit : the setting, pixels.
    """
    return max(min(stereo_limit, SUSPICION_OVER_NOISE * noise), LEAST_SUSPICION_PX)


def contradiction_limit(noise: float, stereo_limit: float) -> float:
    """Median error of a fit, pixels, above which the matches contradict each other; arguments as above."""
    limit = min(stereo_limit, CONTRADICTION_OVER_NOISE * noise)
    return max(limit, LEAST_CONTRADICTION_OVER_NOISE * noise, LEAST_CONTRADICTION_PX)
