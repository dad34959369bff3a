"""Which box rule is best: methods × rules over sequences and seeds, as one Markdown table.

examples:
  vo data compare_box_rules
  vo data compare_box_rules --sequences 00,synthetic/jam --methods viso2 --labels 00=labels/00 --jobs 2

Rules: none, all (the paper), moving (only boxes judged moving), truth (drawn scenes only). Called again,
it does not do finished runs again.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from vo_lib.commands.common import add_cache, open_with_bar, parse_methods, parse_whole
from vo_lib.commands.console import reporting, say, show_report_table
from vo_lib.commands.data import run_script
from vo_lib.core.errors import DataError
from vo_lib.core.files import write_text_atomic
from vo_lib.data.sequence import SYNTHETIC, Sequence, parse_sequences
from vo_lib.runs.jobs import run_jobs
from vo_lib.runs.results import run_folder
from vo_lib.synthetic import SCENES
from vo_lib.tables.report import ReportTable
from vo_lib.tables.reproduce import slug
from vo_lib.tables.sweep import Axis, run_sweep, sweep_table
from vo_lib.tables.table1 import markdown

RULES = ("none", "all", "moving", "truth")
COLUMNS = ["sequence", "method", "rule", "TE %", "RE deg/100 m", "removed", "back end ms"]


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    scenes = ",".join(f"{SYNTHETIC}{name}" for name in SCENES)
    parser.add_argument("--sequences", default=scenes, metavar="S,S,…", help="default: the drawn scenes")
    parser.add_argument("--methods", default="viso2,solution_selection", metavar="M,M,…")
    parser.add_argument(
        "--labels", action="append", default=[], metavar="S=DIR", help="label folder of a sequence"
    )
    parser.add_argument("--seeds", default="5", metavar="N", help="seeds 0 … N-1; default 5")
    parser.add_argument("--jobs", default="1", metavar="N", help="processes; default 1")
    parser.add_argument("--out", default="runs/box_rules", metavar="DIR", help="folder for runs and table.md")
    add_cache(parser)


def run(options: argparse.Namespace) -> int:
    """Run what is missing; write and show the table."""
    methods = parse_methods(options.methods, "kit")["kit"]
    seeds, workers = parse_whole("--seeds", options.seeds), parse_whole("--jobs", options.jobs)
    labels = dict(map(parse_labels, options.labels))
    rows: list[list[str]] = []
    failed = False
    with run_folder(options.out) as folder:
        for name in parse_sequences(options.sequences):
            sequence = open_with_bar(name, options.cache, labels.get(name))
            for method in methods:
                table, ok = run_rules(sequence, method, seeds, workers, folder, options.cache)
                failed |= not ok
                show_report_table(table)
                rows += [[sequence.name, method, *row] for row in table.rows]
        title = f"Box rules, mean ± standard deviation over {seeds} seeds"
        write_text_atomic(folder / "table.md", markdown(ReportTable(title, COLUMNS, rows, [])))
    say(f"written to {folder / 'table.md'}")
    return int(failed)


def run_rules(
    sequence: Sequence, method: str, seeds: int, workers: int, folder: Path, cache: Path | None
) -> tuple[ReportTable, bool]:
    """The table of one method on one sequence, a row for each rule; False where a run failed."""
    rules = RULES if (sequence.folder / "truth").is_dir() else RULES[:-1]
    place = folder / slug(sequence.name) / method
    place.mkdir(parents=True, exist_ok=True)
    with reporting(f"{sequence.name}, {method}") as report:
        run = partial(run_jobs, workers=workers, progress=report, cache=cache)
        sweep = run_sweep(sequence, method, (Axis("filter.rule", rules),), seeds, place, run)
    return sweep_table(sweep), not any(cell.errors for cell in sweep.cells)


def parse_labels(text: str) -> tuple[str, str]:
    """Sequence and folder of "00=labels/00"."""
    name, equals, folder = text.partition("=")
    if not equals or not folder:
        raise DataError(f"--labels {text!r}: expected SEQUENCE=FOLDER")
    return parse_sequences(name)[0], folder


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
