"""Sequences: KITTI-layout folders found by name or by path, read a stereo pair at a time."""

from __future__ import annotations

import dataclasses
import functools
import os
import re
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..beyond.calibration import Calibration
from ..core.boxes import Boxes, no_boxes
from ..core.camera import StereoCamera
from ..core.errors import DataError
from ..core.matches import StereoMatches
from ..core.poses import read_kitti_poses
from ..core.types import Array, Image, Mask, Progress
from .drawn import ensure_scene
from .kitti import list_frames, read_calibration, read_image, read_times
from .labels import read_labels, require_written, written_labels
from .scenes import SCENES
from .truth import open_truth

Prepared = TypeVar("Prepared")

SYNTHETIC = "synthetic/"
PROCESSES = min(os.cpu_count() or 1, 4)  # at once, where nobody is asked how many
KITTI = "kitti/"
PROJECT = Path(__file__).resolve().parents[2]
SMALLEST = 32  # pixels of an image's side: OpenCV's windows need some


@dataclass(frozen=True)
class Sequence:
    """A stereo sequence of N frames in a KITTI-layout folder. Images are read when asked for.

    Attributes
    ----------
    name : as a person would call it, "kitti/07" or the folder's name.
    folder : where image_0, image_1 and calib.txt are.
    frames : (N) file names without ending, in order.
    camera : with the image size.
    times : (N,) seconds.
    truth : (N, 4, 4) ground-truth poses T_w_c, or None.
    labels : folder of YOLO label files, or None.
    calibration : what is known of the cameras' errors besides calib.txt, for the kit's own way; or None.
    wait : returns when the label file of a frame, by its name, is written; or None: the labels are there.
    labels_identity : what decides the boxes where `wait` is given; None: the label files as they are.
    """

    name: str
    folder: Path
    frames: tuple[str, ...]
    camera: StereoCamera
    times: Array
    truth: Array | None
    labels: Path | None
    calibration: Calibration | None = None
    wait: Callable[[str], None] | None = None
    labels_identity: str | None = None

    def __len__(self) -> int:
        return len(self.frames)

    def stereo(self, index: int) -> tuple[Image, Image]:
        """Left and right image of a frame, (H, W) uint8; `DataError` names an image that cannot be used."""
        size = (self.camera.height, self.camera.width)
        images = []
        for side in ("image_0", "image_1"):
            path = self.folder / side / f"{self.frames[index]}.png"
            image = read_image(path)
            if image.shape != size:
                found, expected = f"{image.shape[1]}×{image.shape[0]}", f"{size[1]}×{size[0]}"
                raise DataError(f"the image is {found}, expected {expected} as the first left image", path)
            images.append(image)
        return images[0], images[1]

    def boxes(self, index: int) -> Boxes:
        """Labelled boxes of a frame's left image; none where there is no label file."""
        if self.labels is None:
            return no_boxes()
        path = self.labels / f"{self.frames[index]}.txt"
        if self.wait is None:
            require_written(path, self._written)
        else:
            self.wait(self.frames[index])
        return read_labels(path, self.camera.width, self.camera.height) if path.exists() else no_boxes()

    @functools.cached_property
    def _written(self) -> dict[str, str]:
        """The label files as a detector wrote them."""
        assert self.labels is not None
        return written_labels(self.labels)

    def on_moving(self, index: int, matches: StereoMatches) -> Mask:
        """Which matches (N,) of a drawn frame with the one before are on things that move, shadows too.

        Raises `DataError` where the sequence is not drawn: nothing but a drawing knows this.
        """
        try:
            truth = _drawn_truth(self.folder)
        except DataError:
            raise DataError(
                f"{self.name} has no truth of what moves: the box rule `truth` is for drawn scenes",
                self.folder,
            ) from None
        before, now = int(self.frames[index - 1]), int(self.frames[index])
        previous = truth.is_moving(before, matches.prev_left, now)
        return np.asarray(previous | truth.is_moving(now, matches.cur_left, before))

    def part(self, start: int, stop: int) -> Sequence:
        """The frames start … stop - 1; `DataError` unless these are two frames or more of the sequence."""
        if not (0 <= start < stop <= len(self)) or stop - start < 2:
            raise DataError(
                f"frames {start}:{stop}: expected two frames or more of 0:{len(self)}, which {self.name} has"
            )
        return dataclasses.replace(
            self,
            frames=self.frames[start:stop],
            times=self.times[start:stop],
            truth=None if self.truth is None else self.truth[start:stop],
        )


_drawn_truth = functools.lru_cache(maxsize=4)(open_truth)


def stereo_ahead(
    sequence: Sequence, prepare: Callable[[tuple[Image, Image]], Prepared], ahead: int = 4
) -> Iterator[Prepared]:
    """What `prepare` makes of each stereo pair, in order; in threads, a few frames ahead."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        waiting: deque[Future[Prepared]] = deque()
        for index in range(len(sequence) + ahead):
            if index < len(sequence):
                waiting.append(pool.submit(lambda i: prepare(sequence.stereo(i)), index))
            if index >= ahead:
                yield waiting.popleft().result()


def kitti_roots() -> list[Path]:
    """Where KITTI is looked for: KITTI_ROOT, then data/kitti here and beside the package."""
    places = [os.environ.get("KITTI_ROOT", ""), "data/kitti", str(PROJECT / "data" / "kitti")]
    # The archives unpack to a folder `dataset`; both it and its parent are accepted.
    roots = [Path(place, inner).resolve() for place in places if place for inner in ("", "dataset")]
    return [root for root in dict.fromkeys(roots) if (root / "sequences").is_dir()]


def kitti_root() -> Path:
    """The KITTI folder that the kit uses: the first one found, else where one would be made."""
    return next(iter(kitti_roots()), Path(os.environ.get("KITTI_ROOT") or PROJECT / "data" / "kitti"))


def available() -> dict[str, Path | None]:
    """Sequences by name with their folders; None for a synthetic scene, which is drawn on first use."""
    found: dict[str, Path | None] = {f"{SYNTHETIC}{name}": None for name in SCENES}
    for root in kitti_roots():
        for folder in sorted((root / "sequences").iterdir()):
            if (folder / "image_0").is_dir():
                found.setdefault(f"{KITTI}{folder.name}", folder)
    return found


def parse_sequences(text: str) -> list[str]:
    """Names or paths of "00,02-10,synthetic/jam,some/folder"; numbers mean KITTI sequences."""
    names: list[str] = []
    for item in text.split(","):
        numbers = re.fullmatch(r"(\d\d)(?:-(\d\d))?", item)
        if numbers is None:
            names.append(item)
            continue
        first, last = int(numbers[1]), int(numbers[2] or numbers[1])
        if last < first:
            raise DataError(f"--sequences {item}: expected a range that rises")
        names += [f"{KITTI}{number:02d}" for number in range(first, last + 1)]
    if not all(names):
        raise DataError(f"--sequences {text!r}: expected names separated by commas")
    return names


def _find_folder(name: str, cache: Path | None, progress: Progress | None) -> Path:
    """Folder of a sequence by its name; a synthetic scene is drawn where it is not in the cache."""
    if name.startswith(SYNTHETIC):
        return ensure_scene(name.removeprefix(SYNTHETIC), cache, progress, jobs=PROCESSES)
    found = available().get(name)
    if found is None and name.startswith(KITTI):
        roots = ", ".join(map(str, kitti_roots())) or "no folder: set KITTI_ROOT or make data/kitti"
        raise DataError(f"the sequence {name} was not found; looked in {roots}")
    if found is None:
        raise DataError("the folder is missing: expected a KITTI folder or a name from `vo list`", name)
    return found


def open_sequence(
    where: str | Path,
    labels: str | Path | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """A sequence by name ("kitti/07", "synthetic/traffic") or by the path of a KITTI-layout folder.

    Everything that can be seen without decoding all images is checked here; `DataError` names the file and
    what was expected.

    Parameters
    ----------
    labels : folder of YOLO label files; by default `labels` in the sequence's folder, if there.
    cache : folder that keeps synthetic scenes; by default the user's cache folder.
    progress : called while a synthetic scene is drawn.
    """
    folder, name = Path(where), str(where)
    if folder.is_dir():
        name = folder.resolve().name
    else:
        folder = _find_folder(name, cache, progress)
    frames = list_frames(folder)
    if len(frames) < 2:
        raise DataError(f"expected two stereo pairs or more, found {len(frames)}", folder / "image_0")
    path = folder / "image_0" / f"{frames[0]}.png"
    first = read_image(path)
    if min(first.shape) < SMALLEST:
        raise DataError(
            f"the image is {first.shape[1]}×{first.shape[0]}, expected {SMALLEST}×{SMALLEST} px or more", path
        )
    camera = read_calibration(folder / "calib.txt", first.shape[1], first.shape[0])
    times = folder / "times.txt"
    if not times.exists():
        raise DataError("the file is missing: expected the seconds of each frame, one number a line", times)
    return Sequence(
        name=name,
        folder=folder,
        frames=tuple(frames),
        camera=camera,
        times=_rows_of_frames(read_times(times), frames, times),
        truth=_find_truth(folder, frames),
        labels=_find_labels(folder, frames, labels),
    )


def _rows_of_frames(rows: Array, frames: list[str], path: Path) -> Array:
    """A row for each frame: all rows in order, or, where the images are a part, the rows of their numbers."""
    if len(rows) == len(frames):
        return rows
    if len(rows) > int(frames[-1]):
        return rows[[int(frame) for frame in frames]]
    raise DataError(f"{len(rows)} rows for {len(frames)} frames: expected one row a frame", path)


def _find_truth(folder: Path, frames: list[str]) -> Array | None:
    beside = folder.resolve().parent.parent / "poses" / f"{folder.resolve().name}.txt"
    for path in (folder / "poses.txt", beside):
        if path.exists():
            return _rows_of_frames(read_kitti_poses(path), frames, path)
    return None


def _find_labels(folder: Path, frames: list[str], labels: str | Path | None) -> Path | None:
    path = folder / "labels" if labels is None else Path(labels)
    if not path.is_dir():
        if labels is not None:
            raise DataError("the label folder is missing", path)
        return None
    stems = {p.stem for p in path.glob("*.txt")}
    if not stems & set(frames) and (stems or labels is not None):
        raise DataError(f"no label file is named after a frame: expected names such as {frames[0]}.txt", path)
    return path
