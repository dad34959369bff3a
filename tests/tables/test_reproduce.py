"""Table 1 over sequences, methods and seeds: averages by hand, and whole commands on small KITTI trees."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands
from made_entries import entry_of, sequence_of, straight, table_of_twos

from vo_lib.commands.cli import main
from vo_lib.core.errors import DataError
from vo_lib.core.poses import read_kitti_poses
from vo_lib.data.kitti import EXPECTED_FRAMES
from vo_lib.data.scenes import SCENES
from vo_lib.data.sequence import parse_sequences
from vo_lib.evaluation.kitti import KITTI_MEASURE, SHORT_MEASURE, Measure, suitable_measure
from vo_lib.tables.entries import Entry, Group, group_entries, made_by
from vo_lib.tables.paper import AVERAGE, PAPER_ROWS, read_paper_table
from vo_lib.tables.report import ReportTable, markdown, spread
from vo_lib.tables.reproduce import default_sequences, plan_jobs, slug, split_missing
from vo_lib.tables.table1 import gains_table, layout_tables, length_table, method_table, trajectory_table
from vo_lib.tables.table1_data import records_csv, table_records
from vo_lib.tables.table_files import TABLE_FILES, make_tables


def group_of(*entries: Entry) -> Group:
    (group,) = group_entries(list(entries))
    return group


def layout(group: Group, narrow: bool = False) -> list[ReportTable]:
    return layout_tables(group, table_of_twos(), narrow)


def test_errors_of_a_method_are_those_of_its_runs_seed_by_seed() -> None:
    entry = entry_of("somewhere", 500, [1.0, 2.0])
    # A sub-sequence ends with the first frame beyond its length: some are a frame longer.
    np.testing.assert_allclose(entry.te, [1.0, 2.0], rtol=0.011)
    np.testing.assert_allclose(entry.re, 0.0, atol=1e-9)
    assert (entry.seeds, entry.measure) == ((0, 1), KITTI_MEASURE)
    # Of the time a frame, without the front end.
    assert (entry.removed_share, entry.back_end_ms) == pytest.approx((0.25, 5.0))


def test_short_paths_get_short_lengths_and_say_so() -> None:
    assert suitable_measure(straight(101)) == SHORT_MEASURE
    assert suitable_measure(straight(103)) == KITTI_MEASURE
    assert KITTI_MEASURE.words == "100, 200, … 800 m, every 10 frames (as KITTI)"
    assert Measure((5.0,), 3).words == "5 m, every 3 frames"
    assert "20, 50, 100 m, every frame" in layout(group_of(entry_of("a", 80, [1.0])))[0].title


def test_the_mean_leaves_01_out_and_the_pooled_average_does_not() -> None:
    long, short = entry_of("kitti/00", 500, [1.0]), entry_of("kitti/04", 150, [3.0])
    highway = entry_of("kitti/01", 150, [9.0])
    group = group_of(long, highway, short)
    assert group.mean("viso2")[0] == pytest.approx((long.te + short.te) / 2)
    counts = [len(e.results[0].kitti) for e in (long, highway, short)]
    values = [float(e.te[0]) for e in (long, highway, short)]
    assert group.pooled("viso2")[0] == pytest.approx(np.average(values, weights=counts))
    as_paper = np.average(values[::2], weights=counts[::2])
    assert group.pooled("viso2", as_paper=True)[0] == pytest.approx(as_paper)
    assert len(set(counts)) == 2
    # Under another measure than the benchmark's no row is the paper's; 01 stands last all the same.
    short_measure = group_of(*(entry_of(f"kitti/{n}", 99, [1.0]) for n in ("00", "01", "04")))
    rows = [row[0] for row in layout(short_measure)[0].rows]
    assert rows == ["mean of 2", "00", "04", "01", "pooled"]
    # Sequences that are not KITTI's are averaged as they are.
    others = group_of(entry_of("x/00", 500, [1.0]), entry_of("x/01", 500, [3.0]))
    assert others.mean("viso2")[0] == pytest.approx(2.0, rel=0.011)


def test_an_average_is_taken_for_each_seed_that_all_sequences_have() -> None:
    group = group_of(entry_of("kitti/00", 300, [1.0, 2.0, 4.0]), entry_of("kitti/02", 300, [3.0, 4.0]))
    np.testing.assert_allclose(group.mean("viso2")[0], [2.0, 3.0], rtol=0.011)


def test_what_cannot_be_averaged_is_not() -> None:
    frames = {"kitti/00": 300, "kitti/07": 60, "other": 300}
    groups = group_entries([entry_of(name, n, [1.0]) for name, n in frames.items()])
    assert [group.sequences for group in groups] == [["kitti/00"], ["kitti/07"], ["other"]]
    assert group_of(entry_of("kitti/01", 300, [1.0])).mean("viso2").shape == (2, 0)
    # A path that holds no sub-sequence counts for nothing.
    long, none = entry_of("a", 300, [1.0]), entry_of("b", 5, [1.0], measure=KITTI_MEASURE)
    assert group_of(long, none).mean("viso2")[0] == pytest.approx(long.te)
    tiny = group_of(entry_of("a", 5, [1.0, 2.0]), entry_of("b", 5, [1.0, 2.0]))
    assert np.isnan(tiny.mean("viso2")).tolist() == [[True, True]] * 2


def test_spread_over_seeds_is_a_standard_deviation() -> None:
    assert spread(np.array([1.0, 3.0])) == "2.000 ± 1.000"
    assert spread(np.array([1.0])) == "1.000"
    assert spread(np.array([1.0, np.nan])) == spread(np.zeros(0)) == "–"


def test_the_layout_is_the_papers_ours_over_its_numbers() -> None:
    methods = ("mesvo_f", "solution_selection", "feature_selection", "moving_selection")
    names = ("00", "01", *PAPER_ROWS[2:])
    runs = [(name, method) for name in names for method in methods]
    group = group_of(*(entry_of(f"kitti/{n}", EXPECTED_FRAMES[n], [1.0, 1.2], m) for n, m in runs))
    table, gains, own = layout(group)
    assert [row[0] for row in table.rows] == [*PAPER_ROWS, "01", "pooled"]
    assert table.columns[3:5] == ["MESVO_F TE", "MESVO_F RE"]
    rows = {row[0]: row[1:] for row in table.rows}
    ours, below, gap = rows["04"][2].split("\n")
    assert ours.startswith("1.1")
    assert below == "2.00"
    assert gap == f"{float(ours.split(' ')[0]) - 2.0:+.3f}".replace("-", "−")
    gap = rows[AVERAGE][2].split("\n")[2]
    assert float(gap.replace("−", "-")) == pytest.approx(-0.9, abs=0.01)
    assert not any("\n" in cell for cell in rows["01"] + rows["pooled"])
    # What is not the paper's stands apart, without its numbers.
    assert own.columns == ["sequence", "moving_selection TE", "moving_selection RE"]
    assert not any("\n" in cell for row in own.rows for cell in row)
    assert [row[0] for row in gains.rows][:2] == ["Solution selection, TE", "Solution selection, RE"]
    text = " ".join(note for each in make_tables([group], table_of_twos()) for note in each.notes)
    assert text.count("2.43 / 1.106") == text.count("1/180") == 1


def test_what_is_no_whole_sequence_or_has_no_boxes_is_said_first_in_the_terminal_too() -> None:
    parts = {"kitti/04": 271, "kitti/07": 300}
    for method, boxed in (("feature_selection", True), ("solution_selection", False)):
        group = group_of(*(entry_of(name, n, [1.0], method) for name, n in parts.items()))
        for narrow in (False, True):
            head = layout(group, narrow)[0].head
            assert head[0].endswith("not comparable with whole ones: kitti/07 (300 of 1101 frames).")
            assert [line.split(":")[0] for line in head[1:]] == [
                "No vehicle boxes on kitti/04, kitti/07"
            ] * boxed


def test_gains_are_what_the_errors_are_smaller_by_seed_by_seed() -> None:
    pairs = {"solution_selection": [2.0, 4.0], "feature_selection": [1.0, 3.0]}
    entries = [entry_of("kitti/01", 500, [9.0, 9.0], method) for method in pairs]  # left out
    for name, n in (("kitti/00", 500), ("kitti/04", 150)):
        entries += [entry_of(name, n, percent, method) for method, percent in pairs.items()]
    row = gains_table(group_of(*entries), read_paper_table()).rows[0]
    assert row[:5] == ["Solution selection, TE", "8.0 %", "8.1 %", "8.6 %", "5.2 %"]
    # Halved in one seed, a quarter less in the other.
    assert row[5:] == ["37.5 ± 12.5 %"] * 2
    worse = (entry_of("a", 300, [p], m) for p, m in ((1.0, "solution_selection"), (2.0, "feature_selection")))
    table = gains_table(group_of(*worse), None)
    assert table.rows[0][1] == "−100.0 %"
    assert table.columns == ["Feature selection over", "ours"]


def test_variants_are_never_averaged_together_and_each_says_what_made_it() -> None:
    entries = [entry_of("kitti/00", 300, [1.0], "mesvo_f", variant) for variant in ("published", "kit")]
    groups = group_entries(entries)
    assert [group.variant for group in groups] == ["published", "kit"]
    words = [layout(group)[0] for group in groups]
    assert "the paper as published" in words[0].title
    assert "matched by their descriptors. Motion: the five-point winner, as it is." in words[0].notes[-1]
    assert "Lucas-Kanade. Motion: the five-point winner, refined on its inliers." in words[1].notes[-1]
    fit = dataclasses.replace(entries[0], method="viso2", how=(entries[0].how[0], "one fit"))
    assert made_by([fit, entries[0]]).endswith(
        "Motion: one fit (viso2); the five-point winner, as it is (mesvo_f)."
    )


def test_tables_have_a_cell_for_each_column_and_a_dash_where_nothing_is() -> None:
    entries = [entry_of("kitti/00", 300, [1.0, 1.1], m) for m in ("viso2", "mesvo_f")]
    entries.append(entry_of("kitti/02", 300, [2.0, 2.1]))
    group = group_of(*entries)
    by_length, drift = length_table(group), trajectory_table(group)
    tables = [*layout(group), *layout(group, narrow=True), method_table(entries[:2]), by_length, drift]
    for table in tables:
        assert {len(row) for row in table.rows} == {len(table.columns)}
    row = next(row for row in tables[0].rows if row[0] == "02")
    assert [cell.split("\n")[0] for cell in row[3:5]] == ["–", "–"]
    assert "SE3" in drift.notes[0]
    assert by_length.columns == ["sequence, method", "100 m", "200 m"]  # 299 m hold no more
    assert "over 2 seeds" in tables[0].notes[0]
    assert float(by_length.rows[0][1].split(" / ")[0]) == pytest.approx(1.05, abs=0.07)
    text = markdown(ReportTable("t", ["a", "b"], [["1", "2\n3"]], ["n"], ["h"]))
    assert text == "## t\n\nh\n\n| a | b |\n| --- | ---: |\n| 1 | 2<br>3 |\n\nn\n"


def test_json_and_csv_hold_what_was_measured() -> None:
    groups = group_entries([entry_of("kitti/04", 271, [1.0, 2.0]), entry_of("tiny", 5, [1.0])])
    whole, tiny = json.loads(json.dumps(table_records(groups, table_of_twos()), allow_nan=False))
    te = groups[0].entries["kitti/04", "viso2"].te
    assert (whole["te_percent"], whole["te_percent_std"]) == pytest.approx((te.mean(), te.std()))
    assert whole["paper_te_percent"] == 2.0
    assert (whole["removed_share"], whole["back_end_ms"], whole["seeds"]) == pytest.approx((0.25, 5.0, 2))
    assert tiny["te_percent"] is tiny["paper_te_percent"] is None
    rows = list(csv.DictReader(io.StringIO(records_csv([whole, tiny]))))
    assert [row["sequence"] for row in rows] == ["kitti/04", "tiny"]
    assert float(rows[0]["te_percent_std"]) == pytest.approx(te.std(), abs=1e-6)
    assert rows[1]["te_percent"] == ""
    # Averages come with the sequences that they are of.
    pair = group_of(entry_of("a", 300, [1.0]), entry_of("b", 300, [2.0]))
    names = [record["sequence"] for record in table_records([pair], table_of_twos())]
    assert names == ["mean of 2", "a", "b", "pooled"]


def test_a_job_for_each_sequence_method_and_seed_in_a_folder_of_its_own() -> None:
    sequences = [sequence_of("kitti/00", 5), sequence_of("a b", 5)]
    jobs = plan_jobs(sequences, {"published": ["viso2"], "kit": ["viso2", "mesvo_f"]}, 3, Path("out"))
    assert len({job.folder for job in jobs}) == len(jobs) == 18
    assert jobs[0].folder == Path("out/runs/published/kitti_00/viso2/seed_0")
    assert [job.config.variant for job in jobs] == ["published"] * 6 + ["kit"] * 12
    assert [job.config.seed for job in jobs[:3]] == [0, 1, 2]
    assert slug("a b/c") == "a_b_c"
    with pytest.raises(DataError, match="two sequences are called a b"):
        plan_jobs([sequences[1], sequences[1]], {"kit": ["viso2"]}, 1, Path("out"))


def test_sequence_numbers_and_ranges_mean_kitti() -> None:
    expected = ["kitti/00", "kitti/02", "kitti/03", "kitti/04", "synthetic/jam", "a/b"]
    assert parse_sequences("00,02-04,synthetic/jam,a/b") == expected
    for wrong in ("05-03", "00,,01", ""):
        with pytest.raises(DataError, match="--sequences"):
            parse_sequences(wrong)


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A KITTI root with 02, 07 and, without truth, 11; a folder for what is found in it."""
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


@pytest.mark.usefixtures("tree")
def test_kitti_is_the_default_where_it_is_and_what_is_not_there_is_told_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn = [f"synthetic/{scene}" for scene in SCENES]
    assert {"kitti/02", "kitti/07", "kitti/11"} <= {*default_sequences()}
    assert not {*drawn} & {*default_sequences()}
    assert split_missing(["kitti/02", "kitti/03", "kitti/02"]) == (["kitti/02"], ["kitti/03"])
    with pytest.raises(DataError, match=r"none of the sequences is here: kitti/03"):
        split_missing(["kitti/03"])
    monkeypatch.setattr("vo_lib.tables.reproduce.available", lambda: dict.fromkeys(drawn))
    assert default_sequences() == drawn


def test_the_whole_table_is_made_and_names_what_is_missing(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduce(tree, "--sequences", "02,07-08,11") == 0
    assert "Not found, so not run: kitti/08" in capsys.readouterr().out
    out, numbers = tree / "out", ("02", "07", "11")
    figures = [f"field_kitti_{number}" for number in numbers]  # what the kit's way learnt
    for number, variant in enumerate(("published", "kit")):
        # One speed: no curve over it.
        figures += [f"figure4_{variant}", f"errors_{variant}_kitti_{number}_by_length"]
        figures += [f"trajectory_{variant}_kitti_{each}" for each in numbers]
    expected = {f"{name}.{kind}" for name in figures for kind in ("png", "pdf")}
    assert {p.name for p in out.glob("[!.]*")} == {*expected, *TABLE_FILES, "runs", "results"}
    assert (out / "figure4_published.pdf").read_bytes().startswith(b"%PDF")
    table = list(csv.DictReader(io.StringIO((out / "table1.csv").read_text(encoding="utf-8"))))
    assert [(row["sequence"], row["seeds"]) for row in table[2:4]] == [("kitti/02", "2")] * 2
    assert list(dict.fromkeys(row["variant"] for row in table)) == ["published", "kit"]
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    assert (metrics["missing"], metrics["failed"]) == (["kitti/08"], [])
    assert metrics["without_truth"] == ["kitti/11"]
    assert 0 < metrics["rows"][1]["te_percent"] < 5
    # 11 has no truth: its poses are there as KITTI's server takes them.
    found = sorted(p.relative_to(out / "results") for p in (out / "results").rglob("*.txt"))
    assert found == [Path(v) / m / "11.txt" for v in ("kit", "published") for m in ("mesvo_f", "viso2")]
    poses = read_kitti_poses(out / "results" / "kit" / "viso2" / "11.txt")
    run = read_kitti_poses(out / "runs" / "kit" / "kitti_11" / "viso2" / "seed_0" / "poses.txt")
    np.testing.assert_allclose(poses, run, atol=1e-9)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "kitti/08" in page
    assert page.count("<img") == page.count("data:image/png;base64,") == len(figures)


def test_a_run_that_fails_is_told_with_its_cause_while_the_others_finish(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = tree / "kitti" / "sequences" / "07" / "image_0" / "000003.png"
    image.write_bytes(image.read_bytes()[:300])
    assert reproduce(tree, "--sequences", "02,07", "--variant", "kit") == 1
    data = json.loads((tree / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert [row["sequence"] for row in data["rows"]] == ["kitti/02"] * 2
    assert {failure["job"].split(",")[0] for failure in data["failed"]} == {"kitti/07"}
    for told in (capsys.readouterr().out, (tree / "out" / "report.html").read_text(encoding="utf-8")):
        assert "000003.png" in told


def test_started_again_it_does_no_finished_run_again_unless_asked(tree: Path) -> None:
    def times(*words: str) -> dict[str, int]:
        assert reproduce(tree, "--sequences", "02", "--variant", "kit", *words) == 0
        return {str(path): path.stat().st_mtime_ns for path in (tree / "out" / "runs").rglob("poses.txt")}

    first = times("--jobs", "2")
    table = (tree / "out" / "table1.md").read_bytes()
    assert len(first) == 4
    assert times() == first
    assert (tree / "out" / "table1.md").read_bytes() == table
    assert all(time > first[path] for path, time in times("--fresh").items())


def test_a_sequence_by_its_path_is_a_row_like_any_other_and_its_doubts_are_said(
    bands: Path, tmp_path: Path
) -> None:
    for side in ("image_0", "image_1"):
        shutil.copy(bands / side / "000002.png", bands / side / "000003.png")
    words = ["--methods", "viso2", "--seeds", "1", "--cache", str(tmp_path / "cache")]
    assert main(["reproduce", "--sequences", str(bands), "--out", str(tmp_path / "out"), *words]) == 0
    text = (tmp_path / "out" / "table1.md").read_text(encoding="utf-8")
    # 2.5 m hold no sub-sequence of 20 m.
    assert "| bands | – | – |" in text
    assert text.startswith("Doubtful: bands: a pair equals the one before: 1 of 5")
    assert text.count("Doubtful") == 1
