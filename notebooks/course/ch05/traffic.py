"""Chapter 5, real traffic: drives with vehicle boxes, and what features in them do to the rotation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from vo_lib.data.catalogue import available
from vo_lib.data.sequence import Sequence
from vo_lib.detection.labels import labelled_sequence
from vo_lib.detection.models import find_model
from vo_lib.errors import DataError
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import essential_from_motion
from vo_lib.geometry.types import Array
from vo_lib.paper.boxes import inside, on_vehicles
from vo_lib.paper.sampson import sampson_distance
from vo_lib.paper.settings import FilterConfig

from ..colours import BAD, PALE
from ..drawing import figure, finish, room
from ..frames import opened
from .claim import LINES, step_errors

FETCH = {
    "kitti/drive_0005": "2011_09_26_drive_0005 --frames 100:154",
    "kitti/drive_0013": "2011_09_26_drive_0013 --frames 0:80",
}


def find_detector(name: str) -> str:
    """The ONNX file of a detector of real vehicles; "", with a sentence, where this machine has none."""
    try:
        return str(find_model(name))
    except DataError:
        print(
            f"The detector {name} is not on this machine; `vo data get_detector` lists those that it fetches."
        )
        return ""


def with_boxes(name: str, detector: str) -> Sequence | None:
    """A real drive with the boxes of its label folder, else of a detector; None, with a reason, where one lacks."""
    if name not in available():
        print(f"{name} is not on this machine; `vo data get_kitti --raw {FETCH[name]}` fetches it.")
        return None
    drive = opened(name)
    if drive.labels is None and not detector:
        print(f"{name} has no label folder and needs a detector of real vehicles.")
        return None
    return drive if drive.labels is not None else labelled_sequence(drive, detector)


def line_distances(sequence: Sequence, matches: StereoMatches, T_cp: Array) -> Array:
    """Sampson distances (N,) of matches under a motion, pixels."""
    points = (sequence.camera.normalise(uv) for uv in (matches.prev_left, matches.cur_left))
    E = essential_from_motion(T_cp[:3, :3], T_cp[:3, 3])
    return sequence.camera.f * np.abs(sampson_distance(E, *points))


def distance_lines(sequence: Sequence, frame: int, matches: StereoMatches, distances: Array) -> str:
    """The median distance of the features outside all boxes, and of those in each box, left to right."""
    xyxy = sequence.boxes(frame).xyxy
    xyxy = xyxy[np.argsort(xyxy[:, 0])]
    within = inside(matches.cur_left, xyxy).T
    names = ["outside boxes", *(f"box at u = {u:4.0f}" for u in xyxy[:, ::2].mean(axis=1))]
    parts = [~within.any(axis=0), *within]
    return "\n".join(
        f"{name:14}: {part.sum():3} features, median {np.median(distances[part]):.2f} px"
        for name, part in zip(names, parts, strict=True)
        if part.any()
    )


def turns_figure(
    sequence: Sequence, runs: Mapping[str, Array], matches: list[StereoMatches], distances: list[Array]
) -> Figure:
    """Rotation error of each step by run, and below it the share of the features in boxes, near their lines or not.

    matches, distances : of the frames 1 … N - 1, under a motion from the features outside boxes.
    """
    made, (turns, shares) = figure(250, 2)
    frames, near = np.arange(1, len(sequence)), [0.25, 1.0]
    for (name, poses), (colour, width) in zip(runs.items(), LINES, strict=False):
        turn = step_errors(sequence, poses)[0]
        turns.plot(frames, turn, color=colour, linewidth=width, label=name)
    turns.set_ylim(0, room(1.3 * max(float(step_errors(sequence, each)[0].max()) for each in runs.values())))
    pulls = []
    for index, (each, far) in enumerate(zip(matches, distances, strict=True), start=1):
        boxed = on_vehicles(each, sequence.boxes(index - 1), sequence.boxes(index), FilterConfig())
        pulls.append(100 * np.array([boxed.mean(), np.mean(boxed & (far > near[0]) & (far < near[1]))]))
    every, pulling = np.array(pulls).T
    shares.fill_between(frames, every, color=PALE, step="mid", label="all features in boxes")
    shares.fill_between(frames, pulling, color=BAD, step="mid", label="off their lines by 0.25 to 1 px")
    shares.set_ylim(0, 1.4 * every.max())
    finish(turns, "rotation error of each step, 1 px [deg]", "frame", "", "upper left")
    finish(shares, "features in boxes [% of all]", "frame", "", "upper left")
    return made
