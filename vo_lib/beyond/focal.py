"""Beyond the paper: whether the images are those of a camera with calib.txt's focal length.

A wrong focal length stretches the scene, and the camera's step with it, along the axis: a camera that only
goes ahead cannot tell. One that turns can, for points at x across the image move by its turn times 1 + x²,
and x is what the focal length gives. A wrong baseline makes everything larger or smaller: no image tells.

Each turning frame gives normal equations for the share by which the focal length is too small, and for the
errors that disparities and parallax tell of the rig: these alone look like a few per cent, so they are free
within what rigs usually have. Motion and points are eliminated, and the frames are summed up.
"""

from __future__ import annotations

import numpy as np

from ..core.camera import StereoCamera
from ..core.geometry import rotation_angle
from ..core.matches import StereoMatches
from ..core.types import Array
from .parallax import parallax_information
from .rig import BY_PARALLAX, effects, prior_covariance

TURN = np.radians(0.5)  # a frame's turn, below which it says little
MOST = 100  # matches of a frame; more cost time
FEWEST = 30
SCALE = 0.5  # pixel residual at which a match's weight is halved
USUAL = 0.2  # of the size that a rig's errors may have, most rigs show so much
INFLATION = 3.0  # frames scatter by this much more than matching noise
# The share that is a doubt, beyond its deviation: good drives show at most 2.7 %, a focal length wrong by
# a tenth 5.5 % and more.
DOUBT = 0.03


class FocalCheck:
    """What a drive says of its camera's focal length, from frame to frame."""

    def __init__(self, camera: StereoCamera):
        self.camera = camera
        prior = USUAL**2 * prior_covariance()[np.ix_(BY_PARALLAX, BY_PARALLAX)]
        self._information = np.diag([0.0] * len(prior) + [1.0])  # of the share next to nothing is known
        self._information[:-1, :-1] = np.linalg.inv(prior)
        self._vector = np.zeros(len(self._information))

    def update(self, matches: StereoMatches, T_cp: Array) -> None:
        """Learn from a frame's matches, as measured, and its motion (4, 4)."""
        if rotation_angle(T_cp[:3, :3]) < TURN or len(matches) < FEWEST:
            return
        matches = matches[np.arange(0, len(matches), -(-len(matches) // MOST))]
        found = parallax_information(self.camera, matches, T_cp[:3, :3], T_cp[:3, 3], self._effects, SCALE)
        if found is not None and np.isfinite(found[0]).all():
            self._information += found[0] / INFLATION**2
            self._vector += found[1] / INFLATION**2

    def _effects(self, x: Array, disparity: Array) -> Array:
        """As in `rig`; a focal length that is too small by a share of 1 doubles places and disparities."""
        zoom = np.vstack([self.camera.f * x, disparity])
        return np.concatenate([effects(self.camera, x, disparity)[BY_PARALLAX, :3], zoom[None]])

    def doubt(self) -> str | None:
        """In words, a focal length that these images contradict; None where they do not or say little."""
        covariance = np.linalg.inv(self._information)
        share = float(covariance[-1] @ self._vector)
        if abs(share) < DOUBT + np.sqrt(covariance[-1, -1]):
            return None
        return (
            f"the turns of this drive fit a focal length about {100 * abs(share):.0f} % "
            f"{'longer' if share > 0 else 'shorter'} than the {self.camera.f:.1f} px of calib.txt: were the "
            "images resized, or is it another camera's? The path may be wrong by as much and more"
        )
