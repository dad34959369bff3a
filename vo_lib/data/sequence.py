"""A stereo sequence in a folder in KITTI's layout; images are read one stereo pair at a time."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..geometry.boxes import VEHICLES, Boxes, no_boxes
from ..geometry.camera import StereoCamera
from ..geometry.motion import inverse, rigid
from ..geometry.types import Array, Image
from .class_names import no_chosen_box
from .kitti import (
    BITS,
    COLOUR,
    EXPECTED_FRAMES,
    GREY,
    PART,
    bits_note,
    camera_names,
    grey_bits,
    image_folders,
    left_offset,
    list_frames,
    read_calibration,
    read_image,
    read_times,
)
from .label_files import count_labels, label_files, read_labels
from .label_names import is_file_of_names, read_class_names
from .masks import read_mask
from .poses import read_kitti_poses


@dataclass(frozen=True, eq=False)
class Sequence:
    """A stereo sequence of N frames in a folder in KITTI's layout; images are read on use.

    Attributes
    ----------
    name : displayed name, such as "kitti/07", or the folder's name.
    folder : folder with image_0, image_1 and calib.txt; without grey images, with image_2 and image_3.
    frames : (N) file stems, in order.
    camera : intrinsics, baseline and image size.
    times : (N,) seconds.
    truth : (N, 4, 4) ground-truth poses T_w_c, or None.
    labels : folder of YOLO label files, or None.
    masks : PNG image, or folder with one image per frame, or None. Features of the left images are ignored
        on non-zero pixels of the mask.
    is_part : whether these are only a part of the frames of a sequence, such as a clip of the benchmark.
    sides : names of the folders of the left and the right images.
    bits : bits of the grey values in the image files; the images that are read have 8.
    skips_frames : whether frames are left out or in another order on purpose, as in a disturbed drive; then a
        gap in their numbers is no fault.
    """

    name: str
    folder: Path
    frames: tuple[str, ...]
    camera: StereoCamera
    times: Array
    truth: Array | None
    labels: Path | None
    masks: Path | None = field(default=None, kw_only=True)
    is_part: bool = field(default=False, kw_only=True)
    sides: tuple[str, str] = field(default=GREY, kw_only=True)
    bits: int = field(default=BITS[0], kw_only=True)
    skips_frames: bool = field(default=False, kw_only=True)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def pieces(self) -> list[range]:
        """Ranges of indices without a gap in the frame numbers; a part of a sequence may have several."""
        starts = [0]
        for index, (before, frame) in enumerate(itertools.pairwise(self.frames), start=1):
            if int(frame) != int(before) + 1:
                starts.append(index)
        return [range(*ends) for ends in itertools.pairwise([*starts, len(self)])]

    def require_unbroken(self) -> None:
        """Raise `DataError` if frame numbers are missing between the frames: no motion leads across a gap.

        In a drive that `skips_frames` on purpose, every step is a motion.
        """
        pieces = self.pieces
        if len(pieces) < 2 or self.skips_frames:
            return
        numbers = ", ".join(f"{int(self.frames[p[0]])}:{int(self.frames[p[-1]]) + 1}" for p in pieces)
        indices = " or ".join(f"--frames {piece.start}:{piece.stop}" for piece in pieces)
        raise DataError(
            f"{self.name} has the frames {numbers} with a gap between, and no motion leads across a gap: "
            f"choose a piece by {indices}"
        )

    @property
    def true_poses(self) -> Array:
        """`truth`, for what is nothing without it; raises `DataError` if the sequence has none."""
        if self.truth is None:
            raise DataError(f"{self.name} has no ground truth: choose a sequence with a ground truth")
        return self.truth

    def stereo(self, index: int) -> tuple[Image, Image]:
        """Left and right image of a frame, (H, W) uint8; a `DataError` names an unusable image."""
        return self.left(index), self._image(self.folder / self.sides[1] / f"{self.frames[index]}.png")

    def left(self, index: int) -> Image:
        """Left image of a frame, (H, W) uint8; a `DataError` names an unusable image."""
        return self._image(self.left_file(self.frames[index]))

    def left_file(self, frame: str) -> Path:
        """The left image of a frame, by the frame's file stem."""
        return self.folder / self.sides[0] / f"{frame}.png"

    def notes(self) -> list[str]:
        """Sentences on images that are not grey images of 8 bits."""
        words = []
        if self.sides == COLOUR:
            folders = " and ".join(COLOUR)
            matrices = " and ".join(camera_names(COLOUR))
            only = "there are only colour images"
            words.append(f"{only}: {folders} are read as grey, with {matrices} of calib.txt")
        if self.bits > BITS[0]:
            words.append(bits_note(self.bits))
        return words

    def _image(self, path: Path) -> Image:
        image = read_image(path, self.bits)
        self._check_size(path, image)
        return image

    def _check_size(self, path: Path, image: Image) -> None:
        size = (self.camera.height, self.camera.width)
        if image.shape != size:
            actual = f"{image.shape[1]}×{image.shape[0]}"
            expected = f"{size[1]}×{size[0]}"
            raise DataError(f"the image is {actual}, expected {expected} as in the first left image", path)

    def mask_files(self) -> list[Path]:
        """The mask of each frame, or one mask for all; empty without masks."""
        if self.masks is None or not self.masks.is_dir():
            return [] if self.masks is None else [self.masks]
        return [self.masks / f"{frame}.png" for frame in self.frames]

    def mask_images(self) -> Iterator[Image]:
        """The masks of all frames in order, empty without masks; one common mask is repeated endlessly."""
        images = map(self._mask, self.mask_files())
        return images if self.masks is None or self.masks.is_dir() else repeat(next(images))

    def _mask(self, path: Path) -> Image:
        mask = read_mask(path)
        self._check_size(path, mask)
        return mask

    def labelled_boxes(self, index: int) -> Boxes:
        """Boxes of all classes in a frame's label file, with the file's numbers; none if it is missing."""
        if self.labels is None:
            return no_boxes()
        path = self.labels / f"{self.frames[index]}.txt"
        return read_labels(path, self.camera.width, self.camera.height) if path.exists() else no_boxes()

    def boxes(self, index: int, classes: tuple[str, ...] = (VEHICLES,)) -> Boxes:
        """Boxes of the chosen classes in a frame's left image; for many frames, use `boxes_of`."""
        return self.boxes_of(classes)(index)

    def boxes_of(self, classes: tuple[str, ...] = (VEHICLES,)) -> Callable[[int], Boxes]:
        """A function that returns a frame's boxes of the chosen classes (setting filter.classes), by index.

        The names of the label folder are read once, here. Raises as `ClassNames.choose`.
        """
        if self.labels is None:
            return lambda index: no_boxes()
        choice = read_class_names(self.labels).choose(classes)
        return lambda index: choice.select(self.labelled_boxes(index))

    def require_boxes(self, classes: tuple[str, ...]) -> None:
        """Raise `ClassesError` if the label folder has boxes, but none of a chosen class and no names.

        Then the numbers are probably not COCO's.
        """
        if self.labels is None:
            return
        names = read_class_names(self.labels)
        choice = names.choose(classes)
        if names.names:
            return
        files = label_files(self.labels)
        for path in files:
            if choice.kinds.keys() & count_labels([path]).boxes.keys():
                return
        found = count_labels(files).boxes
        if found:
            raise no_chosen_box(found, choice, self.labels)

    def part(self, start: int, stop: int) -> Sequence:
        """The frames start … stop - 1; `DataError` unless these are two or more frames of the sequence."""
        require_frames(start, stop, len(self), self.name)
        return dataclasses.replace(
            self,
            frames=self.frames[start:stop],
            times=self.times[start:stop],
            truth=None if self.truth is None else self.truth[start:stop],
            is_part=self.is_part or stop - start < len(self),
        )


def require_frames(start: int, stop: int, count: int, name: str) -> None:
    """Raise `DataError` unless start … stop - 1 are two or more of the `count` frames of a sequence."""
    if not 0 <= start < stop - 1 < count:
        raise DataError(f"frames {start}:{stop}: expected two or more frames of {name}, which has 0:{count}")


def at_pixels(picture: NDArray[Any], uv: Array) -> NDArray[Any]:
    """Values (N,) of a picture (H, W) at the pixels nearest to uv (N, 2)."""
    last = np.array(picture.shape[::-1]) - 1
    column, row = np.rint(np.clip(np.nan_to_num(uv), 0, last)).astype(np.intp).T
    return np.asarray(picture[row, column])


def open_folder(folder: Path, name: str, labels: str | Path | None = None) -> Sequence:
    """The sequence in a folder in KITTI's layout. Of images with 8 bits, only the first pair is read.

    labels : folder of YOLO label files; by default `labels` in the sequence's folder, if it exists.

    Raises `DataError` with the file at fault and the expected content.
    """
    frames = list_frames(folder)
    sides = image_folders(folder)
    if len(frames) < 2:
        raise DataError(f"expected two or more stereo pairs, found {len(frames)}", folder / sides[0])
    bits = grey_bits([folder / side / f"{frame}.png" for frame in frames] for side in sides)
    first = read_image(folder / sides[0] / f"{frames[0]}.png", bits)
    camera = read_calibration(folder / "calib.txt", first.shape[1], first.shape[0], sides)
    times = folder / "times.txt"
    return Sequence(
        name=name,
        folder=folder,
        frames=tuple(frames),
        camera=camera,
        times=_rows_of_frames(read_times(times), frames, times),
        truth=_find_truth(folder, frames, sides),
        labels=_find_labels(folder, frames, labels),
        is_part=(folder / PART).exists() or len(frames) < EXPECTED_FRAMES.get(folder.name, 0),
        sides=sides,
        bits=bits,
    )


def _rows_of_frames(rows: Array, frames: list[str], path: Path) -> Array:
    """The rows of these frames, from a table of only these frames or of the whole sequence."""
    if len(rows) == len(frames):
        return rows
    if len(rows) > int(frames[-1]):
        return rows[[int(frame) for frame in frames]]
    raise DataError(f"{len(rows)} rows for {len(frames)} frames: expected one row per frame", path)


def _find_truth(folder: Path, frames: list[str], sides: tuple[str, str]) -> Array | None:
    """True poses of the left camera. KITTI's files have the poses of camera 0, the left grey camera."""
    kitti_poses = folder.resolve().parent.parent / "poses" / f"{folder.resolve().name}.txt"
    for path in (folder / "poses.txt", kitti_poses):
        if path.exists():
            poses = _rows_of_frames(read_kitti_poses(path), frames, path)
            if sides == GREY:
                return poses
            T_0_left = rigid(np.eye(3), left_offset(folder / "calib.txt", sides))
            return inverse(T_0_left) @ poses @ T_0_left
    return None


def _find_labels(folder: Path, frames: list[str], labels: str | Path | None) -> Path | None:
    path = folder / "labels" if labels is None else Path(labels)
    if not path.is_dir():
        if labels is not None:
            raise DataError("the label folder is missing", path)
        return None
    stems = {p.stem for p in path.glob("*.txt") if not is_file_of_names(p.name)}
    if stems & set(frames):
        return path
    if stems or labels is not None:
        raise DataError(f"no label file is named after a frame: expected names such as {frames[0]}.txt", path)
    return None
