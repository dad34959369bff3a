"""Images, matches and truth of frames, kept in memory for notebooks and panels."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from IPython.display import Image as Shown

from vo_lib.data.catalogue import DRAWING_PROCESSES, KITTI, SYNTHETIC, available, open_sequence, scene_folders
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.kitti import read_part
from vo_lib.data.label_remarks import coverage_remarks
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import Truth, open_truth
from vo_lib.errors import DataError
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.types import Array, Image, Progress
from vo_lib.kit.surface import CoarseDisparity, coarse_disparity
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import single_threaded
from vo_lib.runs.front_end import make_front_end

from .drawing import beside, show
from .memory import Memory
from .progress import with_bar

DEFAULT = "synthetic/traffic"

_sequences: Memory[Sequence] = Memory(8)
_pairs: Memory[tuple[Image, Image]] = Memory(12)
_prepared: Memory[Any] = Memory(8)
_matches: Memory[StereoMatches] = Memory(24)
_truths: Memory[Truth] = Memory(4)
_disparities: Memory[CoarseDisparity] = Memory(8)


def is_open(name: str) -> bool:
    """Whether a sequence is open."""
    return name in _sequences


def remember_sequence(sequence: Sequence) -> str:
    """Remember a sequence that was opened elsewhere; return the name by which `opened` gives it.

    That is its own name, unless this belongs to another sequence: folders may have equal names, and a part, or a
    sequence with other labels, has the name of the whole.
    """
    for name in _names_for(sequence):
        kept = _sequences.get(name, lambda: sequence)  # stores the sequence if the name is free
        if are_same(kept, sequence):
            return name
    raise AssertionError("there is always a longer name")


def remember_as(name: str, sequence: Sequence) -> None:
    """Remember a sequence by the name that `remember_sequence` gave it, also if it was forgotten in between."""
    _sequences.keep(name, sequence)


def listed() -> Mapping[str, Path | None]:
    """Sequences by name, as in `available`; without those of KITTI if KITTI_ROOT is wrong.

    What needs only a drawn street then works; opening a sequence of KITTI says what is wrong.
    """
    try:
        return available()
    except DataError:
        return scene_folders()


def _names_for(sequence: Sequence) -> Iterator[str]:
    """The sequence's own name, unless it belongs to one of the catalogue that is not open, then longer ones."""
    folders = listed()
    if sequence.name in folders and not is_open(sequence.name):
        # To compare them, the one of the catalogue is opened; no other has its folder and all its frames.
        if not sequence.is_part and sequence.folder == folders[sequence.name]:
            opened(sequence.name)
            yield sequence.name
    else:
        yield sequence.name
    yield with_frames(sequence.name, sequence)
    longer = long_name(sequence)
    yield longer
    for number in itertools.count(2):  # copies with other labels, say
        yield f"{longer} ({number})"


def long_name(sequence: Sequence) -> str:
    """A name with the folder and the frames, which tells a part from the whole."""
    return with_frames(str(sequence.folder), sequence)


def with_frames(name: str, sequence: Sequence) -> str:
    """A name and the numbers of the first and the last frame."""
    return f"{name}, {sequence.frames[0]} to {sequence.frames[-1]}"


def are_same(one: Sequence, other: Sequence) -> bool:
    """Whether two sequences have the same frames, truth, labels and so on."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    for each in fields(one):
        mine = getattr(one, each.name)
        theirs = getattr(other, each.name)
        has_array = isinstance(mine, np.ndarray) or isinstance(theirs, np.ndarray)
        if not (np.array_equal(mine, theirs) if has_array else mine == theirs):
            return False
    return True


def opened(name: str, progress: Progress | None = None) -> Sequence:
    """A sequence by name or folder; `progress` is called while a synthetic scene is drawn.

    Of a sequence with a gap between its frames, this is the longest piece: no motion leads across a gap.
    """
    return _sequences.get(name, lambda: longest_piece(open_sequence(name, progress=progress)))


def longest_piece(sequence: Sequence) -> Sequence:
    """The sequence itself, or the longest piece of a sequence with gaps between its frames."""
    piece = max(sequence.pieces, key=len)
    if len(piece) == len(sequence):
        return sequence
    return sequence.part(piece.start, piece.stop)


def load(name: str = DEFAULT) -> Sequence:
    """A sequence for a notebook cell; a bar is shown while a synthetic scene is drawn for the first time."""
    sequence = with_bar(f"drawing {name}", lambda report: opened(name, report))
    for remark in coverage_remarks(sequence):
        print(f"{name}: {remark}.")
    part = read_part(sequence.folder)
    if part is not None and len(part.pieces) > 1:
        first = int(sequence.frames[0])
        print(f"{name} has a gap between its frames: these are {first} to {int(sequence.frames[-1])}.")
    return sequence


def load_part(name: str, first: int, last: int) -> Sequence:
    """Frames first … last of a drawn scene; if the whole scene is missing, only these frames are drawn."""

    def find(report: Progress) -> Sequence:
        frames = range(first, last + 1)
        scene = name.removeprefix(SYNTHETIC)
        folder = ensure_scene(scene, progress=report, jobs=DRAWING_PROCESSES, frames=frames)
        sequence = replace(open_sequence(folder), name=name)
        start = sequence.frames.index(f"{first:06d}")
        return sequence.part(start, start + len(frames))

    return with_bar(f"drawing frames {first} to {last} of {name}", find)


def key_of(sequence: Sequence, frame: int) -> tuple[Hashable, ...]:
    """Key of a frame in a `Memory`, to which a caller adds the settings that its result depends on.

    A part of a sequence has keys of its own.
    """
    return sequence.folder, sequence.frames[0], frame


def stereo(sequence: Sequence, frame: int) -> tuple[Image, Image]:
    """Left and right image of a frame."""
    return _pairs.get(key_of(sequence, frame), lambda: sequence.stereo(frame))


def disparity_map(sequence: Sequence, frame: int, largest: int) -> CoarseDisparity:
    """Disparity (H/2, W/2) of a frame by block matching, pixels of the full image; negative if unknown.

    largest : the largest disparity that is searched for, pixels.
    """
    left, right = stereo(sequence, frame)
    key = (*key_of(sequence, frame), largest)
    return _disparities.get(key, lambda: coarse_disparity(left, right, largest))


def before_step(sequence: Sequence, frame: int, config: MethodConfig) -> tuple[Any, Any]:
    """A front end that has processed the two pairs before `frame` >= 1 (at frame 1: one), and the prepared pair."""
    front_end = make_front_end(sequence.camera, config)

    def prepare(index: int) -> Any:
        key = (*key_of(sequence, index), config.features, config.matching)
        return _prepared.get(key, lambda: front_end.prepare(stereo(sequence, index)))

    indices = range(max(frame - 2, 0), frame + 1)  # the front end predicts from the motion before
    with ThreadPoolExecutor(max_workers=2) as pool, single_threaded():
        pairs = list(pool.map(prepare, indices))
        for earlier in pairs[:-1]:
            front_end.step(earlier)
    return front_end, pairs[-1]


def frame_matches(sequence: Sequence, frame: int, config: MethodConfig) -> StereoMatches:
    """Matches of a frame >= 1 with the previous frame, by the front end of the configuration.

    The front end has seen two earlier pairs at most: the ages are 1 or 2, so the buckets may keep other features
    than in a run.
    """

    def make() -> StereoMatches:
        front_end, pair = before_step(sequence, frame, config)
        matches: StereoMatches = front_end.step(pair)
        return matches

    return _matches.get((*key_of(sequence, frame), config.features, config.matching), make)


@dataclass(frozen=True, eq=False)
class Points:
    """Matches of a frame after bucketing, the input of the method.

    Attributes
    ----------
    matches : (N,) matches; x_p, x_c : (N, 2) normalised points; X_p : (N, 3) metres, previous left frame.
    T_cp : (4, 4) the true motion, or None.
    """

    matches: StereoMatches
    x_p: Array
    x_c: Array
    X_p: Array
    T_cp: Array | None

    @property
    def key(self) -> tuple[bytes, bytes, bytes]:
        """Key in a `Memory` of what is computed from the coordinates, whichever settings have led to them."""
        return self.x_p.tobytes(), self.x_c.tobytes(), self.X_p.tobytes()


def frame_points(sequence: Sequence, frame: int, config: MethodConfig) -> Points:
    """Input of chapters 2 to 4: the bucketed matches of a frame in normalised coordinates."""
    matches = frame_matches(sequence, frame, config)
    camera = sequence.camera
    matches = matches[select_by_bucket(matches.cur_left, matches.age, matches.strength, config.buckets)]
    if len(matches) < 5:
        raise DataError(
            f"frame {frame} has {len(matches)} matches; the five-point algorithm needs five: choose another frame"
        )
    x_p = camera.normalise(matches.prev_left)
    x_c = camera.normalise(matches.cur_left)
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    return Points(matches, x_p, x_c, X_p, true_motion(sequence, frame))


def true_motion(sequence: Sequence, frame: int) -> Array | None:
    """The true T_cp (4, 4) of a frame >= 1, or None."""
    poses = sequence.truth
    return None if poses is None else np.asarray(inverse(poses[frame]) @ poses[frame - 1])


def scene_truth(sequence: Sequence) -> Truth | None:
    """The full truth of a drawn scene (depth, objects); None for other sequences."""
    if not (sequence.folder / "truth" / "scene.json").exists():
        return None
    return _truths.get(sequence.folder, lambda: open_truth(sequence.folder))


# Each kind of data that a sequence may lack: the data, and the words where they are missing.
MISSING_DATA: dict[str, tuple[Callable[[Sequence], object | None], str]] = {
    "poses": (attrgetter("truth"), "has no ground truth: no error can be stated"),
    "depth": (scene_truth, "has no true depth of its pixels, unlike a drawn scene"),
    "labels": (attrgetter("labels"), "has no labelled boxes"),
    "moving": (scene_truth, "has no truth of moving objects, unlike a drawn scene"),
}


def why_missing(sequence: Sequence, what: str = "poses") -> str:
    """A sentence if a sequence lacks the data `what`, a key of `MISSING_DATA`; else ""."""
    data_of, words = MISSING_DATA[what]
    return f"{sequence.name} {words}." if data_of(sequence) is None else ""


def has_data(sequence: Sequence, what: str = "poses") -> bool:
    """Whether a sequence has the data that a cell needs; if not, a sentence is printed.

    if has_data(sequence, "depth"):
        show(draw.depth_figure(...))
    """
    missing = why_missing(sequence, what)
    if missing:
        print(f"{missing} The corresponding part of this cell is skipped.")
    return not missing


def real_frame(name: str = "", frame: int = 40) -> tuple[Sequence, int] | None:
    """A sequence of KITTI and a frame number; without KITTI, a sentence is printed and the result is None.

    The sequence is `name` ("kitti/drive_0013") if available, else the first sequence of KITTI.
    """
    names = [each for each in available() if each.startswith(KITTI)]
    if len(names) == 0:
        print("KITTI is not on this machine: set KITTI_ROOT to its folder to see a real frame in this cell.")
        return None
    sequence = opened(name if name in names else names[0])
    return sequence, min(frame, len(sequence) - 1)


def real_pair(scene: Sequence, frame: int, name: str = "") -> Shown | None:
    """A drawn and a real left image, side by side; without KITTI, None and a printed sentence."""
    found = real_frame(name)
    if found is None:
        return None
    real, real_index = found
    drawn_left, _ = stereo(scene, frame)
    real_left, _ = stereo(real, real_index)
    drawn_words = f"{scene.name}, frame {frame}"
    real_words = f"{real.name}, frame {real_index}"
    return show(beside(drawn_left, real_left, drawn_words, real_words))
