"""A stereo sequence in a folder in KITTI's layout; images are read one stereo pair at a time."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
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
    COLOUR,
    EXPECTED_FRAMES,
    GREY,
    IMAGE_BITS,
    PART,
    bits_note,
    find_truth,
    grey_bits,
    image_folders,
    left_offset,
    list_frames,
    projection_names,
    read_calibration,
    read_image,
    read_times,
)
from .label_files import count_labels, label_files, label_stems, read_labels
from .label_names import read_class_names
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
    truth : (N, 4, 4) ground-truth poses T_w_c of the left camera, metres, or None. The world w is that of
        the file (for KITTI, the left camera in frame 0; with colour images, the left colour camera), for a
        part, too: its first pose is then not the identity.
    truth_file : the file of `truth`, or None.
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
    truth_file: Path | None = field(default=None, kw_only=True)
    masks: Path | None = field(default=None, kw_only=True)
    is_part: bool = field(default=False, kw_only=True)
    sides: tuple[str, str] = field(default=GREY, kw_only=True)
    bits: int = field(default=IMAGE_BITS, kw_only=True)
    skips_frames: bool = field(default=False, kw_only=True)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def pieces(self) -> list[range]:
        """Ranges of indices without a gap in the frame numbers; a part of a sequence may have several."""
        starts = [0]
        for index in range(1, len(self)):
            if int(self.frames[index]) != int(self.frames[index - 1]) + 1:
                starts.append(index)
        ends = [*starts[1:], len(self)]
        return [range(start, end) for start, end in zip(starts, ends, strict=True)]

    def require_unbroken(self, first: int = 0) -> None:
        """Raise `DataError` if frame numbers are missing between the frames: no motion leads across a gap.

        In a drive that `skips_frames` on purpose, every step is a motion. The error names the parts without a
        gap. `first` : for a `part` of a sequence, the index of its first frame in the whole one.
        """
        pieces = self.pieces
        if len(pieces) < 2 or self.skips_frames:
            return
        numbers = []
        parts = []
        for piece in pieces:
            first_number = int(self.frames[piece.start])
            last_number = int(self.frames[piece.stop - 1])
            numbers.append(f"{first_number}:{last_number + 1}")
            parts.append(f"{first + piece.start}:{first + piece.stop}")
        raise DataError(
            f"{self.name} has the frames {', '.join(numbers)} with a gap between, and no motion leads across "
            f"a gap: choose --frames {' or '.join(parts)}, counted from 0"
        )

    @property
    def truth_name(self) -> str:
        """The truth's file in short: poses.txt in the sequence's folder, poses/00.txt in KITTI's, else ""."""
        if self.truth_file is None:
            return ""
        name = self.truth_file.name
        return name if self.truth_file.parent == self.folder else f"poses/{name}"

    @property
    def true_poses(self) -> Array:
        """`truth`, for what is nothing without it; raises `DataError` if the sequence has none."""
        if self.truth is None:
            raise DataError(f"{self.name} has no ground truth: choose a sequence with a ground truth")
        return self.truth

    def stereo(self, index: int) -> tuple[Image, Image]:
        """Left and right image of a frame, (H, W) uint8; a `DataError` names an unusable image."""
        _, right = self.sides
        right_file = self.folder / right / f"{self.frames[index]}.png"
        return self.left(index), self._image(right_file)

    def left(self, index: int) -> Image:
        """Left image of a frame, (H, W) uint8; a `DataError` names an unusable image."""
        return self._image(self.left_file(self.frames[index]))

    def left_file(self, frame: str) -> Path:
        """The file of a frame's left image, by the frame's file stem."""
        left, _ = self.sides
        return self.folder / left / f"{frame}.png"

    def notes(self) -> list[str]:
        """Sentences on images that are not grey images of 8 bits."""
        notes = []
        if self.sides == COLOUR:
            folders = " and ".join(COLOUR)
            matrices = " and ".join(projection_names(COLOUR))
            only = "there are only colour images"
            notes.append(f"{only}: {folders} are read as grey, with {matrices} of calib.txt")
        if self.bits > IMAGE_BITS:
            notes.append(bits_note(self.bits))
        return notes

    def _image(self, path: Path) -> Image:
        """An image (H, W) uint8; `DataError` for one of another size."""
        image = read_image(path, self.bits)
        self._require_size(path, image)
        return image

    def _require_size(self, path: Path, image: Image) -> None:
        """Raise `DataError` for an image or mask (H, W) of another size than the camera's images."""
        height, width = image.shape
        camera = self.camera
        if (height, width) != (camera.height, camera.width):
            expected = f"expected {camera.width}×{camera.height} as in the first left image"
            raise DataError(f"the image is {width}×{height}, {expected}", path)

    def mask_files(self) -> list[Path]:
        """The mask of each frame, or one mask for all; empty without masks."""
        if self.masks is None:
            return []
        if self.masks.is_dir():
            return [self.masks / f"{frame}.png" for frame in self.frames]
        return [self.masks]

    def mask_images(self) -> Iterator[Image]:
        """The masks of all frames in order, empty without masks; one common mask is repeated endlessly."""
        if self.masks is None or self.masks.is_dir():
            return map(self._mask, self.mask_files())
        return itertools.repeat(self._mask(self.masks))

    def mask(self, index: int) -> Image | None:
        """Mask of a frame, (H, W) uint8, 0 or 255, None without masks; `DataError` for an unusable one."""
        if self.masks is None:
            return None
        if self.masks.is_dir():
            return self._mask(self.masks / f"{self.frames[index]}.png")
        return self._mask(self.masks)

    def _mask(self, path: Path) -> Image:
        """A mask (H, W) uint8, 0 or 255; `DataError` for one of another size."""
        mask = read_mask(path)
        self._require_size(path, mask)
        return mask

    def labelled_boxes(self, index: int) -> Boxes:
        """Boxes of all classes in a frame's label file, with the file's numbers; none if it is missing."""
        if self.labels is None:
            return no_boxes()
        path = self.labels / f"{self.frames[index]}.txt"
        if not path.exists():
            return no_boxes()
        return read_labels(path, self.camera.width, self.camera.height)

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

    def refuse_other_numbers(self, classes: tuple[str, ...]) -> None:
        """Raise `ClassesError` if the label folder names no classes and no box has a chosen number.

        Then the numbers are probably not COCO's. A folder without boxes is not refused. Raises also as
        `ClassNames.choose`.
        """
        if self.labels is None:
            return
        names = read_class_names(self.labels)
        choice = names.choose(classes)
        if names.names:
            return
        files = label_files(self.labels)
        for path in files:  # mostly, the first file has a chosen box, and the others need not be read
            if choice.kinds.keys() & count_labels([path]).boxes.keys():
                return
        counts = count_labels(files).boxes
        if counts:
            raise no_chosen_box(counts, choice, self.labels)

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
    if start < 0 or stop > count or stop - start < 2:
        raise DataError(f"frames {start}:{stop}: expected two or more frames of {name}, which has 0:{count}")


def at_pixels(picture: NDArray[Any], uv: Array) -> NDArray[Any]:
    """Values (N,) of a picture (H, W) at the pixels nearest to uv (N, 2) and inside; NaN counts as 0."""
    height, width = picture.shape
    inside = np.clip(np.nan_to_num(uv), 0, [width - 1, height - 1])
    column, row = np.rint(inside).astype(np.intp).T
    return np.asarray(picture[row, column])


def open_folder(folder: Path, name: str, labels: str | Path | None = None) -> Sequence:
    """The sequence in a folder in KITTI's layout.

    Of images with 8 bits, only the first left one is read, and the header of the first right one; with more
    bits, all are, as in `grey_bits`.

    labels : folder of YOLO label files; by default `labels` in the sequence's folder, if it exists.

    Raises `DataError` with the file at fault and the expected content.
    """
    frames = list_frames(folder)
    left, right = image_folders(folder)
    if len(frames) < 2:
        raise DataError(f"expected two or more stereo pairs, found {len(frames)}", folder / left)
    left_files = [folder / left / f"{frame}.png" for frame in frames]
    right_files = [folder / right / f"{frame}.png" for frame in frames]
    bits = grey_bits([left_files, right_files])
    height, width = read_image(left_files[0], bits).shape
    camera = read_calibration(folder / "calib.txt", width, height, (left, right))
    times_file = folder / "times.txt"
    truth_file = find_truth(folder)
    return Sequence(
        name=name,
        folder=folder,
        frames=tuple(frames),
        camera=camera,
        times=_rows_of_frames(read_times(times_file), frames, times_file),
        truth=None if truth_file is None else _read_truth(truth_file, folder, frames, (left, right)),
        truth_file=truth_file,
        labels=_find_labels(folder, frames, labels),
        is_part=(folder / PART).exists() or len(frames) < EXPECTED_FRAMES.get(folder.name, 0),
        sides=(left, right),
        bits=bits,
    )


def _rows_of_frames(rows: Array, frames: list[str], path: Path) -> Array:
    """The rows of these frames, from a table of only these frames or of the whole sequence.

    Raises `DataError` if the table has too few rows.
    """
    if len(rows) == len(frames):
        return rows
    numbers = [int(frame) for frame in frames]
    if len(rows) > numbers[-1]:
        return rows[numbers]
    raise DataError(f"{len(rows)} rows for {len(frames)} frames: expected one row per frame", path)


def _read_truth(path: Path, folder: Path, frames: list[str], sides: tuple[str, str]) -> Array:
    """True poses T_w_c (N, 4, 4) of the left camera, metres, from the file of `find_truth`."""
    poses = _rows_of_frames(read_kitti_poses(path), frames, path)
    if sides == GREY:
        return poses
    # The file has poses of camera 0, in a world that is camera 0 in frame 0. The camera becomes the left
    # colour camera, and so does the world.
    T_0_left = rigid(np.eye(3), left_offset(folder / "calib.txt", sides))
    return inverse(T_0_left) @ poses @ T_0_left


def _find_labels(folder: Path, frames: list[str], named: str | Path | None) -> Path | None:
    """The label folder that a person named, or `labels` in the sequence's folder; None if there is none.

    Raises `DataError` if the named folder is missing or has no label of a frame, and if the labels of the
    default folder are those of other frames.
    """
    path = folder / "labels" if named is None else Path(named)
    if not path.is_dir():
        if named is None:
            return None
        raise DataError("the label folder is missing", path)
    stems = label_stems(path)
    if not stems and named is None:
        return None
    if stems.isdisjoint(frames):
        raise DataError(f"no label file is named after a frame: expected names such as {frames[0]}.txt", path)
    return path
