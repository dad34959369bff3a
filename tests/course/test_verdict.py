"""The verdicts of chapter 7 have the level that they claim, in the right unit."""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record_rows import record_row

from course.ch07 import verdict
from course.ch07.claimed_gain import gain_over_sequences, our_column, printed_column, why_no_gain
from course.ch07.our_errors import Ours, open_report, read_report
from course.ch07.verdict import (
    BY_CHOICES,
    CLOSE,
    DIFFERENT,
    NOT_REPRODUCED,
    REPRODUCED,
    SCATTERED,
    chance_alone,
    choice_ranges,
    judge,
    judge_all,
    summary,
    verdict_tables,
)
from course.intervals import prediction_half_width
from vo_lib.errors import DataError
from vo_lib.report.paper_unit import PAPERS_FACTOR, RIGHT_FACTOR, converted
from vo_lib.report.record import FORMAT, RECORD
from vo_lib.report.table1 import (
    BENCHMARK_COUNTS,
    BENCHMARK_FRAMES,
    ERROR_KINDS,
    PAPER_METHODS,
    SUB_SEQUENCES,
    read_paper_table,
)

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


def write_record(folder: Path, rows: list[Any], **fields: Any) -> None:
    (folder / RECORD).write_text(json.dumps({"format": FORMAT, "rows": rows} | fields), encoding="utf-8")


def report(
    folder: Path,
    factor: float,
    seeds: int = 5,
    spread: float = 0.01,
    unit: bool = True,
    seed: int = 0,
    kinds: tuple[str, ...] = tuple(ERROR_KINDS),
) -> None:
    """A record of ten whole sequences whose runs scatter round `factor` times the paper's numbers."""
    rng = np.random.default_rng(seed)
    rows = []
    for row, method in itertools.product(SUB_SEQUENCES, PAPER_METHODS):
        errors: dict[str, Any] = {}
        for place, kind in enumerate(ERROR_KINDS):
            printed = PAPER.value(row, method)[place]
            assert printed is not None
            true = factor * (converted(printed, method, kind) if unit else printed)
            scatter = spread if kind in kinds else 0.01
            errors[kind] = np.abs(true * (1 + scatter * rng.normal(size=seeds))).tolist()
        rows.append(record_row(row, method, seeds, **errors))
    write_record(folder, rows)


def outcomes(folder: Path) -> list[str]:
    cells = judge_all(read_report(folder), PAPER, {})
    return [cell.outcome for of_kind in cells.values() for cell in of_kind if cell.row != "Avg"]


@pytest.mark.parametrize("seed", range(5))
def test_a_report_is_reproduced_at_the_papers_errors_and_not_a_tenth_off(tmp_path: Path, seed: int) -> None:
    report(tmp_path, 1.0, seed=seed)
    equal = outcomes(tmp_path)
    assert len(equal) == 80
    assert equal.count(REPRODUCED) >= 0.95 * len(equal)
    for factor in (0.9, 1.1):
        report(tmp_path, factor, seed=seed)
        assert outcomes(tmp_path).count(REPRODUCED) == 0


@pytest.mark.parametrize("spread", [0.08, 0.2, 0.5])
@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_runs_that_scatter_widely_reproduce_nothing(tmp_path: Path, spread: float, factor: float) -> None:
    report(tmp_path, factor, spread=spread)
    found = outcomes(tmp_path)
    assert found.count(REPRODUCED) <= 0.05 * len(found)
    assert found.count(SCATTERED) > 0.6 * len(found)
    table = verdict_tables(judge_all(read_report(tmp_path), PAPER, {}))[0]
    shares = [row[table.columns.index("allowed / printed")] for row in table.rows]
    outcome = table.columns.index("verdict")
    for row, share in zip(table.rows, shares, strict=True):
        assert share.endswith(" %") != row[outcome].startswith("no verdict")
    assert f"{SCATTERED}: " in table.head[0] or f"{SCATTERED}: " in table.notes[0]


@pytest.mark.parametrize("seeds", [3, 5, 10, 30])
@pytest.mark.parametrize("spread", [0.005, 0.01, 0.02, 0.03, 0.05, 0.1])
def test_a_method_that_is_a_tenth_off_is_rarely_reproduced(seeds: int, spread: float) -> None:
    rng = np.random.default_rng(0)
    count = 1500
    wrong = 0
    close = 0
    for runs in 1.1 * (1 + spread * rng.normal(size=(count, seeds + 1))):
        # The paper's method has an error of 1.00, so its run is a tenth below ours.
        printed = round(float(runs[-1]) / 1.1, 2)
        deviation = float(runs[:-1].std(ddof=1))
        ours = Ours(True, True, seeds, float(runs[:-1].mean()), deviation)
        outcome = judge(printed, "viso2", "te_percent", "04", ours).outcome
        wrong += outcome == REPRODUCED
        close += outcome == CLOSE
    assert wrong + close <= 0.04 * count  # 2.5 %, and the chance of the simulation


# "one case in eight with three seeds, nearly one in five with five"
@pytest.mark.parametrize(("seeds", "least", "most"), [(3, 0.10, 0.16), (5, 0.15, 0.25)])
def test_wrong_verdicts_are_rare_only_if_the_paper_scatters_as_we_do(
    seeds: int, least: float, most: float
) -> None:
    rng = np.random.default_rng(0)
    count = 4000
    wrong = 0
    for _ in range(count):
        values = 1.1 * (1 + 0.01 * rng.normal(size=seeds))
        printed = float(1 + 0.03 * rng.normal())  # the paper's runs scatter three times as much
        ours = Ours(True, True, seeds, float(values.mean()), float(values.std(ddof=1)))
        wrong += judge(printed, "viso2", "te_percent", "04", ours).outcome in (REPRODUCED, CLOSE)
    assert least < wrong / count < most


def test_wide_scatter_does_not_widen_the_range_of_the_open_choices() -> None:
    ours = Ours(True, True, 5, 2.0, 0.3)  # allows for 0.91
    cell = judge(0.9, "feature_selection", "te_percent", "04", ours, (1.6, 2.0))
    assert cell.outcome == NOT_REPRODUCED
    assert judge(1.02, "feature_selection", "te_percent", "04", ours, (1.1, 2.0)).outcome == BY_CHOICES


def test_re_of_the_paper_is_shown_as_printed_and_converted(tmp_path: Path) -> None:
    assert converted(1.0, "mesvo_f", "re_deg_per_100m") == pytest.approx(1.0313, abs=1e-4)
    assert converted(1.0, "viso2", "re_deg_per_100m") == 1.0
    assert converted(1.0, "mesvo_f", "te_percent") == 1.0
    report(tmp_path, 1.0, spread=0.002, unit=False)
    cells = judge_all(read_report(tmp_path), PAPER, {})["re_deg_per_100m"]
    own = [cell.outcome for cell in cells if cell.method != "viso2" and cell.row != "Avg"]
    assert own.count(CLOSE) == len(own)  # the factor is 3 %, found and named, but not 10 %
    table = verdict_tables({"re_deg_per_100m": cells})[0]
    shown = dict(zip(table.columns, next(row for row in table.rows if row[0] == "00 MESVO_F"), strict=True))
    assert (shown["printed"], shown["in the right unit"]) == ("0.339", "0.350")


def test_the_allowed_difference_is_that_of_one_more_run_and_half_a_digit() -> None:
    ours = Ours(True, True, 5, 1.04, 0.01)
    cell = judge(1.02, "viso2", "te_percent", "04", ours)
    assert cell.allowed == pytest.approx(2.776 * 0.01 * np.sqrt(1.2) + 0.005, abs=1e-5)
    assert cell.outcome == REPRODUCED
    assert judge(1.00, "viso2", "te_percent", "04", ours).outcome == CLOSE
    assert judge(0.90, "viso2", "te_percent", "04", ours).outcome == DIFFERENT


@pytest.mark.parametrize("choices", [None, (1.5, 2.0), (0.9, 1.1)])
@pytest.mark.parametrize("deviation", [0.0, 0.002, 0.004, 0.006])
@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_difference_of_three_percent_is_close_however_little_runs_scatter(
    factor: float, deviation: float, choices: tuple[float, float] | None
) -> None:
    ours = Ours(True, True, 5, factor, deviation)
    cell = judge(1.0, "feature_selection", "te_percent", "04", ours, choices)
    assert cell.outcome == CLOSE
    assert cell.difference_share == pytest.approx(factor - 1.0)
    wider = Ours(True, True, 5, factor, 0.012)
    assert judge(1.0, "feature_selection", "te_percent", "04", wider, choices).outcome == REPRODUCED
    table = verdict_tables({"te_percent": [cell]})[0]
    shown = dict(zip(table.columns, table.rows[0], strict=True))
    assert shown["difference / printed"] == ("+3.0 %" if factor > 1 else "−3.0 %")


def test_the_chapter_says_what_each_verdict_means() -> None:
    chapter = Path(verdict.__file__).parents[2] / "07_reproduce_the_paper.ipynb"
    cells = json.loads(chapter.read_text(encoding="utf-8"))["cells"]
    beside_the_table = next("".join(cell["source"]) for cell in cells if cell["id"] == "coverage-read")
    lines = beside_the_table.splitlines()
    named = [line.split("|")[1].strip() for line in lines if line.startswith("| ")]
    for outcome in (*verdict.INSIDE, *verdict.OUTSIDE, "no verdict"):
        assert named.count(outcome) == 1


def test_a_difference_that_may_reach_a_tenth_is_not_called_close() -> None:
    for mean, deviation in ((1.08, 0.01), (0.92, 0.01), (1.1, 0.0), (1.2, 0.001)):
        cell = judge(1.0, "feature_selection", "te_percent", "04", Ours(True, True, 5, mean, deviation))
        assert cell.outcome == DIFFERENT


def test_re_allows_for_the_six_decimals_of_the_devkit() -> None:
    rng = np.random.default_rng(0)
    inside = 0
    runs = 4000
    for _ in range(runs):
        errors = 0.128 * (1 + 0.003 * rng.normal(size=6))  # deg/100 m; the last is the paper's
        steps = np.round(errors[-1] / RIGHT_FACTOR / 1e-6)
        printed = round(steps * 1e-6 * PAPERS_FACTOR, 3)
        ours = Ours(True, True, 5, float(errors[:5].mean()), float(errors[:5].std(ddof=1)))
        cell = judge(printed, "feature_selection", "re_deg_per_100m", "04", ours)
        inside += cell.outcome == REPRODUCED
    assert inside >= 0.95 * runs


def test_the_verdict_by_choices_needs_choices_measured_on_the_whole_sequence(tmp_path: Path) -> None:
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
    assert "none of these numbers can be compared" in summary([cell])
    assert "0 of 0" not in summary([cell])


def test_a_table_without_a_record_is_judged_by_its_means(tmp_path: Path) -> None:
    assert read_report(tmp_path) == {}
    assert verdict_tables(judge_all(read_report(tmp_path), PAPER, {})) == []
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
    cells = judge_all(read_report(tmp_path), PAPER, {})["te_percent"]
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
    rows = [row for row in record["rows"] if row["sequence"] != "kitti/10"]
    write_record(tmp_path, rows)
    assert ("Avg", "feature_selection", "te_percent") not in read_report(tmp_path)
    # One sequence has its seeds in another order, and one more.
    methods = [row["method"] for row in record["rows"][:4]]
    other = [record_row("10", method) for method in methods]
    for row in other:
        row["seeds"] = [7, 4, 3, 2, 1, 0]
        row["te_percent"] = [99.0, 4.0, 3.0, 2.0, 1.0, 0.0]
        row["re_deg_per_100m"] = [0.3] * 6
    write_record(tmp_path, rows + other)
    averages = read_report(tmp_path)["Avg", "feature_selection", "te_percent"]
    assert averages.seed_numbers == (0, 1, 2, 3, 4)
    assert averages.values is not None
    assert np.diff(averages.values) == pytest.approx(0.1)  # a tenth of a step of 10's own seeds


def test_the_contradictory_average_of_viso2_gets_no_verdict() -> None:
    cell = judge(2.43, "viso2", "te_percent", "Avg", Ours(True, True, 5, 2.10, 0.01))
    assert cell.outcome == "no verdict: the printed average is not the mean of its rows"


TABLE_HEAD = "variant,sequence,method,seeds,paper_te_percent,paper_re_deg_per_100m,te_percent,te_percent_std,"
TABLE_HEAD += "re_deg_per_100m,re_deg_per_100m_std,removed_share"
GOOD_LINE = "published,kitti/04,viso2,5,1.02,0.866,1.04,0.01,0.9,0.01,0"


@pytest.mark.parametrize(
    "line",
    [
        GOOD_LINE,  # twice
        GOOD_LINE.replace("/04", "/07").replace(",5,", ",0,"),
        GOOD_LINE.replace("/04", "/07").replace(",5,", ",5.5,"),
        GOOD_LINE.replace("/04", "/07").replace(",1.04,", ",inf,"),
        GOOD_LINE.replace("/04", "/07").replace(",1.04,", ",nan,"),
        GOOD_LINE.replace("/04", "/07").replace(",1.04,", ",-1.04,"),
        GOOD_LINE.replace("/04", "/07").replace(",1.04,0.01,", ",1.04,,"),  # five seeds without a deviation
        GOOD_LINE.replace("/04", "/07").replace(",1.04,", ",true,"),
    ],
)
def test_a_wrong_line_of_a_table_is_named(tmp_path: Path, line: str) -> None:
    (tmp_path / "table1.csv").write_text(f"{TABLE_HEAD}\n{GOOD_LINE}\n{line}\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"table1\.csv, line 3: ") as caught:
        read_report(tmp_path)
    assert open_report(tmp_path)[1] == [f"The report cannot be used: {caught.value}."]


@pytest.mark.parametrize("text", ["", "variant,sequence\npublished,00,1\n", "a\nb\n"])
def test_a_damaged_table_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "table1.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=r"table1\.csv"):
        read_report(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        '{"format": 1, "rows": [{"variant": "published"}]}',
        "{",
        '{"format": 1, "rows": 3}',
        '{"format": 1, "rows": {}}',
        '{"format": 1}',
        '{"format": 2, "rows": []}',
        '{"format": "1", "rows": []}',
        '{"format": true, "rows": []}',
        '{"rows": []}',
        '{"format": 1, "rows": [3]}',
    ],
)
def test_a_damaged_record_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / RECORD).write_text(text, encoding="utf-8")
    with pytest.raises(
        DataError, match=r"reproduction\.json(, line 1)?: .*expected .*vo reproduce"
    ) as caught:
        read_report(tmp_path)
    assert "\n" not in str(caught.value)
    assert open_report(tmp_path) == ({}, [f"The report cannot be used: {caught.value}."])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("seeds", [0, 0, 0, 0, 0]),
        ("seeds", [0, 1, 2, 3]),
        ("seeds", []),
        ("seeds", [0, 1, 2, 3, 4.0]),
        ("seeds", [0, 1, 2, 3, True]),
        ("seeds", [-1, 0, 1, 2, 3]),
        ("seeds", 5),
        ("te_percent", ["1.0"] * 5),
        ("te_percent", [True] * 5),
        ("te_percent", [1.0, 1.0, 1.0, 1.0]),
        ("te_percent", [1.0, 1.0, 1.0, 1.0, math.inf]),
        ("te_percent", [1.0, 1.0, 1.0, 1.0, math.nan]),
        ("te_percent", [1.0, 1.0, 1.0, 1.0, -0.1]),
        ("te_percent", [1.0, 1.0, 1.0, 1.0, 10**400]),
        ("te_percent", 1.0),
        ("re_deg_per_100m", [[1.0]] * 5),
        ("re_deg_per_100m", None),
        ("whole", "false"),
        ("whole", 1),
        ("whole", False),  # with all frames and the benchmark's measure
        ("frames", 200),
        ("frames", 271.0),
        ("frames", 0),
        ("sequence", "kitti/00"),
        ("sequence", "kitti/99"),
        ("sequence", 4),
        ("method", "feature_selektion"),
        ("method", None),
        ("variant", "publish"),
        ("settings", {}),
        ("removed_share", "0.1"),
        ("removed_share", 1.5),
        ("removed_share", None),
        ("removed_share", 0.3),  # of mesvo_f, which removes nothing
        ("sub_sequences", "20 m, every frame"),
        ("sub_sequences", "100, 200, … 800 m, every frame"),
        ("sub_sequences", 20),
        ("sub_sequence_count", 3),
        ("sub_sequence_count", 44),
        ("sub_sequence_count", 43.0),
        ("sub_sequence_count", -1),
    ],
)
def test_a_row_with_a_wrong_field_is_refused_in_one_line(tmp_path: Path, field: str, value: Any) -> None:
    good = record_row("07", "mesvo_f")
    write_record(tmp_path, [good, record_row("04", "mesvo_f")])
    assert len(read_report(tmp_path)) == 4
    write_record(tmp_path, [good, record_row("04", "mesvo_f") | {field: value}])
    with pytest.raises(DataError, match=r"reproduction\.json: row 2 .*expected .*repeat") as caught:
        read_report(tmp_path)
    assert "\n" not in str(caught.value)
    missing = record_row("04", "mesvo_f")
    del missing[field]
    write_record(tmp_path, [good, missing])
    with pytest.raises(DataError, match=rf"row 2 .*expected a field {field}, found none"):
        read_report(tmp_path)


@pytest.mark.parametrize(
    ("method", "settings", "share", "refused"),
    [
        ("viso2", "", 1e-9, True),
        ("solution_selection", "", 0.3, True),
        ("solution_selection", "selection.sets=20", 0.3, True),
        ("solution_selection", "filter.rule=all", 0.3, False),
        ("feature_selection", "", 0.3, False),
        ("feature_selection", "filter.rule=none", 0.3, True),
    ],
)
def test_a_method_without_removal_has_removed_nothing(
    tmp_path: Path, method: str, settings: str, share: float, refused: bool
) -> None:
    write_record(tmp_path, [record_row("04", method, settings=settings, removed_share=share)])
    if refused:
        with pytest.raises(DataError, match=f"expected 0, since {method} removes no feature, found"):
            read_report(tmp_path)
    else:
        read_report(tmp_path)


@pytest.mark.parametrize("row", ["01", *SUB_SEQUENCES])
def test_a_whole_row_has_the_benchmarks_sub_sequences(tmp_path: Path, row: str) -> None:
    write_record(tmp_path, [record_row(row, "mesvo_f")])
    assert len(read_report(tmp_path)) == 2
    count = BENCHMARK_COUNTS[f"kitti/{row}"]
    write_record(tmp_path, [record_row(row, "mesvo_f", sub_sequence_count=count - 1)])
    with pytest.raises(DataError, match=rf"expected sub_sequence_count {count}, .*found {count - 1}"):
        read_report(tmp_path)
    part = {"whole": False, "frames": 60, "sub_sequences": "20 m, every frame", "sub_sequence_count": 3}
    write_record(tmp_path, [record_row(row, "mesvo_f") | part])
    assert len(read_report(tmp_path)) == 2


def test_a_row_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    rows = [record_row("04", "mesvo_f"), record_row("07", "mesvo_f"), record_row("04", "mesvo_f")]
    write_record(tmp_path, rows)
    with pytest.raises(DataError, match=r"row 3 \(kitti/04, mesvo_f\): expected one row"):
        read_report(tmp_path)
    rows[2] |= {"settings": "selection.sets=20"}
    write_record(tmp_path, rows)
    assert len(read_report(tmp_path)) == 4


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (record_row("04", "mesvo_f", variant="kit"), "only rows of variant kit"),
        (
            record_row("04", "mesvo_f", settings="selection.sets=20"),
            r"changed settings \(selection.sets=20\)",
        ),
    ],
)
def test_a_report_that_cannot_be_compared_says_why(tmp_path: Path, row: dict[str, Any], words: str) -> None:
    write_record(tmp_path, [row])
    found, (sentence,) = open_report(tmp_path)
    assert found == {}
    assert re.search(words, sentence)
    assert "There is no report" not in sentence


def test_a_report_says_where_it_comes_from(tmp_path: Path) -> None:
    assert "There is no report" in open_report(tmp_path)[1][0]
    write_record(tmp_path, [])
    assert "has no row" in open_report(tmp_path)[1][0]
    rows = [record_row("04", "mesvo_f")]
    write_record(tmp_path, rows, date="2026-11-27", detector={"file": "yolox_tiny.onnx"})
    found, (sentence,) = open_report(tmp_path)
    assert len(found) == 2
    assert "2026-11-27" in sentence
    assert "Boxes: yolox_tiny.onnx; the paper trained a YOLOv8 of its own" in sentence
    write_record(tmp_path, [record_row("04", "mesvo_f", sequence="synthetic/jam", whole=False)])
    assert "no row of the printed table" in open_report(tmp_path)[1][1]


def test_the_summary_tells_how_many_differences_chance_alone_would_make(tmp_path: Path) -> None:
    report(tmp_path, 1.1, spread=0.002)
    cells = judge_all(read_report(tmp_path), PAPER, {})
    of_te = cells["te_percent"]
    assert len([cell for cell in of_te if cell.row == "Avg"]) == 4  # made of the same runs, so not counted
    assert "Outside the seeds: 40 of 40" in summary(of_te)
    said = chance_alone(itertools.chain(*cells.values()))
    assert "80 of 80 numbers are outside the seeds" in said
    assert "on average at most 4.0 outside (5 %)" in said
    assert said.count("or more would be surprising") == 1
    assert max(map(len, said.splitlines())) <= 125
    assert chance_alone([]) == ""


@pytest.mark.parametrize(
    ("kind", "spread"), [("te_percent", 0.01), ("re_deg_per_100m", 0.01), ("te_percent", 0.03)]
)
def test_the_simulated_number_of_false_alarms_is_that_of_many_records(kind: str, spread: float) -> None:
    # Other cells than those of the record, with the same true errors: how many are outside, on average?
    rng = np.random.default_rng(7)
    place = [*ERROR_KINDS].index(kind)
    cells = []
    outside = 0
    records = 60
    for number in range(records):
        for row, method in itertools.product(SUB_SEQUENCES, PAPER_METHODS):
            printed = PAPER.value(row, method)[place]
            assert printed is not None
            true = converted(printed, method, kind)
            runs = true * (1 + spread * rng.normal(size=6))
            ours = Ours(True, True, 5, float(runs[:5].mean()), float(runs[:5].std(ddof=1)))
            if number == 0:
                cells.append(judge(printed, method, kind, row, ours))
            factor = converted(1.0, method, kind)
            steps = np.round(runs[5] / RIGHT_FACTOR / 1e-6) * 1e-6 * RIGHT_FACTOR
            last = steps if factor != 1.0 else runs[5]
            shown = round(float(last) / factor, ERROR_KINDS[kind][1])
            outside += judge(shown, method, kind, row, ours).outcome in verdict.OUTSIDE
    counts = verdict.simulated_outside(cells)
    assert counts.mean() == pytest.approx(outside / records, abs=0.4)
    assert counts.mean() < 2.0
    surprising = verdict.surprising_number(counts)
    assert np.mean(counts >= surprising) <= 0.05 < np.mean(counts >= surprising - 1)
    assert f"it is {counts.mean():.1f} on average (simulated" in chance_alone(cells)
    assert f"{surprising} or more would be surprising" in chance_alone(cells)


def test_the_gain_over_sequences_is_uncertain() -> None:
    before = printed_column(PAPER, "solution_selection", "te_percent")
    after = printed_column(PAPER, "feature_selection", "te_percent")
    gain = gain_over_sequences(before, after)
    assert gain.interval.mean == pytest.approx(-0.074)
    assert (gain.interval.low, gain.interval.high) == pytest.approx((-0.186, 0.038), abs=1e-3)
    assert gain.share == pytest.approx(0.078, abs=1e-3)
    assert gain.without[-1] == pytest.approx(-0.027, abs=1e-3)
    assert gain.words == "a gain, but another set of sequences could show none or a loss"
    assert gain.sequences_needed == 38
    clear = gain_over_sequences(before, {name: value - 0.1 for name, value in before.items()})
    assert clear.words == "a gain that is hardly chance"
    assert gain_over_sequences(before, before).words == "no change on any sequence"
    with pytest.raises(DataError, match="two sequences or more"):
        gain_over_sequences({"00": 1.0}, after)


def test_an_increase_is_a_loss() -> None:
    before = {"00": 1.0, "01": 2.0, "02": 3.0}
    unsure = gain_over_sequences(before, {"00": 1.0, "01": 2.7, "02": 3.1})
    assert unsure.words == "a loss, but another set of sequences could show none or a gain"
    sure = gain_over_sequences(before, {name: value + 0.1 + 0.001 * value for name, value in before.items()})
    assert sure.words == "a loss that is hardly chance"
    even = gain_over_sequences({"00": 1.0, "01": 2.0}, {"00": 1.5, "01": 1.5})
    assert even.words == "gains and losses that cancel"
    with pytest.raises(DataError, match="none on 01"):
        gain_over_sequences(before, {"00": 1.0, "01": math.nan, "02": 3.1})


PAIR = ("solution_selection", "feature_selection")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([], "not measured"),
        ([record_row("04", PAIR[0]), record_row("07", PAIR[1])], "no run of Feature selection: 04"),
        ([record_row("04", name) for name in PAIR], "there are 1"),
        (
            [record_row(row, name, removed_share=0.0) for row in ("04", "07") for name in PAIR],
            "no boxes: 04, 07",
        ),
        (
            [
                record_row(row, name, te_percent=[1.0, None, 1.0, 1.0, 1.0] if row == "07" else [1.0] * 5)
                for row in ("04", "07")
                for name in PAIR
            ],
            "a seed of Solution selection without errors: 07",
        ),
        (
            [record_row(row, name, whole=False, frames=200) for row in ("04", "07") for name in PAIR],
            "part of the sequence: 04, 07",
        ),
    ],
)
def test_a_record_that_gives_no_gain_over_sequences_says_why(
    tmp_path: Path, rows: list[dict[str, Any]], words: str
) -> None:
    write_record(tmp_path, rows)
    found = read_report(tmp_path)
    assert words in why_no_gain(found, PAIR, "te_percent")
    before, after = (our_column(found, method, "te_percent") for method in PAIR)
    assert len(before.keys() & after.keys()) < 2


def test_two_whole_sequences_with_boxes_give_a_gain(tmp_path: Path) -> None:
    write_record(tmp_path, [record_row(row, name) for row in ("04", "07", "10") for name in PAIR])
    found = read_report(tmp_path)
    assert why_no_gain(found, PAIR, "te_percent") == ""
    before, after = (our_column(found, method, "te_percent") for method in PAIR)
    assert gain_over_sequences(before, after).names == ("04", "07", "10")
