"""Measure every number that the documentation quotes.

examples:
  vo data measure_results --jobs 2 --out notebooks/results.md
  vo data measure_results --sequences 00,01 --detector yolov8n.onnx --jobs 2

Each system of Table 1 is run as published and the kit's way, with seeds 0-4. Called again with the same
--runs, it does not do finished runs again.
"""

from __future__ import annotations

import argparse
import platform
import shlex
import sys
from datetime import date
from pathlib import Path

from measure import ablation
from measure.result_tables import Key, box_rules, calibrations, jobs_of, systems
from vo_lib.commands.common import add_cache, open_with_bar, parse_whole
from vo_lib.commands.console import reporting, say
from vo_lib.commands.scripts import run_script
from vo_lib.config import VARIANTS
from vo_lib.data.catalogue import SYNTHETIC, parse_sequences
from vo_lib.data.scenes import TABLE_SCENES
from vo_lib.data.sequence import Sequence
from vo_lib.detection.labels import labelled_sequence
from vo_lib.detection.settings import DetectorConfig
from vo_lib.errors import DataError
from vo_lib.files import read_csv, write_atomic
from vo_lib.report.page import ReportTable, markdown, provenance
from vo_lib.runs.drive import Run
from vo_lib.runs.folder import read_run, run_folder
from vo_lib.runs.jobs import run_jobs

ABLATION = Path(__file__).parents[1] / "notebooks" / "ablation.csv"  # its tables are the last of the page


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """The options that say what is measured, and in how many processes."""
    scenes = ",".join(f"{SYNTHETIC}{name}" for name in TABLE_SCENES)
    parser.add_argument("--sequences", default=scenes, metavar="S,S,…", help="default: the drawn scenes")
    parser.add_argument("--detector", metavar="MODEL", help="finds the vehicles where there are no labels")
    parser.add_argument("--jobs", default="1", metavar="N", help="processes; default 1")
    add_cache(parser)


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_inputs(parser)
    parser.add_argument("--runs", default="runs/results", metavar="DIR", help="folder for the runs")
    parser.add_argument("--out", default="runs/results/results.md", metavar="FILE", help="the page")


def run(options: argparse.Namespace) -> int:
    """Run what is missing; write the page."""
    workers = parse_whole("--jobs", options.jobs)
    sequences = open_all(options)
    for sequence in sequences:
        if sequence.truth is None:
            raise DataError(f"{sequence.name} has no ground truth to measure against")
    with run_folder(options.runs) as folder:
        jobs = {key: job for sequence in sequences for key, job in jobs_of(sequence, folder)}
        with reporting(f"{len(jobs)} runs") as report:
            outcomes = run_jobs(list(jobs.values()), workers, report, options.cache)
    failed = [f"{outcome.job.name}: {outcome.error}" for outcome in outcomes if outcome.error]
    if failed:
        raise DataError(failed[0])
    runs: dict[Key, list[Run]] = {}
    for (key, _), job in jobs.items():
        runs.setdefault(key, []).append(read_run(job.folder, job.sequence))
    tables = [
        *(systems(sequences, runs, variant) for variant in VARIANTS),
        box_rules(sequences, runs),
        calibrations(sequences, runs),
    ]
    if ABLATION.exists():
        tables += ablation.tables([cells for _, cells in read_csv(ABLATION)[1:]])
    write_atomic(options.out, _page(tables, options))
    say(f"written to {options.out}")
    return 0


def open_all(options: argparse.Namespace, score: float = 0.25) -> list[Sequence]:
    """The sequences that the options name, with labels, or the detector's boxes of `score` or more."""
    opened = []
    for name in parse_sequences(options.sequences):
        sequence, detector = open_with_bar(name, options.cache), DetectorConfig(score=score)
        if sequence.labels is None and options.detector is not None:
            with reporting(f"vehicles of {name}") as report:
                sequence = labelled_sequence(
                    sequence, options.detector, detector, cache=options.cache, progress=report
                )
        opened.append(sequence)
    return opened


def _page(tables: list[ReportTable], options: argparse.Namespace) -> str:
    """The page: how it was made, then the tables."""
    words = ["vo", "data", "measure_results", "--sequences", options.sequences]
    words += [] if options.detector is None else ["--detector", Path(options.detector).name]
    made = [*provenance(), platform.processor() or platform.machine()]
    head = [
        "# Measured results",
        "Written by the command below, not by hand. TE in % / RE in deg/100 m, mean ± deviation over "
        "seeds 0-4. Drawn scenes: as the KITTI benchmark measures them; "
        "`jam`, 100 m long, and clips of KITTI by length, from every frame. A clip is the beginning of its "
        "sequence. Axes removed: the truth of a raw drive is turned against the camera, so TE is taken with "
        "the pitch and yaw between them that make TE smallest. Vehicles of clips without labels are those "
        "of the detector that the command names.",
        f"    {shlex.join(words)}",
        f"{date.today().isoformat()}. " + "; ".join(made) + ".",
    ]
    return "\n\n".join([*head, *(markdown(table) for table in tables)])


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
