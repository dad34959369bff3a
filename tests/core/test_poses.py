"""Trajectory files: what is written is read back, and what is no trajectory is refused with its line."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vo_lib.core.errors import DataError
from vo_lib.core.files import write_bytes_atomic, write_text_atomic
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.poses import (
    format_kitti_poses,
    format_tum,
    read_kitti_pair,
    read_kitti_poses,
    read_tum,
    write_kitti_poses,
    write_tum,
)
from vo_lib.core.types import Array

IDENTITY_ROW = "1 0 0 0 0 1 0 0 0 0 1 0\n"
TUM_IDENTITY = "{} 0 0 0 0 0 0 1\n"
KITTI_TRUTH = Path(__file__).resolve().parents[3] / "shared" / "data" / "kitti_poses"


def random_poses(seed: int, n: int, reach: float = 1000.0) -> Array:
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = rotation_from_vector(rng.normal(size=(n, 3)))
    T[:, :3, 3] = rng.uniform(-reach, reach, (n, 3))
    return T


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 20), reach=st.sampled_from([0.0, 1e-3, 1.0, 1e5]))
def test_kitti_poses_survive_a_round_trip(
    tmp_path_factory: pytest.TempPathFactory, seed: int, n: int, reach: float
) -> None:
    T = random_poses(seed, n, reach)
    path = tmp_path_factory.mktemp("kitti") / "poses.txt"
    write_kitti_poses(path, T)
    back = read_kitti_poses(path)
    np.testing.assert_allclose(back, T, rtol=1e-9, atol=1e-12)
    assert format_kitti_poses(back) == path.read_text()


@given(
    seed=st.integers(0, 2**32 - 1),
    times=st.lists(st.integers(0, 10**15), min_size=1, max_size=20, unique=True),
)
def test_tum_times_and_poses_survive_a_round_trip(
    tmp_path_factory: pytest.TempPathFactory, seed: int, times: list[int]
) -> None:
    t = np.array(sorted(times)) * 1e-6
    T = random_poses(seed, len(t))
    path = tmp_path_factory.mktemp("tum") / "poses.txt"
    write_tum(path, t, T)
    t_back, back = read_tum(path)
    np.testing.assert_allclose(t_back, t, rtol=0, atol=1e-6 / 4)
    np.testing.assert_allclose(back, T, rtol=1e-9, atol=5e-9)


def test_text_is_the_same_for_zero_and_minus_zero() -> None:
    T = np.eye(4)[None]
    assert format_kitti_poses(T) == format_kitti_poses(np.where(T == 0, -0.0, T))
    assert "-" not in format_tum(np.zeros(1), np.where(T == 0, -0.0, T)).replace("e-", "")


def test_tum_rows_hold_time_position_and_quaternion_in_this_order(tmp_path: Path) -> None:
    T = np.eye(4)[None].copy()
    T[0, :3, :3] = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2]))
    T[0, :3, 3] = 1.0, 2.0, 3.0
    row = [float(word) for word in format_tum(np.array([0.5]), T).split()]
    np.testing.assert_allclose(row, [0.5, 1, 2, 3, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-9)


def test_trailing_blank_lines_windows_line_ends_and_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_bytes(b"\xef\xbb\xbf" + (IDENTITY_ROW * 2).replace("\n", "\r\n").encode() + b"\r\n \n\n")
    np.testing.assert_array_equal(read_kitti_poses(path), np.tile(np.eye(4), (2, 1, 1)))


def test_tum_comments_are_skipped_and_lines_still_counted(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_text("# time x y z\n" + TUM_IDENTITY.format(0) + " # middle\n" + TUM_IDENTITY.format(1))
    assert read_tum(path)[0].tolist() == [0.0, 1.0]
    path.write_text(path.read_text() + "2 0 0 0 0 0 0\n")
    with pytest.raises(DataError, match=r"line 5: 7 columns"):
        read_tum(path)


@pytest.mark.parametrize("printed", ["%.3e", "%.6e", "%.4f"])
def test_rotations_printed_with_few_digits_are_accepted(tmp_path: Path, printed: str) -> None:
    T = random_poses(1, 50)
    path = tmp_path / "poses.txt"
    np.savetxt(path, T[:, :3].reshape(-1, 12), fmt=printed)
    np.testing.assert_allclose(read_kitti_poses(path)[:, :3, :3], T[:, :3, :3], atol=1e-3)


def test_kitti_truth_is_read_as_printed() -> None:
    path = KITTI_TRUTH / "04.txt"
    if not path.exists():
        pytest.skip("KITTI ground truth is not in ../shared/data")
    T = read_kitti_poses(path)
    np.testing.assert_array_equal(T[:, :3].reshape(-1, 12), np.loadtxt(path))
    np.testing.assert_array_equal(T[:, 3], np.tile([0, 0, 0, 1], (len(T), 1)))


def test_truth_and_estimate_of_different_length_are_named_with_their_counts(tmp_path: Path) -> None:
    truth, estimate = tmp_path / "truth.txt", tmp_path / "estimate.txt"
    truth.write_text(IDENTITY_ROW * 3)
    estimate.write_text(IDENTITY_ROW * 2)
    with pytest.raises(DataError) as caught:
        read_kitti_pair(truth, estimate)
    assert f"{estimate}: has 2 rows" in str(caught.value)
    assert f"truth {truth} has 3" in str(caught.value)
    assert [len(T) for T in read_kitti_pair(truth, truth)] == [3, 3]


def test_poses_that_are_not_finite_or_of_wrong_shape_are_never_written(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    for wrong in (np.full((1, 4, 4), np.nan), np.eye(4), np.zeros((2, 3, 4))):
        with pytest.raises(ValueError, match="expected finite poses"):
            write_kitti_poses(path, wrong)
    for times in (np.zeros(2), np.array([np.nan])):
        with pytest.raises(ValueError, match="expected 1 finite times"):
            write_tum(path, times, np.eye(4)[None])
    assert list(tmp_path.iterdir()) == []


def test_a_write_replaces_the_file_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "note.txt"
    write_text_atomic(path, "one\n")
    write_text_atomic(path, "zwölf\n")
    assert path.read_bytes() == "zwölf\n".encode()
    write_bytes_atomic(path, b"\x00\xff")
    assert path.read_bytes() == b"\x00\xff"
    for refused in (tmp_path / "missing" / "note.txt", tmp_path):
        with pytest.raises(DataError, match="cannot be written"):
            write_text_atomic(refused, "text")
    assert [p.name for p in tmp_path.iterdir()] == ["note.txt"]


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    path = tmp_path / "note.txt"
    write_text_atomic(path, "old\n")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, moment, full)
    with pytest.raises(DataError, match="cannot be written: No space left on device") as caught:
        write_text_atomic(path, "new\n")
    assert str(path) in str(caught.value)
    assert path.read_text() == "old\n"
    assert [p.name for p in tmp_path.iterdir()] == ["note.txt"]
