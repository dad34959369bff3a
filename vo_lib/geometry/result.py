"""Result of the odometry for one frame, and the clock that times its stages."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from enum import StrEnum

from .types import Array


class Flag(StrEnum):
    """Remark on a frame, as frames.csv has it."""

    STANDSTILL = "standstill"  # the features do not move
    FEW_MATCHES = "few_matches"  # no motion: too few matches
    NO_MOTION = "no_motion"  # no motion: the matches agree on none
    # The kit's own:
    FILTER_OFF = "filter_off"  # boxes would have left too few matches
    PRIOR_DROPPED = "prior_dropped"  # the prior's best candidate was clearly worse than the best of all
    DOUBTFUL_SPEED = "doubtful_speed"  # beyond the limits of a vehicle
    DOUBTFUL_TURN = "doubtful_turn"
    DOUBTFUL_TILT = "doubtful_tilt"


MAX_MISSING_FRAMES = 10  # in a row without a motion; with more, tracking is lost
WITHOUT_MOTION = frozenset((Flag.FEW_MATCHES, Flag.NO_MOTION))
DOUBTFUL = frozenset((Flag.DOUBTFUL_SPEED, Flag.DOUBTFUL_TURN, Flag.DOUBTFUL_TILT))


@dataclass(frozen=True)
class FrameResult:
    """Motion of one frame and how it came about.

    Attributes
    ----------
    T_cp : (4, 4) motion from the previous to the current left camera, metres.
    matches : matches found; removed : matches removed by boxes; used : left after bucketing.
    inliers : matches in use that agree with the epipolar geometry.
    prior_angle : angle to the previous essential vector, degrees; NaN without one.
    flags : remarks; empty when nothing was unusual.
    ms : milliseconds of each stage.
    """

    T_cp: Array
    matches: int = 0
    removed: int = 0
    used: int = 0
    inliers: int = 0
    prior_angle: float = float("nan")
    flags: tuple[Flag, ...] = ()
    ms: dict[str, float] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        """Whether the images of this frame gave a motion; else an earlier one stands in."""
        return not WITHOUT_MOTION.intersection(self.flags)

    @property
    def in_doubt(self) -> bool:
        """Whether the images gave no motion, or one beyond the limits of a vehicle."""
        return not self.measured or bool(DOUBTFUL.intersection(self.flags))


class Clock:
    """Milliseconds of stages, each measured from the end of the one before."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = time.perf_counter()

    def stage(self, name: str) -> None:
        """End a stage; the time of a stage that comes again is added."""
        now = time.perf_counter()
        self.ms[name] = self.ms.get(name, 0.0) + 1e3 * (now - self._last)
        self._last = now
