"""Chapter 5, real traffic: drives with vehicle boxes, and the effect of the features in boxes on the rotation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from vo_lib.data.catalogue import available
from vo_lib.data.label_remarks import coverage_remarks
from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import with_all_labels
from vo_lib.detection.models import find_model
from vo_lib.errors import DataError
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import essential_from_motion
from vo_lib.geometry.types import Array
from vo_lib.paper.box_removal import inside, on_vehicles
from vo_lib.paper.sampson import sampson_distance
from vo_lib.paper.settings import FilterConfig

from ..colours import BAD, PALE
from ..drawing import figure, finish
from ..frames import opened
from .claim import LINES, step_errors

FEWEST = 3  # features of a box whose median says something
ACCEPTS = 1.0  # inlier threshold of the runs in the chart of the turns, pixels
REJECTS = 0.25  # a threshold that rejects features of things that move nearly as the camera does, pixels
FETCH = {
    "kitti/drive_0005": "2011_09_26_drive_0005 --frames 100:154",
    "kitti/drive_0013": "2011_09_26_drive_0013 --frames 0:80",
}


def find_detector(name: str) -> str:
    """The ONNX file of a detector of real vehicles; if there is none, "" and a printed sentence."""
    try:
        return str(find_model(name))
    except DataError:
        print(f"The detector {name} is not on this machine; `vo data get_detector` lists the detectors.")
        return ""


def with_boxes(name: str, detector: str) -> Sequence | None:
    """A real drive with boxes from its label folder or a detector; None and a printed reason otherwise."""
    if name not in available():
        print(f"{name} is not on this machine; `vo data get_kitti --raw {FETCH[name]}` fetches it.")
        return None
    drive = opened(name)
    if drive.labels is None and not detector:
        print(f"{name} has no label folder and needs a detector of real vehicles.")
        return None
    if detector:
        drive = with_all_labels(drive, detector)
    for remark in coverage_remarks(drive):
        print(f"{name}: {remark}.")
    return drive


def line_distances(sequence: Sequence, matches: StereoMatches, T_cp: Array) -> Array:
    """Sampson distances (N,) of matches under a motion, pixels."""
    camera = sequence.camera
    x_p = camera.normalise(matches.prev_left)
    x_c = camera.normalise(matches.cur_left)
    E = essential_from_motion(T_cp[:3, :3], T_cp[:3, 3])
    return camera.f * np.abs(sampson_distance(E, x_p, x_c))


@dataclass(frozen=True)
class BoxDistances:
    """Features of a box, or outside all boxes.

    row : of the box in its frame; -1 for the features outside all boxes. count : number of the features.
    median : of their distances, pixels.
    """

    row: int
    count: int
    median: float


def distances_by_box(
    sequence: Sequence, frame: int, matches: StereoMatches, distances: Array
) -> list[BoxDistances]:
    """Median distances of the features outside all boxes, then inside each box with features, left to right."""
    xyxy = sequence.boxes(frame).xyxy
    within = inside(matches.cur_left, xyxy)
    masks = {-1: ~within.any(axis=1)}  # by row of the box
    for row in np.argsort(xyxy[:, 0]).tolist():
        masks[row] = within[:, row]
    by_box = []
    for row, mask in masks.items():
        if mask.any():
            median = float(np.median(distances[mask]))
            by_box.append(BoxDistances(row, int(mask.sum()), median))
    return by_box


def farthest_box(rows: list[BoxDistances]) -> BoxDistances | None:
    """The box whose features are farthest from their epipolar lines, by the median; None without such a box.

    Only boxes with at least `FEWEST` features count.
    """
    boxes = [each for each in rows if each.row >= 0 and each.count >= FEWEST]
    return max(boxes, key=lambda each: each.median, default=None)


def distance_lines(rows: list[BoxDistances]) -> str:
    """A line for the features outside the boxes and for each box, by the number that is in the picture."""
    far = farthest_box(rows)
    lines = []
    for number, each in enumerate(rows):
        name = f"box {number}" if each.row >= 0 else "outside boxes"
        mark = "  ← black in the picture" if each is far else ""
        lines.append(f"{name:13}: features: {each.count:3}, median {each.median:.2f} px{mark}")
    return "\n".join(lines)


def turns_figure(
    sequence: Sequence, runs: Mapping[str, Array], matches: list[StereoMatches], distances: list[Array]
) -> Figure:
    """Rotation error of each step by run, and the share of features in boxes by frame.

    The runs are those with the inlier threshold `ACCEPTS`. A second area shows the features in boxes that this
    threshold accepts, but `REJECTS` does not: they are a little off their epipolar lines.

    runs : poses (N, 4, 4) by the name of the run. matches, distances : matches of the frames 1 … N - 1, and their distances (`line_distances`), pixels.
    """
    made, (turns, shares) = figure(250, 2)
    frames = np.arange(1, len(sequence))
    in_boxes = []
    accepted = []
    for (name, poses), (colour, width) in zip(runs.items(), LINES, strict=False):
        rotation_errors, _ = step_errors(sequence, poses)
        turns.plot(frames, rotation_errors, color=colour, linewidth=width, label=name)
    for frame, each, far in zip(frames.tolist(), matches, distances, strict=True):
        boxed = on_vehicles(each, sequence.boxes(frame - 1), sequence.boxes(frame), FilterConfig())
        in_boxes.append(100 * boxed.mean())
        accepted.append(100 * np.mean(boxed & (far > REJECTS) & (far < ACCEPTS)))
    shares.fill_between(frames, in_boxes, color=PALE, step="mid", label="all")
    shares.fill_between(
        frames, accepted, color=BAD, step="mid", label=f"off their lines by {REJECTS:g} to {ACCEPTS:g} px"
    )
    shares.set_ylim(0, 1.3 * max(in_boxes))
    finish(turns, f"rotation error of each step, {ACCEPTS:g} px [deg]", "frame")
    finish(shares, "features in boxes [% of all]", "frame", "", "upper left")
    return made
