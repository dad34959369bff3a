"""Chapter 1: measured results of variant `kit` with its own front end, and with the paper's in its place."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from vo_lib.evaluation.statistics import one_run_shows

from ..notebook_folder import NOTEBOOKS

ABLATION = NOTEBOOKS / "ablation.csv"  # written by `vo data measure_ablation`
METHOD = "feature_selection"
UNCHANGED = ""  # in the column "idea": variant `kit` as it is
PAPERS = "front end (turned off: the paper's)"  # with the paper's front end in place of the kit's
REAL = "kitti/"
ERRORS = ("te", "re", "lost")  # columns of the table
TIMED_FRAMES = 40  # the times in the file are those of the first frames of one drive
SHOWN = "*"  # behind an error with the paper's front end that one run would show to be another


@dataclass(frozen=True)
class FrontEnds:
    """Means over the seeds on a drive: with the kit's front end, and their change with the paper's.

    Attributes
    ----------
    drive : name of a sequence, or of a sequence and its disturbance, such as "kitti/00: dark".
    kit, change : TE, %; RE, deg/100 m; number of frames without a motion.
    kit_deviation, deviation : standard deviations over the seeds, of `kit` and of `change`. seeds : their number.
    """

    drive: str
    kit: tuple[float, ...]
    kit_deviation: tuple[float, ...]
    change: tuple[float, ...]
    deviation: tuple[float, ...]
    seeds: int

    @property
    def paper(self) -> tuple[float, ...]:
        """The means with the paper's front end."""
        return tuple(own + more for own, more in zip(self.kit, self.change, strict=True))

    @property
    def disturbed(self) -> bool:
        """Whether the images of the drive are disturbed."""
        return ": " in self.drive

    def shows(self, number: int) -> bool:
        """Whether one run would show the change of an error of `ERRORS`.

        The file lacks the standard deviation with the paper's front end. The error is the sum of the kit's and
        of the change, so it scatters at most as much as both together; this bound is used.
        """
        own = self.kit_deviation[number]
        most = own + self.deviation[number]
        return bool(one_run_shows(self.kit[number], own, self.paper[number], most))


@dataclass(frozen=True)
class Times:
    """Processor time per frame, milliseconds, on the first `TIMED_FRAMES` frames of a drive."""

    drive: str
    kit: float
    paper: float


def _rows(path: Path) -> dict[tuple[str, str], dict[str, str]]:
    """The rows of the method on real drives, by idea and drive."""
    rows: dict[tuple[str, str], dict[str, str]] = {}
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["method"] == METHOD and row["sequence"].startswith(REAL) and row["te"]:
                rows[row["idea"], row["sequence"]] = row
    return rows


def front_ends(path: Path = ABLATION) -> list[FrontEnds]:
    """The comparison of the front ends on every real drive, clean drives first."""
    rows = _rows(path)
    compared = []
    for drive in [drive for idea, drive in rows if idea == PAPERS]:
        whole = rows[UNCHANGED, drive]
        changed = rows[PAPERS, drive]
        compared.append(
            FrontEnds(
                drive,
                _numbers(whole),
                _numbers(whole, "_sd"),
                _numbers(changed),
                _numbers(changed, "_sd"),
                int(changed["seeds"]),
            )
        )
    return sorted(compared, key=lambda each: each.disturbed)


def _numbers(row: dict[str, str], suffix: str = "") -> tuple[float, ...]:
    return tuple(float(row[name + suffix]) for name in ERRORS)


def times(path: Path = ABLATION) -> Times:
    """The times with both front ends; they were measured on one drive alone, in runs of their own."""
    rows = _rows(path)
    drive = next(drive for (idea, drive), row in rows.items() if idea == PAPERS and row["ms"])
    kit = float(rows[UNCHANGED, drive]["ms"])
    return Times(drive, kit, kit + float(rows[PAPERS, drive]["ms"]))


def front_end_lines(path: Path = ABLATION) -> str:
    """A line for each drive: TE, RE and lost frames with both front ends; after ± the deviation of the change."""
    compared = front_ends(path)
    lines = [
        f"{'':24}      TE [%]             RE [deg/100 m]      lost frames",
        f"{'':24}   kit paper's    ±       kit paper's    ±      kit paper's",
    ]
    for each in compared:
        line = f"{each.drive:24}"
        for error in (0, 1):
            star = SHOWN if each.shows(error) else ""
            line += f"{each.kit[error]:6.2f}{each.paper[error]:8.2f}{star:1}{each.deviation[error]:5.2f}   "
        lines.append(f"{line}{each.kit[2]:6.1f}{each.paper[2]:8.1f}")
    seeds = min(each.seeds for each in compared)
    measured = times(path)
    lines += [
        f"Means over {seeds} seeds; ±: standard deviation of the difference over the seeds.",
        f"{SHOWN}: one run would show the difference. It exceeds 2 %, and two standard deviations of the",
        "difference between two runs with different seeds, which is larger than ±.",
        f"Processor time, in runs of their own on the first {TIMED_FRAMES} frames of {measured.drive}:",
        f"{measured.kit:.1f} ms a frame with the kit's front end, {measured.paper:.1f} ms with the paper's.",
    ]
    return "\n".join(lines)
