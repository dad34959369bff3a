"""Chapter 1: the paper's front end and the kit's behind one interface."""

from __future__ import annotations

from typing import Any, Protocol

from ..core.camera import StereoCamera
from ..core.matches import StereoMatches
from ..core.types import Image
from ..method import config as method
from ..method.matching import LoopMatcher as PublishedMatcher
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
    """The kit's front end for the kit's settings, the paper's for the paper's."""
    if isinstance(matching, MatchingConfig) and isinstance(features, FeatureConfig):
        return LoopMatcher(camera, features, matching)
    return PublishedMatcher(features, matching)
