"""Numbers that the README quotes are those of `notebooks/results.md`, which a script writes."""

from __future__ import annotations

import re
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
    for quoted, exact in zip(README[row][column].split(" / "), pair, strict=True):
        decimals = len(quoted.partition(".")[2])
        assert abs(float(quoted) - float(exact)) <= 0.5 * 10**-decimals + 1e-9


def test_the_readme_quotes_what_is_left_without_the_axes() -> None:
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    quoted = re.search(f"the kit's TE is ({NUMBER}) on 00 and ({NUMBER}) on 01", text)
    assert quoted is not None
    for clip, number in zip(("00, 100 m", "01, 20 m"), quoted.groups(), strict=True):
        exact = re.findall(NUMBER, RESULTS[-1][f"kitti/{clip}, solution_selection"]["learnt, axes"])[0]
        assert abs(float(number) - float(exact)) <= 0.005 + 1e-9
