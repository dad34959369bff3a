"""Numbers in the README and the course's pages are those that scripts have written."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NUMBER = r"\d+(?:\.\d+)?"


def tables(path: Path) -> list[dict[str, dict[str, str]]]:
    """The tables of a page: cells by row and column."""
    found: list[list[list[str]]] = [[]]
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("|"):
            found[-1].append([cell.strip() for cell in line.strip("|").split(" | ")])
        elif found[-1]:
            found.append([])
    return [
        {row[0].strip(): dict(zip(table[0], row, strict=False)) for row in table[2:]}
        for table in found
        if table
    ]


README, RESULTS = tables(ROOT / "README.md")[0], tables(ROOT / "notebooks" / "results.md")
QUOTED = [
    (row, column) for row, cells in README.items() for column in list(cells)[1:] if cells[column] != "–"
]


def require_rounded(quoted: Iterable[str], exact: Iterable[float | str]) -> None:
    """Each number as quoted is the exact one, rounded to its digits."""
    for text, number in zip(quoted, exact, strict=True):
        decimals = len(text.partition(".")[2])
        assert abs(float(text) - float(number)) <= 0.5 * 10**-decimals + 1e-9


@pytest.mark.parametrize(("row", "column"), QUOTED)
def test_the_readme_quotes_the_results(row: str, column: str) -> None:
    name = re.sub("drawn `(.*)`", r"synthetic/\1", row.replace("KITTI ", "kitti/"))
    variant, _, method = column.partition(", ")
    if method:
        measured = RESULTS[("published", "kit").index(variant)][name][method.strip("`")]
    else:
        measured = RESULTS[-1][f"{name}, solution_selection"][variant]
    # TE and RE, each with its deviation behind it.
    pair = [re.findall(NUMBER, part)[0] for part in measured.split("<br>")[0].split(" / ")]
    require_rounded(README[row][column].split(" / "), pair)


def test_the_readme_quotes_what_is_left_without_the_axes() -> None:
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    quoted = re.search(f"the kit's TE is ({NUMBER}) on 00 and ({NUMBER}) on 01", text)
    assert quoted is not None
    rows = [RESULTS[-1][f"kitti/{clip}, solution_selection"] for clip in ("00, 100 m", "01, 20 m")]
    require_rounded(quoted.groups(), [re.findall(NUMBER, row["learnt, axes"])[0] for row in rows])


def pages(name: str) -> str:
    return " ".join((ROOT / "notebooks" / name).read_text(encoding="utf-8").split())


def test_the_choice_of_rows_in_pixels_quotes_what_was_measured() -> None:
    with (ROOT / "notebooks" / "choices.csv").open(encoding="utf-8", newline="") as lines:
        rows = {(row["sequence"], row["alternative"]): row for row in csv.DictReader(lines)}

    def number(sequence: str, column: str, alternative: str = "") -> float:
        return float(rows[sequence, alternative][column])

    plain, longer = (number("kitti/01", "length", each) for each in ("", "metres"))
    worse = {
        sequence: 100 * number(sequence, "te", "metres") / number(sequence, "te")
        for sequence in ("kitti/01", "synthetic/jam")
    }
    says = f"the steps of the clip of 01 are {plain + longer:.1f} % too long and not {plain:.1f}, its TE is "
    says += f"{worse['kitti/01']:.0f} % larger, and that of the drawn `jam` {worse['synthetic/jam']:.0f} %"
    assert f"{says}, with the same RE." in pages("paper_and_code.md")
    assert {row["re"] for (_, alternative), row in rows.items() if alternative == "metres"} <= {"0.0000", ""}


def test_each_run_sheet_has_ninety_minutes_and_exercises_that_there_are() -> None:
    sheets = re.split(r"\n### \[", (ROOT / "notebooks" / "teaching.md").read_text(encoding="utf-8"))[1:]
    assert len(sheets) == len(list((ROOT / "notebooks").glob("0*.ipynb")))
    for chapter, sheet in enumerate(sheets):
        rows = re.findall(r"^\| (\d+) \| (.*?) \|", sheet.split("\n## ")[0], re.MULTILINE)
        assert sum(int(minutes) for minutes, _ in rows) == 90, chapter
        notebook = next((ROOT / "notebooks").glob(f"0{chapter}_*.ipynb")).read_text(encoding="utf-8")
        named = [number for _, section in rows for number in re.findall(r"\d\.\d", section)]
        assert named
        for number in named:
            assert f"### Exercise {number} " in notebook, number
