"""Tables and sentences in a terminal of 80 columns: what never breaks, and where the rest does."""

from __future__ import annotations

import os
import random
import re

import pytest
from terminal import shown_in_terminal

from vo_lib.commands.table_layout import fitting_parts
from vo_lib.report.breaking import broken, glued

WIDTH = 80
NUMBER = "11.602 ± 0.117"
SETTINGS = ("selection.threshold", "translation.agreement", "calibration.estimate", "filter.classes")
WORDS = ["car", "truck", "bus", "motorcycle", "bicycle", "autorickshaw"]


def squeezed(cells: list[str]) -> str:
    """The letters of cells, without blanks and breaks."""
    return re.sub(r"\s", "", "".join(cells))


def random_table(seed: int) -> tuple[list[str], list[list[str]], int]:
    """Headings, rows and the number of columns with names: long names, long settings, many numbers."""
    rng = random.Random(seed)
    names = rng.randint(1, 4)
    numbers = rng.randint(1, 8)
    kinds = ["TE %", "RE deg/100 m", "removed", "back-end ms", "sub-seqs", "end apart m"]
    columns = [*rng.sample(SETTINGS, names), *(rng.choice(kinds) for _ in range(numbers))]
    rows = []
    for _ in range(rng.randint(1, 5)):
        of_row = []
        for _ in range(names):
            long = ",".join(rng.choice(WORDS) for _ in range(rng.randint(1, 9)))
            of_row.append(rng.choice([long, "0.25", "0.5 (not used)", "an_imported_name_" + "x" * 23]))
        rows.append([*of_row, *(rng.choice([NUMBER, "33.1", "–", "12 (few)"]) for _ in range(numbers))])
    return columns, rows, names


@pytest.mark.parametrize("seed", range(60))
def test_tables_fit_and_keep_numbers_and_headings_whole(seed: int) -> None:
    columns, rows, names = random_table(seed)
    parts = fitting_parts(columns, rows, WIDTH, len, names)
    for part in parts:
        assert part.width(len) <= WIDTH
        for cells in (part.columns, *part.rows):
            for cell in cells:
                assert "±" not in cell or NUMBER in cell
        for heading in part.columns[part.name_columns :]:
            assert " ".join(heading.split("\n")) in columns
        if part.name_columns == names:
            assert part.columns[:names] == columns[:names]  # no heading of a setting is broken
    # Each number of the table is in one of its parts.
    for place, row in enumerate(rows):
        shown = [cell.replace("\n", " ") for part in parts for cell in part.rows[place][part.name_columns :]]
        assert shown == row[names:]
        for part in parts:
            of_names = squeezed(part.rows[place][: part.name_columns])
            assert all(squeezed([name]) in of_names for name in row[:names])


def test_a_wide_table_is_split_and_a_narrow_one_is_not() -> None:
    columns = ["method", *["TE %"] * 12]
    parts = fitting_parts(columns, [["mesvo_f", *[NUMBER] * 12]], WIDTH, len)
    assert [len(part.columns) for part in parts] == [5, 5, 5]
    (whole,) = fitting_parts(columns[:4], [["mesvo_f", *[NUMBER] * 3]], WIDTH, len)
    assert whole.rows == [["mesvo_f", NUMBER, NUMBER, NUMBER]]


def test_names_of_several_settings_share_a_column_before_the_table_is_split() -> None:
    columns = ["selection.threshold", "translation.agreement", "TE %", "RE deg/100 m", "removed"]
    (part,) = fitting_parts(columns, [["0.25", "1.0", NUMBER, NUMBER, "12.3 %"]], WIDTH, len, name_columns=2)
    assert part.columns[0] == "settings"
    assert part.rows[0][0] == "selection.threshold=0.25\ntranslation.agreement=1.0"


WRONG_LINES = [
    "run nowhere/at/all --out out --detector yolov8n.onnx --selection.threshold many",
    "reproduce --sequences 00 --set selection.threshold=0.25,0.5,1,many --methods mesvo_f",
    "sweep --sequences 00,01 --methods mesvo_f --set selection.sets=1 --set selection.threshold=1",
    "evaluate --nothing such --as this",
    "data get_detector no_such_detector",
    "check_all_of_this please",
]
# One process for all lines: the start of Python takes longer than the errors.
PRINT_ERRORS = """
import shlex, sys
from vo_lib.commands.cli import main
for line in sys.argv[1:]:
    try:
        code = main(shlex.split(line))
    except SystemExit as end:  # of an option that does not exist
        code = end.code
    print(f"exit code {code}")
"""


@pytest.mark.parametrize("columns", [60, 80, 132])
@pytest.mark.skipif(os.name != "posix", reason="a terminal of POSIX")
def test_errors_are_wrapped_in_a_terminal(columns: int) -> None:
    shown = shown_in_terminal(WRONG_LINES, columns, PRINT_ERRORS)
    *errors, rest = "\n".join(shown).split("exit code 2")
    assert (len(errors), rest) == (len(WRONG_LINES), "")
    for error in errors:
        first, *more = error.strip("\n").splitlines()
        assert re.match(r"(vo|[\w ]+): error: ", first)
        assert max(map(len, (first, *more))) <= columns
        assert all(re.match(r"  \S", each) for each in more)
        assert more or columns > len(first)


def test_what_is_read_as_one_is_not_broken() -> None:
    for whole in (
        "11.602 ± 0.117",
        "deg/100 m",
        "`vo data get_detector NAME`",
        "vo data get_detector yolox-tiny",
    ):
        lines = broken(glued(f"{'word ' * 12}{whole} and more"), 70).split("\n")
        assert any(whole in line for line in lines)
