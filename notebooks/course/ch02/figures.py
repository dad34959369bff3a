"""Figures of chapter 2: epipolar lines, the polynomial and its roots, the four motions of one E."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import (
    decompose_essential,
    essential_angle,
    essential_from_motion,
    inverse,
    rigid,
    rotation_angle,
    rotation_from_vector,
    transform,
)
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.paper.five_point import (
    EXPONENTS,
    cubic_constraints,
    determinant,
    eliminate,
    epipolar_rows,
    five_point,
    null_space,
)
from vo_lib.paper.real_roots import DEGREE, real_roots
from vo_lib.paper.sampson import sampson_distance

from ..colours import BAD, CYCLE, DARK, FOURTH, GOOD, PALE, bgr
from ..drawing import figure, finish, log_axis, photo, room
from ..drawn_matches import draw_dots
from ..simulation.problems import FOCAL, Motion, random_problems
from ..view3d import Shape
from ..view3d import camera as view_of

# Share of the polynomial's largest value; larger values are compressed.
COMPRESSED = 1e-3
TOP = 1.1 * float(np.arcsinh(1 / COMPRESSED))


def epipolar_line(E: Array, x_p: Array, camera: StereoCamera) -> Array:
    """The epipolar line a u + b v + c = 0 of the current point, (3,) pixels, a² + b² = 1.

    `E x_p` is the line in normalised coordinates, and K⁻ᵀ E x_p the line in pixels.
    """
    line = np.linalg.inv(camera.K).T @ E @ np.append(x_p, 1.0)
    return np.asarray(line / np.linalg.norm(line[:2]))


def draw_line(picture: Image, line: Array, colour: str, thickness: int = 1) -> None:
    """Draw a line a u + b v + c = 0 with a² + b² = 1 across a BGR picture, in place."""
    middle = np.array(picture.shape[1::-1]) / 2
    foot = middle - (line[:2] @ middle + line[2]) * line[:2]
    along = picture.shape[1] * np.array([-line[1], line[0]])
    # Sixteenths of a pixel; a line may be far outside.
    ends = np.clip(np.rint(16 * np.stack([foot - along, foot + along])), -(2**24), 2**24).astype(int)
    start, end = ends.tolist()
    cv2.line(picture, start, end, bgr(colour), thickness, cv2.LINE_AA, shift=4)


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
    one = len(set(names)) == 1
    draw_dots(picture, pixels(x_c, camera), ["#FFFFFF"] * len(E) if one else colours, 6, names)
    if one:
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
    order = np.arange(DEGREE + 1)
    values = (np.cos(theta)[:, None] ** order[::-1] * np.sin(theta)[:, None] ** order) @ coefficients
    axis.axhline(0.0, color=PALE, linewidth=1)
    height = np.arcsinh(values / (COMPRESSED * np.max(np.abs(values))))
    axis.plot(np.degrees(theta), height, color=DARK, linewidth=1)
    axis.plot(roots, np.zeros(len(roots)), "o", color=BAD, markersize=5)
    axis.set(xlim=(-5, 185), ylim=(-TOP, TOP), xticks=(0, 45, 90, 135, 180), yticks=())
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


def four_motions(E: Array, x_p: Array, x_c: Array) -> list[tuple[Array, Array, Array, BoolArray]]:
    """The four motions of E (3, 3), with the depths of matches x_p, x_c (N, 2).

    Each motion has R, t with |t| = 1, depths (N,) along the previous rays, and a mask (N,) of the points in
    front of both cameras. Least squares solves depth_c x_c = depth_p R x_p + t: a cross product with one ray
    leaves only the depth along the other ray.
    """
    rotations, t = decompose_essential(E)
    p, c = (np.concatenate([x, np.ones((len(x), 1))], axis=1) for x in (x_p, x_c))
    motions = []
    for R, direction in itertools.product(rotations, (t, -t)):
        q = p @ R.T
        normal = np.cross(c, q)
        squared = np.maximum(np.sum(normal**2, axis=1), 1e-18)
        depth_p, depth_c = (-np.sum(normal * np.cross(ray, direction), axis=1) / squared for ray in (c, q))
        motions.append((R, direction, depth_p, (depth_p > 0) & (depth_c > 0)))
    return motions


TOY = rigid(rotation_from_vector(np.array([0.0, -0.3, 0.0])), np.array([-0.7, 0.0, -0.6]))  # T_cp
TOY_X = np.array([0.9, -0.5, 2.6])  # the point seen by both cameras, in the previous one


def epipolar_plane() -> list[Shape]:
    """Two cameras, a point, the epipolar plane, and its intersection with the current image."""
    T_p_c = inverse(TOY)
    c = inverse(TOY)[:3, 3]
    size = 1.2
    x_p, x_c = (X[:2] / X[2] for X in (TOY_X, transform(TOY, TOY_X[None])[0]))
    epipole = TOY[:2, 3] / TOY[2, 3]
    ends = size * np.array([np.append(x_c + k * (epipole - x_c), 1.0) for k in (-0.3, 1.1)])
    return [
        view_of(np.eye(4), "previous camera", size=size),
        view_of(T_p_c, "current camera", FOURTH, size=size),
        Shape(np.stack([np.zeros(3), TOY_X, c, np.zeros(3)]), GOOD, "area"),
        Shape(np.stack([size * np.append(x_p, 1.0), TOY_X]), GOOD, name="ray of the previous camera"),
        Shape(np.stack([c / 2, np.zeros(3), c]), DARK, name="t", width=3.0),  # its name is in the middle
        Shape(np.stack([np.zeros(3), TOY_X]), GOOD),
        Shape(np.stack([TOY_X, c]), GOOD, name="point"),
        Shape(transform(T_p_c, ends), BAD, name="epipolar line", width=3.0),
    ]


def four_views() -> list[Shape]:
    """The four motions of one essential matrix side by side, each with the rays of the same match.

    Rays are orange where they meet behind a camera.
    """
    x_p, x_c = ((X[:2] / X[2])[None] for X in (TOY_X, transform(TOY, TOY_X[None])[0]))
    shapes = []
    for k, (R, t, depth, front) in enumerate(
        four_motions(essential_from_motion(TOY[:3, :3], TOY[:3, 3]), x_p, x_c)
    ):
        here = rigid(np.eye(3), np.array([3.5 * k, 0.0, 0.0]))
        other = here @ inverse(rigid(R, t))
        X = transform(here, depth[:, None] * np.append(x_p, [[1.0]], axis=1))[0]
        shapes += [view_of(here, f"motion {k + 1}"), view_of(other, colour=FOURTH)]
        shapes += [Shape(np.stack([T[:3, 3], X]), GOOD if front[0] else BAD) for T in (here, other)]
    return shapes


KINDS: dict[str, Motion] = {
    "general": "general",
    "neighbours": "general",
    "a plane": "planar",
    "pure rotation": "pure_rotation",
}


def degeneracies(noise_px: float, count: int = 200) -> tuple[list[str], list[Shape]]:
    """A line of text, and a drawing of 65 points (five in orange) and two cameras, for each kind of scene.

    The text has the number of five-point solutions that fit all 65 points, and the median errors of the best
    solution of noisy points.
    """
    lines = []
    shapes = []
    for number, (name, kind) in enumerate(KINDS.items()):
        given = random_problems(np.random.default_rng(0), count, 65, kind)
        away = np.linalg.norm(given.x_c - given.x_c[:, :1], axis=2)
        five = np.tile(np.arange(5), (count, 1)) if name != "neighbours" else np.argsort(away, axis=1)[:, :5]
        x = np.stack([np.take_along_axis(each, five[..., None], axis=1) for each in (given.x_p, given.x_c)])
        exact = five_point(*x)
        fits = [
            np.abs(sampson_distance(E, given.x_p[k], given.x_c[k])).max() < 1e-7
            for E, k in zip(exact.E, exact.set_index, strict=True)
        ]
        E, of = five_point(*(x + np.random.default_rng(1).normal(0.0, noise_px / FOCAL, x.shape)))
        R, t = decompose_essential(E)
        turn = np.degrees(rotation_angle(np.swapaxes(R, -1, -2) @ given.R_cp[of, None]).min(axis=-1))
        way = np.degrees(essential_angle(t, given.t_cp[of]))
        order = np.lexsort((turn, of))
        best = order[np.unique(of[order], return_index=True)[1]]
        # Without a motion, every [t]× R is a solution, and no t is true.
        still = kind == "pure_rotation"
        fit = "all solutions fit" if still else f"{sum(fits) / count:.1f} solutions fit"
        direction = "" if still else f", of the direction of t {np.median(way[best]):.1f}°"
        lines.append(f"{name:13}: {fit}; error of the rotation {np.median(turn[best]):.2f}°{direction}")
        here = rigid(np.eye(3), np.array([45.0 * number, 0.0, 0.0]))
        other = here @ inverse(rigid(given.R_cp[0], given.t_cp[0]))
        X = transform(here, given.X_p[0])
        shapes += [view_of(here, name, size=2.5), view_of(other, colour=FOURTH, size=2.5)]
        shapes += [Shape(X, GOOD, "dots", width=3.0), Shape(X[five[0]], BAD, "dots", width=6.0)]
    return lines, shapes


POWERS = [["", name, f"{name}²", f"{name}³"] for name in "xyzw"]
MONOMIALS = ["".join(names[power] for names, power in zip(POWERS, row, strict=True)) for row in EXPONENTS]


def cubics_figure(before: Array, after: Array) -> Figure:
    """Magnitudes of the coefficients (10, 20) of ten cubics before and after elimination; white is zero."""
    made, (*axes, bar) = figure(250, 3, (1.0, 1.0, 0.02))
    titles = "the ten cubics", "x³, y³, x²y, xy² eliminated"
    for axis, matrix, title in zip(axes, (before, after), titles, strict=True):
        size = np.log10(np.maximum(np.abs(matrix) / np.abs(matrix).max(), 1e-9))
        shown = axis.imshow(np.where(size > -8, size, np.nan), cmap="viridis", vmin=-4, vmax=0, aspect="auto")
        axis.set_xticks(range(20), MONOMIALS, rotation=90)
        axis.set_yticks(range(0, 10, 3), [f"{row + 1}" for row in range(0, 10, 3)])
        axis.plot([3.5, 3.5], [-0.5, 9.5], color=BAD, linewidth=1.5)
        axis.plot([-0.5, 19.5], [3.5, 3.5], color=BAD, linewidth=1.5 if title[0] == "x" else 0)
        finish(axis, title)
    made.colorbar(shown, cax=bar)
    bar.yaxis.set_ticks_position("left")
    bar.yaxis.set_label_position("left")
    finish(bar, "", y="log10 |coefficient / largest|")
    return made
