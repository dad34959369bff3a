"""The paper's Table 1 as a data file, and the averages of its numbers."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from course.ch07.figures import printed_gains
from vo_lib.config import METHODS
from vo_lib.data.poses import read_kitti_poses
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.report.table1 import (
    AVERAGE,
    BENCHMARK_COUNTS,
    CLAIMS,
    PAPER_METHODS,
    PAPER_ROWS,
    SUB_SEQUENCES,
    read_paper_table,
)

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
PRINTED, TRUTH = DATA / "paper_table1.csv", DATA / "kitti_poses"


def test_table_has_88_printed_numbers() -> None:
    table = read_paper_table()
    printed = [
        number for row in PAPER_ROWS for method in PAPER_METHODS for number in table.value(row, method)
    ]
    assert len(printed) == 88
    assert all(isinstance(number, float) for number in printed)
    assert table.value("01", "viso2") == (None, None)
    assert table.value(AVERAGE, "viso2") == (2.43, 1.106)
    assert table.value("07", "mesvo_f") == (1.20, 0.850)
    assert table.value("10", "feature_selection") == (0.79, 0.300)
    assert set(PAPER_METHODS) <= set(METHODS)


@pytest.mark.skipif(not PRINTED.exists(), reason="the paper's table is not in ../shared/data")
def test_table_equals_the_shared_copy() -> None:
    lines = [line for line in PRINTED.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    table = read_paper_table()
    for row in csv.DictReader(lines):
        for method in PAPER_METHODS:
            expected = float(row[f"{method}_te"]), float(row[f"{method}_re"])
            assert table.value(row["sequence"], method) == expected, (row["sequence"], method)


def test_printed_gains_depend_on_the_weights() -> None:
    (average, rows, pooled), over_mesvo = (printed_gains(read_paper_table(), m) for m in CLAIMS)
    # Averages 0.86 → 0.79 and 0.296 → 0.276: the paper's 8 % and 7 %.
    assert average == pytest.approx((100 * (1 - 0.79 / 0.86), 100 * (1 - 0.276 / 0.296)))
    assert over_mesvo[0] == pytest.approx((100 * (1 - 0.79 / 0.84), 100 * (1 - 0.276 / 0.326)))
    assert rows[0] == pytest.approx(100 * (1 - 7.84 / 8.58))  # sums of the ten rows
    assert pooled[0] < average[0]  # long sequences gain less


@pytest.mark.skipif(not TRUTH.is_dir(), reason="the truth of KITTI is not in ../shared/data")
def test_weights_are_the_numbers_of_sub_sequences() -> None:
    for row in ("01", *SUB_SEQUENCES):
        truth = read_kitti_poses(TRUTH / f"{row}.txt")
        assert len(kitti_errors(truth, truth)) == BENCHMARK_COUNTS[f"kitti/{row}"], row
