"""Chapter 5, beyond the paper: rules for the removal of features on vehicles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.boxes import Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches, empty_matches
from ..geometry.result import Flag
from ..geometry.types import BoolArray
from ..paper.boxes import on_vehicles
from .judgement import BoxMotionClassifier, Judgement
from .settings import KitFilterConfig


@dataclass(frozen=True)
class Filtered:
    """The effect of a box rule on the N matches of a frame.

    Attributes
    ----------
    keep : (N,) bool; flags : `FILTER_OFF` (boxes would have left too few: all stay).
    judgement : of the boxes by the rule `moving`; None with other rules.
    """

    keep: BoolArray
    flags: tuple[Flag, ...] = ()
    judgement: Judgement | None = None


def unless_too_few(keep: BoolArray, config: KitFilterConfig) -> Filtered:
    """The matches to keep; all of them, flagged, where fewer than `min_matches` would be left.

    A motion from vehicles is better than a motion from a handful of points. The share that is left does not
    count: where a vehicle holds most of the matches its features win the vote.
    """
    if not keep.all() and np.count_nonzero(keep) < config.min_matches:
        return Filtered(np.ones(len(keep), np.bool_), (Flag.FILTER_OFF,))
    return Filtered(keep)


class BoxFilter:
    """A box rule along a sequence: `start` with the first frame's boxes, then `step` by step."""

    def __init__(self, camera: StereoCamera, config: KitFilterConfig):
        self.config = config
        self._boxes = no_boxes()
        self._classifier = BoxMotionClassifier(camera, config) if config.rule == "moving" else None

    def start(self, boxes: Boxes) -> None:
        """The first frame: its boxes."""
        self._boxes = boxes
        if self._classifier is not None:
            self._classifier.step(empty_matches(), boxes)

    def step(self, matches: StereoMatches, boxes: Boxes, on_moving: BoolArray | None = None) -> Filtered:
        """The matches of the next frame that stay.

        Parameters
        ----------
        matches : of the frame before with this one; boxes : in this frame's left image.
        on_moving : (N,) matches on moving things, by the truth of a drawn scene; the rule `truth` needs it.
        """
        before, self._boxes = self._boxes, boxes
        if self._classifier is not None:
            judgement = self._classifier.step(matches, boxes)
            return replace(unless_too_few(~judgement.removed, self.config), judgement=judgement)
        if self.config.rule == "truth":
            assert on_moving is not None
            return unless_too_few(~on_moving, self.config)
        if self.config.rule == "none":
            return Filtered(np.ones(len(matches), np.bool_))
        return unless_too_few(~on_vehicles(matches, before, boxes, self.config), self.config)
