"""Figures of chapter 0: the jam, the stages of the method, points and paths seen from above."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib import run
from vo_lib.config import preset
from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import no_boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import DEVIATION_OVER_MEDIAN, inverse
from vo_lib.geometry.types import Array, Image
from vo_lib.paper.box_removal import in_boxes
from vo_lib.paper.five_point import five_point
from vo_lib.paper.odometry import Odometry
from vo_lib.report.plots import match_image

from ..by_depth import by_depth_figure
from ..colours import BAD, CYCLE, DARK, GOOD, PALE, THIRD
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, figure, finish, photo, room
from ..drawing import RIGHT as RIGHT_MARGIN
from ..drawn_matches import draw_dots, draw_flow, features_picture
from ..frames import frame_matches, frame_points, scene_truth, stereo
from ..simulation.given_boxes import WithBoxes
from ..view3d import Shape, View, camera_shape

JAM_LEFT = 76  # margin of the figure of the jam, for numbers such as -0.5 and the name of the axis, pixels
RAYS = 14  # number
RAYS_END = 15.0  # largest distance of their points, metres
FIRST_FRAMES = 20  # of a sequence without truth, whose motions are estimated
AGREES_M = 0.3  # largest difference from the translation of a near point that agrees with it, metres
SAME_M = 0.01  # largest distance of a point from the library's that is called equal, metres


def with_boxes_of_vehicles(sequence: Sequence, *vehicles: int) -> WithBoxes:
    """A drawn sequence with boxes of only those vehicles whose numbers in the truth are `vehicles`."""
    ground_truth = scene_truth(sequence)
    if ground_truth is None:
        raise DataError(f"{sequence.name} is not a drawn scene: it has no truth of vehicles")
    given = []
    for index, frame in enumerate(sequence.frames):
        boxes = sequence.boxes(index)
        corners = np.rint(boxes.xyxy).astype(int)
        middles = (corners[:, :2] + corners[:, 2:]) / 2
        at_middle = ground_truth.vehicle_at(int(frame), middles)
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
    shapes = [camera_shape(np.eye(4), "left camera"), camera_shape(right)]
    for centre, colour in ((np.zeros(3), GOOD), (right[:3, 3], THIRD)):
        shapes += [Shape(np.array([centre, X]), colour, width=1.0) for X in some]
    shapes.append(Shape(some, BAD, "dots", width=5.0))
    return View(*shapes, title="Two rays meet in a point")


def poses_view(sequence: Sequence, every: int = 20) -> View:
    """The path of the true poses in three dimensions, with a camera at some poses."""
    poses = from_first(sequence.true_poses)
    cameras = [camera_shape(poses[k], str(k), size=2.0) for k in range(0, len(poses), every)]
    path = Shape(poses[:, :3, 3], GOOD)
    return View(path, *cameras, title=f"{sequence.name}: every {every}th pose, with the number of its frame")


def depth_figure(camera: StereoCamera, measured: Array, true: Array) -> Figure:
    """Errors of measured depths (N,) by true depth, metres, and σ_Z for the scatter of the disparity errors.

    The scatter is the standard deviation of most errors, from their median size: wrong matches hardly change it.
    """
    good = np.isfinite(measured) & np.isfinite(true)
    measured = measured[good]
    true = true[good]
    fb = camera.f * camera.baseline
    sigma = DEVIATION_OVER_MEDIAN * float(np.median(np.abs(fb / measured - fb / true)))
    labels = (f"{len(true)} matches", f"Z² / (f b) · {sigma:.2f} px")
    return by_depth_figure(true, np.abs(measured - true), labels, "error of the depth", sigma / fb)


def road_axis(axis: Axes, ahead: tuple[float, float], height: int) -> None:
    """Let an axis show the road from above, with one scale: forward is to the right, right is down.

    ahead : first and last metre forward. height : of the axis, pixels; its figure is `WIDTH` pixels wide.
    """
    pixels_per_metre = axis.get_position().width * WIDTH / (ahead[1] - ahead[0])
    half = height / pixels_per_metre / 2
    axis.set(xlim=ahead, ylim=(half, -half))


def jam_figure(jam: Sequence, runs: Mapping[str, Array]) -> Figure:
    """Paths of the runs from above, with equal scales, and their distances from the true path by frame.

    runs : poses (N, 4, 4) by name. The distances are drawn in centimetres.
    """
    true = from_first(jam.true_poses)[:, :3, 3]
    frames = int(jam.frames[0]) + np.arange(len(true))
    length = float(true[-1, 2])
    made = Figure(figsize=(WIDTH / 100, 4.3), dpi=100)
    width = (WIDTH - JAM_LEFT - RIGHT_MARGIN) / WIDTH
    above = made.add_axes((JAM_LEFT / WIDTH, 0.66, width, 0.26))
    below = made.add_axes((JAM_LEFT / WIDTH, 0.11, width, 0.38))
    largest = 0.0
    for (name, poses), colour in zip(runs.items(), (BAD, THIRD, CYCLE[3], GOOD), strict=False):
        places = poses[:, :3, 3]
        away = 100 * np.linalg.norm(places - true, axis=1)
        largest = max(largest, float(away.max()))
        above.plot(places[:, 2], places[:, 0], color=colour, linewidth=2, label=name)
        below.plot(frames, away, color=colour, linewidth=2, label=f"{name}: {away[-1]:.1f} cm at the end")
    above.plot(true[:, 2], true[:, 0], color=DARK, linewidth=1, label="truth")
    road_axis(above, (-0.2, length + 0.6), round(0.26 * 430))
    below.set_ylim(0, room(1.05 * largest))
    finish(above, "paths from above", "z, forward [m]", "x, right [m]", "above")
    finish(below, "distance from the true path [cm]", "frame", "", "upper left")
    return made


def stage_pictures(sequence: Sequence, frame: int) -> dict[str, Image | Figure]:
    """A picture of each of the stages 1 to 4 for a frame >= 2, with the matches after bucketing."""
    config = preset("solution_selection")
    odometry = Odometry(sequence.camera, config)
    odometry.step(frame_matches(sequence, frame - 1, config), no_boxes())
    points = frame_points(sequence, frame, config)
    matches = points.matches
    sets = odometry.five_point_sets(points.x_p, points.x_c)
    E, set_index = five_point(points.x_p[sets], points.x_c[sets])
    winner = odometry.select(E, set_index, points.x_p, points.x_c).candidate
    rotation = odometry.rotation(E[winner], matches)
    t_cp = odometry.translate(matches, rotation)
    if t_cp is None:
        raise DataError(f"frame {frame}: no feature is near enough for a translation; choose another frame")

    image, _ = stereo(sequence, frame)
    start = matches.prev_left
    end = matches.cur_left
    count = len(matches)
    words = f"{count} matches: each line leads from where the point was to where it is"
    five = sets[0]
    motions = int(np.count_nonzero(set_index == 0))
    agree = rotation.inliers
    best = f"the best of {len(E)} candidates: {np.count_nonzero(agree)} of {count} matches agree (blue)"
    X_c = sequence.camera.triangulate(matches.cur_left, matches.cur_right)
    return {
        "matches": features_picture(image, start, end, np.ones(count), words),
        "five": five_picture(image, start[five], end[five], motions),
        "winner": features_picture(image, start, end, agree, best),
        "translation": translation_figure(points.X_p @ rotation.R_cp.T, X_c, t_cp),
    }


def five_picture(image: Image, start: Array, end: Array, motions: int) -> Image:
    """The five matches of one set in an image, numbered, with lines from their starts to their ends (5, 2).

    motions : how many motions fit them exactly.
    """
    picture = photo(image, image.shape[1])
    draw_flow(picture, start, end, [BAD] * len(start), 3, 2)
    draw_dots(picture, end, [BAD] * len(end), 5, range(1, len(end) + 1))
    words = f"one set of five matches, and {motions} motions that fit it exactly"
    return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words)


def translation_figure(turned: Array, now: Array, t_cp: Array) -> Figure:
    """Near points from above: a line from each point after the rotation (N, 3) to its place now (N, 3), metres.

    t_cp : (3,) the translation, with which blue points agree.
    """
    height = 280
    made, (axis,) = figure(height + 68)
    road_axis(axis, (3.0, 25.0), height)
    agree = np.linalg.norm(now - turned - t_cp, axis=1) <= AGREES_M
    for chosen, colour, words in ((agree, GOOD, "agrees with t"), (~agree, BAD, "does not")):
        ends = np.stack([turned[chosen], now[chosen]])
        axis.plot(ends[:, :, 2], ends[:, :, 0], color=colour, linewidth=1)
        axis.plot(now[chosen, 2], now[chosen, 0], ".", color=colour, markersize=5, label=words)
    step = ", ".join(f"{value:.2f}" for value in t_cp.round(2) + 0.0)  # no minus before a zero
    finish(axis, f"near points from above, t = ({step}) m", "z, forward [m]", "x, right [m]", "above")
    return made


def above_figure(own: Array, library: Array, deviation: Array) -> Figure:
    """Points (N, 3) of a student's function and of the library from above, metres, with bars of one deviation.

    Blue: equal; orange: the student's, where they differ, and the library's in grey. Results of another form
    are not drawn. deviation : (N,) of Z.
    """
    if own.shape != library.shape:
        own = np.full(library.shape, np.nan)
    height = 260
    made, (axis,) = figure(height + 68)
    road_axis(axis, (0.0, 60.0), height)
    differ = ~(np.linalg.norm(own - library, axis=1) <= SAME_M)
    z = library[:, 2]
    axis.hlines(library[:, 0], z - deviation, z + deviation, color=DARK, linewidth=1, alpha=0.6)
    axis.plot(z, library[:, 0], ".", color=PALE, markersize=5)
    axis.plot(own[~differ, 2], own[~differ, 0], ".", color=GOOD, markersize=5)
    axis.plot(own[differ, 2], own[differ, 0], ".", color=BAD, markersize=5)
    title = "points from above; bars: one standard deviation of Z"
    finish(axis, title, "z, forward [m]", "x, right [m]")
    return made


def motions_of(sequence: Sequence) -> tuple[list[Array], str]:
    """Motions T_cp (4, 4) of a sequence, and what they are: the true ones, or estimates of the first frames."""
    if sequence.truth is not None:
        poses = sequence.truth
        words = "true motions"
    else:
        first_frames = sequence.part(0, min(FIRST_FRAMES + 1, len(sequence)))
        poses = run(first_frames, preset("solution_selection")).poses
        words = "motions estimated by the paper's method (there is no truth)"
    return [inverse(now) @ before for before, now in itertools.pairwise(poses)], words


def paths_figure(paths: Mapping[str, Array], height: int = 300) -> Figure:
    """Paths (N, 4, 4) from above, with equal scales: forward is to the right, right is down."""
    made, (axis,) = figure(height)
    looks: Any = ((GOOD, 4.0), (BAD, 1.5))
    for (name, poses), (colour, width) in zip(paths.items(), looks, strict=False):
        places = np.asarray(poses)[:, :3, 3]
        axis.plot(places[:, 2], places[:, 0], color=colour, linewidth=width, label=name)
    axis.invert_yaxis()
    axis.set_aspect("equal", adjustable="datalim")
    finish(axis, "paths from above", "z, forward [m]", "x, right [m]", "above")
    return made


def angles_figure(angles: Array) -> Figure:
    """Yaw, pitch and roll (N, 3) of the poses of a path, degrees, by frame."""
    made, (axis,) = figure(220)
    for column, (name, width) in enumerate((("yaw", 3.0), ("pitch", 2.0), ("roll", 1.0))):
        axis.plot(angles[:, column], color=CYCLE[column], linewidth=width, label=name)
    finish(axis, "angles of the camera [deg]", "frame", "", "above")
    return made
