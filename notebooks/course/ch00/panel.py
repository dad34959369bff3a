"""Chapter 0: the view of a sequence: both images, disparity, depth of a point, true path.

And, drawn for its pages: matches in boxes, depths, and one picture for each stage of the method.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from matplotlib.figure import Figure

from vo_lib.config import preset
from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import trajectory_distances
from vo_lib.geometry.boxes import Boxes, no_boxes
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.kit.surface import CoarseDisparity
from vo_lib.paper.boxes import in_boxes
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import draw_sets
from vo_lib.paper.translation import eliminate_points, feature_rows, solve_translation
from vo_lib.report.plots import match_image
from vo_lib.settings import Checked, setting

from ..ch02.figures import polynomial_chart, polynomial_of
from ..ch03.figures import field_figure
from ..ch03.panel import field_of, previous_vector
from ..colours import BAD, DARK, GOOD, PALE, THIRD, bgr
from ..controls import Control
from ..drawing import HALF_HEIGHT, WIDTH, beside, caption, figure, finish, log_axis, photo, say, stack
from ..frames import disparity_map, frame_matches, frame_points, stereo, true_poses, truth
from ..lessons import motion_of
from ..panel import Drawing, Panel, State
from ..results import Fact
from ..simulation.truth import depth as true_depths
from ..view3d import Shape, View, camera, view

LEFT_HEIGHT, CHART_HEIGHT = 298, 170
RAYS, RAYS_END = 14, 15.0  # so many rays, to points nearer than this, metres
MOST = 30  # per cent shown of a depth's error
FARTHEST = 80  # metres shown


@dataclass(frozen=True)
class PointView(Checked):
    """The point that the panel follows from the left into the right image."""

    u: float = setting(0.3, "column of the point, as a share of the image width", low=0, high=1)
    v: float = setting(0.72, "row of the point, as a share of the image height", low=0, high=1)


def disparity_picture(disparity: CoarseDisparity, largest: int) -> Image:
    """A disparity map in colours, bright for near points, grey for missing values."""
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
        u, v = round(state.view.u * (camera.width - 1)), round(state.view.v * (camera.height - 1))
        largest = state.config.matching.max_disparity
        coarse = disparity_map(sequence, frame, largest)
        disparity = float(coarse[min(v // 2, coarse.shape[0] - 1), min(u // 2, coarse.shape[1] - 1)])
        d = disparity if disparity > 0 else float("nan")
        depth = camera.f * camera.baseline / d
        left, right = (photo(image, camera.width) for image in stereo(sequence, frame))
        for picture, column in ((left, float(u)), (right, u - d)):
            cv2.line(picture, (0, v), (camera.width, v), bgr(PALE), 1)
            if np.isfinite(column):
                cv2.drawMarker(picture, (round(column), v), bgr(BAD), cv2.MARKER_CROSS, 30, 3)
        words = "right image: the same row", "disparity: bright is near, grey was not found"
        below = beside(right, disparity_picture(coarse, largest), *words)
        whole = caption(photo(left, WIDTH, LEFT_HEIGHT), f"left image, frame {frame}")
        encoded = stack([whole, below, path_figure(sequence, frame)], self.height)
        known = truth(sequence)
        true_depth = float("nan") if known is None else float(true_depths(known, frame)[v, u])
        sentence = (
            f"The point ({u}, {v}) of the left image is {d:.1f} px further left in the right image, in the "
            f"same row. Its depth is Z = f b / d = {camera.f:.1f} px × {camera.baseline:.3f} m / {d:.1f} px "
            f"= {depth:.1f} m."
        )
        if np.isnan(d):
            sentence = (
                f"At ({u}, {v}) block matching found no disparity: sky, too little texture, or out of view "
                "on the right."
            )
        facts = (
            Fact("disparity d", d, "px", 1),
            Fact("depth Z", depth, "m", 1),
            Fact("true depth", true_depth if np.isfinite(true_depth) else float("nan"), "m", 1),
            Fact("pixels with a disparity", 100 * float(np.mean(coarse > 0)), "%", 1),
            Fact("time", float(sequence.times[frame]), "s", 1),
        )
        return Drawing(encoded, sentence, facts)


@dataclass(frozen=True)
class Watched(Sequence):
    """A drawn sequence with labels for only some of its vehicles, given by their numbers in the truth."""

    vehicles: tuple[int, ...] = field(default=(), kw_only=True)

    def boxes(self, index: int) -> Boxes:
        known, boxes = truth(self), super().boxes(index)
        assert known is not None
        corners = np.rint(boxes.xyxy).astype(int)
        at_middle = known.vehicle_at(int(self.frames[index]), (corners[:, :2] + corners[:, 2:]) / 2)
        return boxes[np.isin(at_middle, self.vehicles)]


def watched(sequence: Sequence, *vehicles: int) -> Watched:
    """A sequence of which only the boxes of some vehicles are seen."""
    return Watched(**vars(sequence), vehicles=vehicles)


def boxed_picture(sequence: Sequence, frame: int) -> Image:
    """All matches of a frame with the one before; those in the boxes of vehicles are orange."""
    config, boxes = preset("feature_selection"), sequence.boxes(frame)
    matches = frame_matches(sequence, frame, config)
    kept = ~in_boxes(matches.cur_left, boxes, config.filter)
    count = f"{np.count_nonzero(~kept)} of all {len(kept)} matches are in vehicle boxes (orange)"
    picture = photo(match_image(stereo(sequence, frame)[0], matches, kept, boxes))
    return caption(picture, f"frame {int(sequence.frames[frame])}: {count}")


def rays_view(sequence: Sequence, frame: int) -> View:
    """Both cameras of a pair, and the rays from them to some near matches, in three dimensions."""
    points, right = frame_points(sequence, frame, preset("solution_selection")), np.eye(4)
    right[0, 3] = sequence.camera.baseline
    near = points.X_p[(points.X_p[:, 2] > 0) & (points.X_p[:, 2] < RAYS_END)]
    some = near[np.linspace(0, len(near) - 1, min(len(near), RAYS)).astype(int)]
    rays = [
        Shape(np.array([centre, X]), colour, width=1.0)
        for centre, colour in ((np.zeros(3), GOOD), (right[:3, 3], THIRD))
        for X in some
    ]
    cameras = *camera(np.eye(4), "left camera"), *camera(right)
    return view(*cameras, *rays, Shape(some, BAD, "dots", width=5.0), title="Two rays meet in a point")


def poses_view(sequence: Sequence, every: int = 10) -> View:
    """The true poses as cameras, every tenth one, in three dimensions."""
    poses = from_first(true_poses(sequence))
    cameras = [part for k in range(0, len(poses), every) for part in camera(poses[k], str(k), size=2.0)]
    path = Shape(poses[:, :3, 3], GOOD)
    return view(path, *cameras, title=f"{sequence.name}: every {every}th pose, with the number of its frame")


def depth_figure(measured: Array, true: Array, height: int = 260) -> Figure:
    """Measured against true depth (N,), metres, and the relative error over the depth."""
    made, (pairs, errors) = figure(height, 2)
    good = np.isfinite(measured) & np.isfinite(true)
    measured, true = measured[good], true[good]
    error = np.clip(100 * (measured / true - 1.0), -MOST, MOST)
    for axis, values, line, limits in (
        (pairs, measured, (0, FARTHEST), (0, FARTHEST)),
        (errors, error, (0, 0), (-MOST, MOST)),
    ):
        axis.plot((0, FARTHEST), line, color=PALE, linewidth=1)
        axis.plot(true, values, ".", color=GOOD, markersize=3)
        axis.set(xlim=(0, FARTHEST), ylim=limits)
    finish(pairs, f"depth of {len(true)} matches", "true depth [m]", "measured depth [m]")
    finish(errors, "relative error; larger ones at the edge", "true depth [m]", "error [%]")
    return made


def method_stages(sequence: Sequence, frame: int) -> dict[str, Image | Figure]:
    """A picture for each of the stages 1 to 4, of the matches that the buckets leave in one frame >= 2."""
    config, focal = preset("solution_selection"), sequence.camera.f
    points = frame_points(sequence, frame, config)
    everything = np.ones(len(points.matches), np.bool_)
    words = f"{len(points.matches)} matches after the buckets: each line leads to where the point is now"
    matches = match_image(stereo(sequence, frame)[0], points.matches, everything, no_boxes())

    sets = draw_sets(np.random.default_rng(0), len(points.x_p), config.selection.sets)
    polynomial, (axis,) = figure(220)
    polynomial_chart(axis, polynomial_of(points.x_p[sets[0]], points.x_c[sets[0]]))

    found = five_point(points.x_p[sets], points.x_c[sets])
    e_prev = previous_vector(sequence, frame, config)
    R_true = None if points.T_cp is None else points.T_cp[:3, :3]
    candidates = field_of(found, points, e_prev, R_true, config.selection, focal)
    R_cp, _, inliers = motion_of(found.E[candidates.selected], points, config.selection, focal)
    return {
        "matches": caption(photo(matches), words),
        "polynomial": polynomial,
        "selection": field_figure(candidates),
        "residuals": residual_figure(sequence, frame, R_cp, inliers),
    }


def residual_figure(
    sequence: Sequence, frame: int, R_cp: Array, inliers: BoolArray, height: int = 240
) -> Figure:
    """Residuals over depth for the translation from the inliers (N,); matches in vehicle boxes in another
    colour."""
    config, rig = preset("feature_selection"), sequence.camera
    points = frame_points(sequence, frame, config)
    made, (axis,) = figure(height)
    solved = solve_translation(rig, points.matches[inliers], R_cp, config.translation)
    assert solved is not None
    M, d = eliminate_points(*feature_rows(rig, points.matches, R_cp))
    residual = rig.f * np.linalg.norm(d - M @ solved[0], axis=1) / points.X_p[:, 2]
    inside = in_boxes(points.matches.cur_left, sequence.boxes(frame), config.filter)
    for chosen, colour, words in ((~inside, GOOD, "elsewhere"), (inside, BAD, "in a vehicle's box")):
        axis.plot(points.X_p[chosen, 2], residual[chosen], ".", color=colour, markersize=4, label=words)
    log_axis(axis.yaxis, 0.01, 50.0)
    axis.set_xlim(0, FARTHEST)
    step = ", ".join(f"{value:.2f}" for value in solved[0].round(2) + 0.0)  # no minus before a zero
    finish(axis, f"residuals of t_cp = ({step}) m", "depth [m]", "residual [px]", boxed=True)
    return made
