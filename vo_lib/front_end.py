"""Chapter 1: the front ends behind one interface."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import NDArray

from .blob_corner import BlobCornerMatcher
from .camera import StereoCamera
from .config import FeatureConfig, MatchingConfig
from .kitti import Image
from .matching import LoopMatcher, StereoMatches


class FrontEnd(Protocol):
    """Stereo pairs in, matches of four images out.

    `prepare` may run in other threads, ahead and in any order; `step` takes its results in order.
    """

    def prepare(self, pair: tuple[Image, Image]) -> Any:
        """What can be computed from a left and a right image, (H, W) uint8, without knowing the motion."""

    def step(self, pair: Any) -> StereoMatches:
        """Matches of the pair before with this one; empty for the first pair."""

    def state(self) -> dict[str, NDArray[Any]]:
        """What the pairs so far left behind, as plain arrays, without the images; empty before the first."""

    def restore(self, state: dict[str, NDArray[Any]], previous: Any) -> None:
        """Go on as the front end whose `state` this was; `previous` is its last prepared pair."""


def make_front_end(camera: StereoCamera, features: FeatureConfig, matching: MatchingConfig) -> FrontEnd:
    """The front end that the settings name."""
    kinds: dict[str, type[LoopMatcher] | type[BlobCornerMatcher]] = {
        "klt": LoopMatcher,
        "blob_corner": BlobCornerMatcher,
    }
    return kinds[matching.front_end](camera, features, matching)
