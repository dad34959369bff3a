"""Table 1 over sequences, methods and seeds: averages, layout, and `vo reproduce` on a small KITTI folder."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from conftest import write_bands
from made_entries import entry_of, sequence_of, table_of_twos

from course.ch07.our_errors import read_report
from vo_lib import open_sequence
from vo_lib.commands.cli import main
from vo_lib.commands.console import show_report_table
from vo_lib.data.kitti import EXPECTED_FRAMES
from vo_lib.errors import DataError
from vo_lib.evaluation.kitti_errors import KITTI_LENGTHS, KITTI_PROTOCOL, SHORT_PROTOCOL, SubsequenceProtocol
from vo_lib.evaluation.statistics import mean_and_deviation
from vo_lib.files import only_process
from vo_lib.report.blocks import Block
from vo_lib.report.page import ReportTable, markdown, plus_minus, records_csv
from vo_lib.report.paper_unit import converted
from vo_lib.report.record import reproduction_record, this_call, without_places
from vo_lib.report.table1 import (
    AVERAGE,
    PAPER_METHODS,
    PAPER_ROWS,
    PROPOSAL,
    Entry,
    Group,
    Reproduction,
    collect,
    group_entries,
    read_paper_table,
    table_records,
)
from vo_lib.report.table1_page import UNIT_NOTE, layout_tables, sentences_on_proposal, tables_by_settings
from vo_lib.report.table1_plan import Cell, jobs_of, plan_cells
from vo_lib.runs.jobs import run_jobs


def group_of(*entries: Entry) -> Group:
    (group,) = group_entries(list(entries))
    return group


def layout(group: Group) -> list[ReportTable]:
    return layout_tables(group, table_of_twos())


def test_entries_have_the_errors_of_each_seed() -> None:
    entry = entry_of("somewhere", 500, [1.0, 2.0])
    # A sub-sequence ends with the first frame beyond its length, so some are a frame longer.
    np.testing.assert_allclose(entry.errors[0], [1.0, 2.0], rtol=0.011)
    np.testing.assert_allclose(entry.errors[1], 0.0, atol=1e-9)
    assert (entry.seeds, entry.protocol) == ((0, 1), KITTI_PROTOCOL)
    # Time per frame without the front end.
    assert (entry.removed_share, entry.back_end_ms) == pytest.approx((0.25, 5.0))


def test_mean_excludes_01_and_pooled_average_does_not() -> None:
    long, short = entry_of("kitti/00", 500, [1.0, 2.0]), entry_of("kitti/04", 150, [3.0])
    highway = entry_of("kitti/01", 150, [9.0])
    group = group_of(long, highway, short)
    # Only seeds of all sequences count.
    assert group.mean("viso2")[0] == pytest.approx((long.errors[0][:1] + short.errors[0]) / 2)
    counts = [len(e.results[0].kitti) for e in (long, highway, short)]
    values = [float(e.errors[0, 0]) for e in (long, highway, short)]
    assert group.pooled("viso2")[0] == pytest.approx(np.average(values, weights=counts))
    assert len(set(counts)) == 2
    names = [record["sequence"] for record in table_records([group], table_of_twos())]
    assert names == ["mean of 2", "kitti/00", "kitti/04", "kitti/01", "pooled"]
    # For other sequences, 01 is not excluded.
    others = group_of(entry_of("x/00", 500, [1.0]), entry_of("x/01", 500, [3.0]))
    assert others.mean("viso2")[0] == pytest.approx(2.0, rel=0.011)
    # A path without a sub-sequence does not count.
    whole, none = entry_of("a", 300, [1.0]), entry_of("b", 5, [1.0], protocol=KITTI_PROTOCOL)
    assert group_of(whole, none).mean("viso2")[0] == pytest.approx(whole.errors[0])


def test_groups_separate_variants_measures_and_data() -> None:
    frames = {"kitti/00": 300, "kitti/07": 60, "other": 300}
    entries = [entry_of(name, n, [1.0]) for name, n in frames.items()]
    groups = group_entries([*entries, entry_of("kitti/00", 300, [1.0], variant="published")])
    assert [group.sequences for group in groups] == [["kitti/00"], ["kitti/07"], ["other"], ["kitti/00"]]
    assert ["variant published" in layout(group)[0].title for group in groups] == [False, False, False, True]


def test_table1_compares_with_the_paper() -> None:
    methods = (*PAPER_METHODS, "moving_selection")
    runs = [(name, method) for name in ("01", *PAPER_ROWS[1:]) for method in methods]
    group = group_of(*(entry_of(f"kitti/{n}", EXPECTED_FRAMES[n], [1.0, 1.2], m) for n, m in runs))
    te, re = layout(group)
    assert te.columns == ["method", "TE %, ours", "printed", "difference", "sub-seqs", "removed %"]
    assert re.columns[1] == "RE deg/100 m, ours"
    rows = {row[0]: row[1:] for row in te.rows}
    assert list(rows) == [f"{name} {m}" for name in (*PAPER_ROWS, "01", "pooled") for m in methods]
    printed = [row[2] for table in (te, re) for row in table.rows if row[2]]
    assert printed == ["2.00"] * 44 + ["2.000"] * 44
    ours, _, difference, count, removed = rows["04 viso2"]
    assert ours.startswith("1.1")
    assert "±" in ours
    assert (difference, removed) == (f"−{2 - float(ours.split()[0]):.2f}", "25.0")
    assert count == str(len(group.entries["kitti/04", "viso2"].results[0].kitti))
    means, pooled = int(rows["Avg viso2"][3]), int(rows["pooled viso2"][3])
    assert pooled - means == int(rows["01 viso2"][3])
    assert rows["04 moving_selection"][1:3] == rows["01 viso2"][1:3] == ["", ""]
    assert rows["pooled viso2"][1:3] == ["", ""]
    assert te.title.endswith("every 10 frames (as KITTI)")


def whole_04(method: str, te: float, re_degrees: float) -> Entry:
    """An entry of the whole 04 whose errors are these for each of two seeds."""
    entry = entry_of("kitti/04", 271, [1.0, 1.0], method, "published")
    of_seed = entry.results[0].kitti
    count = len(of_seed)
    errors = replace(
        of_seed, t_err=np.full(count, te / 100.0), r_err=np.full(count, np.radians(re_degrees) / 100.0)
    )
    return replace(entry, results=tuple(replace(result, kitti=errors) for result in entry.results))


def test_a_row_that_equals_the_paper_in_the_right_unit_has_no_difference(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The terminal, the report's tables, the CSV and the record compare RE in one unit, and show both."""
    paper = read_paper_table()
    entries = []
    for method in PAPER_METHODS:
        te, re_degrees = paper.value("04", method)
        assert te is not None
        assert re_degrees is not None
        entries.append(whole_04(method, te, converted(re_degrees, method, "re_deg_per_100m")))
    of_te, of_re = layout_tables(group_of(*entries), paper)
    compared = ["printed", "printed, in the right unit", "difference"]
    assert of_re.columns[1:5] == ["RE deg/100 m, ours", *compared]
    cells = {row[0]: row[1:5] for row in of_re.rows}
    assert cells["viso2"][1] == cells["viso2"][2]
    printed = paper.value("04", "mesvo_f")[1]
    assert printed is not None
    assert cells["mesvo_f"][1:3] == [f"{printed:.3f}", f"{printed * 5729.578 / 5555.556:.3f}"]
    assert {row[4].lstrip("+−") for row in of_re.rows} == {"0.000"}
    assert {row[3].lstrip("+−") for row in of_te.rows} == {"0.00"}
    assert UNIT_NOTE in of_re.notes
    monkeypatch.setenv("COLUMNS", "80")
    show_report_table(of_re)
    shown = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in shown if line[:1] in "┏┃┡│└") <= 80
    (line,) = (line for line in shown if "mesvo_f" in line and f"{printed:.3f}" in line)
    assert [cell.strip() for cell in line.split("│")[3:6]] == cells["mesvo_f"][1:]
    lines = list(csv.DictReader(io.StringIO(records_csv(table_records([group_of(*entries)], paper)))))
    call = this_call("vo reproduce", 1.0, 1)
    record = reproduction_record(entries, paper, [], None, call, [], [], None, {})
    for row, of_record in zip(lines, record["rows"], strict=True):
        te, re_degrees = paper.value("04", row["method"])
        assert re_degrees is not None
        right = converted(re_degrees, row["method"], "re_deg_per_100m")
        for found in (row, of_record):
            assert float(found["paper_te_percent"]) == float(found["paper_te_percent_right_unit"]) == te
            assert float(found["paper_re_deg_per_100m"]) == re_degrees
            assert float(found["paper_re_deg_per_100m_right_unit"]) == pytest.approx(right, abs=1e-6)
            assert float(found["re_deg_per_100m_difference"]) == pytest.approx(0.0, abs=1e-6)
            assert float(found["te_percent_difference"]) == pytest.approx(0.0, abs=1e-6)


def test_a_part_has_no_comparison_in_the_record() -> None:
    part = entry_of("kitti/04", 270, [1.0], "mesvo_f", "published")
    call = this_call("vo reproduce", 1.0, 1)
    (row,) = reproduction_record([part], read_paper_table(), [], None, call, [], [], None, {})["rows"]
    compared = [name for name in row if name.startswith("paper_") or name.endswith("_difference")]
    assert len(compared) == 6
    assert {row[name] for name in compared} == {None}


def test_drawn_scenes_have_no_printed_numbers() -> None:
    group = group_of(*(entry_of("synthetic/jam", 300, [1.0], m) for m in ("viso2", "mesvo_f")))
    (table,) = layout(group)
    assert table.title.startswith("synthetic/jam, variant kit: sub-sequences of")
    assert table.columns == ["method", "TE %", "RE deg/100 m", "sub-seqs", "removed %"]
    assert [row[0] for row in table.rows] == ["viso2", "mesvo_f"]


@pytest.mark.parametrize(
    ("name", "frames", "protocol"),
    [
        ("kitti/04", 271, SHORT_PROTOCOL),
        ("kitti/04", 271, SubsequenceProtocol(KITTI_LENGTHS, 1)),
        ("kitti/04", 270, KITTI_PROTOCOL),
        ("kitti/07", 271, KITTI_PROTOCOL),
        ("04", 271, KITTI_PROTOCOL),
    ],
)
def test_only_whole_sequences_have_printed_numbers(
    name: str, frames: int, protocol: SubsequenceProtocol
) -> None:
    def printed(entry: Entry) -> float | None:
        (record,) = table_records(group_entries([entry]), table_of_twos())
        assert record["te_percent"] is not None
        number: float | None = record["paper_te_percent"]
        return number

    assert printed(entry_of("kitti/04", 271, [1.0])) == 2.0
    other = entry_of(name, frames, [1.0], protocol=protocol)
    assert printed(other) is None
    # If another sequence replaces a row of the paper, there is no average of the paper.
    entries = [entry_of(f"kitti/{n}", EXPECTED_FRAMES[n], [1.0]) for n in PAPER_ROWS[1:] if n != "04"]
    assert AVERAGE not in {
        r["sequence"] for r in table_records(group_entries([*entries, other]), table_of_twos())
    }


def test_a_method_that_failed_on_a_sequence_has_no_average_of_the_paper() -> None:
    """Its mean is over fewer sequences, says so, and is compared with nothing."""
    methods = ("solution_selection", PROPOSAL)
    runs = [(name, method) for name in PAPER_ROWS[1:] for method in methods]
    entries = [entry_of(f"kitti/{n}", EXPECTED_FRAMES[n], [1.0, 1.2], method) for n, method in runs]
    entries = [replace(entry, has_boxes=True) for entry in entries]
    (sentence,) = sentences_on_proposal([group_of(*entries)])
    assert sentence.startswith("Mean of 10 sequences")
    failed = next(entry for entry in entries if (entry.sequence, entry.method) == ("kitti/04", PROPOSAL))
    rest = [entry for entry in entries if entry is not failed]
    rows = {
        (record["sequence"], record["method"]): record["paper_te_percent"]
        for record in table_records([group_of(*rest)], table_of_twos())
        if not record["sequence"].startswith("kitti/")
    }
    assert rows == {
        (AVERAGE, "solution_selection"): 2.0,
        ("mean of 9", PROPOSAL): None,
        ("pooled", "solution_selection"): None,
        ("pooled of 9", PROPOSAL): None,
    }
    assert sentences_on_proposal([group_of(*rest)]) == []
    # The settings of blocks beside each other: only the mean over fewer sequences says so.
    changed = [replace(entry, settings="selection.sets=50") for entry in rest]
    (table,) = tables_by_settings(group_entries([*entries, *changed]))
    assert [row[0] for row in table.rows] == [
        "solution_selection, presets",
        "solution_selection, selection.sets=50",
        "feature_selection, presets",
        "feature_selection, selection.sets=50 (mean of 9)",
    ]
    assert table.notes == ["Means over 10 sequences of equal weight."]


def test_paths_that_are_compared_have_the_same_seed(tmp_path: Path) -> None:
    """Of a method whose run with the first seed failed, no path stands in for it."""
    sequence = open_sequence(write_bands(tmp_path / "bands"))
    blocks = [Block("published"), Block("published", (("selection.sets", 5),))]
    methods = {"published": ["mesvo_f", "solution_selection"]}
    cells = plan_cells(blocks, methods, [sequence.name], 2, tmp_path, lambda name, config: sequence)
    outcomes = run_jobs(jobs_of(cells), cache=tmp_path / "cache")
    failed = next(cell for cell in cells if cell.block == blocks[1] and cell.method == "mesvo_f").jobs[0]
    outcomes = [
        replace(outcome, error="killed") if outcome.job.folder == failed.folder else outcome
        for outcome in outcomes
    ]
    result = collect(cells, outcomes, [])
    assert [len(entry.seeds) for entry in result.entries] == [2, 2, 1, 2]
    methods_of_blocks = [list(drawn.by_method) for drawn in result.paths.values()]
    assert methods_of_blocks == [["mesvo_f", "solution_selection"], ["solution_selection"]]


def test_table_head_names_parts() -> None:
    (head,) = layout(group_of(*(entry_of(f"kitti/{n}", 271, [1.0]) for n in ("04", "07"))))[0].head
    assert head.endswith("not comparable with whole sequences: kitti/07 (271 of 1101 frames).")


def test_result_compares_means_with_and_without_removal() -> None:
    pairs = {"solution_selection": [2.9, 3.1], "feature_selection": [1.9, 2.1], "mesvo_f": [1.0, 1.0]}
    entries = [entry_of("kitti/01", 500, [9.0, 9.0], method) for method in pairs]  # left out
    for name, n in (("kitti/00", 500), ("kitti/04", 150)):
        entries += [entry_of(name, n, percent, method) for method, percent in pairs.items()]
    assert sentences_on_proposal([group_of(*entries)]) == []  # without boxes nothing is removed
    entries = [replace(entry, has_boxes=True) for entry in entries]
    group = group_of(*entries)
    (text,) = sentences_on_proposal([group])
    assert text.startswith("Mean of 2 sequences, variant kit: feature_selection")
    means = [f"{group.mean(method)[0].mean():.3f}" for method in pairs]
    # From 3 to 2 %; the rotations are exact.
    assert text.endswith(
        f"lowers TE from {means[0]} to {means[1]} % (−33.3 %) compared with solution_selection"
        "; two seeds give only a rough standard deviation."
    )
    assert sentences_on_proposal([group_of(*(e for e in entries if e.method == "mesvo_f"))]) == []
    # 01 counts if there is no other sequence; its errors are equal here.
    (text,) = sentences_on_proposal([group_of(*entries[:3])])
    assert text.startswith("kitti/01, variant kit: feature_selection")
    assert "changes neither TE nor RE compared" in text
    # From 3 to 2.8 %, with standard deviations of 0.1 %: both count, so the limit is 0.28 %.
    pairs = {"solution_selection": [2.9, 3.1], "feature_selection": [2.7, 2.9]}
    entries = [replace(entry_of("kitti/00", 500, pairs[m], m), has_boxes=True) for m in pairs]
    (text,) = sentences_on_proposal([group_of(*entries)])
    assert (
        "changes TE from 3.019 to 2.818 % (which one run would not show: within two standard deviations of "
        "the difference between two runs, or 2 %)"
    ) in text
    pairs = {"solution_selection": [3.1], "feature_selection": [2.9]}
    entries = [replace(entry_of("kitti/00", 500, pairs[m], m), has_boxes=True) for m in pairs]
    (text,) = sentences_on_proposal([group_of(*entries)])
    # One seed lowers nothing.
    assert " changes TE from 3.120 to 2.919 % (−6.5 %) compared with solution_selection" in text
    assert text.endswith("; one seed does not tell whether another run would show this.")
    # Neither does a comparison in which only one method has several seeds.
    entries[0] = replace(entry_of("kitti/00", 500, [3.1, 3.1], "solution_selection"), has_boxes=True)
    (text,) = sentences_on_proposal([group_of(*entries)])
    assert " changes TE from " in text
    assert "one seed does not tell" in text


def test_a_path_without_sub_sequences_has_a_sentence_and_no_row() -> None:
    short, long = entry_of("a", 5, [1.0], protocol=KITTI_PROTOCOL), entry_of("b", 300, [1.0])
    assert layout(group_of(short)) == []
    assert [row[0] for row in layout(group_of(short, long))[0].rows] == [
        "mean of 1 viso2",  # the other path has no errors that a mean could contain
        "b viso2",
        "pooled viso2",
    ]
    assert Reproduction([], {}, [short, long]).problems == [
        "Shorter than every sub-sequence, so no errors: a (its path has 4.0 m, the shortest sub-sequence 100 "
        "m). The option --lengths chooses shorter ones."
    ]


def test_table_is_written_as_markdown_and_csv() -> None:
    entries = [entry_of("kitti/00", 300, [1.0, 1.1], m) for m in ("viso2", "mesvo_f")]
    group = group_of(*entries, entry_of("kitti/02", 300, [2.0, 2.1]))
    (table,) = layout(group)
    assert {len(row) for row in table.rows} == {len(table.columns)} == {5}
    assert "02 viso2" in (rows := [row[0] for row in table.rows])
    assert "02 mesvo_f" not in rows  # no row without a run
    assert "over 2 seeds" in table.notes[0]
    text = markdown(ReportTable("t", ["a", "b"], [["1", "2\n3"]], ["n"], ["h"]))
    assert text == "## t\n\nh\n\n| a | b |\n| --- | ---: |\n| 1 | 2<br>3 |\n\nn\n"
    records = table_records([group, group_of(entry_of("tiny", 5, [1.0]))], table_of_twos())
    first, *_, last = csv.DictReader(io.StringIO(records_csv(records)))
    assert (first["sequence"], last["sequence"], last["te_percent"]) == ("mean of 2", "tiny", "")
    assert float(first["te_percent_std"]) == pytest.approx(group.mean("viso2")[0].std(ddof=1), abs=1e-6)
    assert plus_minus(*mean_and_deviation(np.array([1.0, 3.0]))) == "2.000 ± 1.414"
    assert plus_minus(*mean_and_deviation(np.array([1.0]))) == "1.000"


def test_jobs_have_separate_folders() -> None:
    sequences = [sequence_of("kitti/00", 5), sequence_of("a b", 5)]
    by_name = {sequence.name: sequence for sequence in sequences}
    methods = {"published": ["viso2"], "kit": ["viso2", "mesvo_f"]}

    def plan(blocks: list[Block], names: list[str]) -> list[Cell]:
        return plan_cells(blocks, methods, names, 3, Path("out"), lambda name, config: by_name[name])

    jobs = jobs_of(plan([Block("published"), Block("kit")], list(by_name)))
    assert len({job.folder for job in jobs}) == len(jobs) == 18
    assert jobs[0].folder == Path("out/runs/published/kitti_00/viso2/seed_0")
    assert [job.config.variant for job in jobs] == ["published"] * 6 + ["kit"] * 12
    assert [job.config.seed for job in jobs[:3]] == [0, 1, 2]
    with pytest.raises(DataError, match="two sequences have the name a b"):
        plan([Block("kit")], ["a b", "a b"])


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a KITTI root: sequences 02 and 07 with truth, sequence 11 without truth."""
    for name in ("02", "07", "11"):
        write_bands(tmp_path / "kitti" / "sequences" / name)
    (tmp_path / "kitti" / "sequences" / "11" / "poses.txt").unlink()
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path / "kitti"))
    return tmp_path


def reproduce(tree: Path, *words: str) -> int:
    places = ["--out", str(tree / "out"), "--cache", str(tree / "cache")]
    return main(
        ["reproduce", *places, "--methods", "viso2,mesvo_f", "--seeds", "2", "--lengths", "1,2", *words]
    )


def page_of(out: Path) -> str:
    """The report without the marks that allow a line to break."""
    return (out / "report.html").read_text(encoding="utf-8").replace("<wbr>", "")


@pytest.mark.slow  # runs many drives
def test_a_record_counts_the_calls_before_it(tree: Path) -> None:
    path = tree / "out" / "reproduction.json"
    records = []
    for words in (("--sequences", "02"), ("--sequences", "02"), ("--sequences", "02,07"), ("--fresh",)):
        sequences = () if words[0] == "--sequences" else ("--sequences", "02")
        assert reproduce(tree, *sequences, *words) == 0
        records.append(json.loads(path.read_text(encoding="utf-8")))
    assert [len(record["calls"]) for record in records] == [1, 2, 3, 1]
    for record in records:
        assert record["calls"][-1]["command"] == record["command"]
        assert record["seconds_of_calls"] == pytest.approx(sum(call["seconds"] for call in record["calls"]))
    # A call that only reads runs takes no time of its own, but its record has that of the runs.
    first, again, more, _ = records
    assert again["seconds_of_work"] == first["seconds_of_work"] < more["seconds_of_work"]
    assert again["work_of_unknown_duration"] == 0
    # A record that cannot be read gives no calls, and is written anew.
    path.write_text('{"calls": [{"seconds": "4"}, 3]}', encoding="utf-8")
    assert reproduce(tree, "--sequences", "02") == 0
    assert len(json.loads(path.read_text(encoding="utf-8"))["calls"]) == 1


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        ("--sequences 00,kitti/04 --out runs/table1 --frames 0:30", None),
        ("--detector yolox-tiny --set selection.threshold=0.5,1", None),
        ("--out /data/eva/out --detector=/opt/models/y.onnx", "--out out --detector=y.onnx"),
        ("--sequences '/data/a b/x,kitti/04,~/k,../up/z'", "--sequences x,kitti/04,k,z"),
        (r"--out 'C:\Users\eva\out' --cache '\\server\share\cache'", "--out out --cache cache"),
        ("--dask tcp://10.0.0.1:8786 --config ~ --cache ../..", "--dask tcp://... --config ... --cache ..."),
        ("--out / --sequences /data/kitti/sequences/04/", "--out ... --sequences 04"),
    ],
)
def test_the_command_of_a_record_names_no_place_of_the_machine(typed: str, kept: str | None) -> None:
    assert without_places(f"vo reproduce {typed}") == f"vo reproduce {kept or typed}"


def test_reproduce_writes_all_files(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce(tree, "--sequences", "02,07-08,11") == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "Not found, so not run: kitti/08" in printed
    told = "1 of 4 sequences are not on this machine, so they are not run: kitti/08"
    assert 0 <= printed.index(told) < printed.index("Not found")
    assert "The other runs will take about" in printed
    assert "All of KITTI 00-10 (23,201 frames), the same methods and seeds: about" in printed
    out, numbers = tree / "out", ("02", "07", "11")
    figures = [f"trajectory_{variant}_kitti_{n}" for variant in ("published", "kit") for n in numbers]
    figures += ["figure4_published", "figure4_kit"]
    expected = {f"{name}.png" for name in figures} | {
        *("table1.md", "table1.csv", "reproduction.json", "report.html", "runs")
    }
    assert {p.name for p in out.glob("[!.]*")} == expected
    table = list(csv.DictReader(io.StringIO((out / "table1.csv").read_text(encoding="utf-8"))))
    assert [(row["sequence"], row["seeds"]) for row in table[2:4]] == [("kitti/02", "2")] * 2
    assert list(dict.fromkeys(row["variant"] for row in table)) == ["published", "kit"]
    assert 0 < float(table[1]["te_percent"]) < 5
    record = json.loads((out / "reproduction.json").read_text(encoding="utf-8"))
    assert str(tree) not in json.dumps(record)
    assert str(tree) not in page_of(out)
    assert record["missing"] == ["kitti/08"]
    assert record["seconds"] > 0
    assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", record["date"])
    assert record["command"].startswith("vo reproduce --out out --cache cache --methods viso2,mesvo_f")
    assert re.fullmatch(r"\d+\.\d+.*", record["versions"]["onnxruntime"])
    assert record["work_of_unknown_duration"] == 0
    assert record["seconds_of_work"] > 0
    assert record["processor"]
    row = next(r for r in record["rows"] if r["sequence"] == "kitti/02" and r["variant"] == "published")
    of_table = next(r for r in table if (r["sequence"], r["method"]) == ("kitti/02", row["method"]))
    assert row["seeds"] == [0, 1]
    assert np.mean(row["te_percent"]) == pytest.approx(float(of_table["te_percent"]), abs=1e-4)
    judged = read_report(out)  # of chapter 7
    assert not judged["02", row["method"], "te_percent"].whole
    assert judged["02", row["method"], "te_percent"].mean == pytest.approx(np.mean(row["te_percent"]))
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "No ground truth, so no errors: kitti/11; the poses are in the folder runs." in page
    for text in (page.replace("<wbr>", ""), printed):
        assert "kitti/11, variant kit, first seed: no ground truth, so these numbers are no errors" in text
        assert "viso2 – mesvo_f" in text
    assert "kitti/08" in page
    assert page.count("<img") == page.count("data:image/png;base64,") == len(figures) + 2  # errors


def test_a_straight_drive_without_truth_has_no_errors_in_its_caption(tree: Path) -> None:
    assert reproduce(tree, "--sequences", "11", "--variant", "published", "--seeds", "1") == 0
    report = (tree / "out" / "report.html").read_text(encoding="utf-8")
    assert "to the side of the line from the start to the end of the path of viso2" in " ".join(
        report.split()
    )
    assert "errors to the side" not in report


@pytest.mark.usefixtures("pictures_not_drawn")
def test_lengths_without_effect_are_reported(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    remark = "--lengths has no effect on kitti/11, which has no ground truth"
    assert reproduce(tree, "--sequences", "02,11", "--variant", "published", "--seeds", "1") == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert 0 <= printed.index(f"note: {remark}") < printed.index(f" {remark}.")
    assert f"{remark}." in (tree / "out" / "report.html").read_text(encoding="utf-8")
    assert "kitti/02 will have no errors" not in printed


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("lengths", [["--lengths", "50,30"], []])
def test_a_path_shorter_than_every_sub_sequence_is_explained(
    tree: Path, capsys: pytest.CaptureFixture[str], lengths: list[str]
) -> None:
    words = ["reproduce", "--sequences", "02", "--methods", "viso2", "--variant", "published", "--seeds", "1"]
    assert main([*words, *lengths, "--out", str(tree / "out"), "--cache", str(tree / "cache")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    both = f"its path has 2.5 m, the shortest sub-sequence {30 if lengths else 20} m"
    assert f"note: kitti/02 will have no errors, since {both}; --lengths chooses shorter ones" in printed
    assert f"so no errors: kitti/02 ({both}). The option --lengths chooses shorter ones." in printed
    assert "kitti/02, variant published, first seed: distances from the true path" in printed
    for column in ("length m", "end error m", "rmse error m"):
        assert column in printed
    page = (tree / "out" / "report.html").read_text(encoding="utf-8")
    assert "distances from the true path" in page


@pytest.mark.usefixtures("pictures_not_drawn")
def test_settings_are_compared_without_truth(
    tree: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    words = ["--sequences", "11", "--variant", "published", "--seeds", "1"]
    words += ["--methods", "viso2,solution_selection"]
    assert reproduce(tree, *words, "--set", "selection.sets=10,50") == 0
    printed = " ".join(capsys.readouterr().out.split())
    table = printed[printed.index("each method by its settings: no ground truth") :]
    assert "solution_selection, selection.sets=10" in table
    assert "with selection.sets=10, from the same start, at the end and as rmse" in table
    links = re.findall(r'<a href="#table\d+">(.*?)</a>', page_of(tree / "out"))
    assert len(links) == 5  # the settings; for each of them, the paths and their distances
    assert len(set(links)) == len(links)


def test_a_warning_of_several_seeds_is_printed_once() -> None:
    warned = {
        "stereo contradicts the motion of 54 of 295 frames": ["a, mesvo_f, seed 0"],
        "stereo contradicts the motion of 58 of 295 frames": ["a, mesvo_f, seed 1", "b, mesvo_f, seed 0"],
        "times.txt has whole numbers": ["b, viso2, seed 0"],
    }
    assert Reproduction([], {}, warned=warned).problems == [
        "Warning: a, mesvo_f, seed 0 and 2 more with other numbers: stereo contradicts the motion of 54 of "
        "295 frames",
        "Warning: b, viso2, seed 0: times.txt has whole numbers",
    ]


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize(
    ("sequences", "note"),
    [
        ("02,kitti/02", "note: kitti/02 is named 2 times, but used once"),
        ("02-03,02,kitti/02", "note: kitti/02 is named 3 times, but used once"),
        ("FOLDER,02", "note: FOLDER and kitti/02 are the same sequence, so it is used once, as kitti/02"),
        (
            "kitti/02,FOLDER",
            "note: kitti/02 and FOLDER are the same sequence, so it is used once, as kitti/02",
        ),
        ("02,LINK", "note: kitti/02 and LINK are the same sequence, so it is used once, as kitti/02"),
        ("FOLDER,LINK", "note: FOLDER and LINK are the same sequence, so it is used once, as FOLDER"),
    ],
)
def test_a_sequence_that_is_named_twice_counts_once(
    tree: Path, capsys: pytest.CaptureFixture[str], sequences: str, note: str
) -> None:
    # Asked before the folder's path is put in, since the path may have these digits.
    names_missing = "03" in sequences
    (tree / "link").symlink_to(tree / "kitti" / "sequences" / "02")
    for name, place in {"FOLDER": tree / "kitti" / "sequences" / "02", "LINK": tree / "link"}.items():
        sequences = sequences.replace(name, str(place))
        note = note.replace(name, str(place))
    words = ["--cache", str(tree / "cache"), "--seeds", "1"]
    table = ["reproduce", "--variant", "published", "--methods", "viso2", "--missing", "ok"]
    capsys.readouterr()
    assert main([*table, "--sequences", sequences, "--out", str(tree / "out"), *words]) == 0
    printed = capsys.readouterr().out
    assert "".join(note.split()) in "".join(printed.split())
    record = json.loads((tree / "out" / "reproduction.json").read_text(encoding="utf-8"))
    assert len(record["rows"]) == 1
    if names_missing:  # and `vo sweep` accepts no missing sequence
        assert "1 of 2 sequences are not on this machine" in " ".join(printed.split())
        return
    grid = ["sweep", "--method", "mesvo_f", "--set", "selection.sets=5", "--set", "min_matches=6"]
    assert main([*grid, "--sequences", sequences, "--out", str(tree / "grid"), *words]) == 0
    assert "".join(note.split()) in "".join(capsys.readouterr().out.split())
    rows = (tree / "grid" / "sweep.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 2  # with the heading


def test_report_embeds_a_film(tree: Path) -> None:
    place = tree / "out" / "runs" / "published" / "kitti_02" / "viso2" / "seed_0"
    film = ["--out", str(place), "--video", str(place / "my film.webm")]
    assert main(["run", "kitti/02", "--method", "viso2", *film]) == 0
    assert reproduce(tree, "--sequences", "02", "--variant", "published") == 0
    page = (tree / "out" / "report.html").read_text(encoding="utf-8")
    (address,) = re.findall(r'<video src="([^"]+)" poster="data:image/jpeg;base64,', page)
    assert (tree / "out" / unquote(address)).samefile(place / "my film.webm")


@pytest.mark.usefixtures("pictures_not_drawn")
def test_failed_run_is_reported_with_its_cause(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = tree / "kitti" / "sequences" / "07" / "image_0" / "000003.png"
    image.write_bytes(image.read_bytes()[:300])
    assert reproduce(tree, "--sequences", "02,07", "--variant", "kit") == 1
    lines = (tree / "out" / "table1.csv").read_text(encoding="utf-8").splitlines()
    assert [line.split(",")[1] for line in lines[1:]] == ["kitti/02"] * 2
    for message in (capsys.readouterr().out, (tree / "out" / "report.html").read_text(encoding="utf-8")):
        assert "Failed: kitti/07" in " ".join(message.split())
        assert "and 3 more" in message
        assert "000003.png" in message


@pytest.mark.usefixtures("pictures_not_drawn")
def test_finished_runs_are_not_repeated(tree: Path) -> None:
    def times(*words: str) -> dict[str, int]:
        assert reproduce(tree, "--sequences", "02", "--variant", "kit", *words) == 0
        return {str(path): path.stat().st_mtime_ns for path in (tree / "out" / "runs").rglob("poses.txt")}

    first = times("--jobs", "2")
    table = (tree / "out" / "table1.md").read_bytes()
    assert len(first) == 4
    assert times() == first
    assert (tree / "out" / "table1.md").read_bytes() == table
    assert all(time > first[path] for path, time in times("--fresh").items())


@pytest.mark.parametrize("command", ["reproduce", "sweep"])
def test_folder_in_use_is_refused(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    words = {
        "reproduce": ["--sequences", str(bands), "--methods", "viso2"],
        "sweep": ["--sequence", str(bands), "--set", "selection.sets=10"],
    }[command]
    with only_process(tmp_path):
        assert main([command, *words, "--seeds", "1", "--out", str(tmp_path)]) == 2
    assert "another process is working in this folder" in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("poses.txt") if bands not in path.parents]


def table_rows(tree: Path) -> list[dict[str, str]]:
    """The rows of the last table."""
    text = (tree / "out" / "table1.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))


def poses_of(tree: Path) -> dict[str, tuple[int, bytes]]:
    """Time and content of the poses of each run, by its folder."""
    root = tree / "out" / "runs" / "published"
    return {
        path.parent.relative_to(root).as_posix(): (path.stat().st_mtime_ns, path.read_bytes())
        for path in root.rglob("poses.txt")
    }


def test_a_setting_is_changed_in_the_whole_table(
    tree: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    words = ["--sequences", "02,07", "--variant", "published"]
    assert reproduce(tree, *words) == 0
    presets = poses_of(tree)
    capsys.readouterr()
    assert reproduce(tree, *words, "--set", "selection.sets=20,200") == 0
    runs = poses_of(tree)
    # The runs of the presets are kept: those of viso2, which does not draw five-point sets, are the same in
    # all blocks, and 200 sets are the preset of mesvo_f.
    new = set(runs) - set(presets)
    assert {folder: runs[folder] for folder in presets} == presets
    assert {folder.split("/")[2] for folder in new} == {"selection.sets=20"}
    assert len(new) == 4
    for folder in new:
        config = json.loads(
            (tree / "out/runs/published" / folder / "config.json").read_text(encoding="utf-8")
        )
        assert config["settings"]["selection"]["sets"] == 20
    rows = table_rows(tree)
    assert [row["settings"] for row in rows] == ["selection.sets=20"] * 8 + ["selection.sets=200"] * 8
    assert {row["method"]: row["not_used"] for row in rows} == {"viso2": "selection.sets", "mesvo_f": ""}
    printed = " ".join(capsys.readouterr().out.split())
    says = "selection.sets is 20, instead of 200; viso2 does not use it, since estimator is reprojection."
    page = (tree / "out" / "report.html").read_text(encoding="utf-8")
    text = (tree / "out" / "table1.md").read_text(encoding="utf-8")
    for where in (printed, page, text):
        assert f"Settings: {says}" in where
    assert "KITTI, variant published: each method by its settings" in printed
    mean = next(row for row in rows if (row["method"], row["settings"]) == ("mesvo_f", "selection.sets=20"))
    errors = [
        f"{float(mean[kind]):.3f} ± {float(mean[f'{kind}_std']):.3f}"
        for kind in ("te_percent", "re_deg_per_100m")
    ]
    assert f"mesvo_f, selection.sets=20 │ {' │ '.join(errors)}" in printed
    data = json.loads((tree / "out" / "reproduction.json").read_text(encoding="utf-8"))
    assert [block["settings"] for block in data["blocks"]] == [
        {"selection.sets": 20},
        {"selection.sets": 200},
    ]
    assert data["blocks"][0]["differs"] == [says]
    assert [row["settings"] for row in data["rows"]] == ["selection.sets=20"] * 4 + ["selection.sets=200"] * 4
    assert (tree / "out" / "trajectory_published_selection.sets=20_kitti_02.png").exists()
    # The same call again does nothing, and one more value does only its runs.
    request.getfixturevalue("pictures_not_drawn")
    assert reproduce(tree, *words, "--set", "selection.sets=20,200,30") == 0
    again = poses_of(tree)
    assert {folder: again[folder] for folder in runs} == runs
    assert {folder.split("/")[2] for folder in set(again) - set(runs)} == {"selection.sets=30"}


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_setting_gives_the_poses_of_a_run_with_it(tree: Path) -> None:
    words = ["--sequences", "02", "--variant", "published", "--set", "selection.threshold=1"]
    assert reproduce(tree, *words) == 0
    single = ["--method", "mesvo_f", "--selection.threshold", "1", "--out", str(tree / "single")]
    assert main(["run", "kitti/02", *single]) == 0
    table = tree / "out/runs/published/kitti_02/mesvo_f/selection.threshold=1.0/seed_0"
    assert (table / "poses.txt").read_bytes() == (tree / "single" / "poses.txt").read_bytes()


@pytest.mark.usefixtures("pictures_not_drawn")
def test_the_settings_of_a_run_are_those_of_the_table(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    single = ["--method", "feature_selection", "--selection.sets", "20", "--out", str(tree / "single")]
    assert main(["run", "kitti/02", *single]) == 0
    words = ["--sequences", "02", "--config", str(tree / "single" / "config.json")]
    assert reproduce(tree, *words) == 0  # with --methods viso2,mesvo_f
    assert [row["settings"] for row in table_rows(tree)] == ["selection.sets=20"] * 2
    assert {row["variant"] for row in table_rows(tree)} == {"published"}
    capsys.readouterr()
    assert reproduce(tree, *words, "--set", "selection.sets=30") == 0
    assert [row["settings"] for row in table_rows(tree)] == ["selection.sets=30"] * 2
    places = ["--out", str(tree / "alone"), "--cache", str(tree / "cache"), "--lengths", "1"]
    assert main(["reproduce", *words, "--seeds", "1", *places]) == 0
    text = (tree / "alone" / "table1.csv").read_text(encoding="utf-8")
    assert [row["method"] for row in csv.DictReader(io.StringIO(text))] == ["feature_selection"]


@pytest.mark.usefixtures("pictures_not_drawn")
def test_missing_sequences_may_be_accepted(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--sequences", "02,08", "--variant", "published"]
    assert reproduce(tree, *words, "--missing", "ok") == 0
    assert "exit code" not in capsys.readouterr().out
    assert reproduce(tree, *words) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "The exit code will be 1; --missing ok accepts this." in printed
    # Nothing was run: the time is that of the runs before.
    assert re.search(r"All of KITTI .*: about .*, extrapolated from the times of kept runs\.", printed)
    assert "The other runs" not in printed


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_table_may_take_a_part_of_each_sequence(tree: Path) -> None:
    words = ["--sequences", "02", "--variant", "published", "--frames", "1:5"]
    assert reproduce(tree, *words) == 0
    configs = [
        json.loads(path.read_text(encoding="utf-8")) for path in (tree / "out" / "runs").rglob("config.json")
    ]
    assert {tuple(config["frames"]) for config in configs} == {("000001", "000004")}
    # The same folder has the whole sequences only with --fresh.
    assert reproduce(tree, *words[:4]) == 2


@pytest.mark.usefixtures("pictures_not_drawn")
def test_dask_runs_the_table(tree: Path) -> None:
    distributed = pytest.importorskip("distributed")
    words = ["--sequences", "02", "--variant", "published", "--set", "selection.sets=20"]
    assert reproduce(tree, *words) == 0
    local = {folder: content for folder, (_, content) in poses_of(tree).items()}
    shutil.rmtree(tree / "out")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster:
        assert reproduce(tree, *words, "--dask", cluster.scheduler_address) == 0
    assert {folder: content for folder, (_, content) in poses_of(tree).items()} == local


@pytest.mark.usefixtures("pictures_not_drawn")
def test_the_time_of_kitti_is_known_where_the_matches_are_kept(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--sequences", "02,07", "--variant", "published"]
    assert reproduce(tree, *words) == 0
    assert "extrapolated from these runs." in capsys.readouterr().out
    places = ["--out", str(tree / "other")]  # the cache has the matches now
    assert reproduce(tree, *words, *places) == 0
    printed = capsys.readouterr().out
    assert "The other runs will take about" in printed
    assert re.search(r"All of KITTI .*, extrapolated from these runs and the times of kept ones\.", printed)
    # Times of another processor say nothing about this one.
    for path in (tree / "cache").rglob("*.json"):
        path.write_text('{"seconds": 1.0, "processor": "another"}', encoding="utf-8")
    assert reproduce(tree, *words, "--out", str(tree / "third")) == 0
    assert "the time is not known, since matches or runs were kept" in capsys.readouterr().out
