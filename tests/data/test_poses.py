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
    read_path,
    read_tum,
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
    t_back, back = read_tum(path)
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


@pytest.mark.parametrize(
    ("per_second", "name"), [(10**9, "nanoseconds"), (10**6, "microseconds"), (10**3, "milliseconds")]
)
def test_large_times_of_tum_get_their_unit_from_their_size(
    tmp_path: Path, per_second: int, name: str
) -> None:
    path = tmp_path / "orb.txt"
    start = 1317384506
    seconds = start + 0.1 * np.arange(5)
    rows = [f"{round(t * per_second)}.000000 {k} 0 0 0 0 0 1" for k, t in enumerate(seconds)]
    path.write_text("\n".join(rows) + "\n")
    file = read_path(path)
    assert file.times is not None
    np.testing.assert_allclose(file.times, seconds, rtol=0, atol=1e-6)
    assert file.notes == (f"{path}: the times are read as {name} since 1970.",)
    path.write_text("\n".join(f"{t:.6f} {k} 0 0 0 0 0 1" for k, t in enumerate(seconds)) + "\n")
    assert read_path(path).notes == ()
