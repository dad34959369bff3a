"""Measure the errors of all methods, and write the page `results.md`.

examples:
  vo data measure_results --jobs 2 --out notebooks/results.md
  vo data measure_results --sequences 00,01 --detector yolov8n.onnx --jobs 2

Each system of Table 1 is run in both variants with seeds 0-4. A second call
with the same --runs executes only the missing runs. If the sequences are those
of notebooks/ablation.csv and more, the tables of measure_ablation end the page.
Choices, miniature and ideas of the kit are measured by scripts of their own.
"""

from __future__ import annotations

import argparse
import platform
import shlex
from datetime import date
from pathlib import Path

from measure import ablation
from measure.axes import MAX_ANGLE_DEG, NARROW_DEG
from measure.result_tables import SEEDS, Key, cells_of_systems, claim_table, jobs_of, result_tables
from vo_lib.commands.common import add_cache, open_with_bar, parse_jobs
from vo_lib.commands.console import print_wrapped, reporting, show_report_table
from vo_lib.data.catalogue import SYNTHETIC, parse_sequences
from vo_lib.data.label_remarks import missing_labels
from vo_lib.data.scenes import TABLE_SCENES
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import read_csv
from vo_lib.detection.label_folders import labelled_sequence
from vo_lib.detection.settings import DetectorConfig
from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import COUNTED
from vo_lib.files import write_atomic
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
    of_ideas: list[ReportTable] = []
    if set(changes.clean) <= {sequence.name for sequence in sequences}:
        of_ideas = ablation.tables(changes)
    write_atomic(out, _page(tables, of_ideas, options))
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


def _page(tables: list[ReportTable], of_ideas: list[ReportTable], options: argparse.Namespace) -> str:
    """The text of the page: the command, the date and the versions, then the tables.

    of_ideas : tables of the ablation, which end the page; they come from runs of their own.
    """
    origin = [*provenance(), platform.processor() or platform.machine()]
    head = [
        "# Measured results",
        page_head([table.title for table in of_ideas]),
        page_command(options.sequences, options.detector),
        f"{date.today().isoformat()}. " + "; ".join(origin) + ".",
    ]
    return "\n\n".join([*head, *(markdown(table) for table in [*tables, *of_ideas])])


def page_command(sequences: str, detector: str | None) -> str:
    """The command that writes the page, as indented text."""
    words = ["vo", "data", "measure_results", "--sequences", sequences]
    if detector is not None:
        words += ["--detector", Path(detector).name]
    return f"    {shlex.join(words)}"


def page_head(titles_of_ideas: list[str]) -> str:
    """What the numbers of the page are. The tables with these titles come from the ablation."""
    of_ideas = ""
    if titles_of_ideas:
        of_ideas = (
            f" The last {len(titles_of_ideas)} tables, from *{titles_of_ideas[0]}* on, are those of another "
            "command, `vo data measure_ablation`, and have seeds and a rule of their own, which stand there."
        )
    return (
        "Generated by the command below. Unless a table says otherwise, errors are means over seeds "
        f"{SEEDS.start}-{SEEDS.stop - 1}; separate tables have the standard deviations, over n - 1. "
        f"{COUNTED} Whether a mean change is chance is another question, which chapter 7 asks.{of_ideas} "
        "Drawn scenes have the sub-sequences of the KITTI benchmark; `jam`, which is 100 m long, and the "
        "clips of KITTI have shorter sub-sequences, which start at every frame. A clip is the beginning of "
        "its sequence. In rows with `axes removed`, TE is computed with the pitch and yaw, up to "
        f"{MAX_ANGLE_DEG:g}° where they are well determined and up to {NARROW_DEG:g}° elsewhere, that "
        "minimise TE, because the truth of a raw drive is rotated against the camera. For clips without "
        "labels, the vehicle boxes come from the detector in the command."
    )
