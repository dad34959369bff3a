"""Chapter 7's long jobs: Table 1 is run, written, read back; a threshold is tried on all methods."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import write_bands

from course.ch07 import ExplorePanel, ReproducePanel
from course.ch07 import explore as ch07_explore
from course.ch07.explore import changes, known_poses, with_changes
from course.progress import Job
from vo_lib.config import METHODS, preset
from vo_lib.tables.paper import shipped_table

LONG = 300.0  # seconds that a job may take; a safeguard


@pytest.fixture
def road(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Forty-three frames, 21 m: sub-sequences of 20 m fit. Caches are in a folder of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return write_bands(tmp_path / "bands", 43)


def panel_of(road: Path) -> ReproducePanel:
    panel = ReproducePanel(str(road), frame=1, view__methods=("viso2", "mesvo_f"), view__seeds=2)
    panel.wait(LONG)
    return panel


def test_table_1_is_run_written_and_read_back(road: Path, tmp_path: Path) -> None:
    panel = panel_of(road)
    before = panel.picture.value
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.picture.value != before
    ran = panel.facts
    assert 0 < ran["TE viso2"] < 5
    assert "viso2" in panel.tables.value
    folders = sorted(path.parent for path in (tmp_path / "cache").rglob("metrics.json"))
    assert len(folders) == 4
    other = panel_of(road)
    other.set(view__seeds=1)
    assert "TE viso2" not in other.facts
    other.knobs["view.folder"].widget.value = str(folders[0].parents[2])
    other.wait(LONG)
    assert other.error == ""
    assert other.facts == pytest.approx(ran, rel=1e-4)
    panel.knobs["view.folder"].widget.value = str(tmp_path / "nowhere")
    panel.wait(LONG)
    assert "no run folder" in panel.error


def test_of_a_folder_with_both_variants_the_one_chosen_is_shown(road: Path, tmp_path: Path) -> None:
    panel = panel_of(road)
    ran = {}
    for variant in ("kit", "published"):
        panel.set(view__variant=variant, view__seeds=1)
        panel.run()
        panel.wait(LONG)
        assert panel.error == ""
        ran[variant] = panel.facts
    assert ran["kit"]["TE mesvo_f"] != ran["published"]["TE mesvo_f"]
    both = next((tmp_path / "cache").rglob("published")).parent
    assert (both / "kit").is_dir()
    panel.knobs["view.folder"].widget.value = str(both)
    panel.wait(LONG)
    for variant in ("kit", "published"):
        panel.set(view__variant=variant)
        panel.wait(LONG)
        assert panel.facts == pytest.approx(ran[variant], rel=1e-4)


def test_the_explorer_refuses_what_is_the_kits_own_where_the_paper_is_chosen(road: Path) -> None:
    panel = ExplorePanel(str(road), frame=1)
    panel.wait(LONG)
    panel.set(view__variant="published", selection__sets=50)
    panel.wait(LONG)
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


def test_the_papers_numbers_can_be_given(road: Path, tmp_path: Path) -> None:
    panel = panel_of(road)
    panel.run()
    panel.wait(LONG)
    panel.knobs["view.paper"].widget.value = str(tmp_path / "nowhere.csv")
    assert "nowhere.csv" in panel.error
    panel.knobs["view.paper"].widget.value = str(shipped_table())
    assert panel.error == ""


def test_a_run_for_a_slider_can_be_stopped_and_the_next_one_goes_on(
    road: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ch07_explore, "PATIENCE", 1e-9)
    panel = ExplorePanel(str(road), frame=1)
    panel.wait(LONG)
    before, bar = panel.picture.value, panel.job.box.children[0]
    shown: list[bool] = []

    def stop(change: dict[str, int]) -> None:
        shown.append(panel.job.box.layout.display == "")
        if change["new"] > 5:
            panel.job.stop()

    bar.observe(stop, "value")
    panel.set(selection__sets=30)
    assert any(shown)
    assert panel.job.box.layout.display == "none"
    assert panel.error == ""
    assert "Stopped" in panel._message.value
    assert panel.picture.value == before
    bar.unobserve_all()
    panel.knobs["selection.sets"].widget.value = 1
    panel.knobs["selection.mode"].widget.value = "literal"
    panel.wait(LONG)
    assert panel.error == panel._message.value == ""
    assert panel.facts["five-point sets"] == 1
    assert panel.picture.value != before


def fail(error: Exception) -> None:
    raise error


def test_short_work_shows_no_bar() -> None:
    job = Job()
    shown: list[str] = []
    job.box.layout.observe(lambda change: shown.append(change["new"]), "display")
    for after in (60.0, 0.0):
        job.start("counting", lambda report: report(1, 2), lambda _: None, fail, after=after)
        job.wait(LONG)
        assert shown == ([] if after else ["", "none"])


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


def test_all_methods_follow_a_changed_threshold(road: Path) -> None:
    panel = ExplorePanel(str(road), frame=1)
    panel.wait(LONG)
    assert panel.frame.max == 39
    panel.set(selection__sets=1, selection__mode="literal")
    assert panel.error == ""
    here = panel.state()
    changed = changes(panel.start, here.config, tuple(panel.knobs))
    assert changed == {"selection.sets": 1, "selection.mode": "literal"}
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    for method in METHODS:
        config = with_changes(preset(method, seed=2), changed)
        assert known_poses(here.sequence, config) is not None
        assert known_poses(here.sequence, preset(method, seed=2)) is not None
