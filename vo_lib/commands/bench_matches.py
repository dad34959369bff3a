"""How good the matches are: those of a drawn scene against its truth, on vehicles and elsewhere."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass

import numpy as np

from ..config import Config
from ..core.matches import StereoMatches
from ..core.rows import Rows, joined
from ..core.types import Array, Mask
from ..data.sequence import Sequence
from ..data.truth import Truth, open_truth
from ..method.boxes import on_vehicles

FEATURE_FRAMES = 30  # frames whose matches are compared with the truth
RIGHT = 1.0  # pixels; a right match is no farther from the truth in any image
BESIDE = 2  # pixels; a corner on an outline lies this near to the surface that it belongs to


@dataclass(frozen=True)
class FeatureErrors:
    """Matches of a drawn scene against its truth, inside or outside vehicle boxes.

    Attributes
    ----------
    matches : how many were compared.
    known_share : share whose true place is known: not on the sky, and still in both images.
    flow_share : share of the known ones within RIGHT pixels of the true flow from left to left image.
    right_share : share of all within RIGHT pixels in all four images; none on the sky is.
    beside_share : the same where the true place of a point up to BESIDE pixels beside counts as well.
    median_error : pixels, of the current left position of the right ones.
    """

    matches: int
    known_share: float | None
    flow_share: float | None
    right_share: float | None
    beside_share: float | None
    median_error: float | None


def feature_errors(
    sequence: Sequence, matches: list[StereoMatches], config: Config
) -> dict[str, FeatureErrors] | None:
    """Matches of some frames, evenly spread, against the truth of a drawn scene; None for other sequences."""
    if not (sequence.folder / "truth").is_dir():
        return None
    truth = open_truth(sequence.folder)
    chosen = np.unique(np.linspace(1, len(sequence) - 1, min(FEATURE_FRAMES, len(sequence) - 1)).astype(int))
    inside, compared = [], []
    for i in chosen.tolist():
        before, now = int(sequence.frames[i - 1]), int(sequence.frames[i])
        m = matches[i]
        inside.append(on_vehicles(m, sequence.boxes(i - 1), sequence.boxes(i), config.filter))
        left, _, known = truth.predict(before, now, m.prev_left)
        right, beside = truth.is_right(m, now, RIGHT, before), _is_right_beside(truth, m, before, now)
        compared.append(_Compared(known, right, beside, np.linalg.norm(m.cur_left - left, axis=1)))
    everything, on_vehicle = joined(compared), np.concatenate(inside)
    parts = {"inside boxes": everything[on_vehicle], "outside boxes": everything[~on_vehicle]}
    return {name: part.summary() for name, part in parts.items()}


@dataclass(frozen=True)
class _Compared(Rows):
    """Of N matches whether each is known, right, right as one beside; and its error, pixels, left to left."""

    known: Mask
    right: Mask
    beside: Mask
    error: Array

    def summary(self) -> FeatureErrors:
        if not len(self):
            return FeatureErrors(0, None, None, None, None, None)
        shares = float(self.right.mean()), float(self.beside.mean())
        flow = float(np.mean(self.error[self.known] <= RIGHT)) if self.known.any() else None
        median = float(np.median(self.error[self.right])) if self.right.any() else None
        return FeatureErrors(len(self), float(self.known.mean()), flow, *shares, median)


def _is_right_beside(truth: Truth, m: StereoMatches, before: int, now: int) -> Mask:
    """Whether matches (N,) are right as their own point's or as one's up to BESIDE pixels beside."""
    found = np.zeros(len(m), np.bool_)
    for step in itertools.product(range(-BESIDE, BESIDE + 1), repeat=2):
        by = np.array(step, float)
        moved = dataclasses.replace(
            m,
            prev_left=m.prev_left + by,
            prev_right=m.prev_right + by,
            cur_left=m.cur_left + by,
            cur_right=m.cur_right + by,
        )
        found |= truth.is_right(moved, now, RIGHT, before)
    return found
