"""Figures of chapter 2: epipolar lines, the polynomial and its roots, the four motions of one E."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import (
    inverse,
    rigid,
    rotation_angle,
    rotation_from_vector,
    transform,
)
from vo_lib.geometry.types import Array, Image, Index
from vo_lib.paper.five_point import (
    EXPONENTS,
    cubic_constraints,
    determinant,
    eliminate,
    epipolar_rows,
    null_space,
)
from vo_lib.paper.real_roots import DEGREE, real_roots

from ..colours import BAD, CYCLE, DARK, FOURTH, GOOD, PALE, WHITE, bgr
from ..drawing import FONT_SIZE, caption, figure, finish, log_axis, numbers_at, photo, room
from ..drawn_matches import draw_dots, draw_flow
from ..frames import Points
from ..view3d import Shape, camera_shape
from . import library
from .puzzle import Puzzle

# Share of the polynomial's largest value; larger values are compressed.
COMPRESSED = 1e-3
TOP = 1.1 * float(np.arcsinh(1 / COMPRESSED))  # of the chart, a little above the largest value after that
FIVE_COLOUR = "#F0E442"  # of the five matches in a picture
LEAST_REACH = 1.8  # of a view from above, in lengths of t: a camera and its arrow are within it


def epipolar_line(E: Array, x_p: Array, camera: StereoCamera) -> Array:
    """The epipolar line of a previous point x_p (2,) in the current image: (a, b, c), pixels, a² + b² = 1.

    Its points (u, v) have a u + b v + c = 0. `E x_p` is the line in normalised coordinates, and K⁻ᵀ E x_p the line
    in pixels.
    """
    line = np.linalg.inv(camera.K).T @ E @ np.append(x_p, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(line / np.linalg.norm(line[:2]))


def draw_line(picture: Image, line: Array, colour: str, thickness: int = 1) -> None:
    """Draw a line a u + b v + c = 0 with a² + b² = 1 across a BGR picture, in place; no line if it is not finite."""
    if not np.isfinite(line).all():
        return  # E x_p = 0: of a wrong answer, or at the epipole
    middle = np.array(picture.shape[1::-1]) / 2
    foot = middle - (line[:2] @ middle + line[2]) * line[:2]
    along = picture.shape[1] * np.array([-line[1], line[0]])
    # Sixteenths of a pixel; a line may be far outside.
    ends = np.clip(np.rint(16 * np.stack([foot - along, foot + along])), -(2**24), 2**24).astype(int)
    start, end = ends.tolist()
    cv2.line(picture, start, end, bgr(colour), thickness, cv2.LINE_AA, shift=4)


def solution_line(number: int, motion: Array, match: int, distance_px: float) -> str:
    """A line of text about a solution: its rotation, its direction, and the distance of a match from its line."""
    R = motion[:, :3]
    angle = np.degrees(rotation_angle(R))
    centre = -R.T @ motion[:, 3]  # of the current camera, in the previous one
    way = ", ".join(f"{part:5.2f}" for part in centre)
    turn = f"solution {number}: turns by {angle:6.2f}° and drives along ({way})"
    return f"{turn}; match {match} is {distance_px:6.2f} px from its line"


def puzzle_lines(puzzle: Puzzle, points: Points, focal: float) -> list[str]:
    """A line of text for each solution of a puzzle; of the four motions, the one in front of both cameras."""
    lines = []
    x_p = points.x_p[puzzle.five]
    x_c = points.x_c[puzzle.five]
    sixth = [puzzle.sixth]
    for number, E in enumerate(puzzle.E, start=1):
        motion = library.choose_motion(library.four_motions(E), x_p, x_c)
        distance = focal * float(library.distances(E, points.x_p[sixth], points.x_c[sixth])[0])
        lines.append(solution_line(number, motion, puzzle.sixth, distance))
    return lines


def sixth_picture(
    image: Image, camera: StereoCamera, E: Array, points: Points, five: Index, sixth: int
) -> Image:
    """The current image with a sixth match and its line by each solution E (M, 3, 3), and the five matches."""
    picture = photo(image, image.shape[1])
    places = pixels(points.x_c[five], camera)
    draw_dots(picture, places, [DARK] * len(five), 8)
    draw_dots(picture, places, [FIVE_COLOUR] * len(five), 6)
    repeated = [sixth] * len(E)  # the same match for each solution
    return lines_picture(picture, camera, E, points.x_p[repeated], points.x_c[repeated], repeated)


def pixels(x: Array, camera: StereoCamera) -> Array:
    """Normalised points (…, 2) as pixels of the left image."""
    return np.asarray(x * camera.f + (camera.cx, camera.cy))


def lines_picture(
    image: Image, camera: StereoCamera, E: Array, x_p: Array, x_c: Array, names: Sequence[int]
) -> Image:
    """The current image with M numbered matches (M, 2); each match has an epipolar line, from its E (M, 3, 3).

    If all M rows are the same match, the lines also have numbers.
    """
    picture = photo(image, image.shape[1])
    colours = [CYCLE[number % len(CYCLE)] for number in range(len(E))]
    for each, point, colour in zip(E, x_p, colours, strict=True):
        draw_line(picture, epipolar_line(each, point, camera), colour, 2)
    is_one_match = len(set(names)) == 1
    dot_colours = [WHITE] * len(E) if is_one_match else colours
    draw_dots(picture, pixels(x_c, camera), dot_colours, 6, names)
    if is_one_match:
        below = np.array([(20.0 + 50 * number, camera.height - 14.0) for number in range(len(E))])
        draw_dots(picture, below, colours, 8, range(1, 1 + len(E)))
    return photo(picture)


def polynomial_of(x_p: Array, x_c: Array) -> tuple[Array, Array]:
    """The degree-10 polynomial of one five-point set, x_p and x_c (5, 2).

    Returns coefficients (11,) of z¹⁰, …, w¹⁰ and real roots (K,): directions of (z, w) in [0, 180) degrees.
    """
    basis, _ = null_space(epipolar_rows(x_p[None], x_c[None]))
    coefficients = determinant(eliminate(cubic_constraints(basis)))
    z, w, _, _ = real_roots(coefficients)
    return coefficients[:, 0], np.degrees(np.arctan2(w, z)) % 180.0


def polynomial_chart(axis: Axes, coefficients: Array, roots: Array) -> None:
    """A polynomial (11,) along the directions (z, w) = (cos θ, sin θ), and its real roots (K,), degrees."""
    theta = np.linspace(0.0, np.pi, 721)
    powers_of_w = np.arange(DEGREE + 1)
    powers_of_z = powers_of_w[::-1]
    monomials = np.cos(theta)[:, None] ** powers_of_z * np.sin(theta)[:, None] ** powers_of_w
    values = monomials @ coefficients
    axis.axhline(0.0, color=PALE, linewidth=1)
    largest = float(np.max(np.abs(values))) or 1.0  # a wrong answer may give zeros only
    height = np.arcsinh(values / (COMPRESSED * largest))
    axis.plot(np.degrees(theta), height, color=DARK, linewidth=1)
    axis.plot(roots, np.zeros(len(roots)), "o", color=BAD, markersize=5)
    axis.set(xlim=(-5, 185), ylim=(-TOP, TOP))
    numbers_at(axis.xaxis, (0, 45, 90, 135, 180))
    numbers_at(axis.yaxis, ())
    title = f"polynomial of degree 10: {len(roots)} real roots"
    finish(axis, title, "direction of (z, w) [deg]", "det C, compressed")


def errors_chart(axis: Axes, errors: Array, winner: float, what: str = "rotation error") -> None:
    """Histogram of rotation errors, degrees, on a logarithmic axis, and the error of the winner."""
    edges = np.logspace(-3, 2, 41)
    counts = np.histogram(np.clip(errors, edges[0], edges[-1]), edges)[0]
    axis.stairs(counts, edges, fill=True, color=GOOD)
    axis.axvline(max(winner, edges[0]), color=BAD, linewidth=2)
    log_axis(axis.xaxis, edges[0], edges[-1])
    axis.set_ylim(0, room(1.05 * float(counts.max()), least=1.0))
    finish(axis, "each set's best solution (line: consensus winner)", f"{what} [deg]", "sets")


def draw_camera(axis: Axes, motion: Array, colour: str, size: float) -> None:
    """Draw the current camera of a motion [R | t] (3, 4) from above: its view, and an arrow along its axis.

    The thick edge is the right side of the camera's image, so that a camera upside down is recognised.
    """
    R = motion[:, :3]
    centre = -R.T @ motion[:, 3]
    corners = centre + size * np.array([[-0.6, 0.0, 1.0], [0.6, 0.0, 1.0]]) @ R
    tip = centre + size * np.array([0.0, 0.0, 1.8]) @ R
    x, _, z = np.array([corners[1], centre, corners[0], corners[1]]).T
    axis.plot(x, z, color=colour, linewidth=1.2)
    axis.plot(x[:2], z[:2], color=colour, linewidth=3.5)
    way = {"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", (tip[0], tip[2]), (centre[0], centre[2]), arrowprops=way)


def motions_figure(
    motions: Array, names: Sequence[str], points: Array | None = None, front: Any = None
) -> Figure:
    """Motions [R | t] (M, 3, 4) from above: the previous camera (dark) at (0, 0), the current camera (pink).

    points : (M, N, 3) points of the matches by each motion, in the previous camera; unit |t|.
    front : (M, N) masks of the points in front of both cameras; all others are orange.
    """
    made, axes = figure(280, len(motions))
    still = np.eye(4)[:3]
    for k, (axis, motion, name) in enumerate(zip(axes, motions, names, strict=True)):
        reach = LEAST_REACH
        if points is not None:
            # Most points; some are far outside, where their rays are nearly parallel.
            away = np.abs(np.nan_to_num(points[k][:, [0, 2]])).max(axis=1)
            reach = room(float(np.percentile(away, 80)), least=LEAST_REACH)
            for mask, colour in ((front[k], GOOD), (~front[k], BAD)):
                axis.plot(*points[k][mask][:, [0, 2]].T, ".", color=colour, markersize=4)
        size = 0.2 * reach if points is None else 0.1 * reach
        draw_camera(axis, still, DARK, size)
        draw_camera(axis, motion, FOURTH, size)
        axis.set(xlim=(-reach, reach), ylim=(-reach, reach))
        axis.set_aspect("equal", adjustable="box")
        finish(axis, name, "x [length of t]", "z" if k == 0 else "")
    return made


def distances_picture(
    image: Image, camera: StereoCamera, points: Points, distances: Array, limit: float
) -> Image:
    """The current image with its matches: orange where a distance (N,) is above the limit, else blue."""
    picture = photo(image, image.shape[1])
    start = pixels(points.x_p, camera)
    end = pixels(points.x_c, camera)
    far = distances > limit
    draw_flow(picture, start[~far], end[~far], [GOOD] * int(np.sum(~far)), 2.5)
    draw_flow(picture, start[far], end[far], [BAD] * int(np.sum(far)), 4)
    return caption(
        photo(picture), f"orange: {np.sum(far)} matches farther than {limit:g} px from their lines"
    )


def rows_figure(A: Array) -> Figure:
    """A constraint matrix (5, 9) with its numbers."""
    made, (axis,) = figure(215)
    largest = float(np.abs(A).max())
    axis.imshow(A, cmap="PuOr", vmin=-largest, vmax=largest, aspect="auto")
    for (row, column), value in np.ndenumerate(A):
        dark = abs(value) > 0.6 * largest
        colour = "white" if dark else "black"
        axis.text(column, row, f"{value:.3f}", ha="center", va="center", color=colour, fontsize=FONT_SIZE)
    entries = ["E11", "E12", "E13", "E21", "E22", "E23", "E31", "E32", "E33"]
    axis.set_xticks(range(9), entries)
    axis.set_yticks(range(5), [f"{row + 1}" for row in range(5)])
    finish(axis, "A: factors of the nine entries of E", "", "match")
    return made


def slice_figure(size: Array, reach: float, z: float) -> Figure:
    """Norms (K, K) of the ten constraints over (x, y) from -reach to reach around a solution, at one z and w = 1."""
    made, (axis, bar) = figure(330, 2, (1.0, 0.025), 560)
    shown = axis.imshow(
        np.log10(np.maximum(size / (size.max() or 1.0), 1e-4)),
        cmap="viridis",
        origin="lower",
        extent=(-reach, reach, -reach, reach),
        aspect="auto",
    )
    axis.plot(0, 0, "o", color=BAD, markersize=14, markerfacecolor="none", markeredgewidth=2)
    axis.set(xticks=(-reach, 0, reach), yticks=(-reach, 0, reach))
    finish(axis, f"a slice of the space at z = {z:.2f}, w = 1", "x - x of solution 1", "y - y of solution 1")
    made.colorbar(shown, cax=bar)
    bar.yaxis.set_ticks_position("left")
    bar.yaxis.set_label_position("left")
    finish(bar, "", y="log10 (size / largest)")
    return made


# The two cameras and the point of the sketch of the epipolar plane.
TOY = rigid(rotation_from_vector(np.array([0.0, -0.3, 0.0])), np.array([-0.7, 0.0, -0.6]))  # T_cp
TOY_X = np.array([0.9, -0.5, 2.6])  # in the previous camera


def epipolar_plane() -> list[Shape]:
    """Two cameras, a point, the epipolar plane, and its intersection with the current image."""
    T_p_c = inverse(TOY)
    c = T_p_c[:3, 3]
    size = 1.2  # depth of the drawn cameras, metres
    moved = transform(TOY, TOY_X[None])[0]
    x_p = TOY_X[:2] / TOY_X[2]
    x_c = moved[:2] / moved[2]
    epipole = TOY[:2, 3] / TOY[2, 3]
    ends = size * np.array([np.append(x_c + k * (epipole - x_c), 1.0) for k in (-0.3, 1.1)])
    return [
        camera_shape(np.eye(4), "previous camera", size=size),
        camera_shape(T_p_c, "current camera", FOURTH, size=size),
        Shape(np.stack([np.zeros(3), TOY_X, c, np.zeros(3)]), GOOD, "area"),
        Shape(np.stack([size * np.append(x_p, 1.0), TOY_X]), GOOD, name="ray of the previous camera"),
        Shape(np.stack([c / 2, np.zeros(3), c]), DARK, name="t", width=3.0),  # its name is in the middle
        Shape(np.stack([np.zeros(3), TOY_X]), GOOD),
        Shape(np.stack([TOY_X, c]), GOOD, name="point"),
        Shape(transform(T_p_c, ends), BAD, name="epipolar line", width=3.0),
    ]


SUPERSCRIPTS = {1: "", 2: "²", 3: "³"}  # of a power of a variable


def _monomial(powers: Array) -> str:
    """The name of a monomial with these powers (4,) of x, y, z and w, such as "x²y"."""
    name = ""
    for letter, power in zip("xyzw", powers, strict=True):
        if power > 0:
            name += letter + SUPERSCRIPTS[power]
    return name


MONOMIALS = [_monomial(powers) for powers in EXPONENTS]


def cubics_figure(before: Array, after: Array) -> Figure:
    """Magnitudes of the coefficients (10, 20) of ten cubics before and after elimination; white is zero."""
    made, (*axes, bar) = figure(250, 3, (1.0, 1.0, 0.02))
    charts = ((before, "the ten cubics"), (after, "x³, y³, x²y, xy² eliminated"))
    for axis, (matrix, title) in zip(axes, charts, strict=True):
        size = np.log10(np.maximum(np.abs(matrix) / np.abs(matrix).max(), 1e-9))
        shown = axis.imshow(np.where(size > -8, size, np.nan), cmap="viridis", vmin=-4, vmax=0, aspect="auto")
        axis.set_xticks(range(20), MONOMIALS, rotation=90)
        axis.set_yticks(range(0, 10, 3), [f"{row + 1}" for row in range(0, 10, 3)])
        axis.plot([3.5, 3.5], [-0.5, 9.5], color=BAD, linewidth=1.5)
        if matrix is after:
            axis.plot([-0.5, 19.5], [3.5, 3.5], color=BAD, linewidth=1.5)
        finish(axis, title)
    made.colorbar(shown, cax=bar)
    bar.yaxis.set_ticks_position("left")
    bar.yaxis.set_label_position("left")
    finish(bar, "", y="log10 |coefficient / largest|")
    return made
