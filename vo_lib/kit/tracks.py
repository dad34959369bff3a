"""Chapter 5, beyond the paper: boxes followed from frame to frame, and which of them move."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from ..geometry.boxes import MOVING, PARKED, UNKNOWN, Boxes, overlap
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.rows import Rows, joined
from ..geometry.types import Array, BoolArray, IntArray
from ..paper.boxes import inside, vehicles
from .moving import (
    BoxSteps,
    background_motion,
    box_steps,
    no_steps,
    owner_of,
    point_steps,
)
from .settings import KitFilterConfig, MovingConfig

MIN_CAMERA_FEATURES = 12  # features outside boxes from which a motion of the camera can be told
MIN_TRACK_OVERLAP = 0.3  # a box is known again above this overlap (IoU) with its place expected
EVIDENCE_DECAY = 0.7  # share of a track's evidence that is kept when new evidence arrives


@dataclass(frozen=True, eq=False)
class Tracks(Rows):
    """M boxes followed, as of one frame.

    Attributes
    ----------
    xyxy : (M, 4) box, pixels.
    information, vector : (M, 3, 3), (M, 3) all evidence of the vehicle's step a frame, in information form,
        in the axes of this frame's left camera: step = information⁻¹ vector, metres.
    state : (M,) PARKED, UNKNOWN or MOVING.
    """

    xyxy: Array
    information: Array
    vector: Array
    state: IntArray


def new_tracks(xyxy: Array) -> Tracks:
    """Tracks that begin with boxes (M, 4), of which nothing is known."""
    m = len(xyxy)
    return Tracks(xyxy, np.zeros((m, 3, 3)), np.zeros((m, 3)), np.full(m, UNKNOWN))


def pair_up(iou: Array) -> IntArray:
    """Row for each column (K,) by descending overlap, each row once; -1 where no overlap enough is left."""
    row_of = np.full(iou.shape[1], -1)
    left = iou.copy()
    while left.size and left.max() >= MIN_TRACK_OVERLAP:
        row, column = np.unravel_index(np.argmax(left), left.shape)
        row_of[column] = row
        left[row], left[:, column] = -1.0, -1.0
    return row_of


def with_evidence(tracks: Tracks, fresh: BoxSteps, R_cp: Array, config: MovingConfig) -> Tracks:
    """Tracks of the frame before, with the steps of their boxes into this one.

    Evidence fades by `EVIDENCE_DECAY` when new evidence arrives, and waits while there is none. A box moves
    when its step is significantly not zero; it is parked when a step of `min_step` would have been seen.
    """
    observed = fresh.information.any(axis=(1, 2))
    keep = np.where(observed, EVIDENCE_DECAY, 1.0)
    information = keep[:, None, None] * (R_cp @ tracks.information @ R_cp.T) + fresh.information
    vector = keep[:, None] * (tracks.vector @ R_cp.T) + np.einsum("kij,kj->ki", fresh.information, fresh.step)
    state = tracks.state.copy()
    determined = information.any(axis=(1, 2))
    spread = np.linalg.inv(information[determined])
    step = np.einsum("kij,kj->ki", spread, vector[determined])
    deviations = np.sqrt(np.maximum(np.einsum("ki,ki->k", step, vector[determined]), 0.0))
    moves = (deviations > config.significance) & (np.linalg.norm(step, axis=1) > config.min_step)
    certain = np.sqrt(np.linalg.eigvalsh(spread)[:, -1]) < config.min_step
    # Half the significance keeps a box moving; with less it is as unknown as it was at first.
    former = np.where(
        deviations > config.significance / 2, state[determined], np.minimum(state[determined], UNKNOWN)
    )
    state[determined] = np.where(moves, MOVING, np.where(certain, PARKED, former))
    return dataclasses.replace(tracks, information=information, vector=vector, state=state)


@dataclass(frozen=True)
class Judgement:
    """The K vehicle boxes of a frame, judged.

    Attributes
    ----------
    boxes : the vehicle boxes, grown by the margin.
    state : (K,) PARKED, UNKNOWN or MOVING.
    step : (K, 3) step from this pair of frames, current left camera's axes, metres; NaN where not seen.
    matches : (K,) features of this frame that may lie on the vehicle.
    removed : (N,) matches whose left point, previous or current, lies in a box that moves; of those in other
        boxes the ones that do not agree with the background: where a box is, outlines, panes and other cars
        behind it are near, and features there are worse than elsewhere.
    """

    boxes: Boxes
    state: IntArray
    step: Array
    matches: IntArray
    removed: BoolArray


class BoxMotionClassifier:
    """Judges the boxes of every frame; to the first one `step` is told no matches."""

    def __init__(self, camera: StereoCamera, config: KitFilterConfig):
        self.camera = camera
        self.config = config
        self._tracks = new_tracks(np.zeros((0, 4)))
        self._motion: Array | None = None

    def step(self, matches: StereoMatches, boxes: Boxes) -> Judgement:
        """Judge the boxes of the next frame's left image by its matches with the frame before."""
        old, current = self._tracks, vehicles(boxes, self.config)
        in_before, in_current = inside(matches.prev_left, old.xyxy), inside(matches.cur_left, current.xyxy)
        outside = np.asarray(~in_before.any(axis=1) & ~in_current.any(axis=1))
        self._find_motion(matches[outside])
        fresh, disagrees = self._ask(matches, current, outside)
        # Each box is expected where its features go on average.
        member = in_before.T.astype(np.float64)
        flow = member @ (matches.cur_left - matches.prev_left) / np.maximum(member.sum(axis=1), 1.0)[:, None]
        row_of = pair_up(overlap(old.xyxy + np.tile(flow, 2), current.xyxy))
        matched = row_of >= 0
        index = np.where(matched, row_of, len(old) + np.arange(len(current)))
        followed = joined([old, new_tracks(current.xyxy)])[index]
        tracks = dataclasses.replace(followed, xyxy=current.xyxy)
        R_cp = np.eye(3) if self._motion is None else self._motion[:3, :3]
        self._tracks = with_evidence(tracks, fresh, R_cp, self.config.moving)
        state, state_before = self._tracks.state, old.state.copy()
        state_before[row_of[matched]] = state[matched]
        in_moved = in_before[:, state_before == MOVING].any(axis=1)
        removed = in_current[:, state == MOVING].any(axis=1) | in_moved | disagrees
        step = np.where(fresh.information.any(axis=1), fresh.step, np.nan)
        return Judgement(current, state, step, fresh.matches, removed)

    def _ask(self, matches: StereoMatches, current: Boxes, outside: BoolArray) -> tuple[BoxSteps, BoolArray]:
        """Steps of the boxes found, and which matches (N,) in boxes do not agree with standing still."""
        disagrees = np.zeros(len(matches), np.bool_)
        if self._motion is None:
            return no_steps(len(current)), disagrees
        config = self.config.moving
        some = matches[np.asarray(~outside)]
        owner = owner_of(self.camera, some.cur_left, some.cur_right, current)
        points = point_steps(self.camera, some, self._motion)
        # What is not a number does not agree.
        limit = (config.agreement * config.noise) ** 2
        disagrees[~outside] = ~(points.squared_error(np.zeros(3)) <= limit)
        return box_steps(points, owner, len(current), config.noise**2), disagrees

    def _find_motion(self, background: StereoMatches) -> None:
        """Motion of the camera from the features outside boxes; None where they are too few to tell it."""
        if len(background) < MIN_CAMERA_FEATURES:
            self._motion = None
        else:
            start, steps = (np.eye(4), 10) if self._motion is None else (self._motion, 3)
            self._motion = background_motion(self.camera, background, start, steps)
