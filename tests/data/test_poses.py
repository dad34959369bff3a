"""Trajectory files: reading and writing, matching of times, and errors of writing."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vo_lib.data.poses import (
    format_kitti_poses,
    format_tum,
    match_times,
    read_kitti_poses,
    read_poses,
    refuse_intervals,
    write_kitti_poses,
)
from vo_lib.errors import DataError
from vo_lib.files import write_atomic
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.types import Array

IDENTITY_ROW = "1 0 0 0 0 1 0 0 0 0 1 0\n"


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
    path.write_text(format_tum(t, T))
    t_back, back = read_poses(path)
    assert t_back is not None
    np.testing.assert_allclose(t_back, t, rtol=0, atol=1e-6 / 4)
    np.testing.assert_allclose(back, T, rtol=1e-9, atol=5e-9)


def test_times_are_matched_to_the_nearest_pose() -> None:
    times, poses = np.array([0.0, 0.009]), np.array([0.010, 5.0, 6.0])
    for a, b in ((times, poses), (poses, times)):
        pairs = [side[k].tolist() for side, k in zip((a, b), match_times(a, b), strict=True)]
        assert sorted(pairs) == [[0.009], [0.010]]
    assert len(match_times(times, poses + 1.0)[0]) == 0


def test_blank_lines_and_windows_line_ends_are_accepted(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_bytes(b"\xef\xbb\xbf" + (IDENTITY_ROW * 2).replace("\n", "\r\n").encode() + b"\r\n \n\n")
    np.testing.assert_array_equal(read_kitti_poses(path), np.tile(np.eye(4), (2, 1, 1)))


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_failed_write_keeps_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    path = tmp_path / "note.txt"
    write_atomic(path, b"\x00\xff")
    write_atomic(path, "zwölf\n")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, moment, full)
    with pytest.raises(DataError, match="cannot be written: No space left on device") as caught:
        write_atomic(path, "new\n")
    assert str(path) in str(caught.value)
    assert path.read_bytes() == "zwölf\n".encode()
    assert [p.name for p in tmp_path.iterdir()] == ["note.txt"]


def test_comments_are_skipped_unread(tmp_path: Path) -> None:
    comments = "# x forward, world to camera, qw qx qy qz\n"
    (tmp_path / "kitti.txt").write_text(comments + IDENTITY_ROW + comments + IDENTITY_ROW)
    (tmp_path / "tum.txt").write_text(f"{comments}0 1 2 3 0 0 0 1\n # 1 2\n0.1 1 2 4 0 0 0 1\n")
    kitti = read_poses(tmp_path / "kitti.txt")
    assert kitti.times is None
    np.testing.assert_array_equal(kitti.poses, np.tile(np.eye(4), (2, 1, 1)))
    tum = read_poses(tmp_path / "tum.txt")
    assert tum.times is not None
    np.testing.assert_array_equal(tum.times, [0.0, 0.1])
    np.testing.assert_array_equal(tum.poses[:, :3, 3], [[1, 2, 3], [1, 2, 4]])


def test_arrays_are_read_without_pickle(tmp_path: Path) -> None:
    path = tmp_path / "path.npy"
    T = random_poses(3, 5)
    np.save(path, T)
    np.testing.assert_array_equal(read_poses(path).poses, T)
    np.save(path, T.astype(np.float32))
    np.testing.assert_allclose(read_poses(path).poses, T, atol=1e-3)
    turned = T.copy()
    turned[3, :3, :3] *= 1.1
    last_row = T.copy()
    last_row[4, 3, 0] = 0.5
    far = T.copy()
    far[2, 0, 3] = 1e10
    endless = T.copy()
    endless[1, 0, 3] = np.nan
    for array, words in (
        (turned, "element 3 is no pose"),
        (last_row, "element 4 is no pose"),
        (endless, "element 1 is no pose"),
        (far, "line 3: a position beyond"),
        (T[:0], "shape"),
        (T[0], "shape"),
        (T[:, :3], "shape"),
        (T.astype(complex), "no array of numbers"),
        (np.array([None]), "no array of numbers"),
    ):
        np.save(path, array)
        with pytest.raises(DataError, match=words):
            read_poses(path)


@pytest.mark.parametrize(("unit", "is_right"), [(1.0, True), (1e3, False), (1e6, False), (1e9, False)])
def test_times_that_are_no_seconds_are_refused(unit: float, is_right: bool) -> None:
    for interval in (0.02, 1 / 30, 0.1):
        times = np.asarray(unit * (1317384506 + interval * np.arange(20)), np.float64)
        if is_right:
            refuse_intervals(times, "times.txt")
        else:
            with pytest.raises(DataError, match=r"times.txt: the median interval .* expected 0.001 to 10 s"):
                refuse_intervals(times, "times.txt")
    refuse_intervals(np.array([5e9]), "times.txt")  # a single time has no interval
    # Times since 1970 have steps of 0.2 µs, so the median interval of 1000 frames a second is below 1 ms.
    refuse_intervals(1.7e9 + 1e-3 * np.arange(6.0), "times.txt")
