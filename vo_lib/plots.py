"""Figures. Functions draw on an axis they are given or return a matplotlib Figure; none uses pyplot."""

from __future__ import annotations

import io

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .detection import Boxes
from .matching import StereoMatches

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

# Okabe and Ito's colours, told apart by colour-blind readers too.
TRUTH_COLOUR = "#000000"
ESTIMATE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")


def draw_trajectory(
    axis: Axes, poses: Array, label: str, colour: str, style: str = "-", width: float = 1.5
) -> None:
    """Top view of poses (N, 4, 4): x to the right, z forward, metres; a dot marks the start."""
    axis.plot(poses[:, 0, 3], poses[:, 2, 3], style, color=colour, label=label, linewidth=width)
    axis.plot(poses[0, 0, 3], poses[0, 2, 3], "o", color=colour, markersize=4)


def trajectory_figure(title: str, truth: Array | None, estimates: dict[str, Array]) -> Figure:
    """Top view of the truth and of named estimates, (N, 4, 4) each, with equal axes in metres."""
    figure = Figure(figsize=(6.4, 6.4), dpi=120, layout="constrained")
    axis = figure.add_subplot()
    for number, (name, poses) in enumerate(estimates.items()):
        # Later lines are thinner, so that those below them still show.
        width = 1.5 + 1.2 * (len(estimates) - 1 - number)
        draw_trajectory(axis, poses, name, ESTIMATE_COLOURS[number % len(ESTIMATE_COLOURS)], width=width)
    if truth is not None:
        # An estimate starts at the identity; the truth of a part of a sequence does not.
        draw_trajectory(axis, np.linalg.inv(truth[0]) @ truth, "ground truth", TRUTH_COLOUR, "--")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x, right [m]")
    axis.set_ylabel("z, forward [m]")
    axis.set_title(title)
    axis.grid(alpha=0.3)
    axis.legend(loc="best")
    return figure


# Features in BGR: kept in blue, removed in orange; boxes in white.
KEPT, REMOVED, BOX = (178, 114, 0), (0, 94, 213), (255, 255, 255)


def match_image(image: Image, matches: StereoMatches, kept: NDArray[np.bool_], boxes: Boxes) -> Image:
    """The current left image (H, W), each match a line from its previous place to a dot; BGR (H, W, 3).

    Kept matches are blue, those removed by boxes orange.
    """
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for x0, y0, x1, y1 in np.rint(boxes.xyxy).astype(int).tolist():
        cv2.rectangle(picture, (x0, y0), (x1, y1), BOX, 1, cv2.LINE_AA)
    # Sub-pixel drawing: OpenCV takes fixed-point coordinates with four binary digits.
    ends = np.rint(np.stack([matches.prev_left, matches.cur_left], axis=1) * 16).astype(int)
    for (start, end), keep in zip(ends.tolist(), kept.tolist(), strict=True):
        colour = KEPT if keep else REMOVED
        cv2.line(picture, start, end, colour, 1, cv2.LINE_AA, shift=4)
        cv2.circle(picture, end, 2 * 16, colour, -1, cv2.LINE_AA, shift=4)
    return np.asarray(picture, np.uint8)


def jpeg(picture: Image, quality: int = 85) -> bytes:
    """A BGR picture (H, W, 3) as JPEG bytes."""
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes, the same for the same figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
