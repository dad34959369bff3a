"""Panels of chapter 7: the run of Table 1, and the part of a sequence for this run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_bands
from real_images import KITTI_00, SHARED, RealImages

from course.ch07 import ExplorePanel, ReproducePanel
from course.ch07.figures import tables_of
from course.ch07.plan import FIRST, Plan, clip, part_of, run_plan
from course.measured_results import results_table
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import KITTI_PROTOCOL

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


def test_a_path_without_a_sub_sequence_is_reported(road: Path) -> None:
    panel = panel_of(road)
    panel.set(view__frames=20)
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert "shorter than the shortest sub-sequence, 20 m" in panel._text.value
    assert panel.tables.value == ""


def test_a_part_of_00_begins_where_its_truth_is_accurate(drive_00: Sequence) -> None:
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
        "course.ch07.plan.suitable_protocol", lambda truth: KITTI_PROTOCOL
    )  # too short for it
    part = clip(12, str(model))
    assert (part.name, part.frames[0]) == ("kitti/00", "000016")
    assert sum(len(part.boxes(frame)) for frame in range(12)) > 12
    entries = run_plan(Plan(part, ("feature_selection",), 1, "published"))
    assert entries[0].removed_share > 0
    assert tables_of(entries) == []  # no sub-sequence is so short


def test_results_are_as_the_head_of_chapter_7_says() -> None:
    text = (Path(__file__).parents[2] / "notebooks" / "results.md").read_text(encoding="utf-8")
    published = text.split("## Variant published: standard")[0]
    lowered = {}
    on_clips = {}
    for kind in ("TE", "RE"):
        (line,) = [line for line in published.splitlines() if f"boxes lowers {kind} on" in line]
        assert f"{kind} is higher on no row" in line
        rows = line.split(f". {kind} is higher")[0]
        lowered[kind] = set(re.findall(r"synthetic/\w+", rows))
        on_clips[kind] = re.findall(r"kitti/\w+, \d+ m", rows)
    assert lowered["TE"] == lowered["RE"] == {"synthetic/jam", "synthetic/highway"}
    assert on_clips == {"TE": [], "RE": ["kitti/drive_0013, 20 m"]}
    kit = text.split("## Variant kit: TE")[1]
    assert "RE is higher on kitti/drive_0013, 50 m" in kit


@pytest.mark.usefixtures("street")
def test_the_answers_below_the_panel_of_thresholds_are_true() -> None:
    panel = ExplorePanel("synthetic/traffic", frame=20)
    panel.wait(LONG)

    def errors(**settings: Any) -> dict[str, float]:
        panel.set(**{"selection__sets": 200, "seed": 0, "translation__max_depth": 100.0} | settings)
        return panel.facts

    assert (
        errors(selection__sets=8)["RE"] < 2 * errors()["RE of the preset"] < errors(selection__sets=5)["RE"]
    )
    by_seed = [errors(selection__sets=5, seed=seed)["RE"] for seed in range(6)]
    assert (round(min(by_seed), 1), round(max(by_seed), 1)) == (0.9, 3.4)
    near = errors(translation__max_depth=15.0)
    assert near["RE"] == near["RE of the preset"]
    assert near["TE"] != near["TE of the preset"]


def test_results_are_as_chapter_6_and_the_appendix_say() -> None:
    rows = results_table("Other systems on the same frames", "kitti/00, 100 m").rows
    for errors in zip(*(map(float, row[1:]) for row in rows), strict=True):
        assert max(errors) < 2 * min(errors)
    for _, off, learnt in results_table("Effect of the estimated calibration: TE, %", "kitti/01").rows:
        assert float(learnt) < 0.5 * float(off)
