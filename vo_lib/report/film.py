"""A film of a run, ten frames per second: features, boxes, the path and its distance from the truth."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..data.poses import from_first
from ..errors import DataError
from ..evaluation.kitti_errors import trajectory_distances
from ..files import DRAFT, open_binary
from ..geometry.matches import StereoMatches
from ..geometry.result import FrameResult
from ..geometry.types import Array, Image
from ..paper.box_removal import Removal
from ..runs.drive import MethodRun, Run, frames
from ..runs.folder import is_finished
from ..runs.front_end import TimedMatches
from . import plots
from .table1 import PROPOSAL

if TYPE_CHECKING:
    from ..kit.calibration import Calibration

FILM_FPS = 10
FILM_ENDING = ".mp4"
FILM_CODEC = cv2.VideoWriter.fourcc(*"vp09")  # VP9 plays in browsers, JupyterLab and VS Code
# OpenCV passes no options to the encoder. At a low frame rate, a frame takes 100 kB; only OpenCV's limit of
# bits per second reduces the size. So frames are encoded at this high rate, and then copied into the film.
ENCODER_FPS = 5000
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_SCALE = 0.6
# At the end of a film, a box that players skip: it shows that the kit may replace the film.
FILM_MARK = b"\0\0\0\x15free" + b"stereo-vo-kit"
MIN_PATH_SIDE_PX = 300  # side of the square with the path
LINE_HEIGHT_PX = 26  # height of a line of text
WORDS_HEIGHT_PX = 88  # height of the text at the top
# Wide enough for a film at half size: the truth is a thin line on the path.
PATH_WIDTH_PX = 9
LINE_WIDTH_PX = 3  # width of the truth and of loops
Pairs = Sequence[tuple[int, int]]
WHITE = (255, 255, 255)  # BGR
PALE = (200, 200, 200)
TRUE_PATH_COLOUR = plots.bgr(plots.TRUTH_COLOUR)
LOOP_LINE_COLOUR = plots.bgr(plots.LOOP_COLOUR)


@dataclass(frozen=True, eq=False)
class FilmFrame:
    """A frame of a film: its matches, what the box rule did to them, and the motion."""

    index: int
    matches: StereoMatches
    removal: Removal
    motion: FrameResult


def film_frames(
    run: Run, matches: Iterable[TimedMatches] | None = None, calibration: Calibration | None = None
) -> Iterator[FilmFrame]:
    """The film frames of a finished run, computed again, without frame 0; arguments as in `run_methods`."""
    method = MethodRun(run.sequence, run.config, calibration)
    for frame in frames(run.sequence, run.config, matches):
        if frame.index == 0:
            method.start(frame)
        else:
            result = method.step(frame)
            yield FilmFrame(frame.index, frame.matches, result.removal, result.motion)


def refuse_foreign_film(path: Path) -> None:
    """Raise `DataError` if a file with the name of a new film exists, and the kit did not write it."""
    if not os.path.lexists(path) or is_finished(path.parent):
        return
    with open_binary(path) as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(file.tell() - len(FILM_MARK), 0))
        if file.read() != FILM_MARK:
            raise DataError("is not a film of the kit: choose another name for the film", path)


class Film:
    """A video file of a run's frames; the complete file appears at the end of the context.

    `loops` : pairs of frames at one place; a pair is drawn from its second frame on. `method` : name of the
    method, for the colour of the path.
    """

    def __init__(self, path: Path, run: Run, label: str, loops: Pairs = (), method: str = PROPOSAL):
        refuse_foreign_film(path)
        self.path = path
        self.run = run
        self.label = label
        self.loops = loops
        self._colour = plots.bgr(plots.METHOD_COLOURS.get(method, plots.METHOD_COLOURS[PROPOSAL]))
        camera = run.sequence.camera
        side = max(camera.height, MIN_PATH_SIDE_PX)
        # Encoders require even numbers of pixels.
        self._shape = (side + WORDS_HEIGHT_PX + side % 2, (camera.width + side + 1) // 2 * 2)
        self._paths = [run.poses]
        self._drift = None
        truth = run.sequence.truth
        if truth is not None:
            self._paths.append(from_first(truth))
            self._drift = plots.distance_from_truth(run.poses, truth)
        self._driven = trajectory_distances(self._paths[-1])
        self._drafts = [path.with_name(f".{path.stem}.{os.getpid()}{k}{DRAFT}{FILM_ENDING}") for k in "ab"]
        self._writer = self._open(self._drafts[0], ENCODER_FPS)
        if not self._writer.isOpened():
            raise DataError("the film cannot be written: no write access, or no VP9 encoder", self.path)
        self._count = 0

    def __enter__(self) -> Film:
        return self

    def __exit__(self, kind: object, *details: object) -> None:
        self._writer.release()
        try:
            if kind is None and self._count:
                self._copy_at_film_rate()
                os.replace(self._drafts[1], self.path)
        finally:
            for draft in self._drafts:
                draft.unlink(missing_ok=True)

    def _open(self, path: Path, fps: int, *options: int) -> cv2.VideoWriter:
        return cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, FILM_CODEC, fps, self._shape[::-1], options)

    def _copy_at_film_rate(self) -> None:
        """Copy the encoded frames from the first draft into the second draft, without coding them again."""
        packets = cv2.VideoCapture(str(self._drafts[0]), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
        options = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1]
        # By default, OpenCV marks every frame as a key frame.
        options += [cv2.VIDEOWRITER_PROP_KEY_INTERVAL, 10**9]
        writer = self._open(self._drafts[1], FILM_FPS, *options)
        while packets.grab():
            writer.set(cv2.VIDEOWRITER_PROP_KEY_FLAG, packets.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME))
            writer.write(packets.retrieve()[1])
        packets.release()
        writer.release()
        with open(self._drafts[1], "ab") as file:
            file.write(FILM_MARK)
        # OpenCV reports no error of writing.
        if cv2.VideoCapture(str(self._drafts[1])).get(cv2.CAP_PROP_FRAME_COUNT) != self._count:
            raise DataError("the film cannot be written: is the disk full?", self.path)

    def add(self, frame: FilmFrame) -> None:
        """Write a frame."""
        self._writer.write(self.picture(frame))
        self._count += 1

    def picture(self, frame: FilmFrame) -> Image:
        """The picture of a frame, BGR: text (at the top, clear of a player's controls), image and path."""
        page = np.full((*self._shape, 3), WHITE, np.uint8)
        left, _ = self.run.sequence.stereo(frame.index)
        removal = frame.removal
        image = plots.match_image(
            left, frame.matches, removal.kept, removal.boxes, removal.state, by_age=True
        )
        height, width = left.shape
        page[WORDS_HEIGHT_PX : WORDS_HEIGHT_PX + height, :width] = image
        self._draw_paths(page[WORDS_HEIGHT_PX:, width:], frame.index)
        self._write_words(page[:WORDS_HEIGHT_PX], frame)
        return page

    def _draw_paths(self, part: Image, index: int) -> None:
        """Draw the path up to a frame, and the complete truth in a pale colour, both seen from above."""
        points = [poses[:, [0, 2], 3] for poses in self._paths]
        low = np.concatenate(points).min(axis=0)
        high = np.concatenate(points).max(axis=0)
        size = np.array(part.shape[1::-1])
        scale = float(((size - 50.0) / np.maximum(high - low, 1.0)).min())
        path, *truth = [scale * (xz - (low + high) / 2) * [1.0, -1.0] + size / 2 for xz in points]
        _draw_line(part, path[: index + 1], self._colour, PATH_WIDTH_PX)
        for line in truth:
            _draw_line(part, line, PALE, LINE_WIDTH_PX)
            _draw_line(part, line[: index + 1], TRUE_PATH_COLOUR, LINE_WIDTH_PX)
        for first, second in self.loops:
            if second <= index:
                _draw_line(part, path[[first, second]], LOOP_LINE_COLOUR, LINE_WIDTH_PX)
        here = np.rint(path[index]).astype(int).tolist()
        cv2.circle(part, here, PATH_WIDTH_PX, self._colour, -1, cv2.LINE_AA)

    def _write_words(self, part: Image, frame: FilmFrame) -> None:
        index = frame.index
        sequence = self.run.sequence
        driven = self._driven[index]
        progress = [
            self.label,
            f"frame {sequence.frames[index]}",
            f"{sequence.times[index] - sequence.times[0]:.1f} s",
            f"{driven:.0f} m driven",
        ]
        if self._drift is not None:
            drift = self._drift[index]
            progress.append(f"{drift:.2f} m from the truth ({100 * drift / max(driven, 1e-9):.2f} %)")
        motion = frame.motion
        counts = [
            f"{motion.matches} matches",
            f"{motion.removed} removed",
            f"{motion.used} used after bucketing",
            f"{motion.inliers} inliers",
        ]
        _write(part, "  ".join([*progress, *motion.flags]), (12, LINE_HEIGHT_PX))
        _write(part, "  ".join(counts), (12, 2 * LINE_HEIGHT_PX))
        new, *_, old = plots.AGE_COLOURS
        legend = [("new match", new), ("old", old), ("removed", plots.REMOVED), ("path", self._colour)]
        if self._drift is not None:
            legend += [("truth", TRUE_PATH_COLOUR), ("truth ahead", PALE)]
        if self.loops:
            closed = sum(second <= index for _, second in self.loops)
            legend.append((f"{closed} loops", LOOP_LINE_COLOUR))
        if frame.removal.state is not None:
            legend.append(("boxes: solid moving, dashed parked, dotted unknown", WHITE))
        column = 17
        for text, colour in legend:
            cv2.circle(part, (column, 3 * LINE_HEIGHT_PX - 6), 5, colour, -1, cv2.LINE_AA)
            column = _write(part, text, (column + 10, 3 * LINE_HEIGHT_PX)) + 20


def _draw_line(part: Image, points: Array, colour: tuple[int, int, int], width: int) -> None:
    fixed = np.rint(points * 16).astype(np.int32)  # OpenCV's fixed-point format, four binary digits
    cv2.polylines(part, [fixed], False, colour, width, cv2.LINE_AA, shift=4)


def _write(part: Image, text: str, at: tuple[int, int]) -> int:
    """Write a line of text and return the column of its end, pixels."""
    cv2.putText(part, text, at, FONT, FONT_SCALE, (0, 0, 0), 1, cv2.LINE_AA)
    (width, _), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    return at[0] + width
