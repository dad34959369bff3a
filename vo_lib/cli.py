"""The `vo` command."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence as Items
from pathlib import Path
from typing import Any

from . import settings
from .config import METHODS, Config, preset
from .console import (
    OneLineParser,
    reporting,
    say,
    show_evaluation,
    show_findings,
    show_report_table,
    show_run,
    show_table,
)
from .demo import SCENE, run_demo
from .environment import check
from .errors import DataError
from .evaluation import KITTI_LENGTHS, KITTI_STEP, evaluate
from .files import write_bytes_atomic, write_text_atomic
from .odometry import run
from .plots import png, trajectory_figure
from .poses import read_kitti_pair
from .report import ReportTable
from .reproduce import COLUMNS, compare_methods, markdown, parse_sequences, table_rows
from .results import run_folder, write_run
from .sequence import SYNTHETIC, Sequence, available, open_sequence
from .synthetic import SCENES, cache_folder


def main(arguments: Items[str] | None = None) -> int:
    """Entry point of `vo`; returns the exit code: 0, or 2 for bad input, or 130 when interrupted."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except DataError as error:
        print(f"vo: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("vo: interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="vo", description="Stereo visual odometry without features on vehicles.")
    commands = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=OneLineParser
    )
    _add_demo(commands)
    _add_run(commands)
    _add_reproduce(commands)
    _add_evaluate(commands)
    for name, command, text in (
        ("list", _list, "sequences found and where"),
        ("check", _check, "packages and data: what is there, what is missing"),
    ):
        simple = commands.add_parser(name, help=text)
        simple.add_argument("--json", action="store_true", help="print JSON")
        simple.set_defaults(command=command)
    return parser


def _add_demo(commands: Any) -> None:
    parser = commands.add_parser("demo", help="the main job with nothing downloaded: all methods on a street")
    parser.add_argument("--out", default="runs/demo", metavar="DIR", help="folder for the report")
    _add_cache(parser)
    parser.set_defaults(command=_demo)


def _add_cache(parser: argparse.ArgumentParser) -> None:
    text = f"folder that keeps synthetic scenes; default {cache_folder()}"
    parser.add_argument("--cache", type=Path, metavar="DIR", help=text.replace("%", "%%"))


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
    _add_cache(parser)
    group = None
    for item in settings.declared(Config):
        section = item.name.partition(".")[0] if "." in item.name else "run"
        if group is None or group.title != section:
            group = parser.add_argument_group(section)
        default = ",".join(map(str, item.default)) if isinstance(item.default, tuple) else item.default
        text = f"{item.text}; {item.describe()}; default {default}".replace("%", "%%")
        group.add_argument(f"--{item.name}", metavar="X", dest=item.name, help=text)
    parser.set_defaults(command=_run)


def _add_reproduce(commands: Any) -> None:
    parser = commands.add_parser(
        "reproduce",
        help="methods over sequences and seeds, as a table",
        epilog="example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection",
    )
    parser.add_argument(
        "--sequences",
        metavar="S,S,…",
        default=",".join(f"{SYNTHETIC}{name}" for name in SCENES),
        help="KITTI numbers and ranges, names from `vo list`, paths; default: the synthetic scenes",
    )
    parser.add_argument("--methods", metavar="M,M,…", default=",".join(METHODS), help="default: all")
    parser.add_argument("--seeds", metavar="N", default="5", help="seeds 0 … N-1; default 5")
    parser.add_argument("--out", default="runs/table", metavar="DIR", help="folder for table.md")
    _add_cache(parser)
    parser.set_defaults(command=_reproduce)


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


def parse_whole(name: str, text: str) -> int:
    """A whole number of 1 or more; `DataError` names the option."""
    if not text.isdecimal() or int(text) < 1:
        raise DataError(f"{name} {text!r}: expected a whole number of 1 or more")
    return int(text)


def _open(name: str, cache: Path | None, labels: str | None = None) -> Sequence:
    """A sequence; a bar is shown while a synthetic scene is drawn."""
    with reporting(f"drawing {name}") as report:
        return open_sequence(name, labels, cache, report)


def _demo(options: argparse.Namespace) -> int:
    with run_folder(options.out) as folder:
        sequence = _open(SCENE, options.cache)
        with reporting("all methods") as report:
            table = run_demo(sequence, folder, report)
    show_report_table(table)
    say(
        f"Look at {folder / 'report.html'} in a browser. What next:",
        "  vo list                                    the other scenes and any KITTI sequences found",
        "  vo run synthetic/jam --out runs/jam        one method on another scene",
        "  vo run PATH --out runs/mine                a KITTI-layout folder of your own",
        "  vo check                                   what is missing for KITTI, and how to get it",
    )
    return 0


def _run(options: argparse.Namespace) -> int:
    config = config_from_options(options)
    sequence = _open(options.sequence, options.cache, options.labels)
    if options.frames is not None:
        sequence = sequence.part(*parse_frames(options.frames, len(sequence)))
    label = f"{sequence.name}, {options.method}"
    with run_folder(options.out) as folder:
        with reporting(label) as report:
            result = run(sequence, config, report)
        errors = write_run(folder, result, options.method)
        picture = trajectory_figure(label, sequence.truth, {options.method: result.poses})
        write_bytes_atomic(folder / "trajectory.png", png(picture))
    show_run(result, options.method, errors, folder)
    return 0


def _reproduce(options: argparse.Namespace) -> int:
    names = parse_sequences(options.sequences)
    methods = options.methods.split(",")
    for method in methods:
        preset(method)
    seeds = parse_whole("--seeds", options.seeds)
    everything: list[list[str]] = []
    with run_folder(options.out) as folder:
        for name in names:
            sequence = _open(name, options.cache)
            with reporting(sequence.name) as report:
                errors, lengths = compare_methods(sequence, methods, seeds, report)
            rows = table_rows(errors)
            everything += [[sequence.name, lengths, *row] for row in rows]
            title = f"{sequence.name}, {lengths}; mean ± standard deviation over {seeds} seeds"
            show_report_table(ReportTable(title, COLUMNS, rows, []))
        write_text_atomic(folder / "table.md", markdown(["sequence", "lengths", *COLUMNS], everything))
    say(f"written to {folder / 'table.md'}")
    return 0


def _evaluate(options: argparse.Namespace) -> int:
    if len(options.truth) != len(options.estimate):
        raise DataError(
            f"{len(options.truth)} truth files and {len(options.estimate)} estimates: expected pairs"
        )
    lengths: tuple[float, ...] = KITTI_LENGTHS
    try:
        if options.lengths is not None:
            lengths = tuple(float(word) for word in options.lengths.split(","))
    except ValueError:
        raise DataError(f"--lengths {options.lengths!r}: expected metres such as 20,50,100") from None
    step = KITTI_STEP if options.step is None else parse_whole("--step", options.step)
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
        show_evaluation(result)
    return 0


def _list(options: argparse.Namespace) -> int:
    found = {name: str(path or "drawn on first use") for name, path in available().items()}
    if options.json:
        print(json.dumps(found, indent=2))
        return 0
    show_table("", ["name", "folder"], [list(row) for row in found.items()], numbers=False)
    if not any(name.startswith("kitti/") for name in found):
        say("no KITTI sequences found; `vo check` says how to get them")
    return 0


def _check(options: argparse.Namespace) -> int:
    findings = check()
    if options.json:
        print(json.dumps([vars(finding) for finding in findings], indent=2))
    else:
        show_findings(findings)
    return 1 if any(finding.state == "problem" for finding in findings) else 0
