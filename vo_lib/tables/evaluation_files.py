"""What `vo evaluate` leaves behind: numbers as JSON and CSV, pictures of paths and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import csv_text
from ..core.types import Array, Progress
from ..evaluation.ate_rpe import align
from ..evaluation.axes import TurnedErrors
from ..evaluation.kitti import Evaluation, KittiErrors
from .error_plots import coloured_paths_figure, components_figure
from .plots import TRUTH, trajectories_figure
from .report import number
from .reproduce import slug
from .table_files import AXES, write_curves, write_figure

HEADING = ["system", "sequence", "length_m", "subsequences", "te_percent", "re_deg_per_100m"]
HEADING += ["ate_rmse_m", "rpe_rmse_m", "rpe_rmse_deg", "pitch_deg", "yaw_deg", "te_turned", "re_turned"]
POOLED = "pooled"
ONLY = "estimate"


@dataclass(frozen=True)
class System:
    """The estimates of one system, judged.

    Attributes
    ----------
    label : its name; empty where it is the only one.
    pairs : truth and estimate of each sequence, (N, 4, 4) each, as `result` has them.
    turned : of each sequence, with axes turned; empty where that was not asked for.
    times : (N,) seconds of the poses of each sequence by name, where the files have them.
    """

    label: str
    pairs: list[tuple[Array, Array]]
    result: Evaluation
    turned: list[TurnedErrors]
    times: Mapping[str, Array]

    @property
    def errors(self) -> dict[str, KittiErrors]:
        """Of each sequence by name and, of several, pooled."""
        parts = {s.name: s.kitti for s in self.result.sequences}
        return parts | ({POOLED: self.result.pooled} if len(parts) > 1 else {})

    def to_dict(self) -> dict[str, Any]:
        """Everything but the single sub-sequences, for JSON."""
        data = self.result.to_dict()
        for sequence, errors in zip(data["sequences"], self.turned, strict=False):
            sequence["axes"] = errors.to_dict()
        return data


def as_json(systems: list[System]) -> dict[str, Any]:
    """One system's numbers, or those of several under their labels."""
    if len(systems) == 1:
        return systems[0].to_dict()
    return {"systems": [{"system": system.label} | system.to_dict() for system in systems]}


def as_csv(systems: list[System]) -> str:
    """A row for each system, sequence and length; over all lengths with ATE, RPE and the turned axes."""
    rows = [HEADING]

    def write(label: str, name: str, length: str, errors: dict[str, Any], *more: float | None) -> None:
        te, re = errors["te_percent"], errors["re_deg_per_100m"]
        numbers = ["" if value is None else f"{value:.6f}" for value in (te, re, *more)]
        row = [label, name, length, str(errors["subsequences"]), *numbers]
        rows.append(row + [""] * (len(HEADING) - len(row)))

    for system in systems:
        data = system.to_dict()
        for s in [*data["sequences"], {"name": POOLED} | data["pooled"]]:
            more: list[float | None] = []
            if "ate" in s:
                rpe = s["rpe"]
                more = [s["ate"]["rmse_m"], rpe["translation"]["rmse_m"], rpe["rotation"]["rmse_deg"]]
            if "axes" in s:
                keys = ("pitch_deg", "yaw_deg", "te_percent", "re_deg_per_100m")
                more += [s["axes"][key] for key in keys]
            write(system.label, s["name"], "all", s, *more)
            for part in s["by_length"]:
                write(system.label, s["name"], f"{part['length_m']:g}", part)
    return csv_text(rows)


def write_pictures(folder: Path, systems: list[System], progress: Progress | None = None) -> None:
    """Of each sequence three pictures, of each and of all together the error curves.

    trajectory: the paths, aligned as ATE has them, with the distance along them; coloured: these paths,
    coloured by that distance; components: position and angles over time, from the first pose.
    The systems of a sequence have the same truth.
    """
    results = systems[0].result.sequences
    for place, sequence in enumerate(results):
        if progress is not None:
            progress(place, len(results))
        truth = systems[0].pairs[place][0]
        alignment = sequence.ate.alignment
        # The first camera's axes: seen from above whatever the world's axes are.
        to_start = np.linalg.inv(truth[0])
        paths = {s.label or ONLY: to_start @ align(*s.pairs[place], alignment)[0] for s in systems}
        words = {s.label or ONLY: _in_words(s, place) for s in systems}
        title = f"{sequence.name}\n{alignment.words}"
        figures = {
            "trajectory": trajectories_figure({title: (truth, paths)}, words),
            "coloured": coloured_paths_figure(title, truth, paths),
            "components": components_figure(
                f"{sequence.name}\nfrom the first pose",
                {TRUTH: truth} | {s.label or ONLY: s.pairs[place][1] for s in systems},
                systems[0].times.get(sequence.name),
            ),
        }
        for name, figure in figures.items():
            write_figure(folder, f"{name}_{slug(sequence.name)}", figure)
    for name in systems[0].errors:
        curves = {
            by: {s.label or ONLY: s.errors[name].curve(by, s.result.lengths) for s in systems} for by in AXES
        }
        write_curves(folder, slug(name), name, curves)
    if progress is not None:
        progress(len(results), len(results))


def _in_words(system: System, place: int) -> str:
    """A legend's entry: KITTI's percentages beside the aligned path."""
    sequence = system.result.sequences[place]
    te, re = number(sequence.kitti.te, 2), number(sequence.kitti.re, 2)
    ate = number(sequence.ate.to_dict()["rmse_m"], 2)
    return f"{system.label or ONLY}: TE {te} %, RE {re} deg/100 m, ATE {ate} m"
