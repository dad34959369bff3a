"""A page that shows a run's path and the points it was computed from in three dimensions, in any browser.

    python -m course.view3d RUN_FOLDER OUT.html

Run it in the folder of the notebooks; RUN_FOLDER is what `vo run --out` wrote.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader

from vo_lib.commands.script import ENDINGS, OneLineParser, exit_code
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.poses import from_first
from vo_lib.files import write_atomic
from vo_lib.geometry.motion import transform
from vo_lib.geometry.types import Array
from vo_lib.paper.boxes import in_boxes
from vo_lib.runs.drive import Run
from vo_lib.runs.folder import read_config, read_run
from vo_lib.runs.matches import CachedMatches

MAX_DEPTH_BASELINES = 50.0  # points farther away scatter too much to be looked at
MAX_POINTS = 40_000  # in a page


def points_of(run: Run) -> list[tuple[Array, int, int]]:
    """Points outside vehicle boxes where they were last seen: place (3,), metres, grey level and frame."""
    sequence, camera = run.sequence, run.sequence.camera
    points: dict[int, tuple[Array, int, int]] = {}
    for index, (matches, _) in enumerate(CachedMatches(sequence, run.config)):
        X_c = camera.triangulate(matches.cur_left, matches.cur_right)
        near = (X_c[:, 2] > 0) & (X_c[:, 2] < MAX_DEPTH_BASELINES * camera.baseline)
        near &= ~in_boxes(matches.cur_left, sequence.boxes(index), run.config.filter)
        u, v = np.clip(np.rint(matches.cur_left[near].T), 0, np.array([camera.size]).T - 1).astype(int)
        grey = np.maximum(sequence.stereo(index)[0][v, u], 60).tolist()
        seen = zip(transform(run.poses[index], X_c[near]), grey, [index] * len(grey), strict=True)
        points |= dict(zip(matches.id[near].tolist(), seen, strict=True))
    return list(points.values())[:: 1 + len(points) // MAX_POINTS]


def write_view(folder: Path, page: Path) -> None:
    """Write the page of the run in a folder: one file that needs nothing else.

    Raises `DataError` where the run or its sequence cannot be read.
    """
    about = read_config(folder)
    whole = open_sequence(about["folder"])
    first, last = map(whole.frames.index, about["frames"])
    run = read_run(folder, whole.part(first, last + 1))
    sequence, points = run.sequence, points_of(run)
    lines = [("#50bef0", run.poses)]
    if sequence.truth is not None:
        lines.insert(0, ("#f03c3c", from_first(sequence.truth)))
    data = {
        "points": np.rint(100 * np.array([X for X, _, _ in points])).astype(int).ravel().tolist(),  # cm
        "grey": [grey for _, grey, _ in points],
        "seen": [index for _, _, index in points],
        "times": np.round(sequence.times - sequence.times[0], 3).tolist(),
        "lines": [(colour, np.round(T[:, :3, 3], 3).tolist()) for colour, T in lines],
    }
    template = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True)
    shown = {"title": folder.resolve().name, "truth": len(lines) > 1, "count": len(points)}
    write_atomic(page, template.get_template("view3d.html").render(data=json.dumps(data), **shown))


if __name__ == "__main__":
    parser = OneLineParser(prog="python -m course.view3d", description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, metavar="RUN_FOLDER", help="folder that `vo run --out` wrote")
    parser.add_argument("page", type=Path, metavar="OUT.html", help="the page")
    options = parser.parse_args()
    try:
        write_view(options.run, options.page)
    except ENDINGS as error:
        sys.exit(exit_code(parser.prog, error))
