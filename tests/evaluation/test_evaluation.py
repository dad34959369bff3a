"""KITTI errors, ATE and RPE: known cases, invariances, and slow or foreign implementations as oracles."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_entries import straight

from vo_lib.commands.cli import main
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import nearest_rotation, rigid, rotation_from_vector
from vo_lib.core.poses import read_by_time, read_kitti_poses, read_tum, write_kitti_poses, write_tum
from vo_lib.core.types import Array
from vo_lib.evaluation.ate_rpe import Alignment, absolute_error, align, relative_error
from vo_lib.evaluation.evaluate import Evaluation, evaluate
from vo_lib.evaluation.kitti import KITTI_BIN_MINIMUM, KITTI_LENGTHS, KittiErrors, kitti_errors

KITTI_TRUTH = Path(__file__).resolve().parents[3] / "shared" / "data" / "kitti_poses"
BENCHMARK = KITTI_TRUTH.parent / "benchmark"
# With steps of 1.07 m no path ends within 0.1 m of these, so that rounding cannot move an end frame.
STEP_LENGTH, LENGTHS = 1.07, (20.0, 50.0, 105.0)

seeds = st.integers(0, 2**32 - 1)


def chain(motions: Array) -> Array:
    """Poses (N+1, 4, 4) from identity along motions (N, 4, 4) from each frame to the next."""
    T = [np.eye(4)]
    for motion in motions:
        T.append(T[-1] @ motion)
    return np.array(T)


def random_motions(rng: np.random.Generator, n: int, turn: float, length: float) -> Array:
    motions = np.tile(np.eye(4), (n, 1, 1))
    motions[:, :3, :3] = rotation_from_vector(rng.normal(0.0, turn, (n, 3)))
    direction = rng.normal([0.0, 0.0, 1.0], 0.1, (n, 3))
    motions[:, :3, 3] = length * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return motions


def random_pair(seed: int, n: int = 140) -> tuple[Array, Array]:
    """A winding path of equal steps and an estimate of it that drifts."""
    rng = np.random.default_rng(seed)
    motions = random_motions(rng, n - 1, 0.05, STEP_LENGTH)
    return chain(motions), chain(motions @ random_motions(rng, n - 1, 0.002, 0.01))


def random_rigid(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rigid(rotation_from_vector(rng.normal(size=3)), rng.normal(0.0, 100.0, 3))


def drifting(truth: Array, seed: int) -> Array:
    """An estimate of a KITTI truth with noise in rotation and translation and 0.3 % of scale."""
    rng = np.random.default_rng(seed)
    T = truth.copy()
    T[:, :3, :3] = [nearest_rotation(R) for R in T[:, :3, :3]]
    motions = np.linalg.inv(T[:-1]) @ T[1:]
    motions[:, :3, 3] *= 1.003
    return chain(motions @ random_motions(rng, len(motions), 5e-4, 0.005))


def literal_kitti_errors(
    truth: Array, estimate: Array, lengths: tuple[float, ...], step: int
) -> list[tuple[float, ...]]:
    """The benchmark's definition, one sub-sequence at a time, path lengths in single precision.

    So are errors over its own lengths; others are in double precision.
    """
    path = [np.float32(0.0)]
    for before, after in zip(truth[:-1, :3, 3], truth[1:, :3, 3], strict=True):
        dx, dy, dz = (after - before).astype(np.float32)
        path.append(np.float32(float(path[-1]) + math.sqrt(dx * dx + dy * dy + dz * dz)))
    plain = [float(d) for d in path]
    rows: list[tuple[float, ...]] = []
    for first in range(0, len(truth), step):
        for length in lengths:
            end = float(path[first] + np.float32(length))
            last = next((i for i in range(first, len(truth)) if plain[i] > end), -1)
            if last == -1:
                continue
            true_motion = np.linalg.inv(truth[first]) @ truth[last]
            motion = np.linalg.inv(estimate[first]) @ estimate[last]
            error = np.linalg.inv(motion) @ true_motion
            real = np.float32 if length in KITTI_LENGTHS else np.float64
            a, b, c = real(error[0, 0]), real(error[1, 1]), real(error[2, 2])
            cosine = float(real(0.5 * (float(a + b + c) - 1.0)))
            r_err = float(real(math.acos(max(min(cosine, 1.0), -1.0))))
            t_err = math.sqrt(sum(error[i, 3] ** 2 for i in range(3)))
            speed = float(np.float32(length / (0.1 * (last - first + 1))))
            rows.append((first, last, length, t_err / length, r_err / length, speed))
    return rows


def assert_equals_literal(errors: KittiErrors, rows: list[tuple[float, ...]]) -> None:
    first, last, length, t_err, r_err, speed = np.array(rows).T
    np.testing.assert_array_equal(errors.first, first)
    np.testing.assert_array_equal(errors.last, last)
    np.testing.assert_array_equal(errors.length, length)
    np.testing.assert_array_equal(errors.speed, speed)
    single = np.isin(length, KITTI_LENGTHS)
    for chosen, relative in ((single, 2e-7), (~single, 1e-9)):
        np.testing.assert_allclose(errors.t_err[chosen], t_err[chosen], rtol=relative, atol=1e-12)
    np.testing.assert_allclose(errors.r_err, r_err, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("name", ["02", "06", "08"])
def test_errors_equal_the_development_kit_s_own_output_in_every_printed_digit(name: str) -> None:
    if not BENCHMARK.exists():
        pytest.skip("the benchmark's output is not in ../shared/data")
    truth, estimate = (read_kitti_poses(folder / f"{name}.txt") for folder in (KITTI_TRUTH, BENCHMARK))
    first, r_err, t_err, length, speed = np.loadtxt(BENCHMARK / f"{name}_errors.txt").T
    errors = kitti_errors(truth, estimate)
    np.testing.assert_array_equal(errors.first, first)
    np.testing.assert_array_equal(errors.length, length)
    # Speeds tell where each sub-sequence ends: one frame more or less is 0.006 m/s or more.
    np.testing.assert_allclose(errors.speed, speed, rtol=0.0, atol=2e-6)
    np.testing.assert_allclose(errors.t_err, t_err, rtol=0.0, atol=5.0001e-7)
    np.testing.assert_allclose(errors.r_err, r_err, rtol=0.0, atol=5.0001e-7)


@pytest.mark.parametrize("step_length", [0.1, 0.25, 0.3, 1.0, 1.3])
def test_kitti_errors_equal_the_literal_definition_where_paths_end_on_a_length(step_length: float) -> None:
    truth = straight(1200, step_length)
    estimate = drifting(truth, seed=3)
    errors = kitti_errors(truth, estimate, (50.0, 100.0, 105.5), step=7)
    assert len(errors) > 10
    assert_equals_literal(errors, literal_kitti_errors(truth, estimate, (50.0, 100.0, 105.5), 7))


def test_one_percent_of_scale_gives_one_percent_of_the_path_driven() -> None:
    truth = straight(500)
    errors = kitti_errors(truth, straight(500, 1.01))
    # Steps of 1 m: the first path longer than 100 m is 101 m, and is still divided by 100.
    for length, part in errors.by_length().items():
        if length < 500:
            assert set(part.last - part.first) == {int(length) + 1}
            assert part.te == pytest.approx((length + 1) / length, rel=1e-7)  # in single precision
            assert part.re == pytest.approx(0.0, abs=1e-5)
        else:
            assert len(part) == 0
            assert part.te is None


def test_a_constant_yaw_drift_gives_its_angle_per_hundred_metres() -> None:
    truth = straight(450)
    turn = rigid(rotation_from_vector(np.array([0.0, math.radians(0.01), 0.0])), np.array([0.0, 0.0, 1.0]))
    # Over KITTI's own lengths the single precision of its cosine is 2e-4 of an angle of 1°.
    for lengths, digits in (((100.0, 200.0, 300.0, 400.0), 1e-3), ((110.0, 210.0, 310.0, 410.0), 1e-6)):
        errors = kitti_errors(truth, chain(np.tile(turn, (449, 1, 1))), lengths)
        for length, part in errors.by_length(lengths).items():
            assert part.re == pytest.approx(0.01 * (length + 1) * 100 / length, rel=digits)


def test_speed_bins_overlap_and_leave_out_their_edges() -> None:
    speed = np.array([2.0, 3.9, 4.0, 5.0, 6.0, 30.0])
    n = np.arange(len(speed))
    errors = KittiErrors(n, n, np.full(6, 100.0), np.linspace(0.0, 0.05, 6), np.zeros(6), speed)
    bins = errors.by_speed()
    assert list(bins) == [2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24]
    assert bins[2].speed.tolist() == [2.0, 3.9]
    assert bins[4].speed.tolist() == [3.9, 4.0, 5.0]
    assert bins[4].te == pytest.approx(2.0)
    assert bins[8].te is None


def test_identical_trajectories_have_no_error_even_when_printed_with_seven_digits() -> None:
    truth, _ = random_pair(5, 400)
    printed = np.round(truth, 7)
    errors = kitti_errors(printed, printed, LENGTHS, step=1)
    assert len(errors) > 500
    assert errors.t_err.max() < 1e-12
    # acos near 1 turns rounding of 1e-16 into 1e-8; the transpose as inverse would give 4e-4.
    assert (errors.r_err * errors.length).max() < 1e-7
    assert absolute_error(printed, printed).distance.max() < 1e-9


@given(seed=seeds, world=seeds)
@settings(max_examples=25)
def test_another_world_frame_changes_no_error(seed: int, world: int) -> None:
    truth, estimate = random_pair(seed)
    moved = random_rigid(world)
    errors = kitti_errors(truth, estimate, LENGTHS)
    for other in (
        kitti_errors(moved @ truth, moved @ estimate, LENGTHS),
        kitti_errors(truth, moved @ estimate, LENGTHS),
    ):
        np.testing.assert_array_equal(other.last, errors.last)
        np.testing.assert_allclose(other.t_err, errors.t_err, atol=1e-10)
        np.testing.assert_allclose(other.r_err, errors.r_err, atol=1e-8)
    ate, rpe = absolute_error(truth, estimate), relative_error(truth, estimate)
    np.testing.assert_allclose(absolute_error(truth, moved @ estimate).distance, ate.distance, atol=1e-8)
    moved_rpe = relative_error(moved @ truth, estimate)
    np.testing.assert_allclose(moved_rpe.translation, rpe.translation, atol=1e-10)
    np.testing.assert_allclose(moved_rpe.rotation, rpe.rotation, atol=1e-10)
    assert errors.te is not None
    assert errors.te > 0.01


@given(seed=seeds, world=seeds, scale=st.floats(0.2, 5.0))
@settings(max_examples=25)
def test_alignment_finds_the_motion_and_scale_that_made_the_estimate(
    seed: int, world: int, scale: float
) -> None:
    truth, _ = random_pair(seed)
    moved = random_rigid(world) @ truth
    for alignment in (Alignment.ORIGIN, Alignment.SE3, Alignment.SIM3):
        aligned, found = align(truth, moved, alignment)
        np.testing.assert_allclose(aligned, truth, atol=1e-8)
        assert found == pytest.approx(1.0)
    scaled = moved.copy()
    scaled[:, :3, 3] *= scale
    aligned, found = align(truth, scaled, Alignment.SIM3)
    np.testing.assert_allclose(aligned, truth, atol=1e-7)
    assert found == pytest.approx(1.0 / scale)


@given(seed=seeds, world=seeds)
@settings(max_examples=20)
def test_no_other_motion_gives_a_smaller_ate_than_the_alignment(seed: int, world: int) -> None:
    truth, estimate = random_pair(seed)
    best = absolute_error(truth, estimate).to_dict()["rmse_m"]
    aligned, _ = align(truth, estimate, Alignment.SE3)
    rng = np.random.default_rng(world)
    nudge = rigid(rotation_from_vector(rng.normal(0.0, 1e-3, 3)), rng.normal(0.0, 1e-2, 3))
    assert best < absolute_error(truth, nudge @ aligned, Alignment.NONE).to_dict()["rmse_m"]
    assert absolute_error(truth, estimate, Alignment.SIM3).to_dict()["rmse_m"] <= best
    assert best < absolute_error(truth, estimate, Alignment.ORIGIN).to_dict()["rmse_m"]


def test_ate_of_a_shifted_and_of_a_mirrored_path() -> None:
    truth, _ = random_pair(1)
    shifted = rigid(np.eye(3), np.array([3.0, 0.0, 4.0])) @ truth
    none = absolute_error(truth, shifted, Alignment.NONE)
    np.testing.assert_allclose(none.distance, 5.0)
    assert none.to_dict() == pytest.approx(
        {"alignment": "none", "scale": 1.0, "rmse_m": 5.0, "mean_m": 5.0, "median_m": 5.0, "max_m": 5.0}
    )
    mirrored = truth.copy()
    mirrored[:, 0, 3] *= -1
    aligned, _ = align(truth, mirrored, Alignment.SE3)
    assert np.linalg.det(aligned[:, :3, :3]).min() > 0.99


def test_standing_still_aligns_without_a_scale() -> None:
    still = np.tile(np.eye(4), (5, 1, 1))
    aligned, scale = align(straight(5), still, Alignment.SIM3)
    assert scale == 1.0
    np.testing.assert_allclose(aligned[:, :3, 3], np.tile([0.0, 0.0, 2.0], (5, 1)))


def test_rpe_is_the_drift_of_each_pair_of_frames() -> None:
    truth = straight(11)
    turn = rigid(rotation_from_vector(np.array([0.0, 0.02, 0.0])), np.array([0.0, 0.3, 1.4]))
    estimate = chain(np.tile(turn, (10, 1, 1)))
    rpe = relative_error(truth, estimate)
    np.testing.assert_allclose(rpe.translation, np.full(10, 0.5))
    np.testing.assert_allclose(rpe.rotation, np.full(10, 0.02))
    assert rpe.to_dict()["rotation"]["rmse_deg"] == pytest.approx(math.degrees(0.02))
    assert relative_error(truth, estimate, 5).rotation.tolist() == pytest.approx([0.1, 0.1])
    assert relative_error(truth, estimate, 11).to_dict()["translation"]["rmse_m"] is None


def test_pooled_weighs_sub_sequences_and_the_plain_mean_sequences() -> None:
    result = evaluate(
        [
            ("long", straight(500), straight(500, 1.01)),
            ("short", straight(150), straight(150, 1.02)),
            ("tiny", straight(30), straight(30, 1.5)),
        ],
        lengths=(100.0,),
    )
    counts = [len(s.kitti) for s in result.sequences]
    assert counts == [40, 5, 0]
    assert [s.kitti.te for s in result.sequences] == [pytest.approx(1.01), pytest.approx(2.02), None]
    assert result.pooled.te == pytest.approx((40 * 1.01 + 5 * 2.02) / 45)
    assert result.mean()["te_percent"] == pytest.approx((1.01 + 2.02) / 2)
    assert result.mean()["sequences"] == ["long", "short"]


def test_json_has_every_table_and_null_where_a_path_is_too_short() -> None:
    def strict(result: Evaluation) -> dict[str, Any]:
        return dict(json.loads(json.dumps(result.to_dict(), allow_nan=False)))

    data = strict(evaluate([("00", straight(300), straight(300, 1.01))], (100.0, 800.0)))
    assert (data["lengths_m"], data["step_frames"]) == ([100.0, 800.0], 10)
    (sequence,) = data["sequences"]
    assert (sequence["name"], sequence["frames"]) == ("00", 300)
    assert sequence["distance_m"] == pytest.approx(299.0)
    assert sequence["ate"]["alignment"] == "se3"
    assert sequence["rpe"]["translation"]["rmse_m"] == pytest.approx(0.01)
    at_100, at_800 = sequence["by_length"]
    assert at_100["length_m"] == 100.0
    assert at_100["te_percent"] == data["pooled"]["te_percent"] == pytest.approx(1.01)
    assert at_800 == {"length_m": 800.0, "subsequences": 0, "te_percent": None, "re_deg_per_100m": None}
    short = strict(evaluate([("clip", straight(1), straight(1))]))
    assert short["pooled"]["te_percent"] is None
    assert short["mean"] == {"sequences": [], "te_percent": None, "re_deg_per_100m": None}
    assert short["sequences"][0]["rpe"]["rotation"]["mean_deg"] is None


def test_input_that_cannot_be_evaluated_is_refused() -> None:
    path, broken = straight(10), straight(10)
    broken[4, 0, 3] = np.nan
    faults = {"truth has 10 poses and the estimate 9": path[:9], "pose 4 of the estimate": broken}
    for said, estimate in faults.items():
        with pytest.raises(DataError, match=f"sequence 07: {said}"):
            evaluate([("07", path, estimate)])
    with pytest.raises(DataError, match="nothing to evaluate"):
        evaluate([])
    for lengths in ((), (0.0,), (-1.0,), (math.nan,), (math.inf,)):
        with pytest.raises(DataError, match="lengths: expected positive"):
            kitti_errors(path, path, lengths)
    with pytest.raises(DataError, match="step: expected 1"):
        kitti_errors(path, path, step=0)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_ate_and_rpe_equal_those_of_evo(seed: int) -> None:
    metrics = pytest.importorskip("evo.core.metrics", reason="evo is not installed")
    trajectory = pytest.importorskip("evo.core.trajectory")
    truth, estimate = random_pair(seed)
    estimate[:, :3, 3] *= 1.1
    for alignment in (Alignment.NONE, Alignment.ORIGIN, Alignment.SE3, Alignment.SIM3):
        reference = trajectory.PosePath3D(poses_se3=list(truth))
        other = trajectory.PosePath3D(poses_se3=list(estimate))
        if alignment is Alignment.ORIGIN:
            other.align_origin(reference)
        elif alignment is not Alignment.NONE:
            other.align(reference, correct_scale=alignment is Alignment.SIM3)
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data((reference, other))
        np.testing.assert_allclose(absolute_error(truth, estimate, alignment).distance, ape.error, atol=1e-8)
    pair = (trajectory.PosePath3D(poses_se3=list(truth)), trajectory.PosePath3D(poses_se3=list(estimate)))
    for delta in (1, 7):
        ours = relative_error(truth, estimate, delta)
        for relation, errors in (
            (metrics.PoseRelation.translation_part, ours.translation),
            (metrics.PoseRelation.rotation_angle_rad, ours.rotation),
        ):
            rpe = metrics.RPE(relation, delta=delta, delta_unit=metrics.Unit.frames)
            rpe.process_data(pair)
            np.testing.assert_allclose(errors, rpe.error, atol=1e-8)


def test_evo_reads_our_files_as_we_do_and_we_its(tmp_path: Path) -> None:
    interface = pytest.importorskip("evo.tools.file_interface", reason="evo is not installed")
    truth, _ = random_pair(0)
    truth[:, :3, :3] = [nearest_rotation(R) for R in truth[:, :3, :3]]
    write_kitti_poses(tmp_path / "kitti.txt", truth)
    path = interface.read_kitti_poses_file(tmp_path / "kitti.txt")
    np.testing.assert_allclose(path.poses_se3, truth, atol=1e-7)
    write_tum(tmp_path / "tum.txt", 1e9 + np.arange(0.0, len(truth)) / 10, truth)
    trajectory = interface.read_tum_trajectory_file(tmp_path / "tum.txt")
    assert trajectory.check()[0]
    np.testing.assert_allclose(trajectory.poses_se3, truth, atol=1e-7)
    interface.write_tum_trajectory_file(tmp_path / "evo.txt", trajectory)
    _, _, (ours,) = read_by_time(tmp_path / "tum.txt", [tmp_path / "evo.txt"], read_tum)
    np.testing.assert_allclose(ours, truth, atol=1e-6)


def test_poses_of_two_clocks_go_together_by_time_as_in_evo(tmp_path: Path) -> None:
    truth, estimate = random_pair(4, 60)
    rng = np.random.default_rng(4)
    times = np.arange(0.0, 60) / 10
    kept = np.sort(rng.choice(60, 40, replace=False))
    write_tum(tmp_path / "truth.txt", times, truth)
    write_tum(tmp_path / "estimate.txt", times[kept] + rng.uniform(-0.008, 0.008, 40), estimate[kept])
    paths = {"truth": truth, "estimate": estimate}
    for first, second in (("truth", "estimate"), ("estimate", "truth")):
        _, a, (b,) = read_by_time(tmp_path / f"{first}.txt", [tmp_path / f"{second}.txt"], read_tum)
        np.testing.assert_allclose(a, paths[first][kept], atol=1e-6)
        np.testing.assert_allclose(b, paths[second][kept], atol=1e-6)
    write_tum(tmp_path / "later.txt", times + 0.05, estimate)
    with pytest.raises(DataError, match=r"later\.txt: fewer than two times are within 0\.01 s"):
        read_by_time(tmp_path / "truth.txt", [tmp_path / "later.txt"], read_tum)
    sync = pytest.importorskip("evo.core.sync", reason="evo is not installed")
    interface = pytest.importorskip("evo.tools.file_interface")
    pair = (interface.read_tum_trajectory_file(tmp_path / f"{n}.txt") for n in ("truth", "estimate"))
    theirs = sync.associate_trajectories(*pair)
    _, true, (found,) = read_by_time(tmp_path / "truth.txt", [tmp_path / "estimate.txt"], read_tum)
    for their, our in zip(theirs, (true, found), strict=True):
        np.testing.assert_allclose(their.poses_se3, our, atol=1e-9)


def test_the_command_names_the_alignment_and_reads_tum(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, poses in zip(("truth", "estimate"), random_pair(2), strict=True):
        write_tum(tmp_path / f"{name}.txt", np.arange(0.0, len(poses)) / 10, poses)
    words = ["--truth", str(tmp_path / "truth.txt"), "--estimate", str(tmp_path / "estimate.txt")]
    words = ["evaluate", *words, "--format", "tum", "--lengths", "20", "--step", "1"]
    assert main(words) == 0
    assert "best rotation and translation (SE3)" in capsys.readouterr().out
    for alignment in Alignment:
        assert main([*words, "--alignment", alignment.value, "--json"]) == 0
        (sequence,) = json.loads(capsys.readouterr().out)["sequences"]
        assert sequence["ate"]["alignment"] == alignment.value


def test_a_curve_has_a_point_for_each_bin_of_three_and_more() -> None:
    errors = kitti_errors(straight(400), straight(400, 1.01), (100.0, 390.0))
    counts = {at: len(part) for at, part in errors.by_length((100.0, 390.0)).items()}
    assert 0 < counts[390.0] < KITTI_BIN_MINIMUM <= counts[100.0]
    ((length, te, re),) = errors.curve("length", (100.0, 390.0))
    assert length == 100.0
    assert te == pytest.approx(1.01)
    assert re == pytest.approx(0.0, abs=1e-6)
    # Bins of 2 m/s round 8 and 10 m/s hold 9.8 m/s.
    assert [at for at, _, _ in errors.curve("speed")] == pytest.approx([3.6 * 8, 3.6 * 10])
