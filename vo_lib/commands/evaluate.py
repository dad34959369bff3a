"""`vo evaluate`."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from ..core.errors import DataError
from ..core.files import write_result
from ..core.poses import read_by_time, read_euroc, read_kitti_pair, read_tum
from ..core.types import Array
from ..evaluation.ate_rpe import Alignment
from ..evaluation.axes import LARGEST, fit_axes
from ..evaluation.kitti import KITTI_LENGTHS, KITTI_STEP, evaluate, pooled
from ..runs.results import run_folder
from ..tables.evaluation_files import POOLED, System, as_csv, as_json, write_pictures
from ..tables.report import number
from .common import parse_lengths, parse_whole
from .console import reporting, say, show_table

NO_NAME = ("poses", "poses_tum", "data")  # files that are called alike in every folder
SEQUENCES_A_TABLE = 4
STATISTICS = ("rmse", "mean", "median", "max")


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo evaluate`."""
    parser.epilog = "example: vo evaluate --truth poses/07.txt --estimate runs/07/poses.txt"
    parser.add_argument("--truth", nargs="+", required=True, metavar="GT", help="pose files")
    parser.add_argument(
        "--estimate",
        nargs="+",
        required=True,
        metavar="EST",
        help="as many, in the same order; for several systems, all of one, then all of the next",
    )
    parser.add_argument("--names", metavar="A,B,…", help="what to call the systems; default by their files")
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
    parser.add_argument("--delta", metavar="N", default="1", help="frames that RPE is taken over; default 1")
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
    delta = parse_whole("--delta", options.delta)
    files = [options.estimate[i * len(options.truth) :][: len(options.truth)] for i in range(count)]
    labels = _labels(options.names, files)
    names = _distinct([[truth] for truth in options.truth])
    read = [_read(options.format, gt, of_one) for gt, *of_one in zip(options.truth, *files, strict=True)]
    times = {name: at for name, (at, _, _) in zip(names, read, strict=True) if at is not None}
    alignment = Alignment(options.alignment)
    systems = []
    with reporting("judging") as report:
        for which, label in enumerate(labels):
            pairs = [(truth, estimates[which]) for _, truth, estimates in read]
            results, turned = [], []
            for number, (name, pair) in enumerate(zip(names, pairs, strict=True), which * len(names)):
                report(number, len(labels) * len(names))
                results.append(evaluate([(name, *pair)], lengths, step, alignment, delta, times))
                turned += [fit_axes(*pair, lengths, step)] if options.axes else []
            sequences = tuple(one for result in results for one in result.sequences)
            whole = dataclasses.replace(results[0], sequences=sequences)
            systems.append(System(label, pairs, whole, turned, times))
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
    _show(systems)
    if not any(len(system.result.pooled) for system in systems):
        say(f"no path holds a sub-sequence of {min(lengths):g} m: try --lengths 20,50,100 --step 1")
    for folder in dict.fromkeys(filter(None, (options.out, options.plot))):
        say(f"written to {folder}")
    return 0


def _labels(names: str | None, files: list[list[str]]) -> list[str]:
    """What the systems are called: by `names`, else by their files; nothing where there is one."""
    if names is None:
        return _distinct(files) if len(files) > 1 else [""]
    labels = names.split(",")
    if len(labels) != len(files) or len(set(labels)) < len(labels) or "" in labels:
        raise DataError(f"--names {names}: expected {len(files)} different names")
    return labels


def _distinct(groups: list[list[str]]) -> list[str]:
    """The shortest names that tell groups of files apart: a file's own, its folder's, the whole path."""
    firsts = [Path(group[0]) for group in groups]
    folders = [path.parent.name for path in firsts]
    files = [
        folder if path.stem in NO_NAME else path.stem for path, folder in zip(firsts, folders, strict=True)
    ]
    for names in (files, folders, list(map(str, firsts))):
        if len(set(names)) == len(names) and all(names):
            return names
    return [f"{path}, {number}" for number, path in enumerate(firsts, start=1)]


def _read(form: str, truth_file: str, files: list[str]) -> tuple[Array | None, Array, list[Array]]:
    """Times, if known, truth and estimates of it, (N, 4, 4) each; by time, what all of them have."""
    if form == "kitti":
        pairs = [read_kitti_pair(truth_file, file) for file in files]
        return None, pairs[0][0], [estimate for _, estimate in pairs]
    return read_by_time(truth_file, files, {"tum": read_tum, "euroc": read_euroc}[form])


def _show(systems: list[System]) -> None:
    """Errors by length, a column for each sequence, a few to a table; then by sequence with both averages."""
    first = systems[0].result
    named = [(_name(s, name), e) for s in systems for name, e in s.errors.items()]
    for start in range(0, len(named), SEQUENCES_A_TABLE):
        part = named[start : start + SEQUENCES_A_TABLE]
        rows = []
        for length in first.lengths:
            cells = [errors.by_length([length])[length] for _, errors in part]
            rows.append([f"{length:g} m", *(_pair(cell.te, cell.re) for cell in cells)])
        title = f"TE % / RE deg/100 m by length, a start every {first.step} frames"
        show_table(title, ["length", *(name for name, _ in part)], rows)
    everything, others = [], []
    for system in systems:
        for s in system.result.sequences:
            name, errors = _name(system, s.name), _pair(s.kitti.te, s.kitti.re)
            everything.append([name, str(s.frames), str(len(s.kitti)), errors])
            ate, rpe = s.ate.to_dict(), s.rpe.to_dict()
            for kind, of_kind, unit in (
                ("ATE m", ate, "m"),
                ("RPE m", rpe["translation"], "m"),
                ("RPE deg", rpe["rotation"], "deg"),
            ):
                values = [of_kind[f"{statistic}_{unit}"] for statistic in STATISTICS]
                others.append([f"{name} {kind}", *(number(value, 4) for value in values)])
        pooled, mean = system.result.pooled, system.result.mean()
        name = _name(system, "pooled, as the devkit")
        everything.append([name, "", str(len(pooled)), _pair(pooled.te, pooled.re)])
        mean_errors = _pair(mean["te_percent"], mean["re_deg_per_100m"])
        everything.append([_name(system, "plain mean"), "", "", mean_errors])
    show_table("all lengths", ["sequence", "frames", "sub-sequences", "TE / RE"], everything)
    show_table("ATE and RPE", ["sequence", *STATISTICS], others)
    alignment, delta = first.sequences[0].ate.alignment, first.sequences[0].rpe.delta
    say(f"ATE {alignment.words}; RPE from frame to frame + {delta}, which needs no alignment")
    if systems[0].turned:
        _show_axes(systems)


def _name(system: System, name: str) -> str:
    """What a row or column is called: the sequence, with several systems the system too."""
    return f"{system.label} {name}" if system.label else name


def _show_axes(systems: list[System]) -> None:
    rows = []
    for system in systems:
        for s, t in zip(system.result.sequences, system.turned, strict=True):
            errors = _pair(s.kitti.te, s.kitti.re), _pair(t.kitti.te, t.kitti.re)
            rows.append([_name(system, s.name), f"{t.pitch:+.2f}", f"{t.yaw:+.2f}", *errors])
        both = system.result.pooled, pooled(t.kitti for t in system.turned)
        rows.append([_name(system, POOLED), "", "", *(_pair(errors.te, errors.re) for errors in both)])
    columns = ["sequence", "pitch °", "yaw °", "TE / RE\nmeasured", "TE / RE\nturned"]
    show_table("axes turned by one pitch and yaw", columns, rows)
    say("the angles that make TE smallest: a look at the truth, not KITTI's measure")


def _pair(te: float | None, re: float | None) -> str:
    return "–" if te is None or re is None else f"{te:.3f} / {re:.3f}"
