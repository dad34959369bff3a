"""Box rules: the removal of features on vehicles (chapter 5, not in the paper)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.boxes import Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches, empty_matches
from ..geometry.result import Flag
from ..geometry.types import BoolArray
from ..paper.box_removal import on_vehicles
from .box_states import BoxMotionClassifier, BoxStates
from .settings import KitFilterConfig


@dataclass(frozen=True)
class Filtered:
    """The effect of a box rule on the N matches of a frame.

    Attributes
    ----------
    keep : (N,) mask; flags : `FILTER_OFF` if all matches are kept because too few would remain.
    judgement : states of the boxes for the rule `moving`; None for other rules.
    """

    keep: BoolArray
    flags: tuple[Flag, ...] = ()
    judgement: BoxStates | None = None


def keep_all_if_too_few(keep: BoolArray, config: KitFilterConfig) -> Filtered:
    """The matches to keep, or all matches and a flag if fewer than `min_matches` would remain.

    A motion from vehicles is better than a motion from a handful of points. The limit is not a share: if most
    matches are on a vehicle, a limit on the remaining share would keep the vehicle, which would win the vote.
    """
    if not keep.all() and np.count_nonzero(keep) < config.min_matches:
        return Filtered(np.ones(len(keep), np.bool_), (Flag.FILTER_OFF,))
    return Filtered(keep)


class BoxFilter:
    """A box rule on a sequence: `start` for the first frame, then `step` for each further frame."""

    def __init__(self, camera: StereoCamera, config: KitFilterConfig):
        self.config = config
        self._boxes = no_boxes()
        self._classifier = BoxMotionClassifier(camera, config) if config.rule == "moving" else None

    def start(self, boxes: Boxes) -> None:
        """Store the boxes of the first frame."""
        self._boxes = boxes
        if self._classifier is not None:
            self._classifier.step(empty_matches(), boxes)

    def step(self, matches: StereoMatches, boxes: Boxes, on_moving: BoolArray | None = None) -> Filtered:
        """The effect of the rule on the next frame.

        Parameters
        ----------
        matches : matches between the previous and this frame; boxes : boxes in this frame's left image.
        on_moving : (N,) mask of matches on moving objects, from a drawn scene's truth, for the rule `truth`.
        """
        previous_boxes, self._boxes = self._boxes, boxes
        if self._classifier is not None:
            judgement = self._classifier.step(matches, boxes)
            return replace(keep_all_if_too_few(~judgement.removed, self.config), judgement=judgement)
        if self.config.rule == "truth":
            assert on_moving is not None
            return keep_all_if_too_few(~on_moving, self.config)
        if self.config.rule == "none":
            return Filtered(np.ones(len(matches), np.bool_))
        return keep_all_if_too_few(~on_vehicles(matches, previous_boxes, boxes, self.config), self.config)
