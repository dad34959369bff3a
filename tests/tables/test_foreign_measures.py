"""Only whole sequences of the benchmark, measured as the benchmark does it, stand beside the paper's."""

from __future__ import annotations

import numpy as np
import pytest
from made_entries import entry_of, table_of_twos

from vo_lib.data.kitti import EXPECTED_FRAMES
from vo_lib.evaluation.kitti import KITTI_LENGTHS, KITTI_MEASURE, KITTI_STEP, SHORT_MEASURE, Measure
from vo_lib.tables.entries import Entry, Group, group_entries
from vo_lib.tables.paper import AVERAGE, PAPER_METHODS, PAPER_ROWS
from vo_lib.tables.table1 import layout_tables
from vo_lib.tables.table1_data import difference, is_papers, is_whole, table_records

SHORT = "04"  # the shortest sequence of the table
WHOLE = EXPECTED_FRAMES[SHORT]
NONE = "–"
FOREIGN = {
    "short lengths": SHORT_MEASURE,
    "half of the lengths": Measure(KITTI_LENGTHS[:4], KITTI_STEP),
    "one length": Measure((100.0,), KITTI_STEP),
    "from every frame": Measure(KITTI_LENGTHS, 1),
    "other lengths": Measure(tuple(length + 1.0 for length in KITTI_LENGTHS), KITTI_STEP),
}


def whole(name: str, measure: Measure = KITTI_MEASURE) -> Entry:
    return entry_of(f"kitti/{name}", EXPECTED_FRAMES[name], [1.0], measure=measure)


def gaps(group: Group) -> list[float | None]:
    """Our differences to the printed numbers of the rows that were run."""
    records = table_records([group], table_of_twos())
    names = ("te_percent_difference", "re_deg_per_100m_difference")
    return [record[name] for record in records for name in names]


def test_a_whole_sequence_measured_as_the_benchmark_does_is_compared() -> None:
    (group,) = group_entries([whole(SHORT)])
    te = 100 * 0.01  # % of the way; a sub-sequence may end a frame late
    assert gaps(group) == [pytest.approx(te - 2.0, abs=0.02), pytest.approx(-2.0, abs=1e-3)]


@pytest.mark.parametrize("foreign", FOREIGN)
def test_a_whole_sequence_under_another_measure_is_not(foreign: str) -> None:
    one = whole(SHORT, FOREIGN[foreign])
    assert np.isfinite(one.te).all()  # there is a number, which is not the paper's kind
    assert not is_whole(one)
    (group,) = group_entries([one])
    assert set(gaps(group)) == {None}
    (table,) = layout_tables(group, table_of_twos())
    assert not any("\n" in cell for row in table.rows for cell in row)
    assert any("Not the benchmark's sub-sequences" in line for line in table.head)


@pytest.mark.parametrize(
    ("name", "frames"),
    [(f"kitti/{SHORT}", WHOLE - 1), (f"kitti/{SHORT}", WHOLE - 100), ("kitti/07", WHOLE), (SHORT, WHOLE)],
)
def test_a_part_another_sequence_or_a_folder_of_ones_own_is_not(name: str, frames: int) -> None:
    part = entry_of(name, frames, [1.0], measure=KITTI_MEASURE)
    assert np.isfinite(part.te).all()
    assert not is_whole(part)
    (group,) = group_entries([part])
    assert set(gaps(group)) == {None}


def test_another_measure_of_any_one_row_takes_the_average_away() -> None:
    names = PAPER_ROWS[1:]
    entries = [whole(name) for name in names]
    assert is_papers(*group_entries(entries))
    # All of them under a foreign measure, and all but one under the benchmark's.
    foreign = [whole(name, FOREIGN["one length"]) for name in names]
    for given in (foreign, [*entries[:-1], foreign[-1]]):
        for group in group_entries(given):
            assert not is_papers(group)
            rows = {row[0]: row[1:] for row in layout_tables(group, table_of_twos())[0].rows}
            assert {cell.split("\n")[0] for cell in rows.get(AVERAGE, [NONE])} == {NONE}
            assert not any(
                "\n" in cell for name, row in rows.items() if name not in PAPER_ROWS for cell in row
            )


def test_all_88_printed_numbers_stand_there_and_differences_of_whole_runs_alone() -> None:
    own = entry_of(f"kitti/{SHORT}", WHOLE, [1.0], "moving_selection")
    (group,) = group_entries([whole(SHORT), entry_of("kitti/07", 300, [1.0]), own])
    table, apart = layout_tables(group, table_of_twos())
    assert [row[0] for row in apart.rows] == ["mean of 2", SHORT, "pooled"]
    rows = {row[0]: row[1:] for row in table.rows}
    cells = [cell.split("\n") for name in PAPER_ROWS for cell in rows[name]]
    assert len(cells) == 2 * len(PAPER_METHODS) * len(PAPER_ROWS) == 88
    assert all(cell[1] in ("2.00", "2.000") for cell in cells)
    assert sum(cell[0] != NONE for cell in cells) == 4
    assert [len(cell.split("\n")) for cell in (*rows[SHORT][:2], *rows["07"][:2])] == [3, 3, 2, 2]
    assert sum(len(cell) == 3 for cell in cells) == 2


def test_a_difference_needs_both_numbers() -> None:
    ours = np.array([1.0, 2.0])
    assert difference(ours, 1.2) == pytest.approx(0.3)
    assert difference(ours, None) is None
    assert difference(np.array([1.0, np.nan]), 1.2) is None
    assert difference(np.zeros(0), 1.2) is None
