"""Chapter 0: a panel with both images, disparity and depth of a point; pictures of the method's stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import ipywidgets as widgets
import numpy as np
from matplotlib.figure import Figure

from vo_lib.config import preset
from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.surface import CoarseDisparity
from vo_lib.paper.box_removal import in_boxes
from vo_lib.paper.selection import draw_sets
from vo_lib.report.plots import match_image
from vo_lib.settings import Checked, setting

from ..ch02.figures import polynomial_chart, polynomial_of
from ..ch03.figures import features_picture, field_figure
from ..ch03.panel import field_of, previous_vector
from ..ch04.figures import by_depth_figure
from ..ch04.weightings import METHOD, solve_by
from ..colours import BAD, GOOD, PALE, THIRD, bgr
from ..drawing import HALF_HEIGHT, PHOTO_HEIGHT, WIDTH, beside, caption, figure, photo
from ..frames import WithBoxes, disparity_map, frame_matches, frame_points, stereo, true_poses, truth
from ..lessons import candidates_of, motion_of
from ..panel import Control, Drawing, Fact, Panel, State
from ..simulation.true_matches import depth as true_depths
from ..view3d import Shape, View, camera

# Writes the place of a click, as shares of the picture, into the hidden text field beside it.
ON_CLICK = """<div style="height:100%; cursor:crosshair" onclick="
const box = this.closest('.vo-clicks'), field = box.querySelector('input');
const at = box.querySelector('img').getBoundingClientRect();
field.value = [(event.clientX - at.x) / at.width, (event.clientY - at.y) / at.height];
field.dispatchEvent(new Event('change', {bubbles: true}))"></div>"""
RAYS = 14  # number
RAYS_END = 15.0  # largest distance of their points, metres


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
        x, y = (float(each) for each in change["new"].split(","))
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

        left, right = (photo(image, camera.width) for image in stereo(sequence, state.frame))
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
    ground_truth = truth(sequence)
    if ground_truth is None:
        return float("nan")
    depth = float(true_depths(ground_truth, frame)[v, u])
    return depth if np.isfinite(depth) else float("nan")


def watched(sequence: Sequence, *vehicles: int) -> WithBoxes:
    """A drawn sequence with boxes of only those vehicles whose numbers in the truth are `vehicles`."""
    ground_truth = truth(sequence)
    if ground_truth is None:
        raise DataError(f"{sequence.name} is not a drawn scene: it has no truth of vehicles")
    given = []
    for index, frame in enumerate(sequence.frames):
        boxes = sequence.boxes(index)
        corners = np.rint(boxes.xyxy).astype(int)
        at_middle = ground_truth.vehicle_at(int(frame), (corners[:, :2] + corners[:, 2:]) / 2)
        given.append(boxes[np.isin(at_middle, vehicles)])
    return WithBoxes(**vars(sequence), given=given)


def boxed_picture(sequence: Sequence, frame: int) -> Image:
    """All matches of a frame with the previous frame; matches in vehicle boxes are orange."""
    config = preset("feature_selection")
    boxes = sequence.boxes(frame)
    matches = frame_matches(sequence, frame, config)
    kept = ~in_boxes(matches.cur_left, boxes, config.filter)
    count = f"{np.count_nonzero(~kept)} of all {len(kept)} matches are in vehicle boxes (orange)"
    picture = photo(match_image(stereo(sequence, frame)[0], matches, kept, boxes))
    return caption(picture, f"frame {int(sequence.frames[frame])}: {count}")


def rays_view(sequence: Sequence, frame: int) -> View:
    """Both cameras of a pair, and the rays from them to some near matches, in three dimensions."""
    points = frame_points(sequence, frame, preset("solution_selection"))
    right = np.eye(4)
    right[0, 3] = sequence.camera.baseline
    near = points.X_p[(points.X_p[:, 2] > 0) & (points.X_p[:, 2] < RAYS_END)]
    some = near[np.linspace(0, len(near) - 1, min(len(near), RAYS)).astype(int)]
    shapes = [camera(np.eye(4), "left camera"), camera(right)]
    for centre, colour in ((np.zeros(3), GOOD), (right[:3, 3], THIRD)):
        shapes += [Shape(np.array([centre, X]), colour, width=1.0) for X in some]
    shapes.append(Shape(some, BAD, "dots", width=5.0))
    return View(*shapes, title="Two rays meet in a point")


def poses_view(sequence: Sequence, every: int = 20) -> View:
    """The path of the true poses in three dimensions, with a camera at some poses."""
    poses = from_first(true_poses(sequence))
    cameras = [camera(poses[k], str(k), size=2.0) for k in range(0, len(poses), every)]
    path = Shape(poses[:, :3, 3], GOOD)
    return View(path, *cameras, title=f"{sequence.name}: every {every}th pose, with the number of its frame")


def depth_figure(camera: StereoCamera, measured: Array, true: Array) -> Figure:
    """Errors of measured depths (N,) by true depth, metres, and σ_Z for the median disparity error."""
    good = np.isfinite(measured) & np.isfinite(true)
    measured = measured[good]
    true = true[good]
    fb = camera.f * camera.baseline
    sigma = float(np.median(np.abs(fb / measured - fb / true)))
    labels = f"{len(true)} matches", f"Z² / (f b) · {sigma:.2f} px"
    return by_depth_figure(true, np.abs(measured - true), labels, "error of the depth", sigma / fb)


def method_stages(sequence: Sequence, frame: int) -> dict[str, Image | Figure]:
    """Pictures of the stages 1 to 4 for one frame >= 2, with the matches after bucketing."""
    config = preset("solution_selection")
    focal = sequence.camera.f
    image = stereo(sequence, frame)[0]
    points = frame_points(sequence, frame, config)
    places = points.matches.prev_left, points.matches.cur_left
    count = len(points.matches)
    words = f"{count} matches after the buckets: each line leads to where the point is now"

    candidates = candidates_of(points, config.selection.sets, 0)
    polynomial, (axis,) = figure(220)
    five = draw_sets(np.random.default_rng(1044), len(points.x_p), 1)[0]  # the set of chapter 2
    polynomial_chart(axis, *polynomial_of(points.x_p[five], points.x_c[five]))

    e_prev = previous_vector(sequence, frame, config)
    R_true = None if points.T_cp is None else points.T_cp[:3, :3]
    candidate_field = field_of(candidates, points, e_prev, R_true, config.selection, focal)
    R_cp, _, _ = motion_of(candidates.E[candidate_field.selected], points, config.selection, focal)
    solved = solve_by(METHOD, sequence.camera, points.matches, R_cp, config.translation)
    if solved is None:
        raise DataError(f"frame {frame}: no feature is near enough for a translation; choose another frame")
    t, residual, _ = solved
    step = ", ".join(f"{value:.2f}" for value in t.round(2) + 0.0)  # no minus before a zero
    off = np.isfinite(residual) & (residual > 1)
    share = f"orange: {np.mean(off):.0%} of the matches, residual above 1 px"
    near = np.where(np.isfinite(residual), residual <= 1, np.nan)  # grey beyond the depth limit
    return {
        "matches": features_picture(image, *places, np.ones(count), words),
        "polynomial": polynomial,
        "selection": field_figure(candidate_field),
        "residuals": features_picture(image, *places, near, f"t_cp = ({step}) m; {share}"),
    }
