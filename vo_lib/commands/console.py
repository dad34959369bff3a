"""What the `vo` command and the data scripts show in a terminal: progress bars, tables."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ..config import Config
from ..core.types import Progress as Report
from ..evaluation.evaluate import Evaluation
from ..runs.results import path_lost
from ..runs.runner import Run
from ..tables.report import ReportTable, number

QUICK = 0.7  # seconds; what takes no longer needs no bar
PAUSE, SPEED_OVER = 0.3, 180.0  # seconds between updates of a bar, and over which it takes its speed


@contextmanager
def reporting(label: str, in_bytes: bool = False) -> Iterator[Report]:
    """A progress function with a bar on standard error, which appears where the work takes longer."""
    from rich import progress as rich  # a tenth of a second, which --help and Tab need not wait for

    count = (rich.DownloadColumn(), rich.TransferSpeedColumn()) if in_bytes else (rich.MofNCompleteColumn(),)
    words = rich.TextColumn("{task.description}", markup=False)
    columns = words, rich.BarColumn(), *count, rich.TimeRemainingColumn()
    bar = rich.Progress(*columns, console=Console(stderr=True), speed_estimate_period=SPEED_OVER)
    task, began, last = bar.add_task(label, total=None), time.monotonic(), -PAUSE

    def report(done: int, total: int) -> None:
        nonlocal last
        if time.monotonic() - began >= QUICK:
            bar.start()
        # Rich knows the last thousand updates: with one a frame, the time left would follow every hiccup.
        if done >= total or time.monotonic() - last >= PAUSE:
            last = time.monotonic()
            bar.update(task, completed=done, total=total)

    try:
        yield report
    finally:
        if bar.live.is_started:
            bar.stop()


def say(*lines: str) -> None:
    """Print lines as they are: no colours, no markup, no wrapping in the middle of a path."""
    Console().print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)


def tell(*sentences: str) -> None:
    """Print sentences, each wrapped between words at the terminal's width."""
    for sentence in sentences:
        Console().print(sentence, highlight=False, markup=False)


def show_table(title: str, columns: list[str], rows: list[list[str]], numbers: bool = True) -> None:
    """A table: the first column names the row; numbers stand to the right."""
    if title:
        say(title)  # above the table, not within: a narrow one would break it
    table, console = Table(), Console()
    cells = [[line for row in (columns, *rows) for line in row[k].split("\n")] for k in range(len(columns))]
    # In a narrow terminal headings and names are broken, numbers never.
    narrow = sum(3 + max(map(len, column)) for column in cells) >= console.width
    table.add_column(columns[0], overflow="fold", no_wrap=not narrow)
    for name in columns[1:]:
        heading = name.replace(" ", "\n") if narrow and numbers else name
        table.add_column(heading, justify="right" if numbers else "left", overflow="fold", no_wrap=numbers)
    for row in rows:
        table.add_row(*map(Text, row))  # no markup: a name may have brackets
    console.print(table)


def show_report_table(table: ReportTable) -> None:
    """A report's table, below a blank line, with what is said above and below it."""
    tell("", table.title, *table.head)
    show_table("", table.columns, table.rows)
    tell(*table.notes)


def show_run(result: Run, method: str, errors: dict[str, Evaluation], folder: Path) -> None:
    """Errors, removals, flags and time of a run."""
    by_length: dict[float, list[str]] = {}
    for kind, label in (("short", ", every frame"), ("kitti", " (as KITTI)")):
        for found in [errors[kind]] if kind in errors else []:
            for length, part in found.sequences[0].kitti.by_length(found.lengths).items():
                if len(part):
                    words = f"{part.te:.2f} % / {part.re:.2f} deg/100 m"
                    by_length[length] = [f"TE / RE over {length:g} m{label}", words]
    rows = [by_length[length] for length in sorted(by_length)]
    if errors:
        ate, rpe = errors["kitti"].sequences[0].ate.to_dict(), errors["kitti"].sequences[0].rpe.to_dict()
        rows.append(["ATE, aligned", f"{number(ate['rmse_m'])} m"])
        step = f"{number(rpe['translation']['rmse_m'], 4)} m / {number(rpe['rotation']['rmse_deg'], 4)} deg"
        rows.append(["RPE, frame to frame", step])
    else:
        rows.append(["TE / RE", "no ground truth"])
    rows.append(["matches a frame, median", number(result.matches_per_frame, 0)])
    removed = sum(m.removed for m in result.motions)
    boxes = "" if result.sequence.labels or result.config.filter.rule == "none" else ", no labels"
    rows.append(["features removed by boxes", f"{removed} ({100 * result.removed_share:.1f} %{boxes})"])
    for flag in sorted({flag for m in result.motions for flag in m.flags}):
        rows.append([f"frames flagged {flag}", str(sum(flag in m.flags for m in result.motions))])
    if isinstance(result.config, Config) and result.calibration is not None:
        said = result.calibration.in_words(result.config.calibration)
        rows.append(["errors of the calibration", said.replace("; ", "\n")])
    rows.append(["time a frame", f"{result.ms_per_frame:.1f} ms"])
    title = f"{result.sequence.name}, {method}, {len(result.poses)} frames"
    show_table(title, ["quantity", "value"], rows)
    if path_lost(result):
        pairs = zip(result.sequence.frames[1:], result.motions, strict=True)
        doubt = [frame for frame, motion in pairs if motion.in_doubt]
        tell(
            f"The path was lost: {len(doubt)} of {len(result.motions)} frames have no motion that can be "
            f"believed, the first is {doubt[0]}. The reasons are in frames.csv; a camera that is carried or "
            "flies needs --vehicle.check off."
        )
    tell(*(f"warning: {sentence}" for sentence in result.doubts))
    say(f"written to {folder}")
