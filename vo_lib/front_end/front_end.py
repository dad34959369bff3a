"""Chapter 1: the front ends behind one interface.

`klt` is the default: its matches are as good as those of `blob_corner`, and it takes a third of the time.
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
