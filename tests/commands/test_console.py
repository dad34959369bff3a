"""Tables in a terminal: names and headings may be broken, numbers never."""

from __future__ import annotations

import pytest

from vo_lib.commands.console import show_report_table
from vo_lib.tables.report import ReportTable


@pytest.mark.parametrize("width", ["60", "80", "200"])
def test_no_number_and_no_word_is_broken(
    width: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", width)
    numbers = ["151.234", "0.123", "12.345", "98.765", "1234.5"]
    note = "Errors over sub-sequences of every length that the path holds, from every frame; no more words."
    names = ["a run", *(f"error {unit} a frame" for unit in ("m", "mm", "deg", "%", "ms"))]
    table = ReportTable(
        "A title that is longer than sixty characters as titles of tables are", names, [], [note]
    )
    table.rows.append(["a_long_name_of_a_method_without_a_gap, published, seed 4", *numbers])
    show_report_table(table)
    printed = capsys.readouterr().out
    assert all(number in printed for number in numbers)
    assert note.split() == printed.split("┘")[1].split()
    assert max(map(len, printed.splitlines())) <= int(width)
