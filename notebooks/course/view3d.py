"""Shapes in three dimensions, rotated with the mouse, in a cell or a page, without an internet connection.

    path = Shape(points, GOOD, name="path")
    View(camera_shape(np.eye(4), "left camera"), path, Shape(corners, BAD, "area"), title="A path")

A cell whose last expression is a `View` shows the shapes; without JavaScript, the cell shows a still picture.
"""

from __future__ import annotations

import base64
import html
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader

from vo_lib.data.poses import from_first
from vo_lib.geometry.motion import transform
from vo_lib.geometry.types import Array
from vo_lib.paper.box_removal import in_boxes
from vo_lib.runs.drive import Run
from vo_lib.runs.match_cache import CachedMatches

from .colours import DARK, GOOD
from .drawing import FONT_SIZE, WIDTH, figure, show

MAX_DEPTH_BASELINES = 50.0  # points farther away scatter too much
MAX_POINTS = 40_000  # of a page
# First direction of view, from behind and above, radians.
YAW = 0.5
TILT = 0.7
PALEST = 200  # grey level of a point on white
HINT = "Drag to rotate, turn the wheel to zoom, Shift and drag to move, double-click to reset."


@dataclass(frozen=True, eq=False)
class Shape:
    """A line, a filled area or single dots.

    Attributes
    ----------
    at : places (N, 3), metres, x right, y down, z forward.
    colour : "#RRGGBB"; for dots also grey levels (N,).
    name : text at the first place of a line or area, or at the last place of a path.
    in_legend : whether the name is beside a piece of the colour above the shapes; lines that cover each other
        need this.
    width : width of a line or dot, pixels.
    first : (N,) frame from which the slider shows each dot, or each place of a path; None: always shown.
    """

    at: Array
    colour: Any = GOOD
    kind: Literal["line", "area", "dots"] = "line"
    name: str = ""
    width: float = 2.0
    first: Any = None
    in_legend: bool = False


def camera_shape(T_w_c: Array, name: str = "", colour: str = DARK, size: float = 0.3) -> Shape:
    """A camera at a pose (4, 4): the pyramid of its view, `size` metres deep."""
    corners = size * np.array([[-1, -0.6, 1], [1, -0.6, 1], [1, 0.6, 1], [-1, 0.6, 1]])
    line = []  # from the centre to a corner and back, for each corner; then round the corners
    for corner in corners:
        line += [np.zeros(3), corner]
    line += list(corners)
    return Shape(transform(T_w_c, np.array(line)), colour, name=name, width=1.2)


class View:
    """Shapes as a page inside a cell, or as a picture if no script runs.

    times : (N,) times of the slider's frames, seconds.
    """

    def __init__(self, *shapes: Shape, title: str, height: int = 420, times: Any = ()):
        self.shapes = shapes
        self.height = height
        self.times = times
        self.title = title

    def page(self) -> str:
        """The complete page as one string."""
        template = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True)
        data = {"times": self.times, "eye": [YAW, TILT], "shapes": [*map(vars, self.shapes)]}
        text = json.dumps(data, default=lambda array: np.round(array, 3).tolist()).replace("<", "\\u003c")
        words = {"title": self.title, "hint": HINT, "palest": PALEST, "data": text}
        return template.get_template("view3d.html").render(**words)

    def still(self) -> bytes:
        """The first view as PNG bytes."""
        picture, (axis,) = figure(self.height)
        for shape in self.shapes:
            x, y, z = np.asarray(shape.at, np.float64).T
            u = np.cos(YAW) * x - np.sin(YAW) * z
            v = np.cos(TILT) * y - np.sin(TILT) * (np.sin(YAW) * x + np.cos(YAW) * z)
            if shape.kind == "dots":
                colour = shape.colour
                if not isinstance(colour, str):
                    colour = [f"{min(grey, PALEST) / 255:.2f}" for grey in colour]  # grey levels of the dots
                axis.scatter(u, v, s=shape.width**2, c=colour, linewidths=0)
            elif shape.kind == "area":
                axis.fill(u, v, color=shape.colour, alpha=0.25)
            else:
                axis.plot(u, v, color=shape.colour, linewidth=shape.width)
            if shape.in_legend:
                axis.plot([], [], color=shape.colour, linewidth=shape.width, label=shape.name)
                continue
            named = 0 if shape.first is None else -1  # a path is named at its end
            axis.annotate(
                shape.name, (u[named], v[named]), (4, -12), textcoords="offset points", fontsize=FONT_SIZE
            )
        if any(shape.in_legend for shape in self.shapes):
            axis.legend(loc="upper left", fontsize=FONT_SIZE, frameon=False)
        axis.set_aspect("equal", adjustable="datalim")
        axis.invert_yaxis()
        axis.set_axis_off()
        return bytes(show(picture).data)

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        framed = (
            f'<iframe title="{html.escape(self.title)}" srcdoc="{html.escape(self.page())}" '
            f'style="width:100%;max-width:{WIDTH}px;height:{self.height}px;border:1px solid #bbb"></iframe>'
        )
        return {"text/html": framed, "image/png": base64.b64encode(self.still()).decode()}


def view_of_run(run: Run) -> View:
    """The path of a run, the points of its matches, and the true path if there is one."""
    sequence = run.sequence
    points = points_of(run)
    frames = np.arange(len(run.poses))
    places = np.array([point.X_w for point in points]).reshape(-1, 3)
    grey = np.array([point.grey for point in points], int)
    first = np.array([point.frame for point in points], int)
    shapes = [Shape(places, grey, "dots", width=1.5, first=first)]
    shapes.append(Shape(run.poses[:, :3, 3], GOOD, name="path", first=frames, width=3.0, in_legend=True))
    if sequence.truth is not None:
        true = from_first(sequence.truth)[:, :3, 3]
        shapes.append(Shape(true, DARK, name="truth", width=1.0, in_legend=True))
    title = f"{sequence.name}: path and {len(points)} points"
    return View(*shapes, height=480, times=sequence.times - sequence.times[0], title=title)


class SeenPoint(NamedTuple):
    """A point of a run: place X_w (3,), metres, with the grey level and the frame of its last observation."""

    X_w: Array
    grey: int
    frame: int


def points_of(run: Run) -> list[SeenPoint]:
    """The points of a run outside all boxes, at most about `MAX_POINTS`."""
    sequence = run.sequence
    camera = sequence.camera
    points: dict[int, SeenPoint] = {}  # by the number of the feature
    boxes_of = sequence.boxes_of(run.config.filter.classes)
    for index, (matches, _) in enumerate(CachedMatches(sequence, run.config)):
        X_c = camera.triangulate(matches.cur_left, matches.cur_right)
        near = (X_c[:, 2] > 0) & (X_c[:, 2] < MAX_DEPTH_BASELINES * camera.baseline)
        near &= ~in_boxes(matches.cur_left, boxes_of(index), run.config.filter)
        left, _ = sequence.stereo(index)
        last_pixel = np.array(camera.size) - 1
        pixels = np.clip(np.rint(matches.cur_left[near]), 0, last_pixel).astype(int)
        grey = left[pixels[:, 1], pixels[:, 0]].tolist()
        X_w = transform(run.poses[index], X_c[near])
        for number, place, level in zip(matches.id[near].tolist(), X_w, grey, strict=True):
            points[number] = SeenPoint(place, level, index)
    every = 1 + len(points) // MAX_POINTS
    return list(points.values())[::every]
