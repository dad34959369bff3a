"""Beyond the paper: what a vehicle can do from one frame to the next, and what is believed beyond that.

A gap in the images, frames that come late or a film played backwards show motions that no vehicle makes, and
they are right: what many matches agree on in both current images is believed, as a jump in time. Less is
believed where the next frame goes on from it. Measured on disturbed drives, steps wrong by half a metre and
more: at most 22 % of the matches agree where a zoom made them, at most 18 matches where a camera was late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .camera import StereoCamera
from .frame import DOUBTFUL, LOST, TIME_JUMP, FrameResult
from .geometry import quaternion_from_rotation, transform
from .matches import StereoMatches
from .reprojection import AGREES
from .settings import Checked, setting
from .types import Array

SHORTEST = 0.1  # seconds; between closer frames noise alone would change the speed too fast
FIRST = 2.0  # seconds for which the speed may have changed before the first motion: 60 m/s, 216 km/h
# Matches that agree, and their share, for a motion beyond the limits to be believed, and if the next one is.
STRONG, SOME = (30, 0.5), (10, 1.0 / 3.0)


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


class _State(NamedTuple):
    """Velocities of the last believed motion and of that before a jump, frames and seconds since then."""

    velocities: list[Array]
    doubted: int  # frames
    lost: float  # seconds for which the path has been lost


class Vehicle:
    """Judges the motions of a camera on a vehicle, x to the right, y down, z ahead, frame by frame.

    Attributes
    ----------
    waiting : flags of the last frame's motion if it is believed only where the next one is too.
    taken_back : those of the frame before, once its motion is no longer believed.
    """

    def __init__(self, config: VehicleConfig, camera: StereoCamera):
        self.config, self.camera = config, camera
        self.waiting: tuple[str, ...] = ()
        self.taken_back: tuple[str, ...] = ()
        self._state = self._before = _State([], 0, 0.0)

    def judge(self, motion: FrameResult, matches: Callable[[], StereoMatches], seconds: float) -> FrameResult:
        """The motion of the next frame with its flags: `TIME_JUMP`, `DOUBTFUL` ones, `LOST` after too many.

        matches : gives those that the motion may have been found from; asked only beyond the limits.
        seconds : since the frame before; 0 where it is not known, and nothing is doubtful.
        """
        T_cp, state = motion.T_cp, self._state
        judged = not motion.in_doubt and self.config.check and seconds > 0.0
        beyond = self._beyond(T_cp, seconds) if judged else ()
        agree = seen = 0
        if beyond and DOUBTFUL[2] not in beyond:
            given = matches()
            agree, seen = self._agreeing(T_cp, given), len(given)
        some, strong = (agree >= max(number, share * seen) for number, share in (SOME, STRONG))
        believed = not motion.in_doubt and (strong or not beyond)
        self.taken_back, self.waiting = () if believed else self.waiting, ()
        if self.taken_back:
            state = self._before._replace(doubted=self._before.doubted + 1)
        elif some and not believed:
            believed, self.waiting, self._before = True, beyond, state
        motion = replace(motion, flags=(*motion.flags, *((TIME_JUMP,) if beyond and believed else beyond)))
        if believed:
            now = [T_cp[:3, 3] / seconds] if seconds > 0.0 else []
            self._state = _State(now + (state.velocities[:1] if beyond else []), 0, 0.0)
            return motion
        self._state = state._replace(doubted=state.doubted + 1)
        if self._state.doubted <= self.config.patience:
            return motion
        # Where the last good motion no longer counts, the speed may have changed.
        self._state = self._state._replace(lost=state.lost + max(seconds, 0.0))
        return replace(motion, flags=(*motion.flags, LOST))

    def _agreeing(self, T_cp: Array, matches: StereoMatches) -> int:
        """How many matches agree with a motion in both current images.

        One that comes so many times nearer is allowed as many times more: its error in depth grows with it.
        """
        X_p = self.camera.triangulate(matches.prev_left, matches.prev_right)
        left, right = self.camera.project(transform(T_cp, X_p))
        off = np.hypot(*(left - matches.cur_left).T) ** 2 + np.hypot(*(right - matches.cur_right).T) ** 2
        nearer = (left - right)[:, 0] / (matches.prev_left - matches.prev_right)[:, 0]
        return int(np.count_nonzero(off < (AGREES * np.maximum(nearer, 1.0)) ** 2))

    def _beyond(self, T_cp: Array, seconds: float) -> tuple[str, ...]:
        """Which limits a motion is beyond."""
        *axis, w = quaternion_from_rotation(T_cp[:3, :3])
        sine = max(float(np.linalg.norm(axis)), 1e-12)
        pitch, yaw, roll = np.degrees(2.0 * np.arctan2(sine, w)) / seconds * np.abs(axis) / sine
        before, time = self._state.velocities or [np.zeros(3)], max(SHORTEST, self._state.lost)
        time = time if self._state.velocities else max(FIRST, time)
        change = min(float(np.linalg.norm(T_cp[:3, 3] / seconds - velocity)) for velocity in before)
        beyond = (
            change > self.config.speed_change * time,
            yaw > self.config.turn_rate,
            max(pitch, roll) > self.config.tilt_rate,
        )
        return tuple(flag for flag, true in zip(DOUBTFUL, beyond, strict=True) if true)
