"""Measuring scripts: speed, axes of the truth, choices, ideas and result tables."""

from __future__ import annotations

import pkgutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import winding_road
from data_command import load

import measure_choices
from measure.axes import axes_rotation, fit_axes, fit_of_halves, turn_axes
from measure.error_tables import compared, tables
from measure.result_tables import claim_table
from vo_lib.config import change, preset
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.poses import write_kitti_poses
from vo_lib.evaluation.kitti_errors import trajectory_distances
from vo_lib.geometry.motion import rigid, rotation_from_vector

LENGTHS = (20.0, 50.0)
TRUTH = winding_road(150, 0.04, 1.07)


def test_measure_speed_prints_all_rows(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for variant in ("published", "kit"):
        assert load("measure_speed")(["--sequence", str(bands), "--frames", "4", "--variant", variant]) == 0
        printed = capsys.readouterr().out
        assert f"numpy {np.__version__}" in printed
        for row in ("wait_images", "matching", "filter", "rotation", "translation", "times the decoding"):
            assert row in printed


@pytest.mark.parametrize(("pitch", "yaw"), [(0.5, -0.9), (-0.123, 0.0), (1.0, 1.0), (0.0, 0.0), (-2.6, 1.27)])
def test_fit_axes_recovers_pitch_and_yaw(pitch: float, yaw: float) -> None:
    fit = fit_axes(TRUTH, turn_axes(TRUTH, axes_rotation((pitch, yaw)).T), LENGTHS, 1)
    assert (fit.pitch, fit.yaw) == pytest.approx((pitch, yaw), abs=1e-6)
    assert fit.kitti.te == pytest.approx(0.0, abs=1e-4)
    x, y, _ = axes_rotation((0.5, 0.9)) @ np.array([0.0, 0.0, 1.0])
    assert x > 0 > y  # positive angles: the camera looks to the right and up


def test_angles_that_noise_decides_stay_below_one_degree() -> None:
    """Without a motion of its own, a path of noise has its smallest TE at any angle."""
    rng = np.random.default_rng(3)
    noise = np.tile(np.eye(4), (len(TRUTH), 1, 1))
    noise[1:, :3, 3] = np.cumsum(rng.normal(0, 0.6, (len(TRUTH) - 1, 3)), axis=0)
    fit = fit_axes(TRUTH, noise, LENGTHS, 1)
    assert fit.limit == 1.0
    assert max(abs(fit.pitch), abs(fit.yaw)) <= 1.0
    assert bool(fit.at_limit) == ("at the limit of 1°" in fit.limit_words)


def test_a_bend_of_the_path_is_told_apart_from_rotated_axes() -> None:
    """Drift in the first half of a path turns the axes of this half only."""
    drifted = [np.eye(4)]
    for index in range(1, len(TRUTH)):
        step = np.linalg.inv(TRUTH[index - 1]) @ TRUTH[index]
        yaw = 0.002 if index < len(TRUTH) // 2 else 0.0
        drifted.append(
            drifted[-1] @ step @ rigid(rotation_from_vector(np.array([0.0, yaw, 0.0])), np.zeros(3))
        )
    (_, first), (_, last) = fit_of_halves(TRUTH, np.array(drifted), LENGTHS, 1)
    assert abs(first) > 3 * abs(last) + 0.3
    turned = turn_axes(TRUTH, axes_rotation((0.4, 1.2)).T)
    for angles in fit_of_halves(TRUTH, turned, LENGTHS, 1):
        assert angles == pytest.approx((0.4, 1.2), abs=1e-6)


def test_measure_axes_prints_the_angles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_kitti_poses(tmp_path / "truth.txt", TRUTH)
    write_kitti_poses(tmp_path / "turned.txt", turn_axes(TRUTH, axes_rotation((0.25, -0.5)).T))
    words = [str(tmp_path / "truth.txt"), str(tmp_path / "turned.txt"), "--step", "1"]
    assert load("measure_axes")([*words, "--lengths", "20,50"]) == 0
    printed = capsys.readouterr().out
    assert "+0.250" in printed
    assert "-0.500" in printed
    assert "limit" not in printed
    assert "start first give pitch +0.250, yaw -0.500 deg; those that start last pitch +0.250" in " ".join(
        printed.split()
    )
    write_kitti_poses(tmp_path / "turned.txt", turn_axes(TRUTH, axes_rotation((0.25, -1.3)).T))
    assert load("measure_axes")([*words, "--lengths", "20,50"]) == 0
    printed = capsys.readouterr().out
    assert "-1.300" in printed
    assert "limit" not in printed
    write_kitti_poses(tmp_path / "turned.txt", turn_axes(TRUTH, axes_rotation((0.25, -3.5)).T))
    assert load("measure_axes")([*words, "--lengths", "20,50"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "note: the fitted yaw is at the limit of 1°, so TE is not the smallest TE over all" in printed
    write_kitti_poses(tmp_path / "turned.txt", TRUTH[:-1])
    assert load("measure_axes")(words) == 2
    assert "turned.txt: has 149 rows" in capsys.readouterr().err


def test_choices_exist_in_the_published_method() -> None:
    for _, name, answers in measure_choices.OPEN:
        for value in answers.values():
            if name.startswith("vo_lib."):
                assert pkgutil.resolve_name(name) is not value
            elif name != measure_choices.AS_PUBLISHED:
                change(preset("feature_selection"), name, value)


def test_each_run_of_a_choice_has_its_own_seed(bands: Path) -> None:
    """With one seed five times, the changes would be those against one run, and the deviation 0."""
    for alternative in measure_choices.alternatives_on(open_sequence(bands)):
        assert [alternative.config(seed).seed for seed in range(3)] == [0, 1, 2], alternative.choice


def test_a_choice_is_measured_once(bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second call reads the results, until a setting or the images differ."""
    sequence = open_sequence(bands)
    one, other = measure_choices.alternatives_on(sequence)[:2]
    assert (one.choice, one.words) == ("as published", "")
    results = measure_choices.stored_or_measured(one, tmp_path / "cache", tmp_path)
    assert results.shape == (measure_choices.SEEDS, 3)

    def not_again(*_: object) -> np.ndarray:
        raise AssertionError("measured again")

    monkeypatch.setattr(measure_choices, "measured", not_again)
    again = measure_choices.stored_or_measured(one, tmp_path / "cache", tmp_path)
    np.testing.assert_array_equal(again, results)
    for changed in (other, replace(one, sequence=sequence.part(0, len(sequence) - 1))):
        with pytest.raises(AssertionError, match="measured again"):
            measure_choices.stored_or_measured(changed, tmp_path / "cache", tmp_path)


def test_a_row_of_choices_has_the_changes_against_the_published_method(bands: Path) -> None:
    sequence = open_sequence(bands)
    published = np.array([[1.0, 2.0, 9.0], [1.2, 2.0, 11.0]])
    results = published + np.array([0.5, -1.0, 1.0])
    as_published, other = measure_choices.alternatives_on(sequence)[:2]
    whole = published[:, 2].mean() if sequence.truth is None else trajectory_distances(sequence.truth)[-1]
    row = measure_choices.row_of(other, results, published)
    assert row[:3] == [other.choice, other.words, sequence.name]
    assert [float(cell) for cell in row[3:8]] == pytest.approx([0.5, 0.0, -1.0, 0.0, 100.0 / whole], abs=1e-4)
    assert row[-1] == str(len(sequence))
    row = measure_choices.row_of(as_published, published, published)
    assert [float(cell) for cell in row[3:7]] == pytest.approx([1.1, 0.1414, 2.0, 0.0], abs=1e-4)


def test_result_tables_compare_two_methods() -> None:
    def row(te: float, deviation: float, mesvo_f: float) -> dict[str, np.ndarray]:
        cell = np.array([[te, deviation], [1.0, 0.0]])
        other = np.array([[mesvo_f, deviation], [1.0, 0.0]])
        return {
            "mesvo_f": other,
            "solution_selection": np.ones((2, 2)) * [1.0, 0.1],
            "feature_selection": cell,
        }

    cells = {"a": row(0.5, 0.1, 1.0), "b": row(1.5, 0.1, 2.0), "c": row(0.8, 0.1, 2.0)}
    sentences = compared(cells, "solution_selection", "feature_selection", "It")
    assert sentences[0].startswith(
        "Would one run show it? It lowers TE on a (1.000 → 0.500). TE is higher on b (1.000 → 1.500). "
        "In 1 of 3 rows, one run would not show the change"
    )
    assert "lowers RE on no row" in sentences[1]
    (row_a,) = claim_table({"a": cells["b"], "a, 5 m": cells["a"]}).rows
    assert row_a == ["a, 5 m", "1.00 / 1.00", "0.50 / 1.00"]
    te, re, spread, _ = tables("T", cells, sentences)
    assert te.rows[0] == ["a", "=", "1.000", "0.500"]
    assert te.rows[1] == ["b", "2.000", "1.000", "1.500"]
    assert (te.head, re.head) == (sentences, [])
    assert spread.rows[2] == ["c", "0.100", "0.100", "0.100"]
