"""Chapter 0: a panel with both images, and disparity and depth of a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import ipywidgets as widgets
import numpy as np

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Image
from vo_lib.kit.surface import CoarseDisparity
from vo_lib.settings import Checked, setting

from ..colours import BAD, PALE, bgr
from ..drawing import HALF_HEIGHT, PHOTO_HEIGHT, WIDTH, beside, caption, photo
from ..frames import disparity_map, scene_truth, stereo
from ..panel import Control, Drawing, Fact, Panel, State
from ..simulation.true_matches import depth as true_depths

# Writes the place of a click, as shares of the picture, into the hidden text field beside it.
ON_CLICK = """<div style="height:100%; cursor:crosshair" onclick="
const box = this.closest('.vo-clicks'), field = box.querySelector('input');
const at = box.querySelector('img').getBoundingClientRect();
field.value = [(event.clientX - at.x) / at.width, (event.clientY - at.y) / at.height];
field.dispatchEvent(new Event('change', {bubbles: true}))"></div>"""


@dataclass(frozen=True)
class PointView(Checked):
    """Position of the point that is marked in both images."""

    u: float = setting(0.3, "column of the point, as a share of the image width", low=0, high=1)
    v: float = setting(0.72, "row of the point, as a share of the image height", low=0, high=1)


def disparity_picture(disparity: CoarseDisparity, largest: int) -> Image:
    """A disparity map in colours, bright for near points, grey for missing values."""
    scaled = np.sqrt(np.clip(disparity / largest, 0.0, 1.0)) * 255
    coloured = cv2.applyColorMap(scaled.astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    coloured[disparity <= 0] = 70
    return np.asarray(coloured, np.uint8)


class StartPanel(Panel):
    """One frame of a sequence, and the depth of one point in this frame."""

    title = "A sequence: one point, its disparity, its depth"
    view = PointView
    height = PHOTO_HEIGHT + HALF_HEIGHT
    controls = (
        Control("view.u", "column u / width", step=0.005),
        Control("view.v", "row v / height", step=0.005),
        Control("matching.max_disparity", high=256, step=16),
    )

    def surface(self) -> Any:
        """The picture; a click in the left image moves the point."""
        place = widgets.Text(continuous_update=False, layout={"display": "none"})
        place.observe(self._clicked, "value")
        over = [self.picture, widgets.HTML(ON_CLICK, layout={"margin": "0"}), place]
        for each in over:
            each.layout.grid_area = "1 / 1"
        return widgets.GridBox(over, layout={"width": "fit-content"}).add_class("vo-clicks")

    def _clicked(self, change: Any) -> None:
        """Move the point to a place "x,y" of the picture, shares of its width and height."""
        camera = self.state().sequence.camera
        share_of_width, share_of_height = change["new"].split(",")
        x = float(share_of_width)
        y = float(share_of_height)
        # The left image is centred in the upper PHOTO_HEIGHT rows of the picture, `scale` times as large; white
        # margins fill the rest of them.
        scale = min(WIDTH / camera.width, PHOTO_HEIGHT / camera.height)
        u = 0.5 + (x - 0.5) * WIDTH / (scale * camera.width)
        v = 0.5 + (y * self.height - PHOTO_HEIGHT / 2) / (scale * camera.height)
        if 0 <= u <= 1 and 0 <= v <= 1:
            self.set(view__u=u, view__v=v)

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        camera = sequence.camera
        u = round(state.view.u * (camera.width - 1))
        v = round(state.view.v * (camera.height - 1))
        largest = state.config.matching.max_disparity
        coarse = disparity_map(sequence, state.frame, largest)
        row = min(v // 2, coarse.shape[0] - 1)
        column = min(u // 2, coarse.shape[1] - 1)
        known = coarse[row, column] > 0
        d = float(coarse[row, column]) if known else float("nan")
        depth = camera.f * camera.baseline / d

        left_image, right_image = stereo(sequence, state.frame)
        left = photo(left_image, camera.width)
        right = photo(right_image, camera.width)
        _mark(left, u, v)
        _mark(right, u - d, v)
        above = caption(photo(left, WIDTH, PHOTO_HEIGHT), f"left image, frame {state.frame}")
        words = "right image: the same row", "disparity: bright is near, grey is missing"
        below = beside(right, disparity_picture(coarse, largest), *words)

        sentence = (
            f"At ({u}, {v}) block matching found no disparity: sky, no texture, or not in the right image."
        )
        if known:
            sentence = (
                f"The point ({u}, {v}) of the left image is {d:.1f} px further left in the right image, in the "
                f"same row. Its depth is Z = f b / d = {camera.f:.1f} px × {camera.baseline:.3f} m / {d:.1f} px "
                f"= {depth:.1f} m."
            )
        facts = (
            Fact("disparity d", d, "px", 1),
            Fact("depth Z", depth, "m", 1),
            Fact("true depth", _true_depth(sequence, state.frame, u, v), "m", 1),
            Fact("pixels with a disparity", 100 * float(np.mean(coarse > 0)), "%", 1),
        )
        return Drawing([above, below], sentence, facts)


def _mark(picture: Image, u: float, v: int) -> None:
    """Draw row v and, unless the column is NaN, a cross at (u, v), in place."""
    cv2.line(picture, (0, v), (picture.shape[1], v), bgr(PALE), 1)
    if np.isfinite(u):
        cv2.drawMarker(picture, (round(u), v), bgr(BAD), cv2.MARKER_CROSS, 30, 3)


def _true_depth(sequence: Sequence, frame: int, u: int, v: int) -> float:
    """True depth of a pixel, metres; NaN if it is not known or the pixel shows the sky."""
    ground_truth = scene_truth(sequence)
    if ground_truth is None:
        return float("nan")
    depth = float(true_depths(ground_truth, frame)[v, u])
    return depth if np.isfinite(depth) else float("nan")
