"""Result of the odometry for one frame, and the clock that times its stages."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from enum import StrEnum

from .types import Array


class Flag(StrEnum):
    """Remark on a frame in frames.csv."""

    STANDSTILL = "standstill"  # hardly any optical flow, so the motion is set to the identity
    FEW_MATCHES = "few_matches"  # too few matches: an earlier motion is repeated
    NO_MOTION = "no_motion"  # no motion with enough inliers was found: an earlier one is repeated
    CONTRADICTS_STEREO = "contradicts_stereo"  # the motion does not fit the depths of the stereo pairs
    # Only in variant `kit`:
    FILTER_OFF = "filter_off"  # no features removed, since too few would remain
    PRIOR_DROPPED = "prior_dropped"  # best candidate near the prior clearly worse than the overall best


WITHOUT_MOTION = frozenset((Flag.FEW_MATCHES, Flag.NO_MOTION))  # flags of a frame that repeats a motion
MAX_MISSING_FRAMES = 10  # largest number of such frames in a row; with more, tracking is lost


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Motion of a frame, with counts, flags and times.

    Attributes
    ----------
    T_cp : (4, 4) motion from the previous to the current left camera, metres.
    matches, removed, used : numbers of all matches, of those that the box rule removed, and of those that
        were left after bucketing.
    inliers : number of used matches that agree with the epipolar geometry or, for VISO2, with the fitted
        motion.
    prior_angle : angle to the previous essential vector, degrees; NaN if one of the two vectors is missing.
    flags : remarks on unusual frames.
    e : (9,) essential vector of the winner; None without a winner, so always for VISO2.
    still : whether the camera stands still: the used features hardly move. With VISO2 there is no flag
        `standstill` then, since it measures the motion all the same.
    ms : milliseconds of each stage.
    """

    T_cp: Array
    matches: int = 0
    removed: int = 0
    used: int = 0
    inliers: int = 0
    prior_angle: float = float("nan")
    flags: tuple[Flag, ...] = ()
    e: Array | None = None
    still: bool = False
    ms: dict[str, float] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        """Whether the frame has a motion of its own; if not, an earlier motion is repeated.

        At a standstill, the identity counts as the frame's own motion.
        """
        return not WITHOUT_MOTION.intersection(self.flags)


class Clock:
    """A clock that measures the times of consecutive stages; `ms` has the milliseconds of each by name."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = time.perf_counter()

    def stage(self, name: str) -> None:
        """End a stage, which began with the end of the previous one; times with equal names are added."""
        now = time.perf_counter()
        self.ms[name] = self.ms.get(name, 0.0) + 1e3 * (now - self._last)
        self._last = now
