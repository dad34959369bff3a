"""What the odometry says of a frame, and the clock that times its stages."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from .types import Array

NO_MOTION = ("few_matches", "no_motion")  # flags of a frame whose images gave no motion
DOUBTFUL = ("doubtful_speed", "doubtful_turn", "doubtful_tilt")  # and of one that no vehicle makes
TIME_JUMP = "time_jump"  # of one that no vehicle makes, but that the images agree on
LOST = "lost"  # more frames in doubt, one after the other, than the last good motion can stand for
REPEATED = "same_images"  # the pair equals the one before
IN_DOUBT = frozenset((*NO_MOTION, *DOUBTFUL))


@dataclass(frozen=True)
class FrameResult:
    """Motion of one frame and how it came about.

    Attributes
    ----------
    T_cp : (4, 4) motion from the previous to the current left camera, metres.
    matches : matches found; removed : matches removed by boxes; used : left after bucketing.
    inliers : matches in use that agree with the epipolar geometry.
    prior_angle : angle to the previous essential vector, degrees; NaN without one.
    flags : words such as "standstill"; empty when nothing was unusual.
    ms : milliseconds of each stage.
    """

    T_cp: Array
    matches: int = 0
    removed: int = 0
    used: int = 0
    inliers: int = 0
    prior_angle: float = float("nan")
    flags: tuple[str, ...] = ()
    ms: dict[str, float] = field(default_factory=dict)

    @property
    def in_doubt(self) -> bool:
        """Whether the images of this frame gave no motion, or one that no vehicle makes."""
        return any(flag in IN_DOUBT for flag in self.flags)


class Clock:
    """Milliseconds of stages, each measured from the end of the one before."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = time.perf_counter()

    def stage(self, name: str) -> None:
        """End a stage; one that comes again goes on."""
        now = time.perf_counter()
        self.ms[name] = self.ms.get(name, 0.0) + 1e3 * (now - self._last)
        self._last = now
