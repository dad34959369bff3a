"""The bench runs on a tiny sequence and its figures belong together; how large they are is not tested."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands

from vo_lib import Sequence, open_sequence, preset
from vo_lib.commands import bench as command
from vo_lib.commands.bench_matches import feature_errors
from vo_lib.commands.bench_solver import BATCHES, PRECISION_MOTIONS, precision
from vo_lib.commands.bench_stages import Effort, describe_machine, peak_memory, run_bench
from vo_lib.commands.cli import main
from vo_lib.config import Config
from vo_lib.core import settings
from vo_lib.core.matches import StereoMatches, empty_matches
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.truth import open_truth

FIELDS = {
    "machine",
    "sequence",
    "ms_a_frame_of",
    "whole_run_ms_a_frame",
    "processor_ms_a_frame",
    "decoding_ms_a_frame",
    "back_end_from_cache_ms_a_frame",
    "peak_memory_mb",
    "five_point_us_a_set",
    "five_point_precision",
    "features",
    "detector",
}
LITTLE = Effort(repeats=1, problems=50, problems_of_others=5)


def small() -> Config:
    """Cells that suit the small images of the band sequence."""
    config: Config = settings.replace(preset("solution_selection"), "features.cell", 10)
    return config


def test_the_figures_of_a_tiny_sequence_are_complete_and_consistent(bands: Path) -> None:
    seen: list[tuple[int, int]] = []
    bench = run_bench(
        open_sequence(bands), "solution_selection", small(), LITTLE, lambda *at: seen.append(at)
    )
    data = json.loads(json.dumps(dataclasses.asdict(bench), allow_nan=False))
    assert data.keys() == FIELDS
    assert data["sequence"]["frames"] == 6
    assert data["sequence"]["matches_a_frame"] > 20
    stages = data["ms_a_frame_of"]
    assert list(stages)[:2] == ["wait_images", "matching"]
    assert {"filter", "rotation", "translation", "calibration"} <= stages.keys()
    assert all(ms >= 0 for ms in stages.values())
    # The first frame has no stages, and the whole run has more to do than its stages.
    assert 5 * sum(stages.values()) <= 6 * data["whole_run_ms_a_frame"]
    assert 0 < data["decoding_ms_a_frame"] < data["processor_ms_a_frame"]
    back_end = sum(stages[name] for name in ("rotation", "translation"))
    assert 0 < data["back_end_from_cache_ms_a_frame"] < 20 * back_end
    assert data["features"] is data["detector"] is None
    assert data["machine"]["numpy"] == np.__version__
    solver = data["five_point_us_a_set"]
    assert [f"this kit, batch of {batch}" for batch in BATCHES] == list(solver)[:2]
    assert "OpenCV findEssentialMat" in solver
    assert seen[-1][0] == seen[-1][1]
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_the_command_prints_json_and_a_table(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "Effort", lambda: LITTLE)
    options = ["bench", "--sequence", str(bands), "--frames", "3"]
    assert main([*options, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data.keys() == FIELDS
    assert data["sequence"]["frames"] == 3
    assert main(options) == 0
    printed = capsys.readouterr().out
    assert describe_machine()["processor"] in printed
    assert "planar_forward" in printed
    assert "street" not in printed


def test_the_cost_of_a_detector_is_measured_on_request(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "Effort", lambda: LITTLE)
    options = ["bench", "--sequence", str(bands), "--frames", "3", "--detector", "street"]
    assert main([*options, "--json"]) == 0
    cost = json.loads(capsys.readouterr().out)["detector"]
    assert cost["model"] == "street.onnx"
    assert cost["threads"] == 1
    assert cost["width_px"] % 32 == cost["height_px"] % 32 == 0
    assert 0 < cost["alone_ms_an_image"] < cost["whole_run_ms_a_frame"] * 3
    assert main(options) == 0
    assert "whole run with street.onnx" in capsys.readouterr().out


def test_the_default_is_the_first_kitti_sequence_or_a_drawn_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("KITTI_ROOT", "")
    if not command.default_sequence().startswith("kitti/"):  # data may lie beside the package
        assert command.default_sequence() == command.SCENE
    write_bands(tmp_path / "root" / "sequences" / "03", frames=2)
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path / "root"))
    assert command.default_sequence() == "kitti/03"


def test_precision_rows_compare_the_solvers_on_each_motion() -> None:
    rows = precision(300, 20)
    ours = [row for row in rows if row.solver == "this kit"]
    assert [row.motion for row in ours] == list(PRECISION_MOTIONS)
    assert all(row.problems == 300 and row.median < 1e-12 and row.share_imprecise == 0 for row in ours)
    opencv = [row for row in rows if row.solver == "OpenCV"]
    assert all(row.problems == 20 and row.median <= row.percentile_95 for row in opencv)


def test_there_are_no_feature_errors_without_truth_and_memory_is_told(bands: Path) -> None:
    assert feature_errors(open_sequence(bands), [empty_matches()] * 6, small()) is None
    memory = peak_memory()
    assert memory is None or 20 < memory < 20_000


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """A small street with parked cars."""
    config = scene_config("traffic", width=496, height=152, length=4.0, parked=0.9)
    return open_sequence(ensure_scene(config, tmp_path_factory.mktemp("scenes"), jobs=1))


def test_matches_are_compared_with_the_truth_inside_and_outside_boxes(drawn: Sequence) -> None:
    truth = open_truth(drawn.folder)
    uv = np.stack(np.meshgrid(np.arange(4.0, 492.0, 6.0), np.arange(4.0, 148.0, 6.0)), axis=-1).reshape(-1, 2)
    matches, known = [empty_matches()], []
    for frame in range(1, len(drawn)):
        _, prev_right, _ = truth.predict(frame - 1, frame - 1, uv)
        left, right, valid = truth.predict(frame - 1, frame, uv)
        views = uv, prev_right, left + np.array([0.25, 0.0]), right.copy()
        ones = np.ones(len(uv), np.int64)
        known.append(valid)
        found = StereoMatches(*views, ones, ones.astype(float), np.cumsum(ones))
        found.cur_left[::4] += 5.0  # every fourth is wrong, another one in the right image alone
        found.cur_right[1::4] += 5.0
        matches.append(found)
    errors = feature_errors(drawn, matches, small())
    assert errors is not None
    inside, outside = errors["inside boxes"], errors["outside boxes"]
    assert inside.matches + outside.matches == sum(map(len, matches))
    assert min(inside.matches, outside.matches) > 50
    assert inside.known_share is not None
    assert outside.known_share is not None
    share = inside.known_share * inside.matches + outside.known_share * outside.matches
    assert share == pytest.approx(np.count_nonzero(known), abs=1e-6)
    assert max(outside.known_share, inside.known_share) < 0.9  # the sky, and what leaves the images
    for part in (inside, outside):
        assert part.known_share is not None
        assert part.flow_share == pytest.approx(0.75, abs=0.08)
        assert part.right_share is not None
        assert part.beside_share is not None
        assert part.right_share == pytest.approx(0.5 * part.known_share, abs=0.08)
        assert part.right_share <= part.beside_share < 0.6
        assert part.median_error == pytest.approx(0.25, abs=1e-6)


def test_a_match_that_belongs_to_a_point_beside_is_counted_apart(drawn: Sequence) -> None:
    truth = open_truth(drawn.folder)
    uv = np.stack(np.meshgrid(np.arange(6.0, 490.0, 4.0), np.arange(6.0, 146.0, 4.0)), axis=-1).reshape(-1, 2)
    matches = [empty_matches()]
    for frame in range(1, len(drawn)):
        _, prev_right, _ = truth.predict(frame - 1, frame - 1, uv)
        left, right, valid = truth.predict(frame - 1, frame, uv)
        ones = np.ones(np.count_nonzero(valid), np.int64)
        # Said to be two pixels to the left of where they are: that matters at outlines only.
        a, b, c, d = ((view - [2.0, 0.0])[valid] for view in (uv, prev_right, left, right))
        matches.append(StereoMatches(a, b, c, d, ones, ones.astype(float), np.cumsum(ones)))
    errors = feature_errors(drawn, matches, small())
    assert errors is not None
    for part in errors.values():
        assert part.right_share is not None
        assert part.right_share < 0.99
        assert part.beside_share == 1.0


def test_where_no_match_is_there_is_no_share(drawn: Sequence) -> None:
    errors = feature_errors(drawn, [empty_matches()] * len(drawn), small())
    assert errors is not None
    assert errors["inside boxes"].matches == 0
    assert errors["inside boxes"].right_share is errors["inside boxes"].flow_share is None
