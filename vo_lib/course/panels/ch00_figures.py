"""Chapter 0, drawn: a stereo pair, a run, depths, and one picture for each stage of the method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...beyond.selection import estimate_essential, sample_sets
from ...beyond.translation import solve_translation
from ...config import SelectionConfig, preset
from ...core.boxes import no_boxes
from ...core.geometry import inverse
from ...core.types import Array, Image
from ...data.sequence import Sequence
from ...method.boxes import in_boxes
from ...method.five_point import five_point
from ...runs.runner import Run
from ...tables.plots import draw_trajectory, match_image
from .ch02_figures import polynomial_chart, polynomial_of
from .ch02_five_point import reference_rotation
from .ch03_figures import field_figure
from .ch03_selection import field_of, previous_vector
from .data import frame_matches, frame_points, stereo
from .style import BAD, DARK, GOOD, PALE, WIDTH, caption, figure, finish, photo, say

SETS = 200
MOST = 30  # per cent shown of a depth's error


def pair_picture(left: Image, right: Image) -> Image:
    """The two images of a pair side by side."""
    half = WIDTH // 2
    parts = [caption(photo(image, half), words) for image, words in ((left, "left"), (right, "right"))]
    return np.concatenate(parts, axis=1)


def run_figure(result: Run, height: int = 300) -> Figure:
    """A run from above beside the truth, and the distance between the two along the way."""
    made, (path, error) = figure(height, 2)
    draw_trajectory(path, result.poses, "computed", GOOD, width=3.0)
    truth = result.sequence.truth
    if truth is not None:
        T = inverse(truth[0]) @ truth
        draw_trajectory(path, T, "truth", DARK, "--")
        away = 100 * np.linalg.norm(result.poses[:, :3, 3] - T[:, :3, 3], axis=1)
        error.plot(away, color=BAD)
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
    estimate = estimate_essential(
        points.x_p, points.x_c, points.X_p, None, np.random.default_rng(0), SelectionConfig(), camera.f
    )
    solved = estimate and solve_translation(camera, points.matches, estimate.R_cp, config.translation)
    if not solved:
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
