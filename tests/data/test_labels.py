"""Label files: clipping, scores, polygons, tolerance, corners, and their counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vo_lib.data.label_files import count_labels, label_files, read_label_rows, read_labels, write_labels
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes, no_boxes


def test_boxes_are_clipped_and_scores_are_optional(tmp_path: Path) -> None:
    boxes = Boxes(np.array([[-20.0, 10, 50, 400]]), np.array([2]), np.array([0.5]))
    write_labels(tmp_path / "a.txt", boxes, 100, 50, scores=False)
    assert len((tmp_path / "a.txt").read_text().split()) == 5
    result = read_labels(tmp_path / "a.txt", 100, 50)
    assert result.xyxy == pytest.approx(np.array([[-0.5, 10, 50, 49.5]]), abs=1e-3)
    assert result.score.tolist() == [1.0]
    write_labels(tmp_path / "a.txt", no_boxes(), 100, 50)
    assert (tmp_path / "a.txt").read_bytes() == b""
    assert len(read_labels(tmp_path / "a.txt", 100, 50)) == 0


BOX = [9.5, 9.5, 29.5, 39.5]  # pixels of an image of 100×50


@pytest.mark.parametrize(
    "line",
    [
        "2 0.2 0.5 0.2 0.6",
        "2.0 0.2 0.5 0.2 0.6",
        "2 0.2 0.5 0.2 0.6 0.75",
        "2 0.1 0.2 0.3 0.2 0.2 0.8",  # triangle
        "2 0.1 0.2 0.3 0.2 0.3 0.8 0.1 0.8",  # rotated box
        "2 0.1 0.3 0.2 0.2 0.3 0.5 0.25 0.8 0.15 0.7",
    ],
)
def test_every_form_of_a_box_is_read(tmp_path: Path, line: str) -> None:
    (tmp_path / "000000.txt").write_text(f"\n{line}\n")
    boxes = read_labels(tmp_path / "000000.txt", 100, 50)
    assert boxes.xyxy == pytest.approx(np.array([BOX]))
    assert boxes.class_id.tolist() == [2]
    assert boxes.score.tolist() == [0.75 if line.endswith("0.75") else 1.0]


def test_small_excesses_are_clipped(tmp_path: Path) -> None:
    (tmp_path / "000000.txt").write_text("2 -0.000001 0.5 0.2 1.000437\n")
    boxes = read_labels(tmp_path / "000000.txt", 100, 50)
    assert boxes.xyxy == pytest.approx(np.array([[-10.5, -0.5, 9.5, 49.5]]))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("2 0.2 0.5 0.2 1.002", "values in 0..1"),
        ("2.5 0.2 0.5 0.2 0.6", "expected a class number"),
        ("-1 0.2 0.5 0.2 0.6", "expected a class number"),
        ("2 120 200 60 40", "values in 0..1"),
        ("2 0.2 0.5 0.2 0.6 0.9 3", "omit the number of the track$"),  # as Ultralytics writes it
        ("2 0.2 0.5 0.2 0.6 0.9 117", "omit the number of the track$"),
        ("2 0.2 0.5 0.2 0.6 0.9 1", r"the track; if this is a triangle, write its last number as 1\.0$"),
        ("2 0.2 0.5 0.2 0.6 0.9 0", r"the track; if this is a triangle, write its last number as 0\.0$"),
        ("2 0.02 0.5 0.2 0.6 0.9 1", "omit the number of the track"),  # not clipped at the border
        ("2 20 50 20 60 90 3", "values in 0..1"),
        ("2 0.2 0.5 0.2 0.6 0.9 3.5", "values in 0..1"),
        ("2 0.2 0.5 0.2", "found 4 fields"),
        ("2 0.2 0.5 0.2 0.6 0.1 0.1 0.1", "found 8 fields"),
    ],
)
def test_other_lines_are_refused(tmp_path: Path, line: str, words: str) -> None:
    (tmp_path / "000000.txt").write_text(f"2 0.2 0.5 0.2 0.6\n{line}\n")
    with pytest.raises(DataError, match=f"000000.txt, line 2: .*{words}"):
        read_labels(tmp_path / "000000.txt", 100, 50)


@pytest.mark.parametrize(
    ("line", "box"),
    [
        ("2 0.2 0.2 0.9 0.9 0.5 1", [0.2, 0.2, 0.9, 1.0]),
        ("2 0.1 0.5 0.8 0.4 0.3 0", [0.1, 0.0, 0.8, 0.5]),
        ("2 0.5 0.9 0 0.3 0.7 1", [0.0, 0.3, 0.7, 1.0]),  # no box has the width 0
        ("2 0.2 0.5 0.2 0.6 0.9 1.0", [0.2, 0.5, 0.9, 1.0]),
    ],
)
def test_triangles_may_end_with_a_whole_number(tmp_path: Path, line: str, box: list[float]) -> None:
    (tmp_path / "000000.txt").write_text(f"{line}\n")
    boxes = read_labels(tmp_path / "000000.txt", 100, 50)
    assert boxes.xyxy == pytest.approx(np.array([box]) * [100, 50, 100, 50] - 0.5)


def test_kittis_object_labels_name_their_conversion(tmp_path: Path) -> None:
    row = "Car 0.00 0 1.85 387.63 181.54 423.81 203.12 1.67 1.87 3.69 -16.53 2.39 58.49 1.57"
    for line in (row, f"{row} 0.93", row.replace("Car", "DontCare")):
        (tmp_path / "000000.txt").write_text(f"{line}\n")
        with pytest.raises(DataError, match=r"000000\.txt, line 1: .* vo data kitti_to_yolo converts them"):
            read_labels(tmp_path / "000000.txt", 100, 50)


PERSON = "0 0.6 0.5 0.1 0.4"  # x from 0.55 to 0.65, y from 0.3 to 0.7


@pytest.mark.parametrize(
    "line",
    [
        f"{PERSON} 0.58 0.35 0.62 0.6",
        f"{PERSON} 0.6 0.35 2",
        f"{PERSON} 0.6 0.35 2 0.58 0.6 1 0 0 0",
        f"{PERSON} 0.6 0.35 1 0.58 0.6 0",
        f"{PERSON} 0.6 0.35 0.98 0.58 0.6 0.71",
        f"{PERSON} 0.6 0.35 0.58 0.6 0.9",  # with a score
        f"{PERSON} 0.6 0.35 0.98 0.58 0.6 0.71 0.64 0.69 0.4 0.9",
        f"{PERSON} " + " ".join(f"{0.56 + 0.005 * k:.3f} {0.32 + 0.02 * k:.3f} 2" for k in range(17)),
        f"{PERSON} " + " ".join(f"{0.56 + 0.005 * k:.3f} {0.32 + 0.02 * k:.3f}" for k in range(17)),
        "2 0.4 0.5 0.1 0.3 0.38 0.4 0.43 0.6",
        "2 0.5 0.5 0.2 0.3 0.45 0.4 0.55 0.6 0 0",
        "2 0.2 0.6 0.1 0.2 0.16 0.52 0.24 0.52 0.16 0.68 0.24 0.68",  # corners of a car's rear
    ],
)
def test_boxes_with_keypoints_are_no_polygons(tmp_path: Path, line: str) -> None:
    (tmp_path / "000000.txt").write_text(f"2 0.2 0.5 0.2 0.6\n{line}\n")
    with pytest.raises(DataError, match=r"line 2: .*found a box with keypoints"):
        read_labels(tmp_path / "000000.txt", 100, 50)


def test_polygons_that_may_be_keypoints_are_counted(tmp_path: Path) -> None:
    lines = [f"{PERSON} 0.6 0.4", "2 0.3 0.5 0.2 0.3 0.25 0.4 0.35 0.6", "2 0.1 0.2 0.3 0.2 0.2 0.8"]
    lines.append("2 0.3 0.5 0.1 0.3 0.28 0.4 0.33 0.6")
    (tmp_path / "000000.txt").write_text("\n".join(lines))
    counts = count_labels([tmp_path / "000000.txt"])
    assert (counts.polygons, counts.may_be_keypoints) == (4, 3)


@pytest.mark.parametrize("count", [3, 4, 5, 8, 30])
@pytest.mark.parametrize("size", [0.01, 0.1, 0.3])
def test_polygons_are_not_taken_for_keypoints(tmp_path: Path, count: int, size: float) -> None:
    generator = np.random.default_rng(0)
    for _ in range(200):
        angles = 2 * np.pi / count * (np.arange(count) + generator.uniform(-0.4, 0.4, count))
        if count == 4:  # a rotated box
            angles = angles[0] + np.array([0, 0.7, np.pi, np.pi + 0.7])
        centre = generator.uniform(size, 1 - size, 2)
        points = centre + size * np.stack([np.cos(angles), np.sin(angles)], axis=1) * [0.9, 0.6]
        line = " ".join(f"{value:.6f}" for value in points.ravel())
        (tmp_path / "000000.txt").write_text(f"2 {line}\n")
        assert read_label_rows(tmp_path / "000000.txt").polygon.tolist() == [True], line


CORNERS = ("2 0.08 0.48 0.24 0.80", "2 0.56 0.45 0.63 0.61")


def test_corners_are_refused(tmp_path: Path) -> None:
    for k, line in enumerate(CORNERS):
        (tmp_path / f"00000{k}.txt").write_text(line)
        with pytest.raises(DataError, match="seem to be corners, class x0 y0 x1 y1"):
            read_labels(tmp_path / "000000.txt", 100, 50)


def test_boxes_that_were_not_clipped_are_no_corners(tmp_path: Path) -> None:
    (tmp_path / "000000.txt").write_text(CORNERS[0])  # a near truck, partly outside
    (tmp_path / "000001.txt").write_text("2 0.5 0.5 0.1 0.1")
    assert read_labels(tmp_path / "000000.txt", 100, 50).xyxy[0, 0] == pytest.approx(-4.5)


def test_labels_of_a_folder_are_counted(tmp_path: Path) -> None:
    (tmp_path / "000000.txt").write_text("0 0.2 0.5 0.2 0.6\n5 0.1 0.2 0.3 0.2 0.2 0.8\n")
    (tmp_path / "000001.txt").write_text("0 0.2 0.5 0.2 0.6\n")
    (tmp_path / "classes.txt").write_text("car\n")
    counts = count_labels(label_files(tmp_path))
    assert counts.boxes == {0: 2, 5: 1}
    assert counts.polygons == 1
    assert not counts.may_be_corners
    corner = "0 0.4 0.4 0.45 0.45\n"  # not outside, but could be corners
    for text, suspicious in ((10 * corner, True), (corner, True), (f"{corner}0 0.5 0.5 0.1 0.1\n", False)):
        (tmp_path / "000001.txt").write_text(text)
        assert count_labels([tmp_path / "000001.txt"]).may_be_corners == suspicious
    (tmp_path / "000001.txt").write_text("")
    assert not count_labels([tmp_path / "000001.txt"]).may_be_corners
