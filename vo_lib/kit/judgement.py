"""Chapter 5, beyond the paper: which boxes of a frame move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.boxes import MOVING, PARKED, UNKNOWN, Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
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


def states(steps: BoxSteps, config: MovingConfig) -> IntArray:
    """PARKED, UNKNOWN or MOVING of each box, (K,).

    A box moves when its step is significantly not zero; it is parked when a step of `min_step` would have
    been seen.
    """
    state, seen = np.full(len(steps), UNKNOWN), steps.information.any(axis=(1, 2))
    step, information = steps.step[seen], steps.information[seen]
    deviations = np.sqrt(np.einsum("ki,kij,kj->k", step, information, step))
    moves = (deviations > config.significance) & (np.linalg.norm(step, axis=1) > config.min_step)
    certain = 1.0 / np.sqrt(np.linalg.eigvalsh(information)[:, 0]) < config.min_step
    state[seen] = np.where(moves, MOVING, np.where(certain, PARKED, UNKNOWN))
    return state


class BoxMotionClassifier:
    """Judges the boxes of every frame; to the first one `step` is told no matches."""

    def __init__(self, camera: StereoCamera, config: KitFilterConfig):
        self.camera = camera
        self.config = config
        self._boxes, self._moved = no_boxes(), np.zeros(0, np.bool_)  # of the frame before
        self._motion: Array | None = None

    def step(self, matches: StereoMatches, boxes: Boxes) -> Judgement:
        """Judge the boxes of the next frame's left image by its matches with the frame before."""
        current = vehicles(boxes, self.config)
        in_before = inside(matches.prev_left, self._boxes.xyxy)
        in_current = inside(matches.cur_left, current.xyxy)
        outside = np.asarray(~in_before.any(axis=1) & ~in_current.any(axis=1))
        self._find_motion(matches[outside])
        steps, disagrees = self._ask(matches, current, outside)
        state = states(steps, self.config.moving)
        moves = state == MOVING
        removed = in_current[:, moves].any(axis=1) | in_before[:, self._moved].any(axis=1) | disagrees
        self._boxes, self._moved = current, moves
        step = np.where(steps.information.any(axis=1), steps.step, np.nan)
        return Judgement(current, state, step, steps.matches, removed)

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
