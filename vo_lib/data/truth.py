"""Reading the truth beside a synthetic sequence, and asking it about pixels and matches."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.camera import StereoCamera
from ..core.errors import DataError
from ..core.files import read_arrays, read_bytes, read_json
from ..core.geometry import inverse
from ..core.matches import StereoMatches
from ..core.poses import read_kitti_poses
from ..core.settings import from_dict
from ..core.types import Array, Index, Mask, Whole
from .scenes import SceneConfig

NEAREST, FARTHEST = 0.25, 3000.0  # metres that the first and the last code of a depth stand for
STILL = 0.01  # metres between two frames below which a vehicle counts as standing


@dataclass(frozen=True)
class Truth:
    """What is true of a synthetic sequence of N frames with K vehicles.

    Attributes
    ----------
    folder : the sequence.
    config : the scene's settings.
    poses : (N, 4, 4) T_w_c of the left camera; the world is the first left camera.
    instance : (K,) instance numbers of the vehicles; instance K + k is the shadow under vehicle k.
    kind : (K,) COCO class: car 2, bus 5, truck 7.
    objects : (N, K, 4, 4) T_w_o. Vehicle axes: x right, y down, z forward, origin on the ground.
    """

    folder: Path
    config: SceneConfig
    poses: Array
    instance: Whole
    kind: Whole
    objects: Array

    @property
    def camera(self) -> StereoCamera:
        """The stereo camera of the sequence."""
        return self.config.camera

    def depth(self, frame: int) -> Array:
        """Depth Z (H, W) of every pixel of the left image, metres; infinite for the sky."""
        return decode_depth(_read(self.folder / "truth" / "depth" / f"{frame:06d}.png"))

    def ids(self, frame: int) -> NDArray[np.uint16]:
        """Instance number (H, W) of every pixel of the left image; 0 is street or sky."""
        return _read(self.folder / "truth" / "instance" / f"{frame:06d}.png").astype(np.uint16)

    def is_moving(self, frame: int, uv: Array, other: int) -> Mask:
        """Whether left pixels (N, 2) of a frame lie on what moves between it and `other`; shadows count."""
        step = self.objects[other, :, :3, 3] - self.objects[frame, :, :3, 3]
        moves = np.append(False, np.linalg.norm(step, axis=1) > STILL)
        return np.asarray(moves[self._vehicle_at(frame, uv)])

    def predict(self, frame_p: int, frame_c: int, uv: Array) -> tuple[Array, Array, Mask]:
        """Where points of one left image are in the pair of another frame; the motion of vehicles included.

        Parameters
        ----------
        frame_p, frame_c : frame of the points given, and frame asked for; they may be the same.
        uv : (N, 2) pixels in the left image of frame_p.

        Returns
        -------
        left, right : (N, 2) pixels in frame_c.
        valid : (N,) the point has a depth (is not sky) and lies inside both images of frame_c. Something
            nearer may hide it there.
        """
        uv = np.asarray(uv, np.float64).reshape(-1, 2)
        z = self._depth_at(frame_p, uv)
        known = np.isfinite(z)
        z = np.where(known, z, 1.0)
        X = np.concatenate([self.camera.normalise(uv) * z[:, None], z[:, None]], axis=1)
        still = np.eye(4)[None]
        moved = np.concatenate([still, self.objects[frame_c] @ inverse(self.objects[frame_p])])
        T = (inverse(self.poses[frame_c]) @ moved @ self.poses[frame_p])[self._vehicle_at(frame_p, uv)]
        left, right = self.camera.project(np.einsum("nij,nj->ni", T[:, :3, :3], X) + T[:, :3, 3])
        both = np.stack([left, right])
        inside = (both >= 0) & (both <= (self.camera.width - 1, self.camera.height - 1))  # false where NaN
        return left, right, known & inside.all(axis=(0, 2))

    def match_errors(self, matches: StereoMatches, frame: int) -> Array:
        """Largest distance (N,) of matches from their true places, pixels; NaN where these are not known.

        The matches are those of the pair `frame` with the one before. Their places in the three images other
        than the previous left one are judged.
        """
        _, right_p, valid_p = self.predict(frame - 1, frame - 1, matches.prev_left)
        left, right, valid_c = self.predict(frame - 1, frame, matches.prev_left)
        away = np.stack([matches.prev_right - right_p, matches.cur_left - left, matches.cur_right - right])
        return np.where(valid_p & valid_c, np.linalg.norm(away, axis=2).max(axis=0), np.nan)

    def _nearest(self, uv: Array) -> tuple[Index, Index]:
        """Row and column of the pixels nearest to positions (N, 2)."""
        uv = np.nan_to_num(np.asarray(uv, np.float64).reshape(-1, 2))
        column = np.clip(np.rint(uv[:, 0]), 0, self.camera.width - 1).astype(np.intp)
        row = np.clip(np.rint(uv[:, 1]), 0, self.camera.height - 1).astype(np.intp)
        return row, column

    def _vehicle_at(self, frame: int, uv: Array) -> Whole:
        """0 for the street, k + 1 for vehicle k or its shadow."""
        number = self.ids(frame)[self._nearest(uv)].astype(np.int64)
        return np.where(number > 0, (number - 1) % max(len(self.instance), 1) + 1, 0)

    def _depth_at(self, frame: int, uv: Array) -> Array:
        """Depth (N,) at sub-pixel positions: 1/Z is linear over a flat face, so it is interpolated.

        Across an outline the depth of the nearest pixel counts.
        """
        near = 1.0 / self.depth(frame)
        ids = self.ids(frame)
        height, width = near.shape
        uv = np.nan_to_num(uv)
        column = np.clip(np.floor(uv[:, 0]), 0, width - 2).astype(np.intp)
        row = np.clip(np.floor(uv[:, 1]), 0, height - 2).astype(np.intp)
        a, b = np.clip(uv[:, 0] - column, 0, 1), np.clip(uv[:, 1] - row, 0, 1)
        around = np.stack([near[row + j, column + i] for j in (0, 1) for i in (0, 1)])
        things = np.stack([ids[row + j, column + i] for j in (0, 1) for i in (0, 1)])
        mixed = (1 - b) * ((1 - a) * around[0] + a * around[1]) + b * ((1 - a) * around[2] + a * around[3])
        same = np.all(things == things[0], axis=0) & (np.ptp(around, axis=0) <= 0.1 * around.max(axis=0))
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / np.where(same, mixed, near[self._nearest(uv)]))


def decode_depth(code: NDArray[np.uint16]) -> Array:
    """Depth (H, W), metres, of its codes; infinite for the sky."""
    z = NEAREST * np.exp((code.astype(np.float64) - 1.0) / 65534.0 * np.log(FARTHEST / NEAREST))
    return np.asarray(np.where(code > 0, z, np.inf))


def open_truth(folder: Path | str) -> Truth:
    """The truth of a synthetic sequence; `DataError` if the folder has none."""
    folder = Path(folder)
    try:
        about = read_json(folder / "truth" / "scene.json", {"config": {}}, "a scene's settings")
        arrays = read_arrays(read_bytes(folder / "truth" / "objects.npz"))
        return Truth(
            folder=folder,
            config=from_dict(SceneConfig, about["config"]),
            poses=read_kitti_poses(folder / "poses.txt"),
            instance=arrays["instance"],
            kind=arrays["kind"],
            objects=arrays["poses"],
        )
    except (DataError, ValueError, KeyError) as error:
        raise DataError(f"no synthetic truth here: {error}", folder) from None


@functools.lru_cache(maxsize=8)
def _read(path: Path) -> NDArray[np.uint16]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else None
    if image is None or image.ndim != 2:
        raise DataError("this picture of the truth is missing or broken", path)
    image.flags.writeable = False
    return np.asarray(image)
