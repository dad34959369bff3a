"""The paper's Table 1 as a data file: read as printed, and a copy completed by a person is checked."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib.config import METHODS
from vo_lib.core.errors import DataError
from vo_lib.tables.paper import AVERAGE, PAPER_METHODS, PAPER_ROWS, read_paper_table, shipped_table


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = shipped_table().read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = tmp_path / "table.csv"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_the_shipped_table_has_the_papers_rows_and_columns_and_its_viso2_average() -> None:
    table = read_paper_table()
    assert set(table.te) == set(table.re) == {(row, method) for row in PAPER_ROWS for method in PAPER_METHODS}
    assert table.value(AVERAGE, "viso2") == (2.43, 1.106)
    assert set(PAPER_METHODS) <= set(METHODS)
    assert "01" not in PAPER_ROWS


def test_numbers_that_are_not_there_are_none_and_counted() -> None:
    table = read_paper_table()
    assert table.value("01", "viso2") == (None, None)
    assert table.value("00", "moving_selection") == (None, None)
    known = sum(v is not None for v in (*table.te.values(), *table.re.values()))
    assert table.missing == 88 - known


def test_a_completed_copy_is_read(tmp_path: Path) -> None:
    table = read_paper_table(changed(tmp_path, "\n07,,,,,,,,", "\n07, 1.5, 2.25 ,,,,,0.9,"))
    assert table.value("07", "viso2") == (1.5, 2.25)
    assert table.value("07", "feature_selection") == (0.9, None)
    assert table.missing == read_paper_table().missing - 3


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("\n07,,,", "\n7,,,", "line 11: '7': expected each of"),
        ("\n07,,,", "\n06,,,", "line 11: '06'"),
        ("\n07,,,", "\n07,,", "line 11: 8 cells, expected 9"),
        ("\n07,,,", "\n07,a,,", "line 11: 'a': expected a number"),
        ("\n07,,,", "\n07,-1,,", "line 11: '-1'"),
        ("\n07,,,", "\n07,nan,,", "line 11: 'nan'"),
        ("sequence,viso2_te", "sequence,te", "line 4: expected the heading"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(DataError) as caught:
        read_paper_table(changed(tmp_path, old, new))
    assert words in str(caught.value)


def test_a_missing_or_empty_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="missing"):
        read_paper_table(tmp_path / "nowhere.csv")
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    with pytest.raises(DataError, match="heading"):
        read_paper_table(tmp_path / "empty.csv")
