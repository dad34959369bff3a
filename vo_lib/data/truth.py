"""Ground truth of a drawn scene: vehicles, and matches on moving vehicles."""

from __future__ import annotations

import functools
import io
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import read_bytes, read_mapping
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray, IntArray
from ..settings import from_dict
from .poses import read_kitti_poses
from .scenes import SceneConfig
from .sequence import Sequence, at_pixels

MAX_STANDING_STEP_M = 0.01  # largest displacement of a standing vehicle between two frames


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of a drawn sequence of N frames with K vehicles.

    Attributes
    ----------
    folder : the sequence's folder.
    config : the scene's settings.
    poses : (N, 4, 4) T_w_c of the left camera; the world has the axes of the first left camera.
    objects : (N, K, 4, 4) poses T_w_o, from the axes of a vehicle o to the world, metres. These axes are x
        right, y down and z forward, with the origin on the ground.
    """

    folder: Path
    config: SceneConfig
    poses: Array
    objects: Array

    def instances(self, frame: int) -> NDArray[np.uint16]:
        """Instance numbers (H, W) of the left image: 0 street or sky, k + 1 vehicle k, K + k + 1 its shadow.

        Raises `DataError` if the instance image is missing or damaged.
        """
        return read_picture(self.folder / "truth" / "instance" / f"{frame:06d}.png").astype(np.uint16)

    def vehicle_at(self, frame: int, uv: Array) -> IntArray:
        """Vehicle numbers (N,) at left pixels (N, 2): k + 1 for vehicle k or its shadow, else 0."""
        number = at_pixels(self.instances(frame), uv).astype(np.int64)
        vehicles = max(self.objects.shape[1], 1)  # without vehicles, every number is 0
        # The numbers 1 to K are vehicles, and K + 1 to 2 K are their shadows in the same order.
        return np.where(number > 0, (number - 1) % vehicles + 1, 0)

    def is_moving(self, frame: int, uv: Array, other: int) -> BoolArray:
        """Mask (N,) of left pixels (N, 2) on a vehicle, or on its shadow, that moves between two frames.

        frame : of the pixels. other : the frame before or after it.
        """
        step = self.objects[other, :, :3, 3] - self.objects[frame, :, :3, 3]
        has_moved = np.linalg.norm(step, axis=1) > MAX_STANDING_STEP_M
        moves_by_number = np.append(False, has_moved)  # number 0 is no vehicle
        return np.asarray(moves_by_number[self.vehicle_at(frame, uv)])


def matches_on_moving(sequence: Sequence, index: int, matches: StereoMatches) -> BoolArray:
    """Mask (N,) of the matches of a drawn frame that are on moving vehicles or on their shadows.

    Raises `DataError` if the sequence is not drawn.
    """
    try:
        truth = _cached_truth(sequence.folder)
    except DataError:
        raise DataError(
            f"{sequence.name} has no truth about moving vehicles: the box rule `truth` is for drawn scenes",
            sequence.folder,
        ) from None
    before = int(sequence.frames[index - 1])
    now = int(sequence.frames[index])
    moves_in_previous = truth.is_moving(before, matches.prev_left, now)
    moves_in_current = truth.is_moving(now, matches.cur_left, before)
    return np.asarray(moves_in_previous | moves_in_current)


def open_truth(folder: Path | str) -> Truth:
    """The ground truth of a drawn sequence; `DataError` if the folder has none."""
    folder = Path(folder)
    try:
        scene = read_mapping(folder / "truth" / "scene.json", "a scene's settings")
        config = from_dict(SceneConfig, scene["config"])
        poses = read_kitti_poses(folder / "poses.txt")
        vehicles = io.BytesIO(read_bytes(folder / "truth" / "objects.npz"))
        with np.load(vehicles, allow_pickle=False) as file:
            return Truth(folder, config, poses, objects=file["poses"])
    except Exception as error:  # the errors of zipfile, zlib and NumPy have no other common base class
        raise DataError(f"the truth of a drawn scene is missing or invalid: {error}", folder) from None


_cached_truth = functools.lru_cache(maxsize=4)(open_truth)


@functools.lru_cache(maxsize=8)
def read_picture(path: Path) -> NDArray[np.uint16]:
    """Values (H, W) of an image of the truth, read-only; `DataError` if the file is missing or damaged."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else None
    if image is None or image.ndim != 2:
        raise DataError("the image of the truth is missing or damaged", path)
    image.flags.writeable = False
    return np.asarray(image)
