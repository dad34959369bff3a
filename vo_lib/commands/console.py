"""What the `vo` command and the data scripts show in a terminal: errors, progress bars, tables."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ..config import Config
from ..core.types import Progress as Report
from ..evaluation.kitti import Evaluation
from ..runs.runner import Run
from ..tables.report import ReportTable
from ..tables.table1 import number
from .environment import Finding

SEQUENCES_A_TABLE = 4


class OneLineParser(argparse.ArgumentParser):
    """Wrong options get one line and exit code 2; the list of all options only on --help."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


@contextmanager
def reporting(label: str) -> Iterator[Report]:
    """A progress function with a bar on standard error, which appears with its first call."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task(label, total=None)

    def report(done: int, total: int) -> None:
        bar.start()
        bar.update(task, completed=done, total=total)

    try:
        yield report
    finally:
        if bar.live.is_started:
            bar.stop()


def say(*lines: str) -> None:
    """Print lines as they are: no colours, no markup, no wrapping in the middle of a path."""
    Console().print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)


def show_table(title: str, columns: list[str], rows: list[list[str]], numbers: bool = True) -> None:
    """A table: the first column names the row; numbers stand to the right."""
    table = Table(title=title, title_justify="left")
    table.add_column(columns[0], overflow="fold")
    for name in columns[1:]:
        table.add_column(name, justify="right" if numbers else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    Console().print(table)


def show_report_table(table: ReportTable) -> None:
    """A report's table with its notes."""
    show_table(table.title, table.columns, table.rows)
    say(*table.notes)


def show_run(result: Run, method: str, errors: dict[str, Evaluation], folder: Path) -> None:
    """Errors, removals, flags and time of a run."""
    rows = []
    for kind, label in (("kitti", "KITTI"), ("short", "short paths, every frame")):
        if kind in errors:
            by_length = errors[kind].sequences[0].kitti.by_length(errors[kind].lengths)
            rows += [
                [f"TE / RE over {length:g} m ({label})", f"{part.te:.2f} % / {part.re:.2f} deg/100 m"]
                for length, part in by_length.items()
                if len(part)
            ]
    if result.sequence.truth is None:
        rows.append(["TE / RE", "no ground truth"])
    rows.append(["matches a frame, median", f"{np.median([m.matches for m in result.motions]):.0f}"])
    removed = sum(m.removed for m in result.motions)
    boxes = "" if result.sequence.labels or result.config.filter.rule == "none" else ", no labels"
    rows.append(["features removed by boxes", f"{removed} ({100 * result.removed_share:.1f} %{boxes})"])
    for flag in sorted({flag for m in result.motions for flag in m.flags}):
        rows.append([f"frames flagged {flag}", str(sum(flag in m.flags for m in result.motions))])
    config = result.config
    if isinstance(config, Config) and config.calibration.estimate and result.motions:
        offset = next((m.offset for m in reversed(result.motions) if np.isfinite(m.offset)), 0.0)
        u, v = result.motions[-1].centre
        found = f"principal point {u:+.1f}, {v:+.1f} px; disparities {offset:+.2f} px"
        rows.append(["learnt of the calibration", found])
    rows.append(["time a frame", f"{result.ms_per_frame:.1f} ms"])
    title = f"{result.sequence.name}, {method}, {len(result.poses)} frames"
    show_table(title, ["quantity", "value"], rows)
    say(f"written to {folder}")


def show_evaluation(result: Evaluation) -> None:
    """Errors by length, a column for each sequence, a few to a table; then by sequence with both averages."""
    everything = [(s.name, s.kitti) for s in result.sequences] + [("pooled", result.pooled)]
    for first in range(0, len(everything), SEQUENCES_A_TABLE):
        part = everything[first : first + SEQUENCES_A_TABLE]
        rows = []
        for length in result.lengths:
            cells = [errors.by_length([length])[length] for _, errors in part]
            rows.append([f"{length:g} m", *(_pair(cell.te, cell.re) for cell in cells)])
        title = f"TE % / RE deg/100 m by length, a start every {result.step} frames"
        show_table(title, ["length", *(name for name, _ in part)], rows)
    rows = [
        [s.name, str(s.frames), str(len(s.kitti)), _pair(s.kitti.te, s.kitti.re)] for s in result.sequences
    ]
    pooled, mean = result.pooled, result.mean()
    rows.append(["pooled, as the devkit", "", str(len(pooled)), _pair(pooled.te, pooled.re)])
    rows.append(["plain mean", "", "", _pair(mean["te_percent"], mean["re_deg_per_100m"])])
    show_table("all lengths", ["sequence", "frames", "sub-sequences", "TE / RE"], rows)
    rows = []
    for sequence in result.sequences:
        ate, rpe = sequence.ate.to_dict(), sequence.rpe.to_dict()
        values = [ate["rmse_m"], rpe["translation"]["rmse_m"], rpe["rotation"]["rmse_deg"]]
        rows.append([sequence.name, *(number(value, 4) for value in values)])
    show_table("ATE and RPE, root mean squares", ["sequence", "ATE m", "RPE m", "RPE deg"], rows)
    alignment, delta = result.sequences[0].ate.alignment, result.sequences[0].rpe.delta
    say(f"ATE {alignment.words}; RPE from frame to frame + {delta}, which needs no alignment")


def _pair(te: float | None, re: float | None) -> str:
    return "–" if te is None or re is None else f"{te:.2f} / {re:.2f}"


def show_findings(findings: list[Finding]) -> None:
    """The check's findings, then what to do about those that are not well."""
    show_table("", ["what", "state", "found"], [[f.what, f.state, f.found] for f in findings], numbers=False)
    say(*(f"{f.what}: {f.remedy}" for f in findings if f.remedy))
