"""Chapter 0: look at a sequence: both images, disparity, depth of a point, the true path.

And, drawn for its pages: a run, depths, and one picture for each stage of the method.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib.figure import Figure

from vo_lib.beyond.selection import sample_sets
from vo_lib.beyond.translation import solve_translation
from vo_lib.config import SelectionConfig, preset
from vo_lib.core.boxes import no_boxes
from vo_lib.core.poses import from_first
from vo_lib.core.settings import Checked, setting
from vo_lib.core.types import Array, Image
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import trajectory_distances
from vo_lib.front_end.surface import CoarseDisparity, coarse_disparity
from vo_lib.method.boxes import in_boxes
from vo_lib.method.five_point import five_point
from vo_lib.runs.runner import Run
from vo_lib.tables.plots import distance_from_truth, draw_trajectory, match_image

from ..ch02.figures import polynomial_chart, polynomial_of
from ..ch02.panel import reference_rotation
from ..ch03.figures import field_figure
from ..ch03.panel import field_of, previous_vector
from ..controls import Control
from ..drawing import BAD, DARK, GOOD, PALE, WIDTH, bgr, caption, figure, finish, photo, say, stack
from ..facts import Fact
from ..frames import Memory, frame_matches, frame_points, key_of, stereo, truth
from ..lessons import consensus_rotation
from ..panel import Drawing, Panel, State

_disparities: Memory[CoarseDisparity] = Memory(8)
HALF = WIDTH // 2
LEFT_HEIGHT, HALF_HEIGHT, CHART_HEIGHT = 298, 150, 210
SETS = 200
MOST = 30  # per cent shown of a depth's error


@dataclass(frozen=True)
class PointView(Checked):
    """The point that the panel follows from the left into the right image."""

    u: float = setting(0.3, "column of the point, as a share of the image width", low=0, high=1)
    v: float = setting(0.72, "row of the point, as a share of the image height", low=0, high=1)


def disparity_map(sequence: Sequence, frame: int, largest: int) -> CoarseDisparity:
    """Disparity (H/2, W/2) of a frame by block matching, pixels of the full image; negative where none."""
    pair = stereo(sequence, frame)
    return _disparities.get((*key_of(sequence, frame), largest), lambda: coarse_disparity(*pair, largest))


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


def pair_picture(left: Image, right: Image) -> Image:
    """The two images of a pair side by side."""
    parts = [caption(photo(image, HALF), words) for image, words in ((left, "left"), (right, "right"))]
    return np.concatenate(parts, axis=1)


def run_figure(result: Run, height: int = 300) -> Figure:
    """A run from above beside the truth, and the distance between the two along the way."""
    made, (path, error) = figure(height, 2)
    draw_trajectory(path, result.poses, "computed", GOOD, width=3.0)
    truth = result.sequence.truth
    if truth is not None:
        draw_trajectory(path, from_first(truth), "truth", DARK, "--")
        error.plot(100 * distance_from_truth(result.poses, truth), color=BAD)
    path.set_aspect("equal", adjustable="datalim")
    finish(path, "path from above", "x, right [m]", "z, forward [m]")
    finish(error, "distance from the true place", "frame", "distance [cm]")
    return made


def depth_figure(measured: Array, true: Array, height: int = 260) -> Figure:
    """Measured against true depth (N,), metres, and the relative error over the depth."""
    made, (pairs, errors) = figure(height, 2)
    good = np.isfinite(measured) & np.isfinite(true)
    measured, true = measured[good], true[good]
    pairs.plot([0, 100], [0, 100], color=PALE, linewidth=1)
    pairs.plot(true, measured, ".", color=GOOD, markersize=3)
    pairs.set_xlim(0, 80)
    pairs.set_ylim(0, 80)
    finish(pairs, "depth of the matches", "true depth [m]", "measured depth [m]")
    errors.axhline(0.0, color=PALE, linewidth=1)
    error = np.clip(100 * (measured / true - 1.0), -MOST, MOST)
    errors.plot(true, error, ".", color=GOOD, markersize=3)
    errors.set_xlim(0, 80)
    errors.set_ylim(-MOST, MOST)
    finish(errors, "relative error; larger ones at the edge", "true depth [m]", "error [%]")
    return made


class Stages(NamedTuple):
    """A picture for each stage of the method, of one frame."""

    matches: Image
    polynomial: Figure
    selection: Figure
    residuals: Figure
    boxes: Image


def method_stages(sequence: Sequence, frame: int) -> Stages:
    """The method on one frame >= 2: a picture of what each stage does."""
    config, camera = preset("feature_selection"), sequence.camera
    left = stereo(sequence, frame)[0]
    points = frame_points(sequence, frame, config)
    everything = np.ones(len(points.matches), np.bool_)
    words = f"{len(points.matches)} matches after bucketing: each line leads to where the point is now"
    matches = caption(photo(match_image(left, points.matches, everything, no_boxes())), words)

    sets = sample_sets(np.random.default_rng(0), len(points.x_p), SETS)
    polynomial, (axis,) = figure(220)
    polynomial_chart(axis, polynomial_of(points.x_p[sets[0]], points.x_c[sets[0]]))

    found = five_point(points.x_p[sets], points.x_c[sets])
    e_prev = previous_vector(sequence, frame, config)
    R_true = reference_rotation(sequence, frame, points)
    field = field_of(found, points, e_prev, R_true, SelectionConfig(), camera.f)
    selection = field_figure(field)

    all_matches, boxes = frame_matches(sequence, frame, config), sequence.boxes(frame)
    kept = ~in_boxes(all_matches.cur_left, boxes, config.filter)
    words = f"{np.count_nonzero(~kept)} of {len(kept)} matches lie in vehicle boxes"
    boxed = caption(photo(match_image(left, all_matches, kept, boxes)), words)
    return Stages(matches, polynomial, selection, residual_figure(sequence, frame), boxed)


def residual_figure(sequence: Sequence, frame: int, height: int = 240) -> Figure:
    """Residuals of the solved motion over depth, matches in vehicle boxes apart."""
    config, camera = preset("feature_selection"), sequence.camera
    points = frame_points(sequence, frame, config)
    made, (axis,) = figure(height)
    R_cp = consensus_rotation(points.x_p, points.x_c, points.X_p, np.random.default_rng(0), camera.f)
    solved = None if R_cp is None else solve_translation(camera, points.matches, R_cp, config.translation)
    if solved is None:
        say(axis, "this frame has no solution")
        return made
    t_cp, residual = solved
    inside = in_boxes(points.matches.cur_left, sequence.boxes(frame), config.filter)
    for chosen, colour, words in ((~inside, GOOD, "elsewhere"), (inside, BAD, "in a vehicle's box")):
        axis.plot(points.X_p[chosen, 2], residual[chosen], ".", color=colour, markersize=4, label=words)
    axis.set_yscale("log")
    axis.set_xlim(0, 80)
    axis.minorticks_off()
    axis.set_yticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
    step = ", ".join(f"{value:.2f}" for value in t_cp.round(2) + 0.0)  # no minus before a zero
    finish(axis, f"residuals of t_cp = ({step}) m", "depth [m]", "residual [px]")
    return made
