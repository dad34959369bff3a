"""Chapter 1: measured results of variant `kit` with its own front end, and with the paper's in its place."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

ABLATION = Path(__file__).parents[2] / "ablation.csv"  # written by `vo data measure_ablation`
METHOD = "feature_selection"
UNCHANGED = ""  # in the column "idea": variant `kit` as it is
PAPERS = "front end (turned off: the paper's)"  # with the paper's front end in place of the kit's
REAL = "kitti/"
SEEDS = 5  # fewest seeds with which the course calls a difference more than chance
ERRORS = ("te", "re", "lost")  # columns of the table


@dataclass(frozen=True)
class FrontEnds:
    """Means over the seeds on a drive: with the kit's front end, and their change with the paper's.

    Attributes
    ----------
    drive : name of a sequence, or of a sequence and its disturbance, such as "kitti/00: dark".
    kit, change : TE, %; RE, deg/100 m; number of frames without a motion.
    deviation : standard deviations of the changes over the seeds. seeds : their number.
    """

    drive: str
    kit: tuple[float, ...]
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


def front_ends(path: Path = ABLATION) -> list[FrontEnds]:
    """The comparison of the front ends on every real drive, clean drives first."""
    rows: dict[tuple[str, str], dict[str, str]] = {}  # by idea and drive
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["method"] == METHOD and row["sequence"].startswith(REAL) and row["te"]:
                rows[row["idea"], row["sequence"]] = row
    drives = [drive for idea, drive in rows if idea == PAPERS]
    compared = []
    for drive in drives:
        changed = rows[PAPERS, drive]
        compared.append(
            FrontEnds(
                drive,
                kit=_numbers(rows[UNCHANGED, drive]),
                change=_numbers(changed),
                deviation=_numbers(changed, "_sd"),
                seeds=int(changed["seeds"]),
            )
        )
    return sorted(compared, key=lambda each: each.disturbed)


def _numbers(row: dict[str, str], suffix: str = "") -> tuple[float, ...]:
    """The errors of a row, or the columns with a suffix that belong to them."""
    return tuple(float(row[name + suffix]) for name in ERRORS)


def saved_ms(path: Path = ABLATION) -> float:
    """Processor time that the kit's front end saves per frame, milliseconds."""
    with path.open(encoding="utf-8", newline="") as lines:
        times = [float(row["ms"]) for row in csv.DictReader(lines) if row["idea"] == PAPERS and row["ms"]]
    return sum(times) / len(times)


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
            line += f"{each.kit[error]:6.2f}{each.paper[error]:8.2f}{each.deviation[error]:6.2f}   "
        lines.append(f"{line}{each.kit[2]:6.1f}{each.paper[2]:8.1f}")
    seeds = min(each.seeds for each in compared)
    lines.append(f"Means over {seeds} seeds; ±: standard deviation of the difference over the seeds.")
    if seeds < SEEDS:
        lines.append(f"A difference of TE or RE would need {SEEDS} seeds to count; here are {seeds}.")
    lines.append(f"In these runs the kit's front end took {saved_ms(path):.1f} ms less per frame.")
    return "\n".join(lines)
