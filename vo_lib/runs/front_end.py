"""Matches of every frame of a sequence with the previous frame, by the front end of a variant."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields
from typing import Any, Protocol, TypeVar

from ..data.sequence import Sequence
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.result import Clock
from ..geometry.types import Image
from ..kit.settings import KitConfig
from ..paper.matching import LoopMatcher
from ..paper.settings import FeatureConfig, MatchingConfig, MethodConfig, PublishedConfig, StereoLimits

# Matches of a frame with the previous frame, and the milliseconds spent in each stage.
TimedMatches = tuple[StereoMatches, dict[str, float]]
Prepared = TypeVar("Prepared")  # what a front end makes of a single stereo pair
# For `exchanged_cameras`. On sequences with exchanged cameras we saw 400 or more matches with the images
# exchanged back, and at most an eighth as many with the images as given. Both limits leave a margin to these
# numbers.
MIN_EXCHANGED_MATCHES = 50
EXCHANGED_RATIO = 4


class FrontEnd(Protocol):
    """The first half of a method: from stereo pairs to matches in four images.

    `prepare` may run in other threads, in advance and in any order; `step` gets the results in order. What
    is handed from one to the other is the front end's own affair.
    """

    def prepare(self, pair: tuple[Image, Image]) -> Any:
        """The result of the work that needs only a single pair: left and right image, (H, W) uint8."""

    def step(self, pair: Any) -> StereoMatches:
        """Matches of the previous pair with this one, both from `prepare`; empty for the first pair."""


def make_front_end(camera: StereoCamera, config: MethodConfig) -> FrontEnd:
    """The front end of the configuration's variant; TypeError for settings of no variant."""
    if isinstance(config, PublishedConfig):
        return LoopMatcher(config.features, config.matching)
    if not isinstance(config, KitConfig):
        raise TypeError(f"no variant has the settings {type(config).__name__}")
    if "tracking" in config.matching.without:  # the parts of the kit's front end that are turned off
        return _papers_matcher(config)
    from ..kit.klt import KltMatcher

    return KltMatcher(camera, config.features, config.matching)


def _papers_matcher(config: MethodConfig) -> LoopMatcher:
    """The paper's matcher with the settings that both variants declare, and defaults for the rest.

    Both declare the border of the images, where there are no features, and the limits of stereo matches.
    """
    common_limits = {limit.name: getattr(config.matching, limit.name) for limit in fields(StereoLimits)}
    return LoopMatcher(FeatureConfig(border=config.features.border), MatchingConfig(**common_limits))


def find_matches(sequence: Sequence, config: MethodConfig) -> Iterator[TimedMatches]:
    """Matches of every frame with the previous frame, computed from the images; empty for the first frame.

    Raises
    ------
    DataError : an image is invalid, or frames are missing between the frames of the sequence.
    """
    sequence.require_unbroken()
    front_end = make_front_end(sequence.camera, config)
    # `prepare` runs in other threads. For `step`, a thread would gain little: like the odometry, it holds
    # Python's lock half of the time.
    clock = Clock()
    for prepared in stereo_ahead(sequence, front_end.prepare):
        clock.stage("wait_images")
        matches = front_end.step(prepared)
        clock.stage("matching")
        yield matches, clock.ms
        clock = Clock()


def exchanged_cameras(sequence: Sequence) -> bool:
    """Whether left and right images are exchanged, by the matches of the first two stereo pairs.

    The matcher requires equal rows and positive disparities. If far more matches fulfil this after an
    exchange of the images, then the rows agree and the disparities are negative.
    """
    count_as_given = _count_matches(sequence, exchange=False)
    count_exchanged = _count_matches(sequence, exchange=True)
    return count_exchanged >= max(MIN_EXCHANGED_MATCHES, EXCHANGED_RATIO * count_as_given)


def _count_matches(sequence: Sequence, exchange: bool) -> int:
    """Number of matches of the second pair with the first, by the paper's matcher with its usual settings."""
    matcher = LoopMatcher(FeatureConfig(), MatchingConfig())
    matcher.step(matcher.prepare(_pair(sequence, 0, exchange)))
    return len(matcher.step(matcher.prepare(_pair(sequence, 1, exchange))))


def _pair(sequence: Sequence, index: int, exchange: bool) -> tuple[Image, Image]:
    """The left and the right image of a frame, (H, W) uint8 each; with `exchange`, the right one first."""
    left, right = sequence.stereo(index)
    return (right, left) if exchange else (left, right)


def stereo_ahead(
    sequence: Sequence, prepare: Callable[[tuple[Image, Image]], Prepared], ahead: int = 4
) -> Iterator[Prepared]:
    """The results of `prepare` for all stereo pairs, in order, which threads compute `ahead` frames ahead."""

    def read_and_prepare(index: int) -> Prepared:
        return prepare(sequence.stereo(index))

    with ThreadPoolExecutor(max_workers=2) as pool:
        waiting: deque[Future[Prepared]] = deque()
        for index in range(len(sequence)):
            waiting.append(pool.submit(read_and_prepare, index))
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
