"""`vo demo`."""

from __future__ import annotations

import argparse

import numpy as np

from ..config import preset
from ..core.boxes import area
from ..data.sequence import PROCESSES, Sequence
from ..front_end.front_end import make_front_end
from ..method.boxes import on_vehicles
from ..runs.jobs import run_jobs
from ..runs.results import run_folder
from ..tables.entries import group_entries
from ..tables.paper import read_paper_table
from ..tables.plots import jpeg, match_image
from ..tables.report import Picture
from ..tables.reproduce import collect, plan_jobs
from ..tables.table1 import method_table
from ..tables.table_files import TABLE_FILES, write_table_files
from .common import BOTH, add_cache, add_variant, open_with_bar, parse_methods
from .console import reporting, say, show_report_table, tell
from .script import steps

NEXT = {
    "vo list": "the other scenes and any KITTI sequences found",
    "vo run synthetic/jam --out runs/jam": "one method on another scene",
    "vo run PATH --out runs/mine": "a KITTI-layout folder of your own",
    "vo check": "what is missing for KITTI, and how to get it",
}

SCENE = "synthetic/traffic"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo demo`."""
    parser.add_argument("--out", default="runs/demo", metavar="DIR", help="folder for the report")
    add_variant(parser, BOTH)
    add_cache(parser)
    parser.set_defaults(command=_demo)


def _demo(options: argparse.Namespace) -> int:
    with run_folder(options.out, *TABLE_FILES) as folder:
        sequence = open_with_bar(SCENE, options.cache)
        jobs = plan_jobs([sequence], parse_methods(None, options.variant), 1, folder)
        with reporting("all methods") as report:
            outcomes = run_jobs(jobs, PROCESSES, report, options.cache, fresh=True)
        result = collect(outcomes, [], 1)
        write_table_files(folder, result, read_paper_table(), "vo demo", (example_frame(sequence),))
    for group in group_entries(result.entries):
        show_report_table(method_table(list(group.entries.values())))
    tell("", *result.problems)
    say(f"Look at {folder / 'report.html'} in a browser. What next:" + steps(NEXT))
    return 1 if result.failed else 0


def example_frame(sequence: Sequence) -> Picture:
    """The matches in the frame with the largest vehicle boxes among a dozen of the sequence."""
    tried = np.linspace(1, len(sequence) - 1, min(12, len(sequence) - 1)).astype(int).tolist()
    frame = max(tried, key=lambda i: area(sequence.boxes(i).xyxy).sum())
    config = preset("feature_selection")
    matcher = make_front_end(sequence.camera, config.features, config.matching)
    pairs = [sequence.stereo(frame - 1), sequence.stereo(frame)]
    matches = [matcher.step(matcher.prepare(pair)) for pair in pairs][-1]
    boxes = sequence.boxes(frame)
    kept = ~on_vehicles(matches, sequence.boxes(frame - 1), boxes, config.filter)
    return Picture(
        jpeg(match_image(pairs[1][0], matches, kept, boxes)),
        "Matches of one frame, from the previous place of a feature to its present one: "
        "orange lies in a vehicle's box (white) and is removed, blue stays.",
    )
