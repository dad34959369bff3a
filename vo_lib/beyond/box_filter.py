"""Chapter 5: which matches stay when features on vehicles are removed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.boxes import Boxes, no_boxes
from ..core.camera import StereoCamera
from ..core.matches import StereoMatches
from ..core.types import Mask
from ..method.boxes import inside, on_vehicles
from .box_tracks import MOVING, UNKNOWN, BoxMotionClassifier, Judgement
from .config import FilterConfig


def static_matches(
    matches: StereoMatches, boxes_p: Boxes, boxes_c: Boxes, config: FilterConfig
) -> tuple[Mask, bool]:
    """Matches to keep by the rules `none` and `all`, (N,) bool, and whether the filter had to be off.

    A match goes when its left point, previous or current, lies in a box (section 3; that both count is ours).
    """
    if config.rule == "none":
        return np.ones(len(matches), np.bool_), False
    return unless_too_few(~on_vehicles(matches, boxes_p, boxes_c, config), config)


def unless_too_few(keep: Mask, config: FilterConfig) -> tuple[Mask, bool]:
    """The matches to keep, or all and True where too few would be left.

    A motion from vehicles is better than a motion from a handful of points.
    """
    left, number = int(np.count_nonzero(keep)), len(keep)
    too_few = left < number and (left < config.min_matches or left < config.min_share * number)
    return (np.ones(number, np.bool_), True) if too_few else (keep, False)


@dataclass(frozen=True)
class Filtered:
    """What a rule leaves of the N matches of a frame.

    Attributes
    ----------
    keep : (N,) bool.
    flags : `filter_off` (too few would be left: all stay), `few_background` (too little outside the boxes to
        judge them by).
    judgement : of the boxes by the rule `moving`; None with other rules.
    """

    keep: Mask
    flags: tuple[str, ...] = ()
    judgement: Judgement | None = None


class BoxFilter:
    """A box rule along a sequence: `start` with the first frame's boxes, then `step` by step."""

    def __init__(self, camera: StereoCamera, config: FilterConfig):
        self.config = config
        self._boxes = no_boxes()
        self._classifier = BoxMotionClassifier(camera, config) if config.rule == "moving" else None

    def start(self, boxes: Boxes) -> None:
        """The first frame: its boxes."""
        self._boxes = boxes
        if self._classifier is not None:
            self._classifier.start(boxes)

    def step(self, matches: StereoMatches, boxes: Boxes, on_moving: Mask | None = None) -> Filtered:
        """Which matches of the next frame stay.

        Parameters
        ----------
        matches : of the frame before with this one; boxes : in this frame's left image.
        on_moving : (N,) matches known to be on moving things, for the rule `truth`.
        """
        before, self._boxes = self._boxes, boxes
        flags, judgement = [], None
        if self.config.rule == "truth":
            if on_moving is None:
                raise ValueError("the rule `truth` needs to be told which matches are on moving things")
            keep, off = unless_too_few(~on_moving, self.config)
        elif self._classifier is not None:
            judgement = self._classifier.step(matches, boxes)
            keep, off = unless_too_few(~on_vehicles_that_move(matches, judgement, self.config), self.config)
            flags += ["few_background"] if judgement.few_background else []
        else:
            keep, off = static_matches(matches, before, boxes, self.config)
        return Filtered(keep, (*(("filter_off",) if off else ()), *flags), judgement)


def on_vehicles_that_move(matches: StereoMatches, judgement: Judgement, config: FilterConfig) -> Mask:
    """Matches (N,) whose left point, previous or current, lies in a box that moves.

    Of the other boxes those go that do not agree with the background: where a box is, outlines, panes and
    other cars behind it are near, and features there are worse than elsewhere.
    """
    least = MOVING if config.moving.unknown == "keep" else UNKNOWN
    now, before = inside(matches.cur_left, judgement.boxes.xyxy), inside(matches.prev_left, judgement.before)
    moving = now[:, judgement.state >= least].any(axis=1)
    moving |= before[:, judgement.state_before >= least].any(axis=1)
    boxed = now.any(axis=1) | before.any(axis=1)
    return np.asarray(moving | (boxed & ~judgement.agrees))
