"""Chapter 1: the front ends behind one interface.

`klt` is the default by measurement (`feature_selection`, TE in % / RE in deg/100 m). The share of right
matches (1 px in all four images) is the same, 92 % on `parked` and on `hard`. `blob_corner` is the better on
`parked`, 0.051 / 0.047 against 0.082 / 0.055, the worse on `hard`, 0.089 / 0.141 against 0.075 / 0.078. On
real images it is as good: 0.92 / 0.96 against 0.96 / 1.01 over 100 m of the first 201 frames of KITTI 00,
0.41 / 2.14 against 0.37 / 2.05 over 20 m of the highway 01. But it takes three times as long.
"""

from __future__ import annotations

from typing import Any, Protocol

from ..core.camera import StereoCamera
from ..core.matches import StereoMatches
from ..core.types import Image
from ..method import config as method
from ..method.matching import LoopMatcher as PublishedMatcher
from .blob_corner import BlobCornerMatcher
from .config import FeatureConfig, MatchingConfig
from .klt import LoopMatcher


class FrontEnd(Protocol):
    """Stereo pairs in, matches of four images out.

    `prepare` may run in other threads, ahead and in any order; `step` takes its results in order.
    """

    def prepare(self, pair: tuple[Image, Image]) -> Any:
        """What can be computed from a left and a right image, (H, W) uint8, without knowing the motion."""

    def step(self, pair: Any) -> StereoMatches:
        """Matches of the pair before with this one; empty for the first pair."""


def make_front_end(
    camera: StereoCamera, features: method.FeatureConfig, matching: method.MatchingConfig
) -> FrontEnd:
    """The front end that the settings name; the paper's where they are no more than the paper's."""
    if not isinstance(matching, MatchingConfig) or not isinstance(features, FeatureConfig):
        return PublishedMatcher(features, matching)
    kinds: dict[str, type[LoopMatcher] | type[BlobCornerMatcher]] = {
        "klt": LoopMatcher,
        "blob_corner": BlobCornerMatcher,
    }
    return kinds[matching.front_end](camera, features, matching)
