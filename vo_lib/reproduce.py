"""Tables of methods over sequences and seeds: mean and spread of the KITTI errors."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config import preset
from .errors import DataError
from .evaluation import suitable_errors
from .runner import run_methods
from .sequence import Progress, Sequence

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MethodErrors:
    """Errors of one method on one sequence over S seeds.

    Attributes
    ----------
    te, re : (S,) translation error, %, and rotation error, deg/100 m; NaN where no sub-sequence fits.
    removed_share : share of the matches that boxes removed, in [0, 1].
    ms_per_frame : mean time of a frame, milliseconds, one seed alone.
    """

    te: Array
    re: Array
    removed_share: float
    ms_per_frame: float


def parse_sequences(text: str) -> list[str]:
    """Names or paths of "00,02-10,synthetic/jam,some/folder"; numbers mean KITTI sequences."""
    names: list[str] = []
    for item in text.split(","):
        numbers = re.fullmatch(r"(\d\d)(?:-(\d\d))?", item)
        if numbers is None:
            names.append(item)
            continue
        first, last = int(numbers[1]), int(numbers[2] or numbers[1])
        if last < first:
            raise DataError(f"--sequences {item}: expected a range that rises")
        names += [f"kitti/{number:02d}" for number in range(first, last + 1)]
    if not all(names):
        raise DataError(f"--sequences {text!r}: expected names separated by commas")
    return names


def compare_methods(
    sequence: Sequence, methods: list[str], seeds: int, progress: Progress | None = None
) -> tuple[dict[str, MethodErrors], str]:
    """Every method with seeds 0 … seeds - 1 on the same matches of a sequence with truth.

    Returns
    -------
    Errors by method, and the sub-sequence lengths in words.
    """
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth: nothing to compare")
    configs = {f"{name}/{seed}": preset(name, seed=seed) for name in methods for seed in range(seeds)}
    runs = run_methods(sequence, configs, progress)
    table, words = {}, ""
    for name in methods:
        mine = [runs[f"{name}/{seed}"] for seed in range(seeds)]
        errors = []
        for result in mine:
            found, words = suitable_errors(sequence.truth, result.poses)
            errors.append(found)
        table[name] = MethodErrors(
            te=np.array([np.nan if e.te is None else e.te for e in errors]),
            re=np.array([np.nan if e.re is None else e.re for e in errors]),
            removed_share=mine[0].removed_share,
            ms_per_frame=float(np.mean([result.ms_per_frame for result in mine])),
        )
    return table, words


COLUMNS = ["method", "TE %", "RE deg/100 m", "removed", "ms a frame"]


def table_rows(errors: dict[str, MethodErrors]) -> list[list[str]]:
    """A row for each method in the order of COLUMNS: mean ± standard deviation over seeds."""
    rows = []
    for method, e in errors.items():
        numbers = [f"{a.mean():.3f} ± {a.std():.3f}" if np.isfinite(a).all() else "–" for a in (e.te, e.re)]
        rows.append([method, *numbers, f"{100 * e.removed_share:.1f} %", f"{e.ms_per_frame:.0f}"])
    return rows


def markdown(columns: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
