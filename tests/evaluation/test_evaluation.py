"""KITTI errors, ATE and RPE: simple cases, invariances, and comparisons with other implementations."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_entries import straight

from vo_lib.data.poses import read_kitti_poses
from vo_lib.errors import DataError
from vo_lib.evaluation.ate_rpe import (
    Alignment,
    Delta,
    absolute_error,
    align,
    interval_pairs,
    relative_error,
)
from vo_lib.evaluation.kitti_errors import (
    KITTI_BIN_MINIMUM,
    KITTI_LENGTHS,
    KITTI_PROTOCOL,
    KittiErrors,
    is_as_kitti,
    kitti_errors,
)
from vo_lib.evaluation.path_errors import evaluate
from vo_lib.evaluation.path_facts import doubt, forward_share, path_difference, path_length
from vo_lib.geometry.motion import (
    nearest_rotation,
    quaternion_from_rotation,
    rigid,
    rotation_from_quaternion,
    rotation_from_vector,
)
from vo_lib.geometry.types import Array

KITTI_TRUTH = Path(__file__).resolve().parents[3] / "shared" / "data" / "kitti_poses"
BENCHMARK = KITTI_TRUTH.parent / "benchmark"
# With steps of 1.07 m, no path ends within 0.1 m of these lengths, so rounding cannot change an end frame.
ROBOT = [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]  # x forward, y left, z up, in camera axes
STEP_LENGTH, LENGTHS = 1.07, (20.0, 50.0, 105.0)

seeds = st.integers(0, 2**32 - 1)


def chain(motions: Array) -> Array:
    """Poses (N+1, 4, 4) from the motions (N, 4, 4) between frames; the first pose is the identity."""
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
    """A winding path of equal steps, and an estimate with drift."""
    rng = np.random.default_rng(seed)
    motions = random_motions(rng, n - 1, 0.05, STEP_LENGTH)
    return chain(motions), chain(motions @ random_motions(rng, n - 1, 0.002, 0.01))


def random_rigid(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rigid(rotation_from_vector(rng.normal(size=3)), rng.normal(0.0, 100.0, 3))


def drifting(truth: Array, seed: int) -> Array:
    """An estimate of KITTI poses with noise in rotation and translation and a scale error of 0.3 %."""
    rng = np.random.default_rng(seed)
    T = truth.copy()
    T[:, :3, :3] = [nearest_rotation(R) for R in T[:, :3, :3]]
    motions = np.linalg.inv(T[:-1]) @ T[1:]
    motions[:, :3, 3] *= 1.003
    return chain(motions @ random_motions(rng, len(motions), 5e-4, 0.005))


def literal_kitti_errors(
    truth: Array, estimate: Array, lengths: tuple[float, ...], step: int
) -> list[tuple[float, ...]]:
    """Errors by the definition of the benchmark, one sub-sequence at a time.

    Path lengths, and errors over the lengths of the benchmark, have single precision.
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
def test_kitti_errors_equal_the_development_kit(name: str) -> None:
    if not BENCHMARK.exists():
        pytest.skip("the benchmark's output is not in ../shared/data")
    truth, estimate = (read_kitti_poses(folder / f"{name}.txt") for folder in (KITTI_TRUTH, BENCHMARK))
    first, r_err, t_err, length, speed = np.loadtxt(BENCHMARK / f"{name}_errors.txt").T
    errors = kitti_errors(truth, estimate)
    np.testing.assert_array_equal(errors.first, first)
    np.testing.assert_array_equal(errors.length, length)
    # The speed determines the end of a sub-sequence: one frame more or less changes the speed by 0.006 m/s.
    np.testing.assert_allclose(errors.speed, speed, rtol=0.0, atol=2e-6)
    np.testing.assert_allclose(errors.t_err, t_err, rtol=0.0, atol=5.0001e-7)
    np.testing.assert_allclose(errors.r_err, r_err, rtol=0.0, atol=5.0001e-7)


@pytest.mark.parametrize("step_length", [0.1, 0.25, 0.3, 1.0, 1.3])
def test_kitti_errors_equal_the_definition(step_length: float) -> None:
    truth = straight(1200, step_length)
    estimate = drifting(truth, seed=3)
    errors = kitti_errors(truth, estimate, (50.0, 100.0, 105.5), step=7)
    assert len(errors) > 10
    assert_equals_literal(errors, literal_kitti_errors(truth, estimate, (50.0, 100.0, 105.5), 7))


def test_speed_bins_overlap_without_their_edges() -> None:
    speed = np.array([2.0, 3.9, 4.0, 5.0, 6.0, 30.0])
    n = np.arange(len(speed))
    errors = KittiErrors(n, n, np.full(6, 100.0), np.linspace(0.0, 0.05, 6), np.zeros(6), speed)
    bins = errors.by_speed()
    assert list(bins) == [2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24]
    assert bins[2].speed.tolist() == [2.0, 3.9]
    assert bins[4].speed.tolist() == [3.9, 4.0, 5.0]
    assert bins[4].te == pytest.approx(2.0)
    assert bins[8].te is None


def test_identical_paths_have_no_error() -> None:
    truth, _ = random_pair(5, 400)
    printed = np.round(truth, 7)
    errors = kitti_errors(printed, printed, LENGTHS, step=1)
    assert len(errors) > 500
    assert errors.t_err.max() < 1e-12
    # acos near 1 amplifies rounding of 1e-16 to 1e-8; the transpose as inverse would give errors of 4e-4.
    assert (errors.r_err * errors.length).max() < 1e-7
    assert absolute_error(printed, printed).distance.max() < 1e-9


@given(seed=seeds, world=seeds, scale=st.floats(0.2, 5.0))
@settings(max_examples=25)
def test_alignment_recovers_motion_and_scale(seed: int, world: int, scale: float) -> None:
    truth, _ = random_pair(seed)
    moved = random_rigid(world) @ truth
    for alignment in (Alignment.ORIGIN, Alignment.SE3, Alignment.SIM3):
        aligned, result = align(truth, moved, alignment)
        np.testing.assert_allclose(aligned, truth, atol=1e-8)
        assert result == pytest.approx(1.0)
    scaled = moved.copy()
    scaled[:, :3, 3] *= scale
    aligned, result = align(truth, scaled, Alignment.SIM3)
    np.testing.assert_allclose(aligned, truth, atol=1e-7)
    assert result == pytest.approx(1.0 / scale)


def test_ate_of_a_shifted_path_is_the_shift_and_no_alignment_mirrors() -> None:
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


def test_rpe_is_the_drift_per_frame() -> None:
    truth = straight(11)
    turn = rigid(rotation_from_vector(np.array([0.0, 0.02, 0.0])), np.array([0.0, 0.3, 1.4]))
    estimate = chain(np.tile(turn, (10, 1, 1)))
    rpe = relative_error(truth, estimate)
    np.testing.assert_allclose(rpe.translation, np.full(10, 0.5))
    np.testing.assert_allclose(rpe.rotation, np.full(10, 0.02))
    assert rpe.to_dict()["rotation"]["rmse_deg"] == pytest.approx(math.degrees(0.02))
    assert relative_error(truth, estimate, Delta(5)).rotation.tolist() == pytest.approx([0.1, 0.1])
    assert relative_error(truth, estimate, Delta(11)).to_dict()["translation"]["rmse_m"] is None


@pytest.mark.parametrize("size", [0, -1, 0.5, 1.5, math.nan, math.inf])
def test_intervals_that_are_no_number_of_frames_are_refused(size: float) -> None:
    with pytest.raises(DataError, match=r"interval of .* frames: expected 1, 2, … frames"):
        Delta(size)


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf])
def test_intervals_that_are_no_length_are_refused(size: float) -> None:
    with pytest.raises(DataError, match=r"interval of .* m: expected .* metres > 0"):
        Delta(size, "m")
    with pytest.raises(DataError, match="unit 'km' of an interval: expected frames or m"):
        Delta(1, "km")  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [1e-3, 1e-20, 5e-324])
def test_pairs_over_a_tiny_length_are_successive_positions(size: float) -> None:
    path = np.array([0.0, 1.0, 2.0, 2.0, 4.0, 5.0])  # with a standstill, over which there is no pair
    first, last = interval_pairs(path, size, exact=False)
    assert first.tolist() == [0, 1, 2, 4]
    assert last.tolist() == [1, 2, 4, 5]


def test_invalid_evaluations_are_refused() -> None:
    path, broken = straight(10), straight(10)
    broken[4, 0, 3] = np.nan
    faults = {"truth has 10 poses and the estimate 9": path[:9], "pose 4 of the estimate": broken}
    for text, estimate in faults.items():
        with pytest.raises(DataError, match=f"orb: {text}"):
            evaluate(path, {"orb": estimate})
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
        ours = relative_error(truth, estimate, Delta(delta))
        for relation, errors in (
            (metrics.PoseRelation.translation_part, ours.translation),
            (metrics.PoseRelation.rotation_angle_rad, ours.rotation),
        ):
            rpe = metrics.RPE(relation, delta=delta, delta_unit=metrics.Unit.frames)
            rpe.process_data(pair)
            np.testing.assert_allclose(errors, rpe.error, atol=1e-8)
    for delta_m in (0.1, 2.5):
        ours = relative_error(truth, estimate, Delta(delta_m, "m"))
        rpe = metrics.RPE(
            metrics.PoseRelation.translation_part,
            delta=delta_m,
            delta_unit=metrics.Unit.meters,
            pairs_from_reference=True,
        )
        rpe.process_data(pair)
        np.testing.assert_allclose(ours.translation, rpe.error, atol=1e-8)


def test_statistics_and_length_equal_those_of_evo() -> None:
    metrics = pytest.importorskip("evo.core.metrics", reason="evo is not installed")
    trajectory = pytest.importorskip("evo.core.trajectory")
    truth, estimate = random_pair(4)
    estimate[:, :3, 3] *= 1.1
    times = np.linspace(0.0, 0.1 * (len(truth) - 1), len(truth))
    pair = [
        trajectory.PoseTrajectory3D(poses_se3=list(poses), timestamps=times) for poses in (truth, estimate)
    ]
    errors = evaluate(truth, {"ours": estimate}, alignment=Alignment.NONE)[0].to_dict()
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    rpe = metrics.RPE(metrics.PoseRelation.rotation_angle_deg)
    for metric, ours, unit in ((ape, errors["ate"], "m"), (rpe, errors["rpe"]["rotation"], "deg")):
        metric.process_data(tuple(pair))
        theirs = metric.get_all_statistics()
        for kind in ("rmse", "mean", "median", "max"):
            assert ours[f"{kind}_{unit}"] == pytest.approx(theirs[kind], abs=1e-9)
    assert path_length(estimate) == pytest.approx(pair[1].path_length)
    pair[1].align_origin(pair[0])
    ape.process_data(tuple(pair))
    apart = path_difference(truth, estimate)
    assert apart.rmse == pytest.approx(ape.get_statistic(metrics.StatisticsType.rmse))
    assert apart.largest == pytest.approx(ape.get_statistic(metrics.StatisticsType.max))
    assert apart.end == pytest.approx(ape.error[-1])


def test_curves_omit_bins_with_few_sub_sequences() -> None:
    errors = kitti_errors(straight(400), straight(400, 1.01), (100.0, 390.0))
    counts = {at: len(part) for at, part in errors.by_length((100.0, 390.0)).items()}
    assert 0 < counts[390.0] < KITTI_BIN_MINIMUM <= counts[100.0]
    ((length, te, re),) = errors.curve("length", (100.0, 390.0))
    assert length == 100.0
    assert te == pytest.approx(1.01)
    assert re == pytest.approx(0.0, abs=1e-6)
    # 9.8 m/s is in the bins around 8 and 10 m/s.
    assert [at for at, _, _ in errors.curve("speed")] == pytest.approx([3.6 * 8, 3.6 * 10])


def test_key_frames_count_in_frames_of_the_truth() -> None:
    """With every tenth pose, the same sub-sequences and pairs of frames as with all poses."""
    truth, _ = random_pair(3, 1200)
    estimate = truth.copy()
    estimate[:, :3, 3] *= 1.02
    frames = np.arange(0, len(truth), 10)
    all_frames = kitti_errors(truth, estimate)
    key_frames = kitti_errors(truth, estimate[frames], frames=frames)
    # No start is lost, but the last, after whose end there is no other key frame.
    np.testing.assert_array_equal(np.unique(key_frames.first), np.unique(all_frames.first)[:-1])
    assert set(key_frames.last) <= set(frames)
    assert key_frames.te == pytest.approx(all_frames.te, rel=0.01)
    for delta in (10, 30):
        dense, sparse = (
            relative_error(truth, poses, Delta(delta), frames=chosen)
            for poses, chosen in ((estimate, None), (estimate[frames], frames))
        )
        np.testing.assert_array_equal(sparse.translation, dense.translation)
    assert len(relative_error(truth, estimate[frames], frames=frames).translation) == 0
    (path,) = evaluate(truth, {"orb": estimate[frames]}, frames=frames)
    assert path.to_dict()["frames"] == 120


def test_pairs_of_irregular_frames_are_delta_apart() -> None:
    frames = np.array([0, 1, 3, 4, 5, 9, 12])
    truth = straight(13)
    estimate = straight(13, 1.5)[frames]
    # From 0 to 3, then from the next frame that has a partner: 9 to 12.
    np.testing.assert_allclose(
        relative_error(truth, estimate, Delta(3), frames=frames).translation, [1.5, 1.5]
    )
    # Starts at the frames 0 and 10, of which the second is missing; the frame 12 takes its place.
    errors = kitti_errors(straight(40), straight(40)[frames], (3.0,), 10, frames=frames)
    assert list(zip(errors.first.tolist(), errors.last.tolist(), strict=True)) == [(0, 4)]


def test_later_ends_are_divided_by_the_true_length() -> None:
    frames = np.arange(0, 400, 40)
    errors = kitti_errors(straight(400), straight(400, 1.01)[frames], (100.0,), frames=frames)
    assert set((errors.last - errors.first).tolist()) == {120}
    np.testing.assert_allclose(errors.t_err, 0.01, rtol=1e-6)


@pytest.mark.parametrize(
    ("frames", "is_part", "as_kitti"), [(900, False, True), (900, True, False), (110, False, False)]
)
def test_only_enough_of_a_whole_path_is_as_kitti(frames: int, is_part: bool, as_kitti: bool) -> None:
    (path,) = evaluate(straight(frames), {"a": straight(frames, 1.01)})
    count = path.to_dict()["subsequences"]
    assert count == len(path.kitti) > 0
    assert is_as_kitti(KITTI_PROTOCOL, count, not is_part) is as_kitti


INVERTED = "does not move along its own +z axis"


@pytest.mark.parametrize("name", ["00", "04", "06", "10"])
def test_another_convention_causes_one_warning_on_kitti(name: str) -> None:
    if not KITTI_TRUTH.is_dir():
        pytest.skip("KITTI's poses are not beside this checkout")
    truth = read_kitti_poses(KITTI_TRUTH / f"{name}.txt")[:900]
    assert forward_share(truth) > 0.98
    others = {"inverted": np.linalg.inv(truth), "robot": truth @ np.array(ROBOT)}
    others["qw first"] = truth.copy()
    for k, pose in enumerate(truth):
        x, y, z, w = quaternion_from_rotation(pose[:3, :3])
        others["qw first"][k, :3, :3] = rotation_from_quaternion(np.array([w, x, y, z]))
    for words, poses in others.items():
        assert INVERTED in doubt(truth, poses), words
        assert INVERTED not in doubt(poses, truth), words  # a camera may look sideways
    drift = truth.copy()
    drift[:, :3, 3] *= 1.9
    assert doubt(truth, drift) == ""
    drift[:, :3, 3] *= 1.1
    assert "is 2.09 times as long as the truth" in doubt(truth, drift)


def test_paths_that_both_stand_still_cause_no_warning() -> None:
    still = np.tile(np.eye(4), (5, 1, 1))
    assert forward_share(still) == forward_share(still[:1]) == 0.0
    assert doubt(still, still) == ""
    assert "is inf times as long as the truth" in doubt(still, straight(5))
