"""Chapter 1: measured results of variant `kit` with its own front end, and with the paper's in its place."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

ABLATION = Path(__file__).parents[2] / "ablation.csv"  # written by `vo data measure_ablation`
METHOD = "feature_selection"
PAPERS = "front end (turned off: the paper's)"
REAL = "kitti/"


@dataclass(frozen=True)
class FrontEnds:
    """Means over the seeds on a drive: with the kit's front end, and their change with the paper's.

    Attributes
    ----------
    drive : name of a sequence, or of a sequence and its disturbance, such as "kitti/00: dark".
    kit, change : TE, %; RE, deg/100 m; distance of the end from the truth, metres; frames without a motion.
    """

    drive: str
    kit: tuple[float, ...]
    change: tuple[float, ...]

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
    rows: dict[tuple[str, str], tuple[float, ...]] = {}
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["method"] == METHOD and row["sequence"].startswith(REAL) and row["end"]:
                numbers = (float(row[name]) for name in ("te", "re", "end", "lost"))
                rows[row["idea"], row["sequence"]] = tuple(numbers)
    drives = [drive for idea, drive in rows if idea == PAPERS]
    compared = [FrontEnds(drive, rows["", drive], rows[PAPERS, drive]) for drive in drives]
    return sorted(compared, key=lambda each: each.disturbed)


def saved_ms(path: Path = ABLATION) -> float:
    """Processor time that the kit's front end saves per frame, milliseconds."""
    with path.open(encoding="utf-8", newline="") as lines:
        times = [float(row["ms"]) for row in csv.DictReader(lines) if row["idea"] == PAPERS and row["ms"]]
    return sum(times) / len(times)


def front_end_lines(path: Path = ABLATION) -> str:
    """A line for each drive: TE, RE, end of the path and lost frames with both front ends."""
    head = f"{'':24}    TE [%]      RE [deg/100 m]    end [m]     lost frames"
    lines = [head, f"{'':24}  kit  paper's   kit  paper's   kit  paper's  kit  paper's"]
    for each in front_ends(path):
        numbers = [f"{own:7.2f}{other:7.2f}" for own, other in zip(each.kit[:3], each.paper[:3], strict=True)]
        lost = f"{each.kit[3]:7.1f}{each.paper[3]:7.1f}"
        lines.append(f"{each.drive:24}{' '.join([*numbers, lost])}")
    lines.append(f"The kit's front end takes {saved_ms(path):.1f} ms less per frame.")
    return "\n".join(lines)
