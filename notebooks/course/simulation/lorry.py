"""A lorry in front of the camera: features of its side, added to the matches of any sequence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

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

from ..frames import WithBoxes
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
    start = np.array([-SIDE[0] / 2, CAMERA_HEIGHT - SIDE[1], config.distance])
    points = start + SIDE * rng.random((POINTS, 3))
    strength = rng.gamma(2.0, 20.0, POINTS)
    spacing = SIDE[0] + config.distance * camera.width / camera.f  # from one lorry to the next, metres
    age = np.zeros(POINTS, np.int64)
    for index, matches in enumerate(frames):
        number, along = divmod(STEP * index + spacing / 2, spacing)
        place = np.array([along - spacing / 2, 0.0, 0.0])
        # Left and right image: u and v of the ends of the side, and measured u and v of its points.
        rims = np.stack(camera.project(start + place + SIDE * [[0.0], [1.0]])).reshape(2, 4)
        pixels = np.stack(camera.project(points + place)) + NOISE * rng.standard_normal((2, POINTS, 2))
        if index == 0:
            rims_p = rims
            pixels_p = pixels
        corner = (camera.width - 1, camera.height - 1)
        images = np.concatenate([pixels_p, pixels])  # previous left, previous right, left, right
        visible = ((images >= 0) & (images <= corner)).all(axis=(0, 2))
        kept = matches[~_hidden(camera, matches, [*rims_p, *rims], config.distance)]
        wanted = round(config.share / (1 - config.share) * len(kept))
        chosen = np.flatnonzero(visible)[:wanted]
        age = np.where(np.isin(np.arange(POINTS), chosen), age + 1, 0)
        ids = -1 - POINTS * int(number) - chosen
        prev_left, prev_right, cur_left, cur_right = images[:, chosen]
        added = StereoMatches(prev_left, prev_right, cur_left, cur_right, age[chosen], strength[chosen], ids)
        xyxy = np.clip(rims[:1], 0, corner * 2)
        box = Boxes(xyxy, np.array([TRUCK]), np.ones(1))
        yield joined([kept, added]), box[xyxy[:, 2] > xyxy[:, 0]]
        rims_p = rims
        pixels_p = pixels


def _hidden(camera: StereoCamera, matches: StereoMatches, rims: list[Array], distance: float) -> BoolArray:
    """Mask (N,) of the matches that the lorry hides in any image; `rims` : box (4,) of the lorry by image."""
    nearer = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2] < distance
    places = matches.prev_left, matches.prev_right, matches.cur_left, matches.cur_right
    covered = [inside(uv, rim[None])[:, 0] for uv, rim in zip(places, rims, strict=True)]
    return np.asarray(np.any(covered, axis=0) & ~nearer)


def drive_past_lorry(
    sequence: Sequence,
    configs: Mapping[str, MethodConfig],
    frames: Iterable[TimedMatches],
    lorry: LorryConfig,
) -> dict[str, Run]:
    """Like `run_methods`, but with the matches and boxes of `with_lorry`.

    The boxes of the sequence are ignored, so a method that removes vehicles removes only the lorry.
    """
    mixed, boxes = zip(*with_lorry(sequence.camera, (matches for matches, _ in frames), lorry), strict=True)
    boxed = WithBoxes(**vars(sequence), given=list(boxes))
    return run_methods(boxed, configs, matches=((matches, {}) for matches in mixed))
