"""A lorry in front of the camera: features of its side, added to the matches of any sequence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.rows import joined
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.paper.box_removal import inside
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import Run, run_methods
from vo_lib.runs.front_end import TimedMatches
from vo_lib.settings import Checked, setting

from .given_boxes import WithBoxes
from .tracks import CAMERA_HEIGHT

SIDE = np.array([4.0, 3.0, 0.0])  # length and height of the lorry's side, metres; the side is flat
STEP = 0.3  # metres to the right from frame to frame, relative to the camera
NOISE = 0.15  # standard deviation of each coordinate measured, pixels
POINTS = 6000  # on the side; the share limits the number of matched points
TRUCK = 7  # COCO's class


@dataclass(frozen=True)
class LorryConfig(Checked):
    """Settings of the lorry: its share of the matches, and its distance."""

    share: float = setting(0.5, "share of the matches on the lorry", low=0, high=0.95)
    distance: float = setting(5.0, "distance from camera to lorry", unit="m", low=3, high=50)


def with_lorry(
    camera: StereoCamera, frames: Iterable[StereoMatches], config: LorryConfig, seed: int = 0
) -> Iterator[tuple[StereoMatches, Boxes]]:
    """The matches of each frame with added matches on a lorry, and the lorry's box in the left image.

    The lorry's side is perpendicular to the view, at a constant distance from the camera. The lorry starts in
    the middle of the view and moves to the right; when it has disappeared, the next lorry enters from the
    left. The lorry hides matches behind it. The features of the lorry have negative ids, which are constant
    while the features are matched.

    Parameters
    ----------
    camera : the camera, with its image size.
    frames : matches of every frame of a sequence; the first frame has none.
    """
    rng = np.random.default_rng(seed)
    # The upper left corner of the side, if the lorry were in the middle of the view.
    start = np.array([-SIDE[0] / 2, CAMERA_HEIGHT - SIDE[1], config.distance])
    points = start + SIDE * rng.random((POINTS, 3))
    strength = rng.gamma(2.0, 20.0, POINTS)
    spacing = SIDE[0] + config.distance * camera.width / camera.f  # from one lorry to the next, metres
    age = np.zeros(POINTS, np.int64)
    before: _Seen | None = None
    for index, matches in enumerate(frames):
        # Each lorry drives one spacing from left to right; the first one begins in the middle of it.
        number, along = divmod(STEP * index + spacing / 2, spacing)
        place = np.array([along - spacing / 2, 0.0, 0.0])
        now = _see(camera, start + place, points + place, rng)
        if before is None:
            before = now
        kept = matches[~_hidden(camera, matches, before, now, config.distance)]
        wanted = round(config.share / (1 - config.share) * len(kept))
        chosen = np.flatnonzero(_in_all_images(camera, before, now))[:wanted]
        age = np.where(np.isin(np.arange(POINTS), chosen), age + 1, 0)
        added = StereoMatches(
            before.left[chosen],
            before.right[chosen],
            now.left[chosen],
            now.right[chosen],
            age[chosen],
            strength[chosen],
            -1 - POINTS * int(number) - chosen,
        )
        yield joined([kept, added]), _cut_box(camera, now.box_left)
        before = now


class _Seen(NamedTuple):
    """The lorry in a stereo pair: its points (POINTS, 2) and the box (4,) of its side in both images, pixels."""

    left: Array
    right: Array
    box_left: Array
    box_right: Array


def _see(camera: StereoCamera, corner: Array, points: Array, rng: np.random.Generator) -> _Seen:
    """The lorry whose side has its upper left corner (3,) and points (POINTS, 3) here; the points are measured."""
    left_ends, right_ends = camera.project(np.stack([corner, corner + SIDE]))
    exact = np.stack(camera.project(points))
    left, right = exact + NOISE * rng.standard_normal(exact.shape)
    return _Seen(left, right, left_ends.ravel(), right_ends.ravel())


def _in_all_images(camera: StereoCamera, before: _Seen, now: _Seen) -> BoolArray:
    """Mask (POINTS,) of the lorry's points that are inside all four images."""
    last_pixel = (camera.width - 1, camera.height - 1)
    images = np.stack([before.left, before.right, now.left, now.right])
    return np.asarray(((images >= 0) & (images <= last_pixel)).all(axis=(0, 2)))


def _hidden(
    camera: StereoCamera, matches: StereoMatches, before: _Seen, now: _Seen, distance: float
) -> BoolArray:
    """Mask (N,) of the matches that the lorry hides in any image."""
    nearer = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2] < distance
    covered = np.zeros(len(matches), np.bool_)
    for uv, box in (
        (matches.prev_left, before.box_left),
        (matches.prev_right, before.box_right),
        (matches.cur_left, now.box_left),
        (matches.cur_right, now.box_right),
    ):
        covered |= inside(uv, box[None])[:, 0]
    return np.asarray(covered & ~nearer)


def _cut_box(camera: StereoCamera, box: Array) -> Boxes:
    """The box (4,) of the lorry, cut at the edges of the image; none if nothing of it is in the image."""
    last_pixel = (camera.width - 1, camera.height - 1)
    xyxy = np.clip(box[None], 0, last_pixel + last_pixel)
    boxes = Boxes(xyxy, np.array([TRUCK]), np.ones(1))
    return boxes[xyxy[:, 2] > xyxy[:, 0]]


def drive_past_lorry(
    sequence: Sequence,
    configs: Mapping[str, MethodConfig],
    frames: Iterable[TimedMatches],
    lorry: LorryConfig,
) -> dict[str, Run]:
    """Like `run_methods`, but with the matches and boxes of `with_lorry`.

    The boxes of the sequence are ignored, so a method that removes vehicles removes only the lorry.
    """
    timed_matches: list[TimedMatches] = []
    boxes = []
    for matches, box in with_lorry(sequence.camera, (given for given, _ in frames), lorry):
        timed_matches.append((matches, {}))
        boxes.append(box)
    boxed = WithBoxes(**vars(sequence), given=boxes)
    return run_methods(boxed, configs, matches=timed_matches)
