"""Sketches of geometry: stereo triangle, epipolar plane, rays of equation (3), sub-sequence, poses."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.core.types import Array

from .drawing import BAD, DARK, FIFTH, FONT_SIZE, GOOD, PALE, THIRD, WIDTH, figure

Place = Array | tuple[float, float]
# Space on paper: x to the right, y down, z to the upper right.
ON_PAPER = np.array([[1.0, 0.0, 0.45], [0.0, -1.0, 0.30]])


def stereo_triangle(height: int = 230) -> Figure:
    """A point seen by two cameras from above, depth to the right: the similar triangles of Z = f b / d."""
    made, axis = _sheet(height, (-2.5, 12.5), (-2.1, 3.0))
    X = np.array([11.0, 0.9])
    for y, name in ((2.0, "left camera"), (0.0, "right camera")):
        C = np.array([0.0, y])
        _line(axis, C, X, GOOD)
        _line(axis, (2.0, y - 0.75), (2.0, y + 0.75), DARK, 2.5)
        _line(axis, C, (2.0, y), PALE, 1.0, "--")
        _dot(axis, C, DARK, name, (-0.2, 0.0), "right")
        _dot(axis, C + (X - C) * 2.0 / X[0], BAD, "u_left" if y else "u_right", (0.15, 0.3 if y else -0.3))
    _dot(axis, X, BAD, "point", (0.2, 0.0))
    _span(axis, (-0.1, 0.15), (-0.1, 1.85), "b", (-0.45, 0.0))
    _span(axis, (0.0, -1.1), (2.0, -1.1), "f", (0.0, 0.25))
    _span(axis, (0.0, -1.7), (11.0, -1.7), "depth Z", (0.0, 0.25))
    return made


def epipolar_plane(height: int = 330) -> Figure:
    """Both rays of a match and the way between the cameras lie in one plane; it cuts the image in a line."""
    made, axis = _sheet(height, (-3.0, 10.5), (-1.4, 5.6))
    C_p, C_c, X = np.zeros(3), np.array([6.0, 0.0, 0.6]), np.array([2.6, -2.8, 6.0])
    plane = np.array([C_p, C_c, X]) @ ON_PAPER.T
    axis.fill(*plane.T, color=GOOD, alpha=0.1)
    _line(axis, plane[0], plane[1], FIFTH, 3.0)
    _text(axis, (plane[1, 0] / 2, -0.35), "t", ha="center")
    for C, name in ((C_p, "previous camera"), (C_c, "current camera")):
        corners = C + np.array([[-1.9, -1.2, 1.6], [1.2, -1.2, 1.6], [1.2, 0.7, 1.6], [-1.9, 0.7, 1.6]])
        axis.fill(*(corners @ ON_PAPER.T).T, facecolor="white", edgecolor=DARK, alpha=0.75)
        _dot(axis, ON_PAPER @ C, DARK, name, (0.0, -0.7), "center")
    _line(axis, plane[0], ON_PAPER @ (1.12 * X), GOOD)
    seen = []
    for share, words in ((0.62, "nearer?"), (1.0, "X, at its depth"), (1.12, "farther?")):
        P, colour = share * X, BAD if share == 1.0 else PALE
        seen.append(ON_PAPER @ (C_c + (P - C_c) * 1.6 / (P - C_c)[2]))
        _line(axis, plane[1], ON_PAPER @ P, GOOD if share == 1.0 else PALE, 1.0)
        _dot(axis, ON_PAPER @ P, colour, words, (-0.25, 0.1), "right")
        _dot(axis, seen[-1], colour)
    _line(axis, seen[0] - 0.6 * (seen[2] - seen[0]), seen[2] + 0.6 * (seen[2] - seen[0]), BAD)
    _dot(axis, ON_PAPER @ (X * 1.6 / X[2]), BAD, "x_p", (-0.2, 0.2), "right")
    _text(axis, seen[1] + np.array([0.5, -0.35]), "x_c")
    _text(axis, seen[2] + np.array([2.1, 0.0]), "E x_p, the epipolar line", color=BAD)
    return made


def eight_rays(height: int = 230) -> Figure:
    """The four rays of one feature from above, depth to the right: noise makes them miss each other."""
    made, axis = _sheet(height, (-1.5, 13.0), (-1.1, 2.4))
    Q, step = np.array([11.0, 0.8]), np.array([2.6, 0.15])
    pairs = (
        (np.zeros(2), PALE, "previous", ((1.6, 0.22), (0.0, -0.25))),
        (step, GOOD, "current", ((1.6, 0.02), (0.0, 0.1))),
    )
    for origin, colour, name, offs in pairs:
        for y, off in offs:
            C = origin + np.array([0.0, y])
            _line(axis, C, C + 1.1 * (Q + np.array([0.0, off]) - C), colour, 1.6)
            _dot(axis, C, DARK)
        _text(axis, origin + np.array([0.0, -0.75]), f"{name} pair", ha="center")
        _span(axis, origin + np.array([-0.3, 0.05]), origin + np.array([-0.3, 1.55]), "b", (-0.3, 0.0))
    _line(axis, (0.0, 1.6), step + np.array([0.0, 1.6]), FIFTH, 3.0)
    _text(axis, (1.3, 1.95), "t")
    _dot(axis, Q, BAD, "Q", (0.2, 0.0))
    return made


def sub_sequence(height: int = 210) -> Figure:
    """A piece of a path: its starts are made equal, the error is taken at its end."""
    made, axis = _sheet(height, (-3.4, 12.0), (-1.3, 2.2))
    s = np.linspace(0.0, 1.0, 60)
    true = 9.0 * s + 1.2j * np.sin(3.0 * s)
    steps = np.diff(true) * 1.04 * np.exp(1j * np.radians(9.0) * s[1:])
    paths = -3.0 + 3.0 * s - 1j * (1.0 - s) ** 2, true, np.concatenate([[0.0], np.cumsum(steps)])
    before, truth, turned = (np.stack([path.real, path.imag], axis=1) for path in paths)
    axis.plot(*before.T, color=PALE, linewidth=2.0)
    for path, colour in ((truth, DARK), (turned, GOOD)):
        axis.plot(*path.T, color=colour, linewidth=2.5)
        ahead = path[-1] - path[-4]
        _arrow(axis, path[-1], path[-1] + 1.2 * ahead / np.linalg.norm(ahead), colour)
    _line(axis, truth[-1], turned[-1], BAD, 3.0)
    _dot(axis, np.zeros(2), DARK, "frame i: starts made equal", (0.2, -0.35))
    _text(axis, truth[-1] + np.array([-0.2, -0.5]), "frame j of the truth", ha="right")
    _text(axis, turned[-1] + np.array([-0.6, 0.55]), "frame j of the estimate", GOOD)
    return made


def pose_chain(height: int = 230) -> Figure:
    """Camera after camera: each motion, inverted, is appended to the pose before."""
    made, axis = _sheet(height, (-0.5, 11.5), (-1.1, 2.9))
    places = np.array([[0.0, 0.0], [3.2, 0.2], [6.4, 0.7], [9.4, 1.7]])
    for number, (place, heading) in enumerate(zip(places, np.radians([2.0, 6.0, 14.0, 24.0]), strict=True)):
        ahead = np.array([np.cos(heading), np.sin(heading)])
        _arrow(axis, place, place + 0.9 * ahead, GOOD)
        _arrow(axis, place, place + 0.7 * np.array([ahead[1], -ahead[0]]), BAD)
        name = f"camera {number}" + ", the world" * (number == 0)
        _dot(axis, place, DARK, name, (0.4, -0.5))
        if number:
            _arrow(axis, places[number - 1] + 0.15, place + np.array([-0.1, 0.15]), THIRD, "arc3,rad=-0.3")
            middle = (places[number - 1] + place) / 2 + np.array([-0.2, 0.8 + 0.1 * number])
            _text(axis, middle, f"inverse of T_cp, frame {number}", THIRD, "center")
    return made


def _sheet(height: int, x: tuple[float, float], y: tuple[float, float]) -> tuple[Figure, Axes]:
    """An axis without numbers that shows at least x and y, with the same scale along both."""
    made, (axis,) = figure(height)
    axis.set_position((0.0, 0.0, 1.0, 1.0))
    middle, size = np.mean([x, y], axis=1), np.array([WIDTH, height])
    half = 0.5 * size * np.max(np.ptp([x, y], axis=1) / size)
    axis.set(xlim=middle[0] + half[0] * np.array([-1, 1]), ylim=middle[1] + half[1] * np.array([-1, 1]))
    axis.set_axis_off()
    return made, axis


def _line(axis: Axes, a: Place, b: Place, colour: str, width: float = 1.5, style: str = "-") -> None:
    axis.plot([a[0], b[0]], [a[1], b[1]], style, color=colour, linewidth=width)


def _arrow(axis: Axes, a: Place, b: Place, colour: str, bow: str = "arc3") -> None:
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 2, "connectionstyle": bow}
    axis.annotate("", tuple(b), tuple(a), arrowprops=style)


def _text(axis: Axes, at: Place, words: str, color: str = DARK, ha: str = "left") -> None:
    axis.text(at[0], at[1], words, color=color, ha=ha, va="center", fontsize=FONT_SIZE + 1)


def _dot(
    axis: Axes, at: Array, colour: str, words: str = "", off: tuple[float, float] = (0, 0), side: str = "left"
) -> None:
    axis.plot(*at, "o", color=colour, markersize=7)
    _text(axis, (at[0] + off[0], at[1] + off[1]), words, ha=side)


def _span(axis: Axes, a: Place, b: Place, words: str, off: tuple[float, float]) -> None:
    """A measure between two points."""
    axis.annotate("", tuple(a), tuple(b), arrowprops={"arrowstyle": "<->", "color": DARK})
    _text(axis, ((a[0] + b[0]) / 2 + off[0], (a[1] + b[1]) / 2 + off[1]), words)
