"""Chapter 5: which matches stay when features on vehicles are removed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.boxes import Boxes, no_boxes
from ..core.camera import StereoCamera
from ..core.matches import StereoMatches, empty_matches
from ..core.types import Mask
from ..method.boxes import on_vehicles
from .box_tracks import BoxMotionClassifier, Judgement
from .config import FilterConfig

Flags = tuple[str, ...]


def static_matches(
    matches: StereoMatches, boxes_p: Boxes, boxes_c: Boxes, config: FilterConfig
) -> tuple[Mask, Flags]:
    """Matches to keep by the rules `none` and `all`, (N,) bool, and flags, see `Filtered`.

    A match goes when its left point, previous or current, lies in a box (section 3; that both count is ours).
    """
    if config.rule == "none":
        return np.ones(len(matches), np.bool_), ()
    return unless_too_few(~on_vehicles(matches, boxes_p, boxes_c, config), config)


def unless_too_few(keep: Mask, config: FilterConfig) -> tuple[Mask, Flags]:
    """The matches to keep; all, and `filter_off`, where too few would be left.

    A motion from vehicles is better than a motion from a handful of points.
    """
    left, number = int(np.count_nonzero(keep)), len(keep)
    too_few = left < number and (left < config.min_matches or left < config.min_share * number)
    return (np.ones(number, np.bool_), ("filter_off",)) if too_few else (keep, ())


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
    flags: Flags = ()
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
            self._classifier.step(empty_matches(), boxes)

    def step(self, matches: StereoMatches, boxes: Boxes, on_moving: Mask | None = None) -> Filtered:
        """Which matches of the next frame stay.

        Parameters
        ----------
        matches : of the frame before with this one; boxes : in this frame's left image.
        on_moving : (N,) matches known to be on moving things; the rule `truth` needs it.
        """
        before, self._boxes = self._boxes, boxes
        if self._classifier is not None:
            judgement = self._classifier.step(matches, boxes)
            keep, flags = unless_too_few(~judgement.removed, self.config)
            return Filtered(keep, flags + ("few_background",) * judgement.few_background, judgement)
        if self.config.rule == "truth":
            assert on_moving is not None
            return Filtered(*unless_too_few(~on_moving, self.config))
        return Filtered(*static_matches(matches, before, boxes, self.config))
