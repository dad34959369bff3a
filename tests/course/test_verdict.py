"""The verdicts of chapter 7 have the level that they claim, in the right unit."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course.ch07 import verdict
from course.ch07.verdict import (
    BY_CHOICES,
    DIFFERENT,
    NOT_REPRODUCED,
    REPRODUCED,
    Ours,
    choice_ranges,
    converted,
    gain_over_sequences,
    judge,
    judged_cells,
    printed_column,
    read_report,
    summary,
    verdict_tables,
)
from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import prediction_half_width
from vo_lib.report.record import RECORD
from vo_lib.report.table1 import BENCHMARK_FRAMES, ERROR_KINDS, PAPER_METHODS, SUB_SEQUENCES, read_paper_table

PAPER = read_paper_table()
RULE = prediction_half_width


@pytest.mark.parametrize("seeds", [3, 5, 10])
def test_one_more_run_of_the_same_method_is_inside_in_95_per_cent(seeds: int) -> None:
    rng = np.random.default_rng(seeds)
    runs = rng.normal(size=(40_000, seeds + 1))
    mean = runs[:, :-1].mean(axis=1)
    deviation = runs[:, :-1].std(axis=1, ddof=1)
    inside = np.abs(runs[:, -1] - mean) <= RULE(1.0, seeds) * deviation
    assert inside.mean() == pytest.approx(0.95, abs=0.01)


def report(folder: Path, factor: float, seeds: int = 5, spread: float = 0.01, unit: bool = True) -> None:
    """A record of ten whole sequences whose runs scatter round `factor` times the paper's numbers."""
    rng = np.random.default_rng(0)
    rows = []
    for row, method in itertools.product(SUB_SEQUENCES, PAPER_METHODS):
        errors: dict[str, Any] = {}
        for place, kind in enumerate(ERROR_KINDS):
            printed = PAPER.value(row, method)[place]
            assert printed is not None
            true = factor * (converted(printed, method, kind) if unit else printed)
            errors[kind] = (true * (1 + spread * rng.normal(size=seeds))).tolist()
        rows.append(
            {
                "variant": "published",
                "settings": "",
                "sequence": f"kitti/{row}",
                "method": method,
                "whole": True,
                "removed_share": 0.1,
                **errors,
            }
        )
    (folder / RECORD).write_text(json.dumps({"rows": rows}), encoding="utf-8")


def outcomes(folder: Path) -> list[str]:
    cells = judged_cells(folder, PAPER, {})
    return [cell.outcome for of_kind in cells.values() for cell in of_kind if cell.row != "Avg"]


def test_a_report_equal_to_the_paper_is_reproduced_and_one_that_is_a_tenth_off_is_not(tmp_path: Path) -> None:
    report(tmp_path, 1.0)
    equal = outcomes(tmp_path)
    assert len(equal) == 80
    assert equal.count(REPRODUCED) >= 0.95 * len(equal)
    for factor in (0.9, 1.1):
        report(tmp_path, factor)
        assert outcomes(tmp_path).count(REPRODUCED) == 0


def test_re_of_the_papers_own_columns_is_converted_and_both_numbers_are_shown(tmp_path: Path) -> None:
    assert converted(1.0, "mesvo_f", "re_deg_per_100m") == pytest.approx(1.0313, abs=1e-4)
    assert converted(1.0, "viso2", "re_deg_per_100m") == 1.0
    assert converted(1.0, "mesvo_f", "te_percent") == 1.0
    report(tmp_path, 1.0, spread=0.002, unit=False)
    cells = judged_cells(tmp_path, PAPER, {})["re_deg_per_100m"]
    own = [cell.outcome for cell in cells if cell.method != "viso2" and cell.row != "Avg"]
    assert own.count(DIFFERENT) == len(own)
    table = verdict_tables({"re_deg_per_100m": cells})[0]
    shown = dict(zip(table.columns, next(row for row in table.rows if row[0] == "00 MESVO_F"), strict=True))
    assert (shown["printed"], shown["in the right unit"]) == ("0.339", "0.350")


def test_the_allowed_difference_is_that_of_one_more_run_and_half_a_digit() -> None:
    ours = Ours(True, True, 5, 1.04, 0.01)
    cell = judge(1.02, "viso2", "te_percent", "04", ours)
    assert cell.allowed == pytest.approx(2.776 * 0.01 * np.sqrt(1.2) + 0.005, abs=1e-5)
    assert cell.outcome == REPRODUCED
    assert judge(1.00, "viso2", "te_percent", "04", ours).outcome == DIFFERENT


def test_re_allows_for_the_six_decimals_of_the_devkit() -> None:
    rng = np.random.default_rng(0)
    inside = 0
    runs = 4000
    for _ in range(runs):
        errors = 0.128 * (1 + 0.003 * rng.normal(size=6))  # deg/100 m; the last is the paper's
        steps = np.round(errors[-1] / verdict.RIGHT_FACTOR / 1e-6)
        printed = round(steps * 1e-6 * verdict.PAPERS_FACTOR, 3)
        ours = Ours(True, True, 5, float(errors[:5].mean()), float(errors[:5].std(ddof=1)))
        cell = judge(printed, "feature_selection", "re_deg_per_100m", "04", ours)
        inside += cell.outcome == REPRODUCED
    assert inside >= 0.95 * runs


def test_the_third_outcome_needs_choices_that_were_measured_on_the_whole_sequence(tmp_path: Path) -> None:
    ours = Ours(True, True, 5, 1.0, 0.01)
    inside = judge(1.2, "feature_selection", "te_percent", "04", ours, (0.8, 1.25))
    assert inside.outcome == BY_CHOICES
    assert judge(1.5, "feature_selection", "te_percent", "04", ours, (0.8, 1.25)).outcome == NOT_REPRODUCED
    assert judge(1.2, "feature_selection", "te_percent", "04", ours).outcome == DIFFERENT
    path = tmp_path / "choices.csv"
    head = "choice,alternative,sequence,te,te_sd,re,re_sd,length,length_sd,frames\n"
    whole = BENCHMARK_FRAMES["kitti/04"]
    rows = "as published,,kitti/04,0.70,0.01,0.2,0.01,0,0,{0}\n"
    rows += "largest depth,20 m,kitti/04,-0.2,0.01,0.1,0,0,0,{0}\n"
    path.write_text(head + rows.format(whole), encoding="utf-8")
    assert choice_ranges(path)["04", "te_percent"] == pytest.approx((0.5, 0.7))
    path.write_text(head + rows.format(51), encoding="utf-8")
    assert choice_ranges(path) == {}
    assert choice_ranges() == {}  # the readings were measured on clips


@pytest.mark.parametrize(
    ("ours", "words"),
    [
        (Ours(False, True, 5, 0.64, 0.01), "part of the sequence"),
        (Ours(True, True, 2, 0.64, 0.01), "fewer than 3 seeds"),
        (Ours(True, False, 5, 0.64, 0.01), "no boxes"),
        (Ours(True, True, 5, float("nan"), float("nan")), "a seed without errors"),
    ],
)
def test_some_numbers_get_no_verdict(ours: Ours, words: str) -> None:
    cell = judge(0.64, "feature_selection", "te_percent", "04", ours)
    assert cell.outcome == f"no verdict: {words}"
    assert "0 of 0" in summary([cell])


def test_a_table_without_a_record_is_judged_by_its_means(tmp_path: Path) -> None:
    assert read_report(tmp_path) == {}
    assert verdict_tables(judged_cells(tmp_path, PAPER, {})) == []
    names = "variant,sequence,method,seeds,paper_te_percent,paper_re_deg_per_100m,te_percent,te_percent_std,"
    names += "re_deg_per_100m,re_deg_per_100m_std,removed_share"
    rows = [
        "published,kitti/04,viso2,5,1.02,0.866,1.04,0.01,0.9,0.01,0",
        "published,kitti/04,mesvo_f,1,0.75,0.222,0.75,,0.222,,0",
        "published,kitti/00,viso2,5,,,2.46,0.01,1.181,0.01,0",
        "published,kitti/04,feature_selection,5,0.64,0.128,0.64,0.01,0.128,0.01,0.0",
        "kit,kitti/04,feature_selection,5,0.64,0.128,0.64,0.01,0.128,0.01,0.1",
    ]
    (tmp_path / "table1.csv").write_text("\n".join([names, *rows]) + "\n", encoding="utf-8")
    cells = judged_cells(tmp_path, PAPER, {})["te_percent"]
    found = {(cell.row, cell.method): cell.outcome for cell in cells}
    assert found == {
        ("04", "viso2"): REPRODUCED,
        ("04", "mesvo_f"): "no verdict: fewer than 3 seeds",
        ("00", "viso2"): "no verdict: part of the sequence",
        ("04", "feature_selection"): "no verdict: no boxes",
    }


def test_the_average_is_made_seed_by_seed_from_ten_whole_sequences(tmp_path: Path) -> None:
    report(tmp_path, 1.0, spread=0.0)
    averages = read_report(tmp_path)["Avg", "feature_selection", "te_percent"]
    printed = [PAPER.value(row, "feature_selection")[0] for row in SUB_SEQUENCES]
    assert averages.mean == pytest.approx(np.mean(np.array(printed, float)))
    record = json.loads((tmp_path / RECORD).read_text(encoding="utf-8"))
    record["rows"] = [row for row in record["rows"] if row["sequence"] != "kitti/10"]
    (tmp_path / RECORD).write_text(json.dumps(record), encoding="utf-8")
    assert ("Avg", "feature_selection", "te_percent") not in read_report(tmp_path)


def test_the_printed_average_of_viso2_contradicts_its_rows_and_gets_no_verdict() -> None:
    cell = judge(2.43, "viso2", "te_percent", "Avg", Ours(True, True, 5, 2.10, 0.01))
    assert cell.outcome == "no verdict: the printed average is not the mean of its rows"


@pytest.mark.parametrize("text", ["", "variant,sequence\npublished,00,1\n", "a\nb\n"])
def test_a_damaged_table_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "table1.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r"table1\.csv"):
        read_report(tmp_path)


@pytest.mark.parametrize("text", ["[]", "{}", '{"rows": [{"variant": "published"}]}', "{", '{"rows": 3}'])
def test_a_damaged_record_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / RECORD).write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r"reproduction\.json"):
        read_report(tmp_path)


def test_the_summary_tells_how_many_differences_chance_alone_would_make(tmp_path: Path) -> None:
    report(tmp_path, 1.1)
    cells = judged_cells(tmp_path, PAPER, {})["te_percent"]
    number = len([cell for cell in cells if not cell.outcome.startswith("no verdict")])
    assert number == len(cells) - 1  # the average of VISO2
    assert f"Outside the seeds: {number} of {number}" in summary(cells)
    assert f"about {round(0.05 * number, 3):.1f} would be" in summary(cells)


def test_the_gain_over_sequences_has_interval_sign_flips_and_leave_one_out() -> None:
    before = printed_column(PAPER, "solution_selection", "te_percent")
    after = printed_column(PAPER, "feature_selection", "te_percent")
    gain = gain_over_sequences(before, after)
    assert gain.interval.mean == pytest.approx(-0.074)
    assert (gain.interval.low, gain.interval.high) == pytest.approx((-0.186, 0.038), abs=1e-3)
    assert gain.share == pytest.approx(0.078, abs=1e-3)
    assert gain.without[-1] == pytest.approx(-0.027, abs=1e-3)
    assert gain.words == "another set of sequences could show no gain"
    clear = gain_over_sequences(before, {name: value - 0.1 for name, value in before.items()})
    assert clear.words == "the mean change over sequences is hardly chance"
    with pytest.raises(DataError, match="two sequences or more"):
        gain_over_sequences({"00": 1.0}, after)
