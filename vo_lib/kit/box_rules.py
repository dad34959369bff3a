"""Box rules of variant `kit`: the removal of features on vehicles (chapter 5, not in the paper)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches, empty_matches
from ..geometry.result import Flag
from ..geometry.types import BoolArray
from ..paper.box_removal import BoxFilter, Removal, vehicles
from .box_states import BoxMotionClassifier
from .settings import KitFilterConfig

# Function of a frame's number and M matches; returns a mask (M,) of the matches on moving objects.
OnMoving = Callable[[int, StereoMatches], BoolArray]


class KitBoxFilter(BoxFilter):
    """A box rule on a sequence: the paper's rules, and the rules `moving` and `truth`.

    A motion from vehicles is better than a motion from a handful of points: if fewer than `min_matches` would
    remain, all matches are kept, with the flag `filter_off`. The limit is not a share: if most matches are on
    a vehicle, a limit on the remaining share would keep the vehicle, which would win the vote.

    Parameters
    ----------
    camera : the stereo camera, for the rule `moving`.
    on_moving : the truth about moving objects, for the rule `truth`.

    Raises
    ------
    ValueError : the rule `truth` without `on_moving`.
    """

    config: KitFilterConfig

    def __init__(self, camera: StereoCamera, config: KitFilterConfig, on_moving: OnMoving | None = None):
        super().__init__(config)
        self._on_moving: OnMoving | None = None  # set for the rule `truth`
        self._classifier: BoxMotionClassifier | None = None  # set for the rule `moving`
        self._frame = 0  # number of the last frame, counted from the first one, 0
        if config.rule == "truth":
            if on_moving is None:
                raise ValueError("the rule truth needs the function on_moving")
            self._on_moving = on_moving
        if config.rule == "moving":
            self._classifier = BoxMotionClassifier(camera, config)

    def start(self, boxes: Boxes) -> None:
        """Store the boxes in the first frame's left image."""
        super().start(boxes)
        if self._classifier is not None:
            self._classifier.step(empty_matches(), boxes)

    def step(self, matches: StereoMatches, boxes: Boxes) -> Removal:
        """What the rule does to the matches between the previous frame and the frame with these boxes."""
        self._frame += 1
        removal = self._by_rule(matches, boxes, self._frame)
        remaining = int(np.count_nonzero(removal.kept))
        if remaining < len(matches) and remaining < self.config.min_matches:
            return replace(removal, kept=np.ones(len(matches), np.bool_), flags=(Flag.FILTER_OFF,))
        return removal

    def _by_rule(self, matches: StereoMatches, boxes: Boxes, frame: int) -> Removal:
        """What the rule does in a frame, by its number, however few matches remain."""
        if self._classifier is not None:
            return self._classifier.step(matches, boxes)
        if self._on_moving is not None:
            kept = ~self._on_moving(frame, matches)
            return Removal(kept, vehicles(boxes, self.config))
        return super().step(matches, boxes)
