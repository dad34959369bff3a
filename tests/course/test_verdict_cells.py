"""The cells of chapter 7 that read a report answer, or say why not, whatever the report has."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_bands
from record_rows import record_row

from course.ch07 import figures
from course.ch07.plan import FIRST, part_of, table_hours
from vo_lib.config import VARIANTS
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.report.record import FORMAT, RECORD

CHAPTER = Path(__file__).parents[2] / "notebooks" / "07_reproduce_the_paper.ipynb"
PAIR = ("solution_selection", "feature_selection")
PIXEL = b"\x89PNG\r\n\x1a\n"


def sources() -> dict[str, str]:
    cells = json.loads(CHAPTER.read_text(encoding="utf-8"))["cells"]
    return {cell["id"]: "".join(cell["source"]) for cell in cells}


def run_cells(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[str, list[Any]]:
    """What the cells print and show for the report in a folder."""
    cells = sources()
    shown: list[Any] = []
    written: dict[str, Any] = {"display": shown.append}
    imports, _, _ = cells["cell-02"].partition("street = load")
    exec(imports, written)
    exec("paper = table1.read_paper_table()\ndrives = table1.PAPER_ROWS[1:]", written)
    written["Image"] = str
    written["show"] = lambda *pictures: shown.extend(pictures)
    given = cells["report"].replace('Path("runs/table1")', f"Path({str(folder)!r})")
    assert given != cells["report"]
    for code in (given, cells["report-figure"], cells["general"], cells["cell-chance"]):
        exec(code, written)
    return capsys.readouterr().out, shown


def row(sequence: str, method: str, **changes: Any) -> dict[str, Any]:
    usual = {
        "seeds": [0, 1, 2],
        "te_percent": [0.7, 0.71, 0.72],
        "re_deg_per_100m": [0.3, 0.31, 0.29],
    }
    return record_row(sequence, method) | usual | changes


def both(*names: str, **changes: Any) -> list[dict[str, Any]]:
    return [row(name, method, **changes) for name in names for method in PAIR]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (both("04"), "our whole sequences: no answer.* there are 1"),
        ([row("04", PAIR[0]), row("07", PAIR[1])], "our whole sequences: no answer.* there are 0"),
        (both("04", "07", removed_share=0.0), "our whole sequences: no answer.*no boxes: 04, 07"),
        (
            both("04", "07", te_percent=[0.7, None, 0.7]),
            "our whole sequences: no answer.*without errors: 04, 07",
        ),
        (
            both("04", "07", whole=False, frames=90),
            "our whole sequences: no answer.*part of the sequence: 04, 07",
        ),
        (both("04", "07", variant="kit"), "only rows of variant kit"),
        (both("04", "07", seeds=[0, 0, 0]), "The report cannot be used.*expected each seed once"),
        (both("04", "07", "10"), r"our whole sequences: .*\(3 sequences\)"),
    ],
)
def test_a_report_of_any_kind_gets_an_answer(
    rows: list[dict[str, Any]], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / RECORD).write_text(json.dumps({"format": FORMAT, "rows": rows}), encoding="utf-8")
    (tmp_path / "figure4_published.png").write_bytes(PIXEL)
    printed, shown = run_cells(tmp_path, capsys)
    assert re.search(words, printed), printed
    assert "nan" not in printed
    assert "There is no report" not in printed
    # The other claims, their charts and Figure 4 are there in any case.
    assert printed.count("   printed: -") == 4
    assert str(tmp_path / "figure4_published.png") in map(str, shown)
    assert len(shown) == 3


def test_without_a_report_the_cells_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed, _ = run_cells(tmp_path, capsys)
    assert "There is no report" in printed
    assert "No report, so no Figure 4." in printed
    assert printed.count("our whole sequences: not measured") == 4


def test_the_core_and_the_topic_below_it_print_the_same_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed, _ = run_cells(tmp_path, capsys)
    for change in ("-0.074 ± 0.112", "-0.020 ± 0.038"):
        assert printed.count(change) == 2


def results(folder: Path, rows: list[str]) -> Path:
    table = [
        "| sequence | mesvo_f | solution_selection | feature_selection |",
        "| --- | ---: | ---: | ---: |",
    ]
    text = "# Results\n\n## Variant published: TE, %\n\n" + "\n".join(table + rows) + "\n\n## Next\n"
    path = folder / "results.md"
    path.write_text(text, encoding="utf-8")
    return path


def test_clips_are_compared_over_one_length(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        "| kitti/00, 20 m | 1 | 2 | 3 |",
        "| kitti/00, 50 m | = | 5 | 6 |",
        "| kitti/00, 100 m | 7 | 8 | 9 |",
        "| kitti/drive_0013, 20 m, axes removed | 1 | 2 | 3 |",
        "| kitti/drive_0013, 50 m, axes removed | 1 | 2 | 4 |",
        "| synthetic/jam, 20 m | 1 | 2 | 3 |",
    ]
    monkeypatch.setattr("course.measured_results.RESULTS", results(tmp_path, rows))
    words, columns = figures.measured_columns(("mesvo_f", "feature_selection"), "te_percent")
    assert words == "over 50 m, axes removed on 0013"
    assert columns == [{"kitti/00": 5.0, "kitti/drive_0013": 1.0}, {"kitti/00": 6.0, "kitti/drive_0013": 4.0}]
    monkeypatch.setattr("course.measured_results.RESULTS", results(tmp_path, rows[2:4]))
    words, columns = figures.measured_columns(("mesvo_f", "feature_selection"), "te_percent")
    assert columns == [{}, {}]
    assert words == "over no length that all of them have"


@pytest.mark.parametrize("sequences", [3, 10])
def test_each_sequence_of_the_choices_has_its_own_colour_and_whole_name(sequences: int) -> None:
    cells = {f"kitti/drive_{number:04}": 1.0 + 0.1 * number for number in range(sequences)}
    made = figures.choices_figure({"measure of a candidate": {"number of inliers": cells}})
    (axis,) = made.axes
    lines = [line for line in axis.get_lines() if str(line.get_label()) in cells]
    assert len({str(line.get_color()) for line in lines}) == sequences
    made.canvas.draw()
    legend = axis.get_legend()
    assert legend is not None
    box = legend.get_window_extent()
    assert box.x1 <= made.bbox.x1
    names = [label.get_window_extent().x0 for label in axis.get_yticklabels()]
    assert min(names) >= 0


def test_a_part_of_a_part_begins_at_the_same_frame(drive_00: Sequence) -> None:
    first = FIRST["kitti/00"]
    for start, expected in ((0, first), (5, first), (first, first), (30, 30)):
        assert part_of(drive_00.part(start, len(drive_00)), 30).frames[0] == f"{expected:06d}"
    part = part_of(drive_00, 50)
    assert part_of(part, 30).frames == part.frames[:30]


def test_the_hours_of_the_table_are_those_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    sequence = open_sequence(str(write_bands(tmp_path / "bands", 8)))
    one = table_hours(sequence, 1, 1)
    assert one.keys() == VARIANTS.keys()
    assert all(np.isfinite(hours) and hours > 0 for hours in one.values())


@pytest.mark.parametrize("question", ["", "Would one run show it? "])
def test_sentences_on_the_removal_are_found_with_and_without_a_question(
    tmp_path: Path, question: str
) -> None:
    sentence = f"{question}Removal of the features in boxes lowers TE on a (1.000 → 0.500)."
    other = "For `viso2`, the rule `moving` in place of `none` lowers TE on a (1.000 → 0.500)."
    page = tmp_path / "results.md"
    page.write_text(
        f"# Results\n\n## Variant kit: TE, %\n\n{sentence}\n\n## Box rules\n\n{other}\n", encoding="utf-8"
    )
    assert figures.removal_sentences(page) == [f"Variant kit. {sentence}"]
    assert len(figures.removal_sentences()) == 4  # TE and RE of both variants


def test_chapter_7_begins_with_the_choices_made_after_numbers_were_seen() -> None:
    page = (CHAPTER.parent / "paper_and_code.md").read_text(encoding="utf-8")
    marked = [line.split("|")[1].strip() for line in page.splitlines() if "| *Numbers seen.*" in line]
    marked += [line.split("|")[1].strip() for line in page.splitlines() if " *Numbers seen.* At" in line]
    assert sorted(marked) == [
        "How are rows weighted?",
        "How are three frames used?",
        "What is MESVO_F?",
        'What is the "error" of a solution?',
    ]
    cells = sources()
    for words in ("the inlier threshold", "MESVO_F", "the weights of the rows", "the use of three frames"):
        assert words in cells["cell-01"]
        assert words.removeprefix("the ") in cells["cell-open"]
