"""Numbers in the README and in the course's pages equal the measured numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from vo_lib.report.table1 import AVERAGE, read_paper_table

ROOT = Path(__file__).resolve().parents[1]
NUMBER = r"\d+(?:\.\d+)?"


def tables(path: Path) -> list[dict[str, dict[str, str]]]:
    """The tables of a page: cells by row and column."""
    result: list[list[list[str]]] = [[]]
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("|"):
            result[-1].append([cell.strip() for cell in line.strip("|").split(" | ")])
        elif result[-1]:
            result.append([])
    return [
        {row[0].strip(): dict(zip(table[0], row, strict=False)) for row in table[2:]}
        for table in result
        if table
    ]


README, MEASURED = tables(ROOT / "README.md")[0], tables(ROOT / "notebooks" / "real_traffic.md")
ROWS = dict(zip(README, ("kitti/drive_0013, 50 m, axes removed", "synthetic/jam, 50 m"), strict=True))


def require_rounded(quoted: Iterable[str], exact: Iterable[float | str]) -> None:
    """Require that each number in a text equals the exact number after rounding."""
    for text, number in zip(quoted, exact, strict=True):
        decimals = len(text.partition(".")[2])
        assert abs(float(text) - float(number)) <= 0.5 * 10**-decimals + 1e-9


@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("method", ["solution_selection", "feature_selection"])
def test_readme_quotes_the_claim_as_measured(row: str, method: str) -> None:
    exact = [table[ROWS[row]][method] for table in MEASURED[:2]]  # TE and RE of variant `published`
    require_rounded(README[row][f"`{method}`"].split(" / "), exact)


def test_readme_quotes_the_change_that_one_run_would_show_on_the_real_drive() -> None:
    page = pages("real_traffic.md")
    published = page[page.index("Variant published") : page.index("Variant kit")]
    lowered = re.search(r"lowers RE on (.*?)\. RE is", published)
    assert lowered is not None
    assert re.findall(r"kitti/drive_0013, (\d+ m)", lowered[1]) == ["20 m"]  # over 50 m one run would not
    assert "kitti" not in published[: published.index("lowers RE on")].partition("lowers TE on")[2]
    quoted = re.search(
        rf"over 20 m, one run would show the change of RE \(({NUMBER}) → ({NUMBER})\)", readme()
    )
    assert quoted is not None
    row = MEASURED[1]["kitti/drive_0013, 20 m, axes removed"]
    require_rounded(quoted.groups(), [row["solution_selection"], row["feature_selection"]])


def test_readme_quotes_the_paper_and_viso2() -> None:
    text = readme()
    papers = re.findall(rf"from ({NUMBER}) to ({NUMBER}) (?:%|deg/100 m)", text)
    value = read_paper_table().value
    assert [*map(tuple, zip(*papers, strict=True))] == [
        tuple(f"{number:{form}}" for number, form in zip(value(AVERAGE, method), (".2f", ".3f"), strict=True))
        for method in ("solution_selection", "feature_selection")
    ]
    viso2 = re.search(rf"`viso2` has a lower TE \(({NUMBER})\)", text)
    assert viso2 is not None
    require_rounded(viso2.groups(), [MEASURED[0][next(iter(ROWS.values()))]["viso2"]])


def readme() -> str:
    return " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())


def choices() -> list[dict[str, str]]:
    with (ROOT / "notebooks" / "choices.csv").open(encoding="utf-8", newline="") as lines:
        return [*csv.DictReader(lines)]


def pages(name: str) -> str:
    return " ".join((ROOT / "notebooks" / name).read_text(encoding="utf-8").split())


def test_choice_of_rows_in_pixels_is_quoted_as_measured() -> None:
    rows = {(row["sequence"], row["alternative"]): row for row in choices()}

    def number(sequence: str, column: str, alternative: str = "") -> float:
        return float(rows[sequence, alternative][column])

    plain, longer = (number("kitti/01", "length", each) for each in ("", "metres"))
    worse = {
        sequence: 100 * number(sequence, "te", "metres") / number(sequence, "te")
        for sequence in ("kitti/01", "synthetic/jam")
    }
    says = f"the steps of the clip of 01 are {plain + longer:.1f} % too long instead of {plain:.1f} %, and "
    says += f"TE is {worse['kitti/01']:.0f} % larger on this clip and {worse['synthetic/jam']:.0f} % larger "
    assert f"{says}on the drawn `jam`; RE is nearly the same." in pages("paper_and_code.md")
    change = [row["re"] for (_, alternative), row in rows.items() if alternative == "metres"]
    assert max(abs(float(number or 0.0)) for number in change) < 0.1


def test_run_sheets_have_ninety_minutes() -> None:
    sheets = re.split(r"\n### \[", (ROOT / "notebooks" / "teaching.md").read_text(encoding="utf-8"))[1:]
    assert len(sheets) == len(list((ROOT / "notebooks").glob("0*.ipynb")))
    for chapter, sheet in enumerate(sheets):
        classes = sheet.split("\n## ")[0].split("\n| min |")[1:]
        tables = [re.findall(r"^\| (\d+) \| (.*?) \|", each, re.MULTILINE) for each in classes]
        for table in tables:
            assert sum(int(minutes) for minutes, _ in table) == 90, chapter
        rows = [row for table in tables for row in table]
        notebook = next((ROOT / "notebooks").glob(f"0{chapter}_*.ipynb")).read_text(encoding="utf-8")
        named = [number for _, section in rows for number in re.findall(r"\d\.[1-9]\d*", section)]
        assert named
        for number in named:
            assert f"### Exercise {number} " in notebook, number
