"""Chapter 7's panels: Table 1 is run and written; a threshold is tried; jobs; the part that is run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands

from course.ch07 import ExplorePanel, ReproducePanel
from course.ch07.figures import without_boxes
from course.ch07.runs import FIRST, Plan, clip, part_of, run_plan
from course.progress import Job
from vo_lib import open_sequence
from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import KITTI_MEASURE
from vo_lib.tables.comparison import read_stored_run

LONG = 300.0  # seconds that a job may take; a safeguard
SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
CLIPS = SHARED / "kitti_clips"
ON_CLIPS = pytest.mark.skipif(not CLIPS.is_dir(), reason="../shared/data/kitti_clips is not there")


@pytest.fixture
def road(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Forty-three frames, 21 m: sub-sequences of 20 m fit. Caches are in a folder of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return write_bands(tmp_path / "bands", 43)


def panel_of(road: Path) -> ReproducePanel:
    panel = ReproducePanel(str(road), frame=1, view__methods=("viso2", "mesvo_f"), view__seeds=2)
    panel.wait(LONG)
    return panel


def test_table_1_is_run_and_written(road: Path, tmp_path: Path) -> None:
    panel = panel_of(road)
    before = panel.picture.value
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.picture.value != before
    assert 0 < panel.facts["TE viso2"] < 5
    assert "viso2" in panel.tables.value
    stored = [read_stored_run(path.parent) for path in (tmp_path / "cache").rglob("metrics.json")]
    runs = {(run.method, run.variant, run.seed) for run in stored}
    assert runs == {(method, "published", seed) for method in ("viso2", "mesvo_f") for seed in (0, 1)}
    assert len(stored) == 4
    ran = panel.facts
    panel.set(view__seeds=1)
    assert "TE viso2" not in panel.facts
    panel.set(view__seeds=2)
    assert panel.facts == ran


def test_without_boxes_the_table_says_that_nothing_was_removed(road: Path) -> None:
    panel = ReproducePanel(str(road), frame=1, view__seeds=1, view__frames=24)
    panel.wait(LONG)
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert "No boxes: nothing was removed" in panel._text.value
    assert "No boxes: nothing was removed" in panel.tables.value


def test_the_explorer_refuses_what_is_the_kits_own_where_the_paper_is_chosen(road: Path) -> None:
    panel = ExplorePanel(str(road), frame=1)
    panel.wait(LONG)
    assert panel.frame.max == 29
    panel.set(view__variant="published", selection__sets=50)
    assert panel.error == ""
    assert panel.facts["TE"] != panel.facts["TE of the preset"]
    panel.set(selection__refine_scale=3.0)
    assert "the kit's own" in panel.error
    panel.set(
        selection__refine_scale=preset("mesvo_f").selection.refine_scale, view__method="moving_selection"
    )
    assert "the kit's own" in panel.error


def test_runs_can_be_stopped_and_gone_on_with(road: Path) -> None:
    panel = panel_of(road)
    bar = panel.job.box.children[0]
    bar.observe(lambda change: panel.job.stop() if change["new"] > 5 else None, "value")
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert "Stopped" in panel._message.value
    assert 5 < bar.value < bar.max
    assert "TE viso2" not in panel.facts
    bar.unobserve_all()
    panel.run()
    panel.wait(LONG)
    assert panel.facts["TE viso2"] > 0


@ON_CLIPS
def test_a_part_of_00_begins_where_its_truth_can_be_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(CLIPS))
    whole = open_sequence("kitti/00")
    part = part_of(whole, 50)
    assert (part.frames[0], len(part)) == ("000016", 50)
    assert part_of(whole, len(whole)) is whole
    assert part_of(whole, len(whole) - 1).frames[0] == "000001"
    assert part_of(open_sequence("kitti/01"), 50).frames[0] == "000000"
    # The images say that the car speeds up evenly; the truth before that frame does not follow them.
    matched = run_plan(Plan(whole.part(0, 60), ("solution_selection",), 1, "kit"))[0]
    true, found = (
        np.linalg.norm(np.diff(p[:, :3, 3], axis=0), axis=1) for p in (matched.truth, matched.poses)
    )
    off = np.abs(true - found)
    first = FIRST["kitti/00"]
    assert 0.17 < off[:first].max() < 0.19
    assert off[first:].max() < 0.06


@ON_CLIPS
def test_the_clip_of_the_row_has_the_boxes_of_a_detector(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("KITTI_ROOT", str(CLIPS))
    whole = clip(150)
    assert (whole.name, len(whole), whole.labels) == ("kitti/00", 150, None)
    monkeypatch.setattr(
        "course.ch07.runs.suitable_measure", lambda truth: KITTI_MEASURE
    )  # of twelve frames too
    part = clip(12, str(SHARED / "models" / "yolov8n_int8.onnx"))
    assert (part.name, part.frames[0]) == ("kitti/00", "000016")
    assert sum(len(part.boxes(frame)) for frame in range(12)) > 12
    entries = run_plan(Plan(part, ("feature_selection",), 1, "published"))
    assert entries[0].removed_share > 0
    assert without_boxes(entries) == []


@pytest.mark.parametrize("clips", [False, pytest.param(True, marks=ON_CLIPS)], ids=["none", "too short"])
def test_without_a_clip_of_100_m_the_row_is_of_the_drawn_street(
    street: Sequence, monkeypatch: pytest.MonkeyPatch, clips: bool
) -> None:
    if clips:
        monkeypatch.setenv("KITTI_ROOT", str(CLIPS))
    else:
        monkeypatch.setattr("course.ch07.runs.available", lambda: {})
    monkeypatch.setattr("course.ch07.runs.opened", lambda name, report: street)
    assert clip(12).folder == street.folder


def fail(error: Exception) -> None:
    raise error


def test_a_bar_is_there_while_work_goes_on() -> None:
    job = Job()
    shown: list[str] = []
    job.box.layout.observe(lambda change: shown.append(change["new"]), "display")
    job.start("counting", lambda report: report(1, 2), lambda _: None, fail)
    job.wait(LONG)
    assert shown == ["", "none"]


def test_one_waits_for_work_that_work_has_started() -> None:
    job = Job()
    done: list[int] = []

    def go_on(number: int) -> None:
        done.append(number)
        if number < 3:
            job.start("counting", lambda _: number + 1, go_on, fail)

    job.start("counting", lambda _: 1, go_on, fail)
    job.wait(LONG)
    assert done == [1, 2, 3]
