"""Classification of the boxes of a frame as moving, parked or unknown (chapter 5, not in the paper)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.boxes import MOVING, PARKED, UNKNOWN, Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray, IntArray
from ..paper.box_removal import Removal, inside, vehicles
from .moving import BoxSteps, background_motion, box_steps, no_steps, owner_of, point_steps
from .settings import KitFilterConfig, MovingConfig

MIN_CAMERA_FEATURES = 12  # smallest number of features outside boxes for an estimate of the camera's motion
# Iterations of this estimate, from no motion and from the motion of the previous frame.
ITERATIONS_FROM_REST = 10
ITERATIONS_FROM_PREVIOUS = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxStates(Removal):
    """The states of the K vehicle boxes of a frame, and the removal that follows from them.

    Removed are matches with a previous or current left point in a moving box and, in other boxes, matches
    that do not agree with the background within `MovingConfig.agreement`, for example on outlines, windows or
    other cars.

    Attributes
    ----------
    state : (K,) PARKED, UNKNOWN or MOVING.
    step : (K, 3) displacement in this frame, metres, in the current left camera's axes; NaN if unknown.
    matches : (K,) number of features that may be on the vehicle.
    """

    state: IntArray
    step: Array
    matches: IntArray


def states(steps: BoxSteps, config: MovingConfig) -> IntArray:
    """State of each box (K,): PARKED, UNKNOWN or MOVING.

    A box is moving if its displacement is significant and longer than `min_step`. Any other box is parked if
    the standard deviation of its displacement is below `min_step` in every direction.
    """
    measured = steps.information.any(axis=(1, 2))
    step = steps.step[measured]
    information = steps.information[measured]
    # How many standard deviations the displacement is from zero, and the largest of its standard deviations.
    significance = np.sqrt(np.einsum("ki,kij,kj->k", step, information, step))
    uncertainty = 1.0 / np.sqrt(np.linalg.eigvalsh(information)[:, 0])
    moves = (significance > config.significance) & (np.linalg.norm(step, axis=1) > config.min_step)
    state_of_measured = np.where(uncertainty < config.min_step, PARKED, UNKNOWN)
    state_of_measured[moves] = MOVING
    state = np.full(len(steps), UNKNOWN)
    state[measured] = state_of_measured
    return state


class BoxMotionClassifier:
    """The states of boxes frame by frame; for the first frame, call `step` with empty matches."""

    def __init__(self, camera: StereoCamera, config: KitFilterConfig):
        self.camera = camera
        self.config = config
        self._previous_boxes = no_boxes()
        self._previous_moves: BoolArray = np.zeros(0, np.bool_)  # which of these boxes were moving
        self._previous_motion: Array | None = None  # the camera's T_cp (4, 4) in the previous frame

    def step(self, matches: StereoMatches, boxes: Boxes) -> BoxStates:
        """The states of the boxes in the next frame's left image, from matches with the previous frame."""
        current = vehicles(boxes, self.config)
        in_previous = inside(matches.prev_left, self._previous_boxes.xyxy)
        in_current = inside(matches.cur_left, current.xyxy)
        outside = np.asarray(~in_previous.any(axis=1) & ~in_current.any(axis=1))
        motion = self._camera_motion(matches[outside])
        steps = no_steps(len(current))
        disagrees = np.zeros(len(matches), np.bool_)
        if motion is not None:
            steps, disagrees_in_boxes = self._measure_steps(matches[~outside], current, motion)
            disagrees[~outside] = disagrees_in_boxes
        state = states(steps, self.config.moving)
        moves = state == MOVING
        was_in_moving = in_previous[:, self._previous_moves].any(axis=1)
        is_in_moving = in_current[:, moves].any(axis=1)
        removed = is_in_moving | was_in_moving | disagrees
        self._previous_boxes = current
        self._previous_moves = moves
        self._previous_motion = motion
        is_measured = np.asarray(steps.information.any(axis=(1, 2)))
        step = np.where(is_measured[:, None], steps.step, np.nan)
        return BoxStates(~removed, current, state=state, step=step, matches=steps.matches)

    def _measure_steps(
        self, in_boxes: StereoMatches, current: Boxes, motion: Array
    ) -> tuple[BoxSteps, BoolArray]:
        """Displacements of the boxes, and a mask of the matches that do not agree with the background.

        in_boxes : the matches in previous or current boxes; motion : the camera's T_cp (4, 4).
        """
        config = self.config.moving
        owner = owner_of(self.camera, in_boxes.cur_left, in_boxes.cur_right, current)
        points = point_steps(self.camera, in_boxes, motion)
        variance = config.noise**2
        # Stricter than AGREES_CHI2 in `box_steps`: here a match is removed if it is doubtful, there it counts
        # as moved only if it clearly disagrees. NaN fails the comparison and counts as disagreement.
        limit = (config.agreement * config.noise) ** 2
        disagrees = np.asarray(~(points.squared_error(np.zeros(3)) <= limit))
        moving_mean = "moving-mean" not in config.without
        return box_steps(points, owner, len(current), variance, moving_mean), disagrees

    def _camera_motion(self, background: StereoMatches) -> Array | None:
        """The camera's motion T_cp (4, 4) from features outside boxes; None with too few features."""
        if len(background) < MIN_CAMERA_FEATURES:
            return None
        if self._previous_motion is None:
            return background_motion(self.camera, background, np.eye(4), ITERATIONS_FROM_REST)
        return background_motion(self.camera, background, self._previous_motion, ITERATIONS_FROM_PREVIOUS)
