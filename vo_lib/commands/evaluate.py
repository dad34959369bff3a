"""`vo evaluate`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

from ..core.errors import DataError
from ..core.files import write_result
from ..core.poses import read_by_time, read_euroc, read_kitti_pair, read_tum
from ..core.types import Array
from ..evaluation.ate_rpe import Alignment
from ..evaluation.axes import LARGEST
from ..evaluation.evaluate import evaluate
from ..evaluation.kitti import KITTI_LENGTHS, KITTI_STEP
from ..runs.results import run_folder
from ..tables.comparison import first_distinct
from ..tables.evaluation_files import System, as_csv, as_json, evaluation_tables, write_pictures
from .common import parse_lengths, parse_whole
from .console import reporting, say, show_report_table, tell

NO_NAME = ("poses", "poses_tum", "data")  # files that are called alike in every folder


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo evaluate`."""
    parser.epilog = "example: vo evaluate --truth poses/07.txt --estimate runs/07/poses.txt"
    parser.add_argument("--truth", nargs="+", required=True, metavar="GT", help="pose files")
    parser.add_argument(
        "--estimate",
        nargs="+",
        required=True,
        metavar="EST",
        help="as many, in the same order; for several systems, all of one, then all of the next; "
        "they are called by what tells their files apart",
    )
    parser.add_argument(
        "--plot",
        metavar="DIR",
        help="draw paths, aligned as --alignment says, coloured by the distance from the truth; "
        "position and angles over time; errors by length and speed",
    )
    parser.add_argument("--out", metavar="DIR", help="write evaluation.json and evaluation.csv")
    parser.add_argument("--lengths", metavar="L,L,…", help="sub-sequence lengths, metres; default 100,…,800")
    parser.add_argument("--step", metavar="N", help="frames from one start to the next; default 10")
    parser.add_argument(
        "--format",
        default="kitti",
        choices=("kitti", "tum", "euroc"),
        help="of the files; tum: matched by time; euroc: a CSV of the body's poses, an estimate may be TUM's",
    )
    parser.add_argument(
        "--alignment",
        default=Alignment.SE3.value,
        choices=[alignment.value for alignment in Alignment],
        help="what may be moved before ATE is taken; default se3",
    )
    parser.add_argument(
        "--axes",
        action="store_true",
        help="TE and RE also with the one pitch and yaw of a sequence, between the camera's axes and the "
        f"truth's, that make TE smallest (at most {LARGEST:g}° each; not KITTI's measure)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=_evaluate)


def _evaluate(options: argparse.Namespace) -> int:
    count, rest = divmod(len(options.estimate), len(options.truth))
    if rest or not count:
        raise DataError(
            f"{len(options.truth)} truth files and {len(options.estimate)} estimates: expected pairs, "
            "or twice as many estimates for two systems"
        )
    lengths = KITTI_LENGTHS if options.lengths is None else parse_lengths(options.lengths)
    step = KITTI_STEP if options.step is None else parse_whole("--step", options.step)
    files = [options.estimate[i * len(options.truth) :][: len(options.truth)] for i in range(count)]
    labels = _distinct(files) if count > 1 else [""]
    names = _distinct([[truth] for truth in options.truth])
    read = [_read(options.format, gt, of_one) for gt, *of_one in zip(options.truth, *files, strict=True)]
    times = {name: at for name, (at, _, _) in zip(names, read, strict=True) if at is not None}
    systems: list[System] = []
    with reporting("judging") as report:

        def watched(pairs: list[tuple[Array, Array]]) -> Iterator[tuple[str, Array, Array]]:
            for number, (name, pair) in enumerate(zip(names, pairs, strict=True), len(systems) * len(names)):
                report(number, count * len(names))
                yield name, *pair

        for which, label in enumerate(labels):
            pairs = [(truth, estimates[which]) for _, truth, estimates in read]
            alignment = Alignment(options.alignment)
            result = evaluate(watched(pairs), lengths, step, alignment, times, options.axes)
            systems.append(System(label, pairs, result, times))
    data = json.dumps(as_json(systems), indent=2, allow_nan=False)
    if options.out is not None:
        with run_folder(options.out, "evaluation.json", "evaluation.csv") as folder:
            write_result(folder / "evaluation.json", data + "\n")
            write_result(folder / "evaluation.csv", as_csv(systems))
    if options.plot is not None:
        with run_folder(options.plot) as folder, reporting("drawing") as report:
            write_pictures(folder, systems, report)
    if options.json:
        print(data)
        return 0
    for table in evaluation_tables(systems):
        show_report_table(table)
    if not any(len(system.result.pooled) for system in systems):
        tell(f"no path holds a sub-sequence of {min(lengths):g} m: try --lengths 20,50,100 --step 1")
    for folder in dict.fromkeys(filter(None, (options.out, options.plot))):
        say(f"written to {folder}")
    return 0


def _distinct(groups: list[list[str]]) -> list[str]:
    """The shortest names that tell groups of files apart: a file's own, else a folder's, inmost first."""
    firsts = [Path(group[0]).absolute() for group in groups]
    _, *folders = zip(*(path.parts[::-1] for path in firsts), strict=False)
    pairs = zip(firsts, folders[0], strict=True)
    files = [folder if path.stem in NO_NAME else path.stem for path, folder in pairs]
    numbered = [f"{path}, {number}" for number, path in enumerate(firsts, start=1)]
    return first_distinct(files, *map(list, folders), numbered)


def _read(form: str, truth_file: str, files: list[str]) -> tuple[Array | None, Array, list[Array]]:
    """Times, if known, truth and estimates of it, (N, 4, 4) each; by time, what all of them have."""
    if form == "kitti":
        pairs = [read_kitti_pair(truth_file, file) for file in files]
        return None, pairs[0][0], [estimate for _, estimate in pairs]
    return read_by_time(truth_file, files, {"tum": read_tum, "euroc": read_euroc}[form])
