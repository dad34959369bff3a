"""Measure every number that the documentation quotes.

examples:
  vo data measure_results --jobs 2 --out notebooks/results.md
  vo data measure_results --sequences 00,01 --detector yolov8n.onnx --jobs 2

Each system of Table 1 is run in both variants with seeds 0-4. A second call
with the same --runs executes only the missing runs.
"""

from __future__ import annotations

import argparse
import platform
import shlex
from datetime import date
from pathlib import Path

from measure import ablation
from measure.axes import MAX_ANGLE_DEG, NARROW_DEG
from measure.result_tables import Key, cells_of_systems, claim_table, jobs_of, result_tables
from vo_lib.commands.common import add_cache, open_with_bar, parse_jobs
from vo_lib.commands.console import print_wrapped, reporting, show_report_table
from vo_lib.data.catalogue import SYNTHETIC, parse_sequences
from vo_lib.data.label_remarks import missing_labels
from vo_lib.data.scenes import TABLE_SCENES
from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import labelled_sequence
from vo_lib.detection.settings import DetectorConfig
from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import COUNTED
from vo_lib.files import read_csv, write_atomic
from vo_lib.report.page import ReportTable, markdown, provenance
from vo_lib.runs.drive import Run
from vo_lib.runs.folder import read_run, run_folder
from vo_lib.runs.jobs import Job, run_jobs

ABLATION = Path(__file__).parents[1] / "notebooks" / "ablation.csv"  # its tables end the whole page


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Add the options for sequences, detector, processes and cache."""
    scenes = ",".join(f"{SYNTHETIC}{name}" for name in TABLE_SCENES)
    parser.add_argument(
        "--sequences", default=scenes, metavar="S,S,…", help="sequences; default: the drawn scenes"
    )
    parser.add_argument("--detector", metavar="MODEL", help="detector for sequences without labels")
    parser.add_argument(
        "--jobs", default="1", metavar="N", help="number of processes at the same time; default 1"
    )
    add_cache(parser)


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_inputs(parser)
    parser.add_argument("--runs", default="runs/results", metavar="DIR", help="folder for the runs")
    text = "Markdown file of the tables; default: results.md in the folder for the runs"
    parser.add_argument("--out", type=Path, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> int:
    """Run the missing jobs and write the page."""
    sequences = open_all(options)
    for sequence in sequences:
        if sequence.truth is None:
            raise DataError(f"{sequence.name} has no ground truth, so errors cannot be computed")
    out = options.out or Path(options.runs) / "results.md"
    with run_folder(options.runs) as folder:
        jobs: dict[tuple[Key, int], Job] = {}
        for sequence in sequences:
            jobs.update(jobs_of(sequence, folder))
        workers = parse_jobs(options.jobs, len(jobs))
        with reporting(f"{len(jobs)} runs") as report:
            outcomes = run_jobs(list(jobs.values()), workers, report, options.cache)
    failed = [f"{outcome.job.name}: {outcome.error}" for outcome in outcomes if outcome.error]
    if failed:
        raise DataError(failed[0])
    runs: dict[Key, list[Run]] = {}
    for (key, _), job in jobs.items():
        runs.setdefault(key, []).append(read_run(job.folder, job.sequence))
    systems = cells_of_systems(sequences, runs)
    tables = result_tables(sequences, runs, systems)
    changes = ablation.Ablation([ablation.read_row(cells) for _, cells in read_csv(ABLATION)[1:]])
    if set(changes.clean) <= {sequence.name for sequence in sequences}:
        tables += ablation.tables(changes)
    write_atomic(out, _page(tables, options))
    show_report_table(claim_table(systems["published"]))
    print_wrapped(f"written to {out}")
    return 0


def open_all(options: argparse.Namespace, score: float = 0.25) -> list[Sequence]:
    """The sequences in the options, with labels, or with the detector's boxes of at least this score."""
    sequences = []
    for name in parse_sequences(options.sequences):
        sequence = open_with_bar(name, options.cache)
        detector = DetectorConfig(score=score)
        if options.detector is not None and missing_labels(sequence):
            with reporting(f"detecting vehicles in {name}") as report:
                sequence = labelled_sequence(
                    sequence, options.detector, detector, cache=options.cache, progress=report
                )
        sequences.append(sequence)
    return sequences


def _page(tables: list[ReportTable], options: argparse.Namespace) -> str:
    """The text of the page: the command, the date and the versions, then the tables."""
    words = ["vo", "data", "measure_results", "--sequences", options.sequences]
    if options.detector is not None:
        words += ["--detector", Path(options.detector).name]
    origin = [*provenance(), platform.processor() or platform.machine()]
    head = [
        "# Measured results",
        "Generated by the command below. All errors are means over seeds 0-4; separate tables have the "
        f"standard deviations, over n - 1. {COUNTED} Whether a mean change is chance is another question, "
        "which chapter 7 asks. Drawn scenes have the sub-sequences of the KITTI benchmark; `jam`, which is "
        "100 m long, and the clips of KITTI have shorter sub-sequences, which start at every frame. A "
        "clip is the beginning of its sequence. "
        f"In rows with `axes removed`, TE is computed with the pitch and yaw, up to {MAX_ANGLE_DEG:g}° where "
        f"they are well determined and up to {NARROW_DEG:g}° elsewhere, that minimise TE, because the truth "
        "of a raw drive is rotated against the camera. For clips without labels, the vehicle "
        "boxes come from the detector in the command.",
        f"    {shlex.join(words)}",
        f"{date.today().isoformat()}. " + "; ".join(origin) + ".",
    ]
    return "\n\n".join([*head, *(markdown(table) for table in tables)])
