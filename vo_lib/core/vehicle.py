"""Beyond the paper: what a vehicle can do from one frame to the next; a motion beyond that is doubtful."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .frame import DOUBTFUL, LOST, FrameResult
from .geometry import quaternion_from_rotation
from .settings import Checked, setting
from .types import Array

SHORTEST = 0.1  # seconds; between closer frames noise alone would change the speed too fast


@dataclass(frozen=True)
class VehicleConfig(Checked):
    """Limits of a vehicle's motion; the fastest of KITTI's cars has half of each turn and tilt."""

    check: bool = setting(True, "flag what no car does; off for a camera that is carried or flies")
    speed_change: float = setting(
        30.0, "largest change of velocity, in any direction", unit="m/s²", low=1, high=1e4
    )
    turn_rate: float = setting(90.0, "fastest turn to the left or right", unit="deg/s", low=1, high=1e4)
    tilt_rate: float = setting(40.0, "fastest pitch and roll", unit="deg/s", low=1, high=1e4)
    patience: int = setting(
        10,
        "frames without a motion, or with a doubtful one, for which the last good one goes on; then the "
        "camera stands still (not as published)",
        low=0,
        high=1000,
    )


class Vehicle:
    """Judges the motions of a camera on a vehicle, x to the right, y down, z ahead, frame by frame."""

    def __init__(self, config: VehicleConfig):
        self.config = config
        self._velocity: Array | None = None  # of the last motion without doubt
        self._doubted = 0  # frames since then
        self._lost = 0.0  # seconds for which the path has been lost

    def judge(self, motion: FrameResult, seconds: float) -> FrameResult:
        """The motion of the next frame with its flags: `DOUBTFUL` ones, and `lost` after too many in doubt.

        seconds : since the frame before; 0 where it is not known, and nothing is doubtful.
        """
        flags = () if motion.in_doubt or not self.config.check else self._beyond(motion.T_cp, seconds)
        motion = replace(motion, flags=(*motion.flags, *flags))
        if not motion.in_doubt:
            self._velocity = motion.T_cp[:3, 3] / seconds if seconds > 0.0 else None
            self._doubted, self._lost = 0, 0.0
            return motion
        self._doubted += 1
        if self._doubted <= self.config.patience:
            return motion
        # Where the last good motion no longer counts, the speed may have changed.
        self._lost += max(seconds, 0.0)
        return replace(motion, flags=(*motion.flags, LOST))

    def _beyond(self, T_cp: Array, seconds: float) -> tuple[str, ...]:
        """Which limits a motion is beyond."""
        if seconds <= 0.0:
            return ()
        *axis, w = quaternion_from_rotation(T_cp[:3, :3])
        sine = max(float(np.linalg.norm(axis)), 1e-12)
        pitch, yaw, roll = np.degrees(2.0 * np.arctan2(sine, w)) / seconds * np.abs(axis) / sine
        before = T_cp[:3, 3] / seconds if self._velocity is None else self._velocity
        change = float(np.linalg.norm(T_cp[:3, 3] / seconds - before))
        beyond = (
            change > self.config.speed_change * max(SHORTEST, self._lost),
            yaw > self.config.turn_rate,
            max(pitch, roll) > self.config.tilt_rate,
        )
        return tuple(flag for flag, true in zip(DOUBTFUL, beyond, strict=True) if true)
