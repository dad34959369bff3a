"""Chapter 1: blobs and corners (`vo_lib.method.features`) matched in a loop, with the kit's finish.

A match goes left current → left previous → right previous → right current → left current, and has to end
at the feature it started from.
Source: Geiger, Ziegler and Stiller, "StereoScan: dense 3d reconstruction in real-time", IV 2011, section III.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.camera import StereoCamera
from ..core.matches import StereoMatches, empty_matches
from ..core.types import Array, Image, Index
from ..method import matching
from ..method.features import best_matches
from .config import FeatureConfig, MatchingConfig
from .klt import RigidMotion, next_motion
from .subpixel import refine_over_time, refine_stereo
from .surface import CoarseDisparity, coarse_disparity

# Search radius round a predicted place, pixels.
NEAR = 20


@dataclass(frozen=True)
class DescribedPair(matching.DescribedPair):
    """A stereo pair with its features, found ahead and in other threads, and its coarse disparity."""

    disparity: CoarseDisparity

    @property
    def images(self) -> tuple[Image, Image]:
        """Left and right image."""
        return self.left, self.right

    @property
    def partner(self) -> Index:
        """The right feature (N,) that is a left one's stereo match, each the other's best; -1: none."""
        mutual = self.to_right >= 0
        mutual[mutual] = self.to_left[self.to_right[mutual]] == np.flatnonzero(mutual)
        return np.where(mutual, self.to_right, -1)


class BlobCornerMatcher:
    """Blobs and corners matched round the loop; the interface is `FrontEnd`.

    Search starts where the last motion and the stereo depth predict each feature (constant velocity); the
    finish is that of the other front end. A feature found again keeps its number and its sub-pixel place.
    """

    def __init__(self, camera: StereoCamera, features: FeatureConfig, settings: MatchingConfig):
        self.camera = camera
        self.features = features
        self.config = settings
        self._previous: tuple[DescribedPair, dict[str, NDArray[Any]]] | None = None
        self._motion: RigidMotion | None = None
        self._next_id = 0

    def prepare(self, pair: tuple[Image, Image]) -> DescribedPair:
        """Features and coarse disparity of a stereo pair."""
        disparity = coarse_disparity(*pair, self.config.max_disparity)
        return describe_pair(pair, disparity, self.features, self.config)

    def step(self, pair: DescribedPair) -> StereoMatches:
        """Matches of the pair before with this one; empty for the first pair."""
        place = _stereo_places(pair, self.config)
        matches, slope, index = empty_matches(), np.zeros((0, 2)), np.zeros(0, np.intp)
        if self._previous is not None:
            matches, slope, index = self._match(pair, place)
        self._motion, _ = next_motion(self.camera, matches, self._motion)
        place["age"][index] = matches.age + 1
        place["id"][index] = matches.id
        for name, values in (("left", matches.cur_left), ("right", matches.cur_right), ("slope", slope)):
            place[name][index] = values
        new = place["id"] < 0
        place["id"][new] = self._next_id + np.arange(np.count_nonzero(new))
        self._next_id += int(np.count_nonzero(new))
        self._previous = (pair, place)
        return matches

    def _match(
        self, pair: DescribedPair, place: dict[str, NDArray[Any]]
    ) -> tuple[StereoMatches, Array, Index]:
        assert self._previous is not None
        before, seen = self._previous
        found = self._loop(before, pair, seen, place, self._motion)
        if self._motion is not None and len(found[0]) < 0.3 * np.count_nonzero(seen["stereo"]):
            again = self._loop(before, pair, seen, place, None)
            found = max(found, again, key=lambda each: len(each[0]))
        return found

    def _loop(
        self,
        before: DescribedPair,
        pair: DescribedPair,
        seen: dict[str, NDArray[Any]],
        place: dict[str, NDArray[Any]],
        motion: RigidMotion | None,
    ) -> tuple[StereoMatches, Array, Index]:
        """Matches, slopes of their surfaces, and their index among the current left features."""
        R, t = motion or (np.eye(3), np.zeros(3))
        reach = self.config.search_radius if motion is None else NEAR
        source = np.flatnonzero(seen["stereo"])
        left, right = seen["left"][source], seen["right"][source]
        guess_left, guess_right = left, right
        if motion is not None:
            guess_left, guess_right = self.camera.project(self.camera.triangulate(left, right) @ R.T + t)
        in_left = best_matches(before.in_left[source], pair.in_left, guess_left, (reach, reach))
        right_index = seen["match"][source]
        in_right = best_matches(before.in_right[right_index], pair.in_right, guess_right, (reach, reach))
        # The loop closes: what was found left from left and right from right is a stereo match.
        ok = (in_left >= 0) & (in_right >= 0)
        ok[ok] = place["stereo"][in_left[ok]] & (place["match"][in_left[ok]] == in_right[ok])
        # Where two come to one feature, the older one keeps it.
        order = np.lexsort((-seen["strength"][source], -seen["age"][source]))
        first = np.zeros(len(source), np.bool_)
        first[order[np.unique(np.where(ok, in_left, -1)[order], return_index=True)[1]]] = True
        ok &= first
        return self._finish(before, pair, seen, source[ok], in_left[ok], in_right[ok], (R, t))

    def _finish(
        self,
        before: DescribedPair,
        pair: DescribedPair,
        seen: dict[str, NDArray[Any]],
        source: Index,
        in_left: Index,
        in_right: Index,
        motion: RigidMotion,
    ) -> tuple[StereoMatches, Array, Index]:
        left, right, slope = (seen[name][source] for name in ("left", "right", "slope"))
        coarse = pair.in_left.uv[in_left], pair.in_right.uv[in_right]
        cur_left, over_time, ok = refine_over_time(
            self.camera, before.images, pair.images, (left, right), slope, coarse, motion, self.config
        )
        cur_right, cur_slope, good = refine_stereo(
            pair.images, pair.disparity, cur_left, over_time, self.config
        )
        ok &= good & (np.linalg.norm(cur_right - over_time, axis=1) <= self.config.loop_tolerance)
        for uv in (cur_left, cur_right):
            ok &= np.all((uv >= 0) & (uv <= (pair.left.shape[1] - 1, pair.left.shape[0] - 1)), axis=1)
        age, strength, number = (seen[name][source][ok] for name in ("age", "strength", "id"))
        matches = StereoMatches(left[ok], right[ok], cur_left[ok], cur_right[ok], age, strength, number)
        return matches, cur_slope[ok], in_left[ok]


def describe_pair(
    pair: tuple[Image, Image], disparity: CoarseDisparity, features: FeatureConfig, settings: MatchingConfig
) -> DescribedPair:
    """Features of a stereo pair, and which left and right ones look most alike."""
    return DescribedPair(**vars(matching.describe_pair(pair, features, settings)), disparity=disparity)


def _stereo_places(pair: DescribedPair, config: MatchingConfig) -> dict[str, NDArray[Any]]:
    """The left features with their stereo matches and the sub-pixel places of these."""
    left, right = pair.in_left, pair.in_right
    partner = pair.partner
    index = np.flatnonzero(partner >= 0)
    place, start = left.uv[index], right.uv[partner[index]]
    found, slope, good = refine_stereo(pair.images, pair.disparity, place, start, config)
    good &= found[:, 0] >= 0
    number = len(left.kind)
    stereo = np.zeros(number, np.bool_)
    stereo[index[good]] = True
    places = {"left": left.uv.copy(), "right": np.full((number, 2), np.nan), "slope": np.zeros((number, 2))}
    places["right"][index], places["slope"][index] = found, slope
    return {
        **places,
        "match": partner,
        "stereo": stereo,
        "age": np.ones(number, np.int64),
        "strength": left.strength,
        "id": np.full(number, -1, np.int64),
    }
