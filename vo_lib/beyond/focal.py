"""Beyond the paper: whether the images are those of a camera with calib.txt's focal length.

A wrong focal length stretches the scene, and the camera's step with it, along the axis: a camera that only
goes ahead cannot tell. One that turns can, for points at x across the image move by its turn times 1 + x²,
and x is what the focal length gives. A wrong baseline makes everything larger or smaller: no image tells.

Each turning frame gives a normal equation for the share by which the focal length is too small; motion and
points are eliminated, and the frames are summed up. The matches are as measured: what is learnt of field and
lens hides half of it.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..core.camera import StereoCamera
from ..core.geometry import rotation_angle
from ..core.matches import StereoMatches
from ..core.types import Array

TURN = np.radians(0.5)  # a frame's turn, below which it says little
MOST = 100  # matches of a frame; more cost time
FEWEST = 30
FAINTEST = 0.3  # pixels; features of smaller disparity are left out
NEAREST = 0.05  # smallest depth in the current frame, as a share of that in the previous one
STEPS = 2  # of Gauss-Newton
SCALE = 0.5  # pixel residual at which a match's weight is halved
FINEST = 0.1  # pixels; no frame's noise is taken to be smaller
SURE = 10.0  # standard deviations of matching noise alone; frames scatter by up to four of them
# The share that is a doubt. Good drives show at most 1.7 %, a focal length wrong by a tenth 4.3 % and more.
DOUBT = 0.03


class FocalCheck:
    """What a drive says of its camera's focal length, from frame to frame."""

    def __init__(self, camera: StereoCamera):
        self.camera = camera
        self._information = self._vector = 0.0

    def update(self, matches: StereoMatches, T_cp: Array) -> None:
        """Learn from a frame's matches, as measured, and its motion (4, 4)."""
        if rotation_angle(T_cp[:3, :3]) < TURN:
            return
        matches = matches[matches.prev_left[:, 0] - matches.prev_right[:, 0] > FAINTEST]
        if len(matches) < FEWEST:
            return
        matches = matches[np.arange(0, len(matches), -(-len(matches) // MOST))]
        try:
            information, vector = focal_information(self.camera, matches, T_cp[:3, :3], T_cp[:3, 3])
        except np.linalg.LinAlgError:
            return
        if np.isfinite(information + vector):
            self._information += information
            self._vector += vector

    def doubt(self) -> str | None:
        """In words, a focal length that these images contradict; None where they do not or say little."""
        share = self._vector / max(self._information, 1e-12)
        if abs(share) < DOUBT + SURE / np.sqrt(max(self._information, 1e-12)):
            return None
        return (
            f"the turns of this drive fit a focal length about {100 * abs(share):.0f} % "
            f"{'longer' if share > 0 else 'shorter'} than the {self.camera.f:.1f} px of calib.txt: were the "
            "images resized, or is it another camera's? The path may be wrong by as much and more"
        )


def focal_information(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array
) -> tuple[float, float]:
    """What a frame says of the share g by which f is too small: its information, and that times g.

    A feature of true disparity D is at

        (X, Y, Z) = R_cp (x / (1 + g), y / (1 + g), 1) + D / ((1 + g) f b) t_cp

    in the current frame, in units of its previous depth, and is seen there at f (1 + g) (X, Y) / Z with
    disparity D / Z. Robust Gauss-Newton over motion and every D, then these are eliminated.
    """
    f, fb, R, t = camera.f, camera.f * camera.baseline, R_cp, t_cp
    x_p, x_c = camera.normalise(matches.prev_left).T, camera.normalise(matches.cur_left).T
    D, d_c = (matches.prev_left - matches.prev_right)[:, 0], (matches.cur_left - matches.cur_right)[:, 0]
    measured = np.stack([D, f * x_c[0], f * x_c[1], d_c])
    p, flat = np.vstack([x_p, np.ones_like(D)]), np.vstack([x_p, np.zeros_like(D)])
    by = np.zeros((7, 4, len(D)))
    for _ in range(STEPS):
        ray, toward = R @ p, np.outer(t, D / fb)
        X, Y, Z = ray + toward
        Z = np.maximum(Z, NEAREST)
        x, y = X / Z, Y / Z
        residual = measured - np.stack([D, f * x, f * y, D / Z])
        # How the place changes by a rotation, by t and by g, (7, 3, N); then how its pixels do.
        moves = np.zeros((7, 3, len(D)))
        moves[:3] = np.cross(np.eye(3)[:, None], ray.T[None]).swapaxes(1, 2)
        moves[[3, 4, 5], [0, 1, 2]] = D / fb
        moves[6] = -R @ flat - toward
        by[:, 1], by[:, 2] = f * (moves[:, 0] - x * moves[:, 2]) / Z, f * (moves[:, 1] - y * moves[:, 2]) / Z
        by[:, 3] = -D / Z**2 * moves[:, 2]
        by[6, 1:3] += f * x, f * y
        ahead = (t[:2, None] - t[2] * np.stack([x, y])) * f / (fb * Z)
        by_D = np.stack([np.ones_like(D), *ahead, (1.0 - t[2] * D / (fb * Z)) / Z])
        # Without the part along by_D, D is eliminated.
        norm = np.sum(by_D**2, axis=0)
        own, own_by = np.sum(by_D * residual, axis=0) / norm, np.sum(by_D * by, axis=1) / norm
        left, left_by = residual - by_D * own, by - by_D * own_by[:, None]
        squared = np.sum(left**2, axis=0)
        weighted = (left_by / (1.0 + squared / SCALE**2)).reshape(7, -1)
        H, g = weighted @ left_by.reshape(7, -1).T, weighted @ left.ravel()
        by_motion = np.linalg.solve(H[:6, :6], np.column_stack([H[:6, 6:], g[:6]]))
        change = by_motion[:, 1]
        R, t = cv2.Rodrigues(change[:3])[0] @ R, t + change[3:]
        D = np.maximum(D + own - change @ own_by[:6], FAINTEST)
    noise = max(float(np.median(squared)) / 3.0, FINEST**2)  # four rows, less one for D
    return float(H[6, 6] - H[6, :6] @ by_motion[:, 0]) / noise, float(g[6] - H[6, :6] @ change) / noise
