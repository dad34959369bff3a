"""Panels of chapter 7: the run of Table 1, and the part of a sequence for this run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands
from real_images import KITTI_00, SHARED, RealImages

from course.ch07 import ReproducePanel
from course.ch07.figures import results_table, tables_of, verdicts
from course.ch07.runs import FIRST, Plan, clip, part_of, run_plan
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import KITTI_PROTOCOL
from vo_lib.report.table1 import read_paper_table

LONG = 300.0  # seconds that a job may take; a safeguard


@pytest.fixture
def road(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The first 43 frames, 21 m, for sub-sequences of 20 m. The caches are in a temporary folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return write_bands(tmp_path / "bands", 43)


def panel_of(road: Path) -> ReproducePanel:
    panel = ReproducePanel(str(road), frame=1, view__methods=("viso2", "mesvo_f"), view__seeds=2)
    panel.wait(LONG)
    return panel


def test_table_1_is_run(road: Path) -> None:
    panel = panel_of(road)
    before = panel.picture.value
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.picture.value != before
    assert "viso2" in panel.tables.value
    assert "mean ± standard deviation over 2 seeds" in panel.tables.value.lower()
    ran = panel.tables.value
    panel.set(view__seeds=1)
    assert panel.tables.value == ""
    panel.set(view__seeds=2)
    assert panel.tables.value == ran


def test_a_part_of_00_begins_where_its_truth_can_be_believed(drive_00: Sequence) -> None:
    whole = drive_00
    part = part_of(whole, 50)
    assert (part.frames[0], len(part)) == ("000016", 50)
    assert part_of(whole, len(whole)) is whole
    assert part_of(whole, len(whole) - 1).frames[0] == "000001"
    # In the images, the car accelerates evenly; the truth before that frame disagrees.
    ran = run_plan(Plan(whole.part(0, 60), ("solution_selection",), 1, "kit"))[0]
    true, estimated = (np.linalg.norm(np.diff(p[:, :3, 3], axis=0), axis=1) for p in (ran.truth, ran.poses))
    off, first = np.abs(true - estimated), FIRST["kitti/00"]
    assert 0.17 < off[:first].max() < 0.2
    assert off[first:].max() < 0.06


def test_the_clip_of_the_row_has_the_boxes_of_a_detector(
    tmp_path: Path, real: RealImages, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SHARED / "models" / "yolov8n_int8.onnx"
    if not model.exists():
        pytest.skip("the detectors are not beside this checkout (shared/data/models)")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("KITTI_ROOT", str(real.root(*KITTI_00)))
    whole = clip(150)
    assert (whole.name, len(whole), whole.labels) == ("kitti/00", 150, None)
    monkeypatch.setattr(
        "course.ch07.runs.suitable_protocol", lambda truth: KITTI_PROTOCOL
    )  # too short for it
    part = clip(12, str(model))
    assert (part.name, part.frames[0]) == ("kitti/00", "000016")
    assert sum(len(part.boxes(frame)) for frame in range(12)) > 12
    entries = run_plan(Plan(part, ("feature_selection",), 1, "published"))
    assert entries[0].removed_share > 0
    assert tables_of(entries) == []  # no sub-sequence is so short


def test_printed_number_is_reproduced_only_within_the_spread_of_seeds(tmp_path: Path) -> None:
    paper = read_paper_table()
    assert verdicts(tmp_path, paper) == []
    names = "variant,sequence,method,seeds,paper_te_percent,paper_re_deg_per_100m,te_percent,te_percent_std,"
    names += "re_deg_per_100m,re_deg_per_100m_std,removed_share"
    rows = [
        "published,kitti/04,viso2,5,1.02,0.866,1.04,0.01,0.9,0.01,0",  # TE within t s √1.2 + 0.005, RE beyond
        "published,kitti/04,mesvo_f,1,0.75,0.222,0.75,,0.222,,0",
        "published,kitti/00,viso2,5,,,2.46,0.01,1.181,0.01,0",
        "published,kitti/04,feature_selection,5,0.64,0.128,0.64,0.01,0.128,0.01,0.0",
        "kit,kitti/04,feature_selection,5,0.64,0.128,0.64,0.01,0.128,0.01,0.1",
    ]
    (tmp_path / "table1.csv").write_text("\n".join([names, *rows]) + "\n", encoding="utf-8")
    te, re = ({row[0]: row for row in table.rows} for table in verdicts(tmp_path, paper))
    assert te["04 VISO2"][1:] == ["1.02", "1.040", "+0.02", "0.035", "reproduced"]
    assert re["04 VISO2"][-1] == "not reproduced"
    assert te["04 MESVO_F"][-1] == "no verdict: fewer than three seeds"
    assert te["00 VISO2"][2:] == ["–", "–", "–", "no verdict: part of the sequence"]
    assert set(te) == {"04 VISO2", "04 MESVO_F", "00 VISO2", "04 Feature selection"}
    assert te["04 Feature selection"][-1] == "no verdict: no boxes"


def test_results_are_as_chapter_6_and_the_appendix_say() -> None:
    rows = results_table("Other systems on the same frames", "kitti/00, 100 m").rows
    for errors in zip(*(map(float, row[1:]) for row in rows), strict=True):
        assert max(errors) < 2 * min(errors)
    for _, off, learnt in results_table("Effect of the estimated calibration: TE, %", "kitti/01").rows:
        assert float(learnt) < 0.5 * float(off)
