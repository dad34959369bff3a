"""The `vo` command."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from collections.abc import Sequence as Items
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from . import settings
from .config import METHODS, Config, preset
from .environment import check
from .errors import DataError
from .evaluation import KITTI_LENGTHS, KITTI_STEP, Evaluation, evaluate
from .files import write_bytes_atomic
from .odometry import Run, run
from .plots import png, trajectory_figure
from .poses import read_kitti_pair
from .results import run_folder, write_run
from .sequence import available, open_sequence


class _Parser(argparse.ArgumentParser):
    """Wrong options get one line and exit code 2; the list of some forty options only on --help."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def main(arguments: Items[str] | None = None) -> int:
    """Entry point of `vo`; returns the exit code: 0, or 2 for bad input, or 130 when interrupted."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except DataError as error:
        print(f"vo: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("vo: interrupted; nothing was written", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="vo", description="Stereo visual odometry without features on vehicles.")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND", parser_class=_Parser)
    _add_run(commands)
    _add_evaluate(commands)
    listing = commands.add_parser("list", help="sequences found and where")
    listing.add_argument("--json", action="store_true", help="print JSON")
    listing.set_defaults(command=_list)
    checking = commands.add_parser("check", help="packages and data: what is there, what is missing")
    checking.add_argument("--json", action="store_true", help="print JSON")
    checking.set_defaults(command=_check)
    return parser


def _add_run(commands: Any) -> None:
    parser = commands.add_parser(
        "run",
        help="one run over one sequence",
        epilog="example: vo run kitti/07 --method feature_selection --out runs/07 --selection.sets 100",
    )
    parser.add_argument("sequence", help="a KITTI-layout folder, or a name from `vo list` such as kitti/07")
    parser.add_argument("--method", default="feature_selection", help=f"one of {', '.join(METHODS)}")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for poses, log, errors, picture")
    parser.add_argument("--frames", metavar="A:B", help="only the frames A … B-1, counted from 0")
    parser.add_argument("--labels", metavar="DIR", help="YOLO label files; default: labels/ in the sequence")
    group = None
    for item in settings.declared(Config):
        section = item.name.partition(".")[0] if "." in item.name else "run"
        if group is None or group.title != section:
            group = parser.add_argument_group(section)
        default = ",".join(map(str, item.default)) if isinstance(item.default, tuple) else item.default
        text = f"{item.text}; {item.describe()}; default {default}".replace("%", "%%")
        group.add_argument(f"--{item.name}", metavar="X", dest=item.name, help=text)
    parser.set_defaults(command=_run)


def _add_evaluate(commands: Any) -> None:
    parser = commands.add_parser(
        "evaluate",
        help="KITTI errors of trajectories",
        epilog="example: vo evaluate --truth poses/07.txt --estimate runs/07/poses.txt",
    )
    parser.add_argument("--truth", nargs="+", required=True, metavar="GT", help="KITTI pose files")
    parser.add_argument(
        "--estimate", nargs="+", required=True, metavar="EST", help="as many, in the same order"
    )
    parser.add_argument("--lengths", metavar="L,L,…", help="sub-sequence lengths, metres; default 100,…,800")
    parser.add_argument("--step", metavar="N", help="frames from one start to the next; default 10")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=_evaluate)


def config_from_options(options: argparse.Namespace) -> Config:
    """The preset of the method with the thresholds given on the command line."""
    config = preset(options.method)
    for item in settings.declared(Config):
        raw = getattr(options, item.name)
        if raw is not None:
            config = settings.replace(config, item.name, item.parse(raw))
    return config


def parse_frames(text: str, number: int) -> tuple[int, int]:
    """Start and stop of "A:B"; either may be left out."""
    start, colon, stop = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return int(start or 0), int(stop or number)
    except ValueError:
        raise DataError(f"--frames {text!r}: expected A:B, two whole numbers") from None


def _run(options: argparse.Namespace) -> int:
    config = config_from_options(options)
    sequence = open_sequence(options.sequence, options.labels)
    if options.frames is not None:
        sequence = sequence.part(*parse_frames(options.frames, len(sequence)))
    with run_folder(options.out) as folder:
        with _progress() as bar:
            task = bar.add_task(f"{sequence.name}, {options.method}", total=len(sequence))
            result = run(sequence, config, lambda done, total: bar.update(task, completed=done))
        errors = write_run(folder, result, options.method)
        title = f"{sequence.name}, {options.method}"
        picture = trajectory_figure(title, sequence.truth, {options.method: result.poses})
        write_bytes_atomic(folder / "trajectory.png", png(picture))
    _print_run(result, options.method, errors, folder)
    return 0


def _progress() -> Progress:
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    return Progress(*columns, console=Console(stderr=True))


def _print_run(result: Run, method: str, errors: dict[str, Evaluation], folder: Path) -> None:
    table = Table(title=f"{result.sequence.name}, {method}, {len(result.poses)} frames", title_justify="left")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    for kind, label in (("kitti", "KITTI"), ("short", "short paths, every frame")):
        if kind in errors:
            for length, part in errors[kind].sequences[0].kitti.by_length(errors[kind].lengths).items():
                if len(part):
                    value = f"{part.te:.2f} % / {part.re:.2f} deg/100 m"
                    table.add_row(f"TE / RE over {length:g} m ({label})", value)
    if result.sequence.truth is None:
        table.add_row("TE / RE", "no ground truth")
    table.add_row("matches a frame, median", f"{np.median([m.matches for m in result.motions]):.0f}")
    removed = sum(m.removed for m in result.motions)
    boxes = "" if result.sequence.labels or result.config.filter.rule == "none" else ", no labels"
    table.add_row("features removed by boxes", f"{removed} ({100 * result.removed_share:.1f} %{boxes})")
    for flag in sorted({flag for m in result.motions for flag in m.flags}):
        table.add_row(f"frames flagged {flag}", str(sum(flag in m.flags for m in result.motions)))
    table.add_row("time a frame", f"{result.ms_per_frame:.1f} ms")
    console = Console()
    console.print(table)
    console.print(f"written to {folder}", soft_wrap=True, highlight=False, markup=False)


def _evaluate(options: argparse.Namespace) -> int:
    if len(options.truth) != len(options.estimate):
        raise DataError(
            f"{len(options.truth)} truth files and {len(options.estimate)} estimates: expected pairs"
        )
    lengths: tuple[float, ...] = KITTI_LENGTHS
    step = KITTI_STEP
    try:
        if options.lengths is not None:
            lengths = tuple(float(word) for word in options.lengths.split(","))
    except ValueError:
        raise DataError(f"--lengths {options.lengths!r}: expected metres such as 20,50,100") from None
    try:
        step = step if options.step is None else int(options.step)
    except ValueError:
        raise DataError(f"--step {options.step!r}: expected a whole number of frames") from None
    # Short names where they tell the sequences apart.
    stems = [Path(path).stem for path in options.truth]
    names = stems if len(set(stems)) == len(stems) else options.truth
    pairs = [
        (name, *read_kitti_pair(truth, estimate))
        for name, truth, estimate in zip(names, options.truth, options.estimate, strict=True)
    ]
    result = evaluate(pairs, lengths, step)
    if options.json:
        print(json.dumps(result.to_dict(), indent=2, allow_nan=False))
    else:
        for table in _evaluation_tables(result):
            Console().print(table)
    return 0


SEQUENCES_A_TABLE = 4


def _evaluation_tables(result: Evaluation) -> Iterator[Table]:
    """Errors by length, a column for each sequence, a few to a table; then by sequence with both averages."""
    title = f"TE % / RE deg/100 m by length, a start every {result.step} frames"
    everything = [(s.name, s.kitti) for s in result.sequences] + [("pooled", result.pooled)]
    for first in range(0, len(everything), SEQUENCES_A_TABLE):
        part = everything[first : first + SEQUENCES_A_TABLE]
        table = Table(title=title, title_justify="left")
        table.add_column("length")
        for name, _ in part:
            table.add_column(name, justify="right", overflow="fold")
        for length in result.lengths:
            cells = [errors.by_length([length])[length] for _, errors in part]
            table.add_row(f"{length:g} m", *(_pair(cell.te, cell.re) for cell in cells))
        yield table
    table = Table(title="all lengths", title_justify="left")
    table.add_column("sequence", overflow="fold")
    for name in ("frames", "sub-sequences", "TE / RE"):
        table.add_column(name, justify="right")
    for s in result.sequences:
        table.add_row(s.name, str(s.frames), str(len(s.kitti)), _pair(s.kitti.te, s.kitti.re))
    pooled, mean = result.pooled, result.mean()
    table.add_section()
    table.add_row("pooled, as the devkit", "", str(len(pooled)), _pair(pooled.te, pooled.re))
    table.add_row("plain mean", "", "", _pair(mean["te_percent"], mean["re_deg_per_100m"]))
    yield table


def _pair(te: float | None, re: float | None) -> str:
    return "–" if te is None or re is None else f"{te:.2f} / {re:.2f}"


def _list(options: argparse.Namespace) -> int:
    found = available()
    if options.json:
        print(json.dumps({name: str(path) for name, path in found.items()}, indent=2))
        return 0
    table = Table("name", "folder")
    for name, path in found.items():
        table.add_row(name, str(path))
    Console().print(table if found else "no sequences found; `vo check` says how to get them")
    return 0


def _check(options: argparse.Namespace) -> int:
    findings = check()
    if options.json:
        print(json.dumps([vars(finding) for finding in findings], indent=2))
    else:
        table = Table("what", "state", "found")
        for finding in findings:
            table.add_row(finding.what, finding.state, finding.found)
        console = Console()
        console.print(table)
        for finding in findings:
            if finding.remedy:
                console.print(f"{finding.what}: {finding.remedy}", highlight=False, markup=False)
    return 1 if any(finding.state == "problem" for finding in findings) else 0
