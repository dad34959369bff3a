"""Measure the effect of each idea of variant `kit` by turning the idea off.

examples:
  vo data measure_ablation --sequences 00,01,kitti/drive_0013 \\
      --detector yolov8n.onnx --disturb 00,01
  vo data measure_ablation --jobs 2 --out notebooks/ablation.csv

A row has the change of the results when one idea is turned off, as mean and
standard deviation over the seeds. A row without the name of an idea has the
results with all ideas: TE in %, RE in deg/100 m, the distance of the last
position from the truth in metres, the excess length of the path in %, and the
number of frames without a motion. The processor time in milliseconds per frame
is measured on the first frames of the first sequence. Other rows of the file
are kept. A second call with the same --runs computes only the missing runs.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from pathlib import Path

import numpy as np

from measure.ablation import (
    COLUMNS,
    IDEAS,
    TIMED_FRAMES,
    TIMED_RUNS,
    WHOLE,
    Ablation,
    Idea,
    Row,
    read_row,
    row_of,
    tables,
)
from measure.axes import axes_rotation, fit_axes, is_raw_drive, number_or_nan, turn_axes
from measure.disturbances import disturbed_drives
from measure_results import add_inputs, open_all
from vo_lib.commands.common import parse_jobs, parse_whole
from vo_lib.commands.console import print_lines, print_wrapped, reporting
from vo_lib.data.catalogue import SYNTHETIC, parse_sequences
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import csv_text, read_csv
from vo_lib.errors import DataError
from vo_lib.evaluation.kitti_errors import SHORT_PROTOCOL, kitti_errors, trajectory_distances
from vo_lib.files import read_mapping, write_atomic
from vo_lib.geometry.types import Array, Progress
from vo_lib.report.page import markdown
from vo_lib.report.table1_plan import slug
from vo_lib.runs import drive
from vo_lib.runs.drive import Run
from vo_lib.runs.folder import read_run, run_folder
from vo_lib.runs.identity import run_identity
from vo_lib.runs.jobs import Job, run_jobs

SEEDS = 5
DRAWN_FRAMES = 100  # the first frames of a drawn scene; all frames would take a night


def results_of(result: Run) -> tuple[float, ...]:
    """The results of a run in the order of `RESULTS`; NaN without a sub-sequence."""
    truth = result.sequence.true_poses
    poses = result.poses
    errors = kitti_errors(truth, poses, SHORT_PROTOCOL.lengths, SHORT_PROTOCOL.step)
    te = errors.te
    if is_raw_drive(result.sequence):
        turned = fit_axes(truth, poses, SHORT_PROTOCOL.lengths, SHORT_PROTOCOL.step)
        te = turned.kitti.te
        poses = turn_axes(poses, axes_rotation((turned.pitch, turned.yaw)))
    path = np.linalg.inv(truth[0]) @ truth
    end = float(np.linalg.norm(poses[-1, :3, 3] - path[-1, :3, 3]))
    excess = 100.0 * (trajectory_distances(poses)[-1] / trajectory_distances(path)[-1] - 1.0)
    lost = sum(not motion.measured for motion in result.motions)
    return number_or_nan(te), number_or_nan(errors.re), end, excess, lost


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_inputs(parser)
    text = "sequences of which disturbed drives are made, too: flicker, blur, noise, gaps, few frames, …"
    parser.add_argument("--disturb", metavar="S,S,…", help=text)
    text = "only the ideas whose names begin like this, in a comma-separated list; default: all ideas"
    parser.add_argument("--ideas", metavar="I,I,…", help=text)
    parser.add_argument("--seeds", default=str(SEEDS), metavar="N", help=f"number of seeds; default {SEEDS}")
    parser.add_argument("--runs", default="runs/ablation", metavar="DIR", help="folder for the runs")
    parser.add_argument("--out", default="runs/ablation.csv", metavar="FILE", help="CSV file of the table")


def chosen_ideas(text: str | None) -> list[Idea]:
    """The ideas whose names begin with a part of a comma-separated list; without a list, all ideas."""
    if text is None:
        return list(IDEAS)
    starts = [start.strip() for start in text.split(",")]
    for start in starts:
        if not start or not any(idea.name.startswith(start) for idea in IDEAS):
            names = "; ".join(idea.name for idea in IDEAS)
            raise DataError(f"--ideas {start!r}: expected the beginning of a name, such as {names}")
    return [idea for idea in IDEAS if idea.name.startswith(tuple(starts))]


def run_folder_of(idea: Idea, sequence: Sequence, folder: Path) -> Path:
    """The folder of the runs of an idea on a drive."""
    return folder / slug(sequence.name) / slug(idea.name or f"all ideas {idea.method}")


def drives_of(options: argparse.Namespace, folder: Path) -> list[Sequence]:
    """The sequences in the options, the drawn ones shortened, and the disturbed drives."""
    names = parse_sequences(options.sequences)
    to_disturb = parse_sequences(options.disturb) if options.disturb else []
    unknown = [name for name in to_disturb if name not in names]
    if unknown:
        raise DataError(f"--disturb {', '.join(unknown)}: expected sequences of --sequences")
    drives = []
    disturbed = []
    for name, sequence in zip(names, open_all(options), strict=True):
        if sequence.truth is None:
            raise DataError(f"{sequence.name} has no ground truth, so errors cannot be computed")
        if sequence.name.startswith(SYNTHETIC):
            drives.append(sequence.part(0, DRAWN_FRAMES))
        else:
            drives.append(sequence)
        if name in to_disturb:
            disturbed += disturbed_drives(sequence, folder / "disturbed" / slug(sequence.name))
    return drives + disturbed


def times_without(
    sequence: Sequence, ideas: list[Idea], folder: Path, progress: Progress
) -> dict[Idea, float]:
    """Processor time without each idea, milliseconds per frame; stored times are not measured again."""
    part = sequence.part(0, min(TIMED_FRAMES, len(sequence)))
    times = {}
    for number, idea in enumerate(ideas, start=1):
        path = run_folder_of(idea, sequence, folder) / "time.json"
        identity = run_identity(part, idea.config(), idea.method)
        stored = read_mapping(path, "a processor time") if path.exists() else {}
        if stored.get("identity") != identity:
            seconds = [_processor_time(part, idea) for _ in range(TIMED_RUNS)]
            stored = {"identity": identity, "ms": 1e3 * min(seconds) / len(part)}
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, json.dumps(stored, indent=1))
        times[idea] = float(stored["ms"])
        progress(number, len(ideas))
    return times


def _processor_time(sequence: Sequence, idea: Idea) -> float:
    """Processor time of a run without an idea, seconds."""
    start = time.process_time()
    drive.run(sequence, idea.config())
    return time.process_time() - start


def run_all(
    drives: list[Sequence], chosen: list[Idea], seeds: int, options: argparse.Namespace, folder: Path
) -> list[Row]:
    """The rows of the table; only runs that are not in their folders are computed."""
    ideas = [*WHOLE, *chosen]
    jobs = []
    for sequence, idea, seed in itertools.product(drives, ideas, range(seeds)):
        path = _folder_of_seed(idea, sequence, seed, folder)
        jobs.append(Job(sequence, idea.method, idea.config(seed), path))
    with reporting(f"{len(jobs)} runs") as report:
        outcomes = run_jobs(jobs, parse_jobs(options.jobs, len(jobs)), report, options.cache)
    failed = [f"{outcome.job.folder}: {outcome.error}" for outcome in outcomes if outcome.error]
    if failed:
        raise DataError(failed[0])
    timed_drive = drives[0]
    with reporting("measuring the time") as report:
        ms = times_without(timed_drive, ideas, folder, report)
    rows = []
    for sequence in drives:
        results = {}
        for idea in ideas:
            paths = [_folder_of_seed(idea, sequence, seed, folder) for seed in range(seeds)]
            results[idea] = np.array([results_of(read_run(path, sequence)) for path in paths])
        rows += _rows_of_drive(sequence.name, results, ms if sequence is timed_drive else {})
    return rows


def _folder_of_seed(idea: Idea, sequence: Sequence, seed: int, folder: Path) -> Path:
    """The folder of the run of an idea on a drive with one seed."""
    return run_folder_of(idea, sequence, folder) / f"seed_{seed}"


def _rows_of_drive(drive_name: str, results: dict[Idea, Array], ms: dict[Idea, float]) -> list[Row]:
    """The rows of a drive: results with all ideas, or their changes without an idea.

    results : (S, 5) over the seeds, by idea, among them those of `WHOLE`.
    ms : processor times by idea; empty for a drive on which none was measured.
    """
    whole_of_method = {idea.method: idea for idea in WHOLE}
    rows = []
    for idea, own in results.items():
        own_ms = ms.get(idea, np.nan)
        if idea in WHOLE:
            rows.append(row_of(idea, drive_name, own, None, own_ms))
        else:
            whole = whole_of_method[idea.method]
            rows.append(row_of(idea, drive_name, own, results[whole], own_ms - ms.get(whole, np.nan)))
    return rows


def run(options: argparse.Namespace) -> int:
    """Run variant `kit` with and without each idea; write the differences and print them as tables."""
    seeds = parse_whole("--seeds", options.seeds)
    out = Path(options.out)
    chosen = chosen_ideas(options.ideas)
    with run_folder(options.runs) as folder:
        folder = folder.resolve()
        rows = run_all(drives_of(options, folder), chosen, seeds, options, folder)
    new = {(row.idea, row.method, row.sequence) for row in rows}
    if out.exists():
        earlier = [read_row(cells) for _, cells in read_csv(out)[1:]]
        rows += [row for row in earlier if (row.idea, row.method, row.sequence) not in new]
    write_atomic(out, csv_text([COLUMNS, *(row.cells for row in rows)]))
    print_lines("\n\n".join(map(markdown, tables(Ablation(rows)))))
    print_wrapped(f"written to {out}")
    return 0
