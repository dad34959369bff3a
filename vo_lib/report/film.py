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
from ..paper.settings import PublishedConfig
from ..runs.drive import MethodRun, Run, frames
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
TEXT_MARGIN_PX = 12  # left and right of the text
DOT_RADIUS_PX = 5  # of the dots of the legend
DOT_GAP_PX = 10  # from the centre of such a dot to its word
LEGEND_GAP_PX = 20  # from a word of the legend to the next dot
BLACK = (0, 0, 0)  # BGR
WHITE = (255, 255, 255)
PALE = (200, 200, 200)
TRUE_PATH_COLOUR = plots.bgr(plots.TRUTH_COLOUR)
LOOP_LINE_COLOUR = plots.bgr(plots.LOOP_COLOUR)

FramePairs = Sequence[tuple[int, int]]  # numbers of two frames at one place: a loop


@dataclass(frozen=True, eq=False)
class FilmFrame:
    """A frame of a film: its number, its matches, what the box rule did to them, and the motion."""

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


def removal_image(run: Run, matches: Iterable[TimedMatches] | None = None) -> tuple[int, Image] | None:
    """The frame of which a run removed the most features, and its image with boxes and features, BGR.

    The removal is computed again. As published, it needs this frame and the one before alone; variant kit
    follows features and boxes over many frames, so the run is repeated up to this frame, with `matches` as
    in `run_methods`. None if the run removed no feature.
    """
    removed = [motion.removed for motion in run.motions]
    if max(removed, default=0) == 0:
        return None
    index = removed.index(max(removed)) + 1  # the first motion leads to frame 1
    if isinstance(run.config, PublishedConfig):
        pair = replace(run, sequence=run.sequence.part(index - 1, index + 1))
        (frame,) = film_frames(pair)
    else:
        frame = next(frame for frame in film_frames(run, matches) if frame.index == index)
    removal = frame.removal
    left = run.sequence.left(index)
    return index, plots.match_image(left, frame.matches, removal.kept, removal.boxes, removal.state)


def refuse_foreign_film(path: Path) -> None:
    """Raise `DataError` for a name without the ending of films, or of a file that the kit did not write."""
    if path.suffix.lower() != FILM_ENDING:
        raise DataError(f"expected the name of a film to end in {FILM_ENDING}", path)
    if not os.path.lexists(path):
        return
    with open_binary(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - len(FILM_MARK), 0))
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
    """A video file of a run's frames: frames are added within `with Film(...) as film`.

    The complete file appears at the end of the context.

    Parameters
    ----------
    path : of the file, with the ending `FILM_ENDING`.
    run : whose path is drawn beside the images of its sequence.
    label : text in the first line of each picture.
    loops : pairs of frames at one place; a pair is drawn from its second frame on.
    method : name of the method, for the colour of the path.

    Raises
    ------
    DataError : the name has not the ending of films, or belongs to a file that the kit did not write; within
        the context, the film cannot be written.
    """

    def __init__(self, path: Path, run: Run, label: str, loops: FramePairs = (), method: str = PROPOSAL):
        refuse_foreign_film(path)
        self.path = path
        self.run = run
        self.label = label
        self.loops = loops
        self._colour = plots.bgr(plots.METHOD_COLOURS.get(method, plots.METHOD_COLOURS[PROPOSAL]))
        camera = run.sequence.camera
        self._image_scale = min(1.0, MAX_IMAGE_WIDTH_PX / camera.width)
        self._image_size = (round(self._image_scale * camera.width), round(self._image_scale * camera.height))
        width, height = self._image_size
        side = max(height, MIN_PATH_SIDE_PX)
        # Height and width of a picture, with text, image and path. Encoders require even numbers of pixels.
        self._shape = (_even(WORDS_HEIGHT_PX + side), _even(width + side))
        self._truth: Array | None = None  # (N, 4, 4) from the first pose on
        self._distance_from_truth = None  # (N,) metres
        truth = run.sequence.truth
        if truth is not None:
            self._truth = from_first(truth)
            self._distance_from_truth = plots.distance_from_truth(run.poses, truth)
        # (N,) metres, on the true path if it is known.
        self._driven = trajectory_distances(run.poses if self._truth is None else self._truth)
        self._open_file = ExitStack()

    def __enter__(self) -> Film:
        height, width = self._shape
        self._video = self._open_file.enter_context(webm_file(self.path, width, height, FILM_FPS))
        return self

    def __exit__(self, *details: Any) -> None:
        self._open_file.__exit__(*details)

    def add(self, frame: FilmFrame) -> None:
        """Write a frame."""
        self._video.add(self.picture(frame))

    def picture(self, frame: FilmFrame) -> Image:
        """The picture of a frame, BGR (H, W, 3): text, image, and path beside it.

        The text is at the top, since the controls of a player are at the bottom.
        """
        page = np.full((*self._shape, 3), WHITE, np.uint8)
        left = self.run.sequence.left(frame.index)
        matches = frame.matches
        boxes = frame.removal.boxes
        if self._image_scale < 1.0:
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
        return self._image_scale * (pixels + 0.5) - 0.5

    def _draw_paths(self, part: Image, index: int) -> None:
        """Draw the path up to a frame, and the complete truth in a pale colour, both seen from above."""
        height, width = part.shape[:2]
        # Width and height for the paths, pixels: below the line that shows the scale, inside the margins.
        room = np.array([width - 2 * MAP_MARGIN_PX, height - 2 * MAP_MARGIN_PX - LINE_HEIGHT_PX])
        drawn = [self.run.poses] if self._truth is None else [self.run.poses, self._truth]
        paths_xz = [poses[:, [0, 2], 3] for poses in drawn]
        low = np.concatenate(paths_xz).min(axis=0)
        high = np.concatenate(paths_xz).max(axis=0)
        scale = float((room / np.maximum(high - low, 1.0)).min())  # pixels per metre
        middle = np.array([MAP_MARGIN_PX, MAP_MARGIN_PX + LINE_HEIGHT_PX]) + room / 2
        # Rows are counted downwards, while z grows upwards on a map.
        lines = [scale * (xz - (low + high) / 2) * [1.0, -1.0] + middle for xz in paths_xz]
        path, *truth = lines
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
        """Write three lines: label and progress of the drive, counts of the matches, and the legend."""
        motion = frame.motion
        facts = "  ".join(["", *self._progress_words(frame.index), *motion.flags])
        room = part.shape[1] - 2 * TEXT_MARGIN_PX - _width(facts)
        _write(part, _shortened(self.label, room) + facts, (TEXT_MARGIN_PX, LINE_HEIGHT_PX))
        counts = [
            f"{motion.matches} matches",
            f"{motion.removed} removed",
            f"{motion.used} used after bucketing",
            f"{motion.inliers} inliers",
        ]
        _write(part, "  ".join(counts), (TEXT_MARGIN_PX, 2 * LINE_HEIGHT_PX))
        row = 3 * LINE_HEIGHT_PX
        column = TEXT_MARGIN_PX + DOT_RADIUS_PX
        for text, colour in self._legend(frame):
            middle_of_letters = row - 6
            cv2.circle(part, (column, middle_of_letters), DOT_RADIUS_PX, colour, -1, cv2.LINE_AA)
            column = _write(part, text, (column + DOT_GAP_PX, row)) + LEGEND_GAP_PX

    def _progress_words(self, index: int) -> list[str]:
        """What is said of the drive up to a frame: its number, time, way, and distance from the truth."""
        sequence = self.run.sequence
        driven = self._driven[index]
        words = [
            f"frame {sequence.frames[index]}",
            f"{sequence.times[index] - sequence.times[0]:.1f} s",
            f"{driven:.0f} m driven",
        ]
        if self._distance_from_truth is not None:
            distance = self._distance_from_truth[index]
            words.append(f"{distance:.2f} m from the truth ({100 * distance / max(driven, 1e-9):.2f} %)")
        return words

    def _legend(self, frame: FilmFrame) -> list[tuple[str, tuple[int, int, int]]]:
        """The words of the legend, each with the colour (BGR) of its dot."""
        legend = [
            ("new match", plots.AGE_COLOURS[0]),
            ("old", plots.AGE_COLOURS[-1]),
            ("removed", plots.REMOVED),
            ("path", self._colour),
        ]
        if self._distance_from_truth is not None:
            legend += [("truth", TRUE_PATH_COLOUR), ("truth ahead", PALE)]
        if self.loops:
            closed = sum(second <= frame.index for _, second in self.loops)
            legend.append((f"{closed} loops", LOOP_LINE_COLOUR))
        if frame.removal.state is not None:
            legend.append(("boxes: solid moving, dashed parked, dotted unknown", WHITE))
        return legend


def _even(pixels: int) -> int:
    """The number, or the next one if it is odd."""
    return pixels + pixels % 2


def _draw_scale(part: Image, scale: float) -> None:
    """Draw a line of a round length at the top left of a map with `scale` pixels per metre.

    At the bottom, the controls of a player would cover it.
    """
    width = part.shape[1]
    length = round_length(width / 3 / scale)  # metres, on a third of the map at most
    left = MAP_MARGIN_PX
    right = left + round(scale * length)
    row = MAP_MARGIN_PX // 2
    cv2.line(part, (left, row), (right, row), BLACK, 1)
    for end in (left, right):
        cv2.line(part, (end, row - 4), (end, row + 4), BLACK, 1)
    _write(part, f"{length:g} m", (right + 8, row + 5))


def round_length(most: float) -> float:
    """The largest of the lengths …, 1, 2, 5, 10, 20, … that is at most `most`, which is positive."""
    power = 10.0 ** math.floor(math.log10(most))
    for digit in (5, 2):
        if digit * power <= most:
            return digit * power
    return power


def _draw_line(part: Image, points: Array, colour: tuple[int, int, int], width: int) -> None:
    """Draw a line through points (N, 2), pixels, in a colour, BGR."""
    corners = plots.fixed_point(points)
    cv2.polylines(part, [corners], False, colour, width, cv2.LINE_AA, shift=plots.FIXED_BITS)


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
