"""A film of a run: features, boxes, the path and how far it strays, ten frames a second, drawn by OpenCV."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.boxes import Boxes
from ..core.errors import DataError
from ..core.files import claim
from ..core.frame import FrameResult
from ..core.matches import SAME, StereoMatches
from ..core.poses import from_first
from ..core.types import Array, Image, Mask
from ..evaluation.kitti import trajectory_distances
from ..method.boxes import on_vehicles
from ..runs.runner import FoundMatches, MethodRun, Run, TimedMatches, single_threaded
from .plots import AGE_COLOURS, REMOVED, distance_from_truth, match_image

FPS = 10
CODES = {".mp4": "mp4v", ".avi": "MJPG"}
NARROW = 800  # pixels; smaller images are shown at twice their size
STRIP = 60  # pixels, the lines of words below
DARK, PALE, WHITE, TRUTH, PATH = (28, 28, 28), (110, 110, 110), (235, 235, 235), (60, 60, 240), (240, 190, 80)


@dataclass(frozen=True)
class Shown:
    """What is seen of a frame but the first: N matches, which of them boxes left (N,), boxes and their state.

    `state` : (K,) as `box_tracks` has it, None where nothing judges boxes.
    """

    index: int
    matches: StereoMatches
    keep: Mask
    boxes: Boxes
    state: NDArray[np.int64] | None
    motion: FrameResult


def shown_frames(run: Run, matches: Iterable[TimedMatches] | None = None) -> Iterator[Shown]:
    """The frames of a finished run, gone through once more; `matches` as in `run_methods`."""
    sequence, config = run.sequence, run.config
    method = MethodRun(sequence, config)
    with single_threaded():
        found = FoundMatches(sequence, config.features, config.matching) if matches is None else matches
        before = sequence.boxes(0)
        for index, frame in enumerate(found):
            boxes = sequence.boxes(index)
            method.step(index, frame, boxes)
            if index == 0:
                continue
            filtered = getattr(method.odometry, "filtered", None)  # the paper's own keeps nothing to show
            if filtered is not None and frame[0] is not SAME:
                judged = filtered.judgement
                keep, state = filtered.keep, None if judged is None else judged.state
                shown = boxes if judged is None else judged.boxes
            else:
                keep, state, shown = np.ones(len(frame[0]), np.bool_), None, boxes
                if config.filter.rule != "none":
                    keep = ~on_vehicles(frame[0], before, boxes, config.filter)
            before = boxes
            yield Shown(index, frame[0], keep, shown, state, method.motions[-1])


class Film:
    """A video file that frames of a run are added to; it appears whole when it is closed, or not at all."""

    def __init__(self, path: Path, run: Run, label: str):
        self.path, self.run, self.label = path, run, label
        camera, truth = run.sequence.camera, run.sequence.truth
        zoom = 2 if camera.width < NARROW else 1
        self._size = zoom * camera.width, zoom * camera.height
        side = max(self._size[1], 300)
        # Even numbers of pixels: encoders take no others.
        self._shape = side + STRIP + side % 2, (self._size[0] + side + 1) // 2 * 2
        self._paths = [run.poses] if truth is None else [run.poses, from_first(truth)]
        self._drift = None if truth is None else distance_from_truth(run.poses, truth)
        self._driven = trajectory_distances(self._paths[-1])
        self._frames = 0
        self._working = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
        code = cv2.VideoWriter.fourcc(*CODES[path.suffix.lower()])
        self._writer = cv2.VideoWriter(str(self._working), code, FPS, self._shape[::-1])
        if not self._writer.isOpened():
            raise DataError("the film cannot be written there, or OpenCV lacks its encoder", path)

    def __enter__(self) -> Film:
        return self

    def __exit__(self, kind: object, *details: object) -> None:
        self._writer.release()
        try:
            if kind is None:
                self._require_whole()
                claim(self.path)
                os.replace(self._working, self.path)
        finally:
            self._working.unlink(missing_ok=True)

    def _require_whole(self) -> None:
        """OpenCV does not say when the disk is full: the frames are counted that can be read again."""
        written = cv2.VideoCapture(str(self._working))
        found = sum(written.grab() for _ in range(self._frames))
        written.release()
        if found != self._frames:
            said = f"{found} of {self._frames} frames could be written: is the disk full?"
            raise DataError(said, self.path)

    def add(self, shown: Shown) -> None:
        """Write a frame."""
        self._writer.write(self.picture(shown))
        self._frames += 1

    def picture(self, shown: Shown) -> Image:
        """The page of a frame, BGR: image, the path beside it, words below."""
        page = np.full((*self._shape, 3), DARK, np.uint8)
        left, _ = self.run.sequence.stereo(shown.index)
        image = match_image(left, shown.matches, shown.keep, shown.boxes, shown.state, by_age=True)
        width, height = self._size
        page[:height, :width] = cv2.resize(image, self._size, interpolation=cv2.INTER_LINEAR)
        self._draw_paths(page[:-STRIP, width:], shown.index)
        self._write_words(page[-STRIP:], shown)
        return page

    def _draw_paths(self, part: Image, index: int) -> None:
        """The path from above up to a frame, the whole truth pale; all of it fits."""
        points = [poses[:, [0, 2], 3] for poses in self._paths]
        low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
        size = np.array(part.shape[1::-1])
        scale = float(((size - 50.0) / np.maximum(high - low, 1.0)).min())
        path, *truth = (scale * (each - (low + high) / 2) * [1.0, -1.0] + size / 2 for each in points)
        for line in truth:
            _line(part, line, PALE, 1)
            _line(part, line[: index + 1], TRUTH, 4)
        _line(part, path[: index + 1], PATH, 2)
        cv2.circle(part, np.rint(path[index]).astype(int).tolist(), 4, WHITE, -1, cv2.LINE_AA)

    def _write_words(self, part: Image, shown: Shown) -> None:
        index, motion = shown.index, shown.motion
        times, driven = self.run.sequence.times, self._driven[index]
        speed = np.linalg.norm(motion.T_cp[:3, 3]) / max(times[index] - times[index - 1], 1e-9)
        first = [self.label, f"frame {self.run.sequence.frames[index]}", f"{times[index] - times[0]:.1f} s"]
        first += [f"{3.6 * speed:.0f} km/h", f"{driven:.0f} m driven"]
        if self._drift is not None:
            off = self._drift[index]
            first.append(f"{off:.2f} m from the truth ({100 * off / max(driven, 1e-9):.2f} %)")
        _words(part, "  ".join([*first, *motion.flags]), (12, 22))
        counts = [f"{getattr(motion, name)} {name}" for name in ("matches", "removed", "used", "inliers")]
        legend = [("  ".join(counts), WHITE), ("new match", AGE_COLOURS[0]), ("old", AGE_COLOURS[-1])]
        legend += [("removed", REMOVED), ("path", PATH), ("truth", TRUTH)][: 2 + (self._drift is not None)]
        if shown.state is not None:
            legend.append(("boxes: whole line moves, dashed parked, dots unknown", WHITE))
        at = 12
        for text, colour in legend:
            at = _words(part, text, (at, 46), colour) + 20


def _line(part: Image, points: Array, colour: tuple[int, int, int], width: int) -> None:
    fixed = np.rint(points * 16).astype(np.int32)  # four binary digits, as OpenCV takes them
    cv2.polylines(part, [fixed], False, colour, width, cv2.LINE_AA, shift=4)


def _words(part: Image, text: str, at: tuple[int, int], colour: tuple[int, int, int] = WHITE) -> int:
    """Write a line of words; returns where it ends, pixels."""
    cv2.putText(part, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    return at[0] + cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)[0][0]
