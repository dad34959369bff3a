"""What `vo evaluate` shows and leaves behind: tables, JSON and CSV, pictures of paths and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.types import Array, Progress
from ..evaluation.ate_rpe import align, rmse, statistics
from ..evaluation.evaluate import Evaluation
from ..evaluation.kitti import KittiErrors
from .error_plots import coloured_paths_figure, components_figure
from .plots import TRUTH, trajectories_figure
from .report import ReportTable, number, te_re
from .reproduce import slug
from .table1_data import KINDS, records_csv
from .table_files import AXES, write_curves, write_figure

STATISTICS = "rmse", "mean", "median", "max"
SEQUENCES_A_TABLE = 4
POOLED = "pooled"
ONLY = "estimate"


@dataclass(frozen=True)
class System:
    """The estimates of one system, judged.

    Attributes
    ----------
    label : its name; empty where it is the only one.
    pairs : truth and estimate of each sequence, (N, 4, 4) each, as `result` has them.
    times : (N,) seconds of the poses of each sequence by name, where the files have them.
    """

    label: str
    pairs: list[tuple[Array, Array]]
    result: Evaluation
    times: Mapping[str, Array]

    def called(self, name: str) -> str:
        """What a row or column of a sequence is called: with several systems the system's too."""
        return f"{self.label} {name}" if self.label else name

    @property
    def errors(self) -> dict[str, KittiErrors]:
        """Of each sequence by name and, of several, pooled."""
        parts = {s.name: s.kitti for s in self.result.sequences}
        return parts | ({POOLED: self.result.pooled} if len(parts) > 1 else {})


def as_json(systems: list[System]) -> dict[str, Any]:
    """One system's numbers, or those of several under their labels."""
    if len(systems) == 1:
        return systems[0].result.to_dict()
    return {"systems": [{"system": system.label} | system.result.to_dict() for system in systems]}


def as_csv(systems: list[System]) -> str:
    """A row for each system, sequence and length; over all lengths with ATE, RPE and the turned axes."""
    records = []
    for system in systems:
        data = system.result.to_dict()
        for s in [*data["sequences"], {"name": POOLED} | data["pooled"]]:
            for length, part in [("all", s), *((f"{each['length_m']:g}", each) for each in s["by_length"])]:
                record = {"system": system.label, "sequence": s["name"], "length_m": length}
                record |= {key: part[key] for key in ("subsequences", *KINDS)}
                ate, rpe, axes = (part.get(key, {}) for key in ("ate", "rpe", "axes"))
                record["ate_rmse_m"] = ate.get("rmse_m")
                record["rpe_rmse_m"] = rpe.get("translation", {}).get("rmse_m")
                record["rpe_rmse_deg"] = rpe.get("rotation", {}).get("rmse_deg")
                record |= {key: axes.get(key) for key in ("pitch_deg", "yaw_deg")}
                records.append(record | {f"turned_{key}": axes.get(key) for key in KINDS})
    return records_csv(records)


def evaluation_tables(systems: list[System]) -> list[ReportTable]:
    """Errors by length, a few sequences to a table; over all lengths; ATE and RPE; with turned axes."""
    first = systems[0].result
    named = [(system.called(name), errors) for system in systems for name, errors in system.errors.items()]
    title = f"TE % / RE deg/100 m by length, a start every {first.step} frames"
    tables = []
    for start in range(0, len(named), SEQUENCES_A_TABLE):
        part = named[start : start + SEQUENCES_A_TABLE]
        rows = [
            [f"{at:g} m", *(te_re(errors.by_length([at])[at]) for _, errors in part)] for at in first.lengths
        ]
        tables.append(ReportTable(title, ["length", *(name for name, _ in part)], rows, []))
    everything, others, turned = [], [], []
    for system in systems:
        for s in system.result.sequences:
            name, drift = system.called(s.name), (s.rpe.translation, np.degrees(s.rpe.rotation))
            everything.append([name, str(s.frames), str(len(s.kitti)), te_re(s.kitti)])
            for kind, errors in zip(("ATE m", "RPE m", "RPE deg"), (s.ate.distance, *drift), strict=True):
                others.append([f"{name} {kind}", *(number(x, 4) for x in statistics(errors).values())])
            if s.turned is not None:
                angles = f"{s.turned.pitch:+.2f}", f"{s.turned.yaw:+.2f}"
                turned.append([name, *angles, te_re(s.kitti), te_re(s.turned.kitti)])
        pooled, mean = system.result.pooled, system.result.mean()
        everything.append([system.called("pooled, as the devkit"), "", str(len(pooled)), te_re(pooled)])
        means = " / ".join(number(mean[kind]) for kind in KINDS)
        everything.append([system.called("plain mean"), "", "", means])
    columns = ["sequence", "frames", "sub-sequences", "TE / RE"]
    tables.append(ReportTable("All lengths", columns, everything, []))
    note = f"ATE {first.sequences[0].ate.alignment.words}; RPE from frame to frame, which needs no alignment."
    tables.append(ReportTable("ATE and RPE", ["sequence", *STATISTICS], others, [note]))
    if turned:
        columns = ["sequence", "pitch °", "yaw °", "TE / RE\nmeasured", "TE / RE\nturned"]
        note = "The angles that make TE smallest: a look at the truth, not KITTI's measure."
        tables.append(ReportTable("Axes turned by one pitch and yaw", columns, turned, [note]))
    return tables


def write_pictures(folder: Path, systems: list[System], report: Progress) -> None:
    """Of each sequence three pictures, of each and of all together the error curves.

    trajectory: the paths, aligned as ATE has them, with the distance along them; coloured: these paths,
    coloured by that distance; components: position and angles over time, from the first pose.
    The systems of a sequence have the same truth.
    """
    results = systems[0].result.sequences
    for place, sequence in enumerate(results):
        report(place, len(results))
        truth, alignment = systems[0].pairs[place][0], sequence.ate.alignment
        estimates = {s.label or ONLY: s.pairs[place][1] for s in systems}
        # The first camera's axes: seen from above whatever the world's axes are.
        to_start = np.linalg.inv(truth[0])
        paths = {name: to_start @ align(truth, path, alignment)[0] for name, path in estimates.items()}
        words = {s.label or ONLY: _in_words(s, place) for s in systems}
        title = f"{sequence.name}\n{alignment.words}"
        times = systems[0].times.get(sequence.name)
        moved = components_figure(f"{sequence.name}\nfrom the first pose", {TRUTH: truth} | estimates, times)
        figures = {
            "trajectory": trajectories_figure({title: (truth, paths)}, words),
            "coloured": coloured_paths_figure(title, truth, paths),
            "components": moved,
        }
        for name, figure in figures.items():
            write_figure(folder, f"{name}_{slug(sequence.name)}", figure)
    for name in systems[0].errors:
        curves = {
            by: {s.label or ONLY: s.errors[name].curve(by, s.result.lengths) for s in systems} for by in AXES
        }
        write_curves(folder, slug(name), name, curves)
    report(len(results), len(results))


def _in_words(system: System, place: int) -> str:
    """A legend's entry: KITTI's percentages beside the aligned path."""
    sequence = system.result.sequences[place]
    te, re, ate = (number(x, 2) for x in (sequence.kitti.te, sequence.kitti.re, rmse(sequence.ate.distance)))
    return f"{system.label or ONLY}: TE {te} %, RE {re} deg/100 m, ATE {ate} m"
