"""Pose files with a header: order, units and times of the columns, and the answer where they are unknown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import EUROC_HEADER, winding_road

from vo_lib.data.poses import format_kitti_poses, format_tum, read_euroc, read_path
from vo_lib.errors import DataError
from vo_lib.geometry.motion import quaternion_from_rotation, rigid, rotation_from_vector
from vo_lib.geometry.types import Array

START_NS = 1403636579763555584
FRAMES = 12
TIMES_NS = START_NS + 100_000_000 * np.arange(FRAMES, dtype=np.int64)
TIMES: Array = 1e-9 * TIMES_NS.astype(np.float64)
WORLD = rigid(rotation_from_vector(np.array([0.4, -0.9, 0.3])), np.array([12.0, -45.0, 7.0]))
POSES = WORLD @ winding_road(FRAMES, 0.3, 1.0)

Cells = Callable[[int], list[str]]


def position(k: int, unit: float = 1.0) -> list[str]:
    return [f"{value / unit:.12f}" for value in POSES[k, :3, 3]]


def quaternion(k: int) -> list[str]:
    """Cells qx qy qz qw."""
    return [f"{value:.15f}" for value in quaternion_from_rotation(POSES[k, :3, :3])]


def w_first(k: int) -> list[str]:
    return [quaternion(k)[3], *quaternion(k)[:3]]


def stamp(k: int) -> str:
    return str(TIMES_NS[k])


def seconds(k: int) -> str:
    return f"{TIMES[k]:.6f}"


def two_stamps(k: int) -> list[str]:
    return [str(TIMES_NS[k] // 10**9), str(TIMES_NS[k] % 10**9)]


def text_of(header: str, row: Cells, separator: str = ",") -> str:
    rows = [separator.join(row(k)) for k in range(FRAMES)]
    return "\n".join([header, *rows] if header else rows) + "\n"


ROS = "pose.pose.position.{0},pose.pose.orientation.{0}"
ARIA = "tx_{0},ty_{0},tz_{0},qx_{0},qy_{0},qz_{0},qw_{0}"
ODOM = [f"/odom/pose/pose/orientation/{axis}" for axis in "wxyz"]
ODOM += [f"/odom/pose/pose/position/{axis}" for axis in "xyz"]
FIELDS = [f"field.pose.pose.position.{axis}" for axis in "xyz"]
FIELDS += [f"field.pose.pose.orientation.{axis}" for axis in "xyzw"]

NAMED: dict[str, tuple[str, Cells, str]] = {
    "EuRoC": (EUROC_HEADER, lambda k: [stamp(k), *position(k), *w_first(k), *["0"] * 9], ","),
    "4Seasons": (
        "# frame_id, tx, ty, tz, qx, qy, qz, qw, scale, fusion_quality, v3",
        lambda k: [stamp(k), *position(k), *quaternion(k), "1.0", "0", "0"],
        ",",
    ),
    "Aria": (
        f"graph_uid,tracking_timestamp_us,utc_timestamp_ns,{ARIA.format('world_device')},"
        f"device_linear_velocity_x_device,gravity_x_world,{ARIA.format('ecef_device')}",
        lambda k: ["0a-b2", stamp(k)[:-3], "-1", *position(k), *quaternion(k), "1", "2", *["0"] * 7],
        ",",
    ),
    "rostopic echo -p": (
        ",".join(["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *FIELDS]),
        lambda k: [str(TIMES_NS[k] + 10**9), str(k), stamp(k), "odom", *position(k), *quaternion(k)],
        ",",
    ),
    "bagpy": (
        "Time,header.seq,header.stamp.secs,header.stamp.nsecs,child_frame_id,"
        + ",".join(name.removeprefix("field.") for name in FIELDS)
        + ",pose.covariance,twist.twist.linear.x",
        lambda k: [seconds(k), str(k), *two_stamps(k), "base", *position(k), *quaternion(k), '"(0, 1)"', "9"],
        ",",
    ),
    "PlotJuggler": (
        ",".join(["__time", "/odom/header/stamp/sec", "/odom/header/stamp/nanosec", *ODOM])
        + ",/odom/pose/pose/orientation/roll_deg,/odom/pose/covariance[0;0],/odom/twist/twist/linear/x",
        lambda k: ["5.0", *two_stamps(k), *w_first(k), *position(k), "1", "2", "3"],
        ",",
    ),
    "OpenVINS": (
        "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33",
        lambda k: [seconds(k), *position(k), *quaternion(k)],
        " ",
    ),
    "Kimera": (
        "#timestamp,x,y,z,qw,qx,qy,qz,vx,vy,vz,bgx,bgy,bgz,bax,bay,baz",
        lambda k: [stamp(k), *position(k), *w_first(k), *["0"] * 9],
        ",",
    ),
    "Newer College": (
        "#sec,nsec,x,y,z,qx,qy,qz,qw",
        lambda k: [*two_stamps(k), *position(k), *quaternion(k)],
        ",",
    ),
    "AirSim": (
        "VehicleName\tTimeStamp\tPOS_X\tPOS_Y\tPOS_Z\tQ_W\tQ_X\tQ_Y\tQ_Z\tImageFile",
        lambda k: ["drone", f"{1e3 * TIMES[k]:.3f}", *position(k), *w_first(k), "a b.png"],
        "\t",
    ),
    "millimetres, semicolons": (
        '"t [ms]";"x [mm]";"y [mm]";"z [mm]";"rotationX";"rotationY";"rotationZ";"rotationW"',
        lambda k: [f'"{1e3 * TIMES[k]:.3f}"', *position(k, 1e-3), *quaternion(k)],
        ";",
    ),
    "w first, blanks": (
        "# timestamp [s] tx ty tz qw qx qy qz",
        lambda k: [seconds(k), *position(k), *w_first(k)],
        "  ",
    ),
    "two comma-separated indices": (
        ",num,t,x,y,z,qx,qy,qz,qw",
        lambda k: [str(k), str(k + 5), seconds(k), *position(k), *quaternion(k)],
        ",",
    ),
}


def assert_is_the_path(path: Path) -> None:
    times, poses, _ = read_path(path)
    assert times is not None
    np.testing.assert_allclose(times, TIMES, rtol=0, atol=2e-6)
    np.testing.assert_allclose(poses, POSES, atol=1e-9)


@pytest.mark.parametrize("name", NAMED)
def test_the_names_of_the_columns_decide(tmp_path: Path, name: str) -> None:
    (tmp_path / "path.csv").write_text(text_of(*NAMED[name]), encoding="utf-8")
    assert_is_the_path(tmp_path / "path.csv")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("ending", ["\r\n", "\r", "\r\r\n"])
def test_files_of_other_systems_have_other_encodings(tmp_path: Path, encoding: str, ending: str) -> None:
    text = text_of("timestamp [ns],tx,ty,tz,qx,qy,qz,qw", lambda k: [stamp(k), *position(k), *quaternion(k)])
    (tmp_path / "path.csv").write_bytes(text.replace("\n", ending).encode(encoding))
    assert_is_the_path(tmp_path / "path.csv")


def test_rows_of_other_topics_are_skipped_with_a_note(tmp_path: Path) -> None:
    lines = text_of("time,x,y,z,qx,qy,qz,qw,imu", lambda k: [seconds(k), *position(k), *quaternion(k), ""])
    lines = lines.replace("\n1403636580.06", "\n1403636580.01,,,,,,,,5\n1403636580.06")
    (tmp_path / "path.csv").write_text(lines, encoding="utf-8")
    assert_is_the_path(tmp_path / "path.csv")
    assert "1 rows without a pose are skipped" in read_path(tmp_path / "path.csv").notes[0]


def test_conventions_hold_only_where_the_order_is_known(tmp_path: Path) -> None:
    path = tmp_path / "path.txt"
    vins = text_of("", lambda k: [stamp(k), *position(k), *w_first(k), "0", "0", "0", ""])
    for text in (vins, vins.replace(",0,0,0,", "")):
        path.write_text(text, encoding="utf-8")
        assert_is_the_path(path)
        order, sensor = read_path(path).notes
        assert "read in EuRoC's order" in order
        assert "those of the body (IMU), not of a camera" in sensor
    path.write_text(format_tum(TIMES, POSES), encoding="utf-8")
    assert_is_the_path(path)
    path.write_text(format_kitti_poses(POSES), encoding="utf-8")
    assert read_path(path).times is None
    np.testing.assert_allclose(read_path(path).poses, POSES, atol=1e-7)


def test_the_truth_of_euroc_is_said_to_be_of_the_body(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    header, row, separator = NAMED["EuRoC"]
    path.write_text(text_of(header, row, separator), encoding="utf-8")
    (note,) = read_path(path).notes
    assert "those of the body (IMU), not of a camera" in note
    path.write_text(format_tum(TIMES, POSES), encoding="utf-8")
    assert read_path(path).notes == ()


def test_files_without_times_are_in_the_order_of_the_frames(tmp_path: Path) -> None:
    path = tmp_path / "pose_left.txt"
    for header, row in (
        ("# tx ty tz qx qy qz qw", lambda k: [*position(k), *quaternion(k)]),
        ("frame tx ty tz qx qy qz qw", lambda k: [str(k), *position(k), *quaternion(k)]),
    ):
        path.write_text(text_of(header, row, " "), encoding="utf-8")
        times, poses, notes = read_path(path)
        assert times is None
        assert "row k is frame k" in notes[0]
        np.testing.assert_allclose(poses, POSES, atol=1e-9)
    path.write_text(
        text_of("frame tx ty tz qx qy qz qw", lambda k: [str(2 * k), *position(k), *quaternion(k)], " "),
        encoding="utf-8",
    )
    with pytest.raises(DataError, match=r"line 3: a file without times has other frame numbers"):
        read_path(path)


def _rows(first: Cells) -> Cells:
    return lambda k: [*first(k), *position(k), *quaternion(k)]


REFUSED: dict[str, tuple[str, Cells, str]] = {
    "comma-separated seconds": ("", _rows(lambda k: [seconds(k)]), "line 1: not a pose file: 8 columns sep"),
    "TartanAir": (
        "",
        lambda k: [" ".join(position(k) + quaternion(k))],
        "not a pose file: 7 columns; expected",
    ),
    "time and matrix": (
        "",
        lambda k: [stamp(k), *format_kitti_poses(POSES[k : k + 1]).split()],
        "not a pose file: 13 columns separated by commas",
    ),
    "EuRoC's, and one more": (
        "",
        lambda k: [stamp(k), *position(k), *w_first(k), "0"],
        "9 columns separated by commas; expected 12 numbers, the upper 3×4 of a pose, row by row (KITTI), "
        "8 numbers, t x y z qx qy qz qw (TUM), 8, 11 or 17 numbers separated by commas",
    ),
    "microseconds": ("", lambda k: [stamp(k)[:-3], *position(k), *w_first(k)], "probably microseconds: name"),
    "angles": (
        "t,x,y,z,roll,pitch,yaw",
        lambda k: ["1"] * 7,
        "line 1: the rotation is given as roll, pitch, ",
    ),
    "matrix": ("t,x,y,z,r11,r12,r13", lambda k: ["1"] * 7, "line 1: the rotation is given as r11, r12, r13"),
    "q0 to q3": (
        "t,x,y,z,q0,q1,q2,q3",
        _rows(lambda k: [seconds(k)]),
        "given as q0, q1, q2, whose convention",
    ),
    "COLMAP": (
        "# Image list:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        lambda k: [" ".join(["1", *w_first(k), *position(k), "1", "a.png"])],
        "line 2: COLMAP's images.txt has poses from the world to the camera",
    ),
    "a column without numbers": (
        "t,x,y,z,qx,qy,qz,qw",
        lambda k: [seconds(k), *position(k), *quaternion(k)[:3]],
        "line 2: 7 columns, but the header in line 1 names qw as column 8",
    ),
    "a column too many": (
        "t,x,y,z,qx,qy,qz,qw",
        _rows(lambda k: [str(k), seconds(k)]),
        "line 2: 9 columns, but the header in line 1 names 8",
    ),
    "an empty number": (
        "t,x,y,z,qx,qy,qz,qw",
        lambda k: [seconds(k), *position(k), "", *quaternion(k)[1:]],
        "line 2: '' is not a finite number; the header is in line 1",
    ),
    "no qw": (
        "t,x,y,z,qx,qy,qz",
        lambda k: ["1"] * 7,
        "line 1: the header does not name qw: expected columns",
    ),
    "another length": (
        "t,x,y,z,qx,qy,qz,qw",
        lambda k: [seconds(k), *position(k), *quaternion(k)[:3], "1.5"],
        "line 2: the quaternion does not have length 1; expected qx qy qz qw of length 1",
    ),
    "feet": (
        "t,x [ft],y [ft],z [ft],qx,qy,qz,qw",
        _rows(lambda k: [seconds(k)]),
        "unit of x [ft], y [ft], z [ft",
    ),
    "two paths": (
        ",".join(
            ["t"]
            + [
                f"/{who}/{kind}/{axis}"
                for who in "ab"
                for kind, axes in (("position", "xyz"), ("orientation", "xyzw"))
                for axis in axes
            ]
        ),
        lambda k: [seconds(k), *position(k), *quaternion(k), *position(k), *quaternion(k)],
        "line 1: the header names several paths, /a/position/x and /b/position/x: keep",
    ),
    "the same name twice": (
        "t,x,y,z,qx,qy,qz,qw,x",
        lambda k: [seconds(k), *position(k), *quaternion(k), "1"],
        "line 1: the header names x twice",
    ),
    "decimal comma": (
        "t;x;y;z;qx;qy;qz;qw",
        lambda k: [";".join([seconds(k), *position(k), *quaternion(k)]).replace(".", ",")],
        "is not a finite number; the header is in line 1",
    ),
    "times that go back": (
        "t,x,y,z,qx,qy,qz,qw",
        _rows(lambda k: [seconds(FRAMES - k - 1)]),
        "line 3: the time does not increase",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_unknown_order_is_refused_with_file_and_line(tmp_path: Path, name: str) -> None:
    header, row, expected = REFUSED[name]
    (tmp_path / "path.csv").write_text(text_of(header, row), encoding="utf-8")
    with pytest.raises(DataError) as caught:
        read_path(tmp_path / "path.csv")
    assert str(caught.value).startswith(str(tmp_path / "path.csv"))
    assert expected in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_the_header_of_a_euroc_folder_decides_too(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    row: Cells = lambda k: [stamp(k), *position(k), *quaternion(k)]  # noqa: E731
    path.write_text(text_of("#timestamp [ns],tx,ty,tz,qx,qy,qz,qw", row), encoding="utf-8")
    poses: Array = read_euroc(path)[1]
    np.testing.assert_allclose(poses, POSES, atol=1e-9)
    path.write_text(text_of("#tx,ty,tz,qx,qy,qz,qw", lambda k: row(k)[1:]), encoding="utf-8")
    with pytest.raises(DataError, match="line 1: the header names no time"):
        read_euroc(path)


ROWS = "\n".join(f"{k * 0.1:.1f} {k} 0 0 0 0 0 1" for k in range(FRAMES))


@pytest.mark.parametrize(
    "header",
    [
        "timestamp t_cw_x t_cw_y t_cw_z q_cw_x q_cw_y q_cw_z q_cw_w",
        "# time tcw_x tcw_y tcw_z qcw_x qcw_y qcw_z qcw_w",
        "# time t_c_w_x t_c_w_y t_c_w_z q_c_w_x q_c_w_y q_c_w_z q_c_w_w",
        "t tx_cw ty_cw tz_cw qx_cw qy_cw qz_cw qw_cw",
        "# t Tcw.x Tcw.y Tcw.z Qcw.x Qcw.y Qcw.z Qcw.w",
        "# time Tcw: tx ty tz qx qy qz qw",
        "# world to camera: timestamp tx ty tz qx qy qz qw",
        "# poses from world to camera\n# timestamp tx ty tz qx qy qz qw",
        "# Tcw",
        "t w2c_tx w2c_ty w2c_tz w2c_qx w2c_qy w2c_qz w2c_qw",
        "t cam_from_world.x cam_from_world.y cam_from_world.z qx qy qz qw",
        "# time p_BW_x p_BW_y p_BW_z q_BW_x q_BW_y q_BW_z q_BW_w",
    ],
)
def test_poses_from_the_world_to_the_camera_are_refused(tmp_path: Path, header: str) -> None:
    path = tmp_path / "est.txt"
    path.write_text(f"{header}\n{ROWS}\n")
    with pytest.raises(DataError, match="poses from the world to the camera: write the inverse poses below"):
        read_path(path)


@pytest.mark.parametrize(
    "header",
    [
        "timestamp t_wc_x t_wc_y t_wc_z q_wc_x q_wc_y q_wc_z q_wc_w",
        "# Twc, the inverse of Tcw\n# timestamp tx ty tz qx qy qz qw",
        "# camera to world\n# timestamp tx ty tz qx qy qz qw",
        "t c2w_tx c2w_ty c2w_tz c2w_qx c2w_qy c2w_qz c2w_qw",
    ],
)
def test_poses_from_the_camera_to_the_world_are_read(tmp_path: Path, header: str) -> None:
    path = tmp_path / "est.txt"
    path.write_text(f"{header}\n{ROWS}\n")
    assert read_path(path).poses.shape == (FRAMES, 4, 4)


@pytest.mark.parametrize(
    "name", ["time[min]", "time [h]", "time_min", "timestamp (ticks)", "t [days]", "time[ft]"]
)
def test_an_unknown_unit_of_time_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "est.csv"
    path.write_text(f"{name},tx,ty,tz,qx,qy,qz,qw\n" + ROWS.replace(" ", ","))
    with pytest.raises(DataError, match="expected s, ms, us or ns"):
        read_path(path)


@pytest.mark.parametrize(
    "name", ["time [s]", "timestamp [UTC]", "time [s since start]", "time (Unix)", "time [sec]"]
)
def test_a_clock_in_brackets_is_no_unit(tmp_path: Path, name: str) -> None:
    path = tmp_path / "est.csv"
    path.write_text(f"{name},tx,ty,tz,qx,qy,qz,qw\n" + ROWS.replace(" ", ","))
    times = read_path(path).times
    assert times is not None
    np.testing.assert_allclose(times, 0.1 * np.arange(FRAMES), atol=1e-12)


def test_decimal_commas_are_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "est.csv"
    path.write_text("t;tx;ty;tz;qx;qy;qz;qw\n0,1;1,5;0;0;0;0;0;1\n")
    with pytest.raises(
        DataError, match="'0,1', with a decimal comma instead of a point, is not a finite number"
    ):
        read_path(path)
