"""Chapter 0: look at a sequence: both images, disparity, depth of a point, the true path."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from ...core.settings import Checked, setting
from ...core.types import Image
from ...data.sequence import Sequence
from ...evaluation.kitti import trajectory_distances
from ...front_end.surface import CoarseDisparity, coarse_disparity
from .base import Drawing, Panel, State
from .controls import Control
from .data import Memory, stereo, truth
from .style import BAD, DARK, GOOD, PALE, WIDTH, Fact, bgr, caption, figure, finish, photo, say, stack

_disparities: Memory[CoarseDisparity] = Memory(8)
HALF = WIDTH // 2
LEFT_HEIGHT, HALF_HEIGHT, CHART_HEIGHT = 298, 150, 210


@dataclass(frozen=True)
class PointView(Checked):
    """The point that the panel follows from the left into the right image."""

    u: float = setting(0.3, "column of the point, as a share of the image width", low=0, high=1)
    v: float = setting(0.72, "row of the point, as a share of the image height", low=0, high=1)


def disparity_map(sequence: Sequence, frame: int, largest: int) -> CoarseDisparity:
    """Disparity (H/2, W/2) of a frame by block matching, pixels of the full image; negative where none."""
    pair = stereo(sequence, frame)
    return _disparities.get((sequence.folder, frame, largest), lambda: coarse_disparity(*pair, largest))


def disparity_picture(disparity: CoarseDisparity, largest: int) -> Image:
    """A disparity map in colours, near bright; grey where none was found."""
    scaled = np.sqrt(np.clip(disparity / largest, 0.0, 1.0)) * 255
    coloured = cv2.applyColorMap(scaled.astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    coloured[disparity <= 0] = 70
    return np.asarray(coloured, np.uint8)


def path_figure(sequence: Sequence, frame: int, height: int = CHART_HEIGHT) -> Figure:
    """The true path from above and the speed along it, with the frame marked."""
    made, (path, speed) = figure(height, 2, (1.0, 1.6))
    if sequence.truth is None:
        for axis in (path, speed):
            say(axis, "no ground truth")
        return made
    x, z = sequence.truth[:, 0, 3], sequence.truth[:, 2, 3]
    path.plot(x, z, color=DARK, linewidth=1.2)
    path.plot(x[frame], z[frame], "o", color=BAD)
    path.set_aspect("equal", adjustable="datalim")
    finish(path, "true path from above", "x, right [m]", "z, forward [m]")
    steps = np.diff(trajectory_distances(sequence.truth)) / np.diff(sequence.times)
    speed.plot(np.arange(1, len(sequence)), steps, color=GOOD, linewidth=1.2)
    speed.axvline(frame, color=BAD, linewidth=1)
    speed.set_ylim(0, None)
    finish(speed, "true speed", "frame", "speed [m/s]")
    return made


class StartPanel(Panel):
    """One frame of a sequence, and the depth of one point in it."""

    title = "Look at a sequence: one point, its disparity, its depth"
    view = PointView
    height = LEFT_HEIGHT + HALF_HEIGHT + CHART_HEIGHT
    controls = (
        Control("view.u", "column u / width", step=0.005),
        Control("view.v", "row v / height", step=0.005),
        Control("matching.max_disparity", high=256, step=16),
    )

    def draw(self, state: State) -> Drawing:
        sequence, frame, camera = state.sequence, state.frame, state.sequence.camera
        left, right = stereo(sequence, frame)
        u, v = round(state.view.u * (camera.width - 1)), round(state.view.v * (camera.height - 1))
        largest = state.config.matching.max_disparity
        coarse = disparity_map(sequence, frame, largest)
        disparity = float(coarse[min(v // 2, coarse.shape[0] - 1), min(u // 2, coarse.shape[1] - 1)])
        found = disparity > 0
        depth = camera.f * camera.baseline / disparity if found else float("nan")
        pictures = [photo(image, camera.width) for image in (left, right)]
        for picture, column in zip(pictures, (u, u - disparity), strict=True):
            cv2.line(picture, (0, v), (camera.width, v), bgr(PALE), 1)
            if found or picture is pictures[0]:
                cv2.drawMarker(picture, (round(column), v), bgr(BAD), cv2.MARKER_CROSS, 30, 3)
        map_picture = photo(disparity_picture(coarse, largest), HALF, HALF_HEIGHT)
        small = [
            caption(photo(pictures[1], HALF, HALF_HEIGHT), "right image: the same row"),
            caption(map_picture, "disparity: bright is near, grey was not found"),
        ]
        whole = caption(photo(pictures[0], WIDTH, LEFT_HEIGHT), f"left image, frame {frame}")
        chart = path_figure(sequence, frame)
        encoded = stack([whole, np.concatenate(small, axis=1), chart], self.height)
        known = truth(sequence)
        true_depth = float(known.depth(frame)[v, u]) if known is not None else float("nan")
        if not np.isfinite(true_depth):
            true_depth = float("nan")
        if found:
            sentence = (
                f"The point ({u}, {v}) of the left image lies {disparity:.1f} px further left in the right "
                f"image, in the same row. So it is Z = f b / d = {camera.f:.1f} px × {camera.baseline:.3f} m "
                f"/ {disparity:.1f} px = {depth:.1f} m away."
            )
        else:
            sentence = (
                f"At ({u}, {v}) block matching found no disparity: sky, too little texture, or out of view "
                "on the right."
            )
        facts = (
            Fact("disparity d", disparity if found else float("nan"), "px", 1),
            Fact("depth Z", depth, "m", 1),
            Fact("true depth", true_depth, "m", 1),
            Fact("pixels with a disparity", 100 * float(np.mean(coarse > 0)), "%", 1),
            Fact("time", float(sequence.times[frame]), "s", 1),
        )
        return Drawing(encoded, sentence, facts)
