"""A film of a run, ten frames per second: features, boxes, the path and its distance from the truth."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..data.poses import from_first
from ..errors import DataError
from ..evaluation.kitti_errors import trajectory_distances
from ..files import open_binary
from ..geometry.matches import StereoMatches
from ..geometry.result import FrameResult
from ..geometry.types import Array, Image
from ..paper.box_removal import Removal
from ..runs.drive import MethodRun, Run, frames
from ..runs.folder import is_finished
from ..runs.front_end import TimedMatches
from . import plots
from .table1 import PROPOSAL
from .webm import FILM_MARK, webm_file

if TYPE_CHECKING:
    from ..kit.calibration import Calibration

FILM_FPS = 10
FILM_ENDING = ".webm"
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_SCALE = 0.6
# Wider images are made smaller: with the path beside it, a film then fits the width of a report.
MAX_IMAGE_WIDTH_PX = 1000
MIN_PATH_SIDE_PX = 300  # side of the square with the path
MAP_MARGIN_PX = 25  # between the path and the edge of its square
LINE_HEIGHT_PX = 26  # height of a line of text
WORDS_HEIGHT_PX = 88  # height of the text at the top
# Wide enough for a film at half size: the truth is a thin line on the path.
PATH_WIDTH_PX = 9
LINE_WIDTH_PX = 3  # width of the truth and of loops
Pairs = Sequence[tuple[int, int]]
BLACK = (0, 0, 0)  # BGR
WHITE = (255, 255, 255)
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


def removal_image(run: Run, calibration: Calibration | None = None) -> tuple[int, Image] | None:
    """The frame of which a run removed the most features, and its image with boxes and features, BGR.

    Its matches are computed again from this frame and the one before. None if the run removed no feature.
    """
    removed = [motion.removed for motion in run.motions]
    if max(removed, default=0) == 0:
        return None
    index = removed.index(max(removed)) + 1  # the first motion leads to frame 1
    pair = replace(run, sequence=run.sequence.part(index - 1, index + 1))
    (frame,) = film_frames(pair, calibration=calibration)
    removal = frame.removal
    left = pair.sequence.left(frame.index)
    return index, plots.match_image(left, frame.matches, removal.kept, removal.boxes, removal.state)


def refuse_foreign_film(path: Path) -> None:
    """Raise `DataError` for a name without the ending of films, or of a file that the kit did not write."""
    if path.suffix.lower() != FILM_ENDING:
        raise DataError(f"expected the name of a film to end in {FILM_ENDING}", path)
    if not os.path.lexists(path) or is_finished(path.parent):
        return
    with open_binary(path) as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(file.tell() - len(FILM_MARK), 0))
        if file.read() != FILM_MARK:
            raise DataError("is not a film of the kit: choose another name for the film", path)


def poster(path: Path) -> bytes:
    """The picture in the middle of a film as JPEG, shown until it is played; empty for a damaged film."""
    video = cv2.VideoCapture(str(path))
    video.set(cv2.CAP_PROP_POS_FRAMES, video.get(cv2.CAP_PROP_FRAME_COUNT) // 2)
    found, picture = video.read()
    video.release()
    return plots.jpeg(np.asarray(picture, np.uint8)) if found else b""


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
        self._scale = min(1.0, MAX_IMAGE_WIDTH_PX / camera.width)
        self._image_size = (round(self._scale * camera.width), round(self._scale * camera.height))
        width, height = self._image_size
        side = max(height, MIN_PATH_SIDE_PX)
        # Encoders require even numbers of pixels.
        self._shape = (side + WORDS_HEIGHT_PX + side % 2, (width + side + 1) // 2 * 2)
        self._paths = [run.poses]
        self._drift = None
        truth = run.sequence.truth
        if truth is not None:
            self._paths.append(from_first(truth))
            self._drift = plots.distance_from_truth(run.poses, truth)
        self._driven = trajectory_distances(self._paths[-1])
        self._open = ExitStack()

    def __enter__(self) -> Film:
        height, width = self._shape
        self._video = self._open.enter_context(webm_file(self.path, width, height, FILM_FPS))
        return self

    def __exit__(self, *details: Any) -> None:
        self._open.__exit__(*details)

    def add(self, frame: FilmFrame) -> None:
        """Write a frame."""
        self._video.add(self.picture(frame))

    def picture(self, frame: FilmFrame) -> Image:
        """The picture of a frame, BGR: text (at the top, clear of a player's controls), image and path."""
        page = np.full((*self._shape, 3), WHITE, np.uint8)
        left = self.run.sequence.left(frame.index)
        matches = frame.matches
        boxes = frame.removal.boxes
        if self._scale < 1.0:
            left = np.asarray(cv2.resize(left, self._image_size, interpolation=cv2.INTER_AREA), np.uint8)
            matches = replace(
                matches,
                prev_left=self._scaled(matches.prev_left),
                cur_left=self._scaled(matches.cur_left),
            )
            boxes = replace(boxes, xyxy=self._scaled(boxes.xyxy))
        image = plots.match_image(left, matches, frame.removal.kept, boxes, frame.removal.state, by_age=True)
        width, height = self._image_size
        page[WORDS_HEIGHT_PX : WORDS_HEIGHT_PX + height, :width] = image
        self._draw_paths(page[WORDS_HEIGHT_PX:, width:], frame.index)
        self._write_words(page[:WORDS_HEIGHT_PX], frame)
        return page

    def _scaled(self, pixels: Array) -> Array:
        """Positions in the smaller image, pixels, of any shape; the centre of the first pixel is at 0."""
        return self._scale * (pixels + 0.5) - 0.5

    def _draw_paths(self, part: Image, index: int) -> None:
        """Draw the path up to a frame, and the complete truth in a pale colour, both seen from above."""
        height, width = part.shape[:2]
        room = np.array([width - 2 * MAP_MARGIN_PX, height - 2 * MAP_MARGIN_PX - LINE_HEIGHT_PX])
        points = [poses[:, [0, 2], 3] for poses in self._paths]
        low = np.concatenate(points).min(axis=0)
        high = np.concatenate(points).max(axis=0)
        scale = float((room / np.maximum(high - low, 1.0)).min())  # pixels per metre
        middle = np.array([MAP_MARGIN_PX, MAP_MARGIN_PX + LINE_HEIGHT_PX]) + room / 2
        lines = [scale * (xz - (low + high) / 2) * [1.0, -1.0] + middle for xz in points]
        path = lines[0]
        truth = lines[1:]
        _draw_line(part, path[: index + 1], self._colour, PATH_WIDTH_PX)
        for line in truth:
            _draw_line(part, line, PALE, LINE_WIDTH_PX)
            _draw_line(part, line[: index + 1], TRUE_PATH_COLOUR, LINE_WIDTH_PX)
        for first, second in self.loops:
            if second <= index:
                _draw_line(part, path[[first, second]], LOOP_LINE_COLOUR, LINE_WIDTH_PX)
        here = np.rint(path[index]).astype(int).tolist()
        cv2.circle(part, here, PATH_WIDTH_PX, self._colour, -1, cv2.LINE_AA)
        _draw_scale(part, scale)

    def _write_words(self, part: Image, frame: FilmFrame) -> None:
        index = frame.index
        sequence = self.run.sequence
        driven = self._driven[index]
        progress = [
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
        facts = "  ".join(["", *progress, *motion.flags])
        room = part.shape[1] - 2 * 12 - _width(facts)
        _write(part, _shortened(self.label, room) + facts, (12, LINE_HEIGHT_PX))
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


def _draw_scale(part: Image, scale: float) -> None:
    """Draw a line of a round length at the top left of a map with `scale` pixels per metre.

    At the bottom, the controls of a player would cover it.
    """
    width = part.shape[1]
    length = round_length(width / 3 / scale)
    left = MAP_MARGIN_PX
    right = left + round(scale * length)
    row = MAP_MARGIN_PX // 2
    for start, end in (
        ((left, row), (right, row)),
        ((left, row - 4), (left, row + 4)),
        ((right, row - 4), (right, row + 4)),
    ):
        cv2.line(part, start, end, BLACK, 1)
    _write(part, f"{length:g} m", (right + 8, row + 5))


def round_length(most: float) -> float:
    """The largest of the lengths …, 1, 2, 5, 10, 20, … that is at most `most`, which is positive."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(step * power for step in (1, 2, 5) if step == 1 or step * power <= most)


def _draw_line(part: Image, points: Array, colour: tuple[int, int, int], width: int) -> None:
    fixed = np.rint(points * 16).astype(np.int32)  # OpenCV's fixed-point format, four binary digits
    cv2.polylines(part, [fixed], False, colour, width, cv2.LINE_AA, shift=4)


def _write(part: Image, text: str, at: tuple[int, int]) -> int:
    """Write a line of text and return the column of its end, pixels."""
    cv2.putText(part, text, at, FONT, FONT_SCALE, BLACK, 1, cv2.LINE_AA)
    return at[0] + _width(text)


def _width(text: str) -> int:
    """The width of a line of text, pixels."""
    (width, _), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    return int(width)


def _shortened(text: str, width: int) -> str:
    """A text of at most `width` pixels: of a longer text, the middle is left out."""
    if _width(text) <= width:
        return text
    for kept in range(len(text) // 2, 0, -1):
        short = f"{text[:kept]}...{text[-kept:]}"
        if _width(short) <= width:
            return short
    return ""
