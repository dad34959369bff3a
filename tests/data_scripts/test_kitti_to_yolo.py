"""KITTI's labels as a YOLO data set: classes, and origin of the images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from data_command import load

from training.kitti_set import check_origin, read_object_set, split
from vo_lib.data.label_files import read_labels
from vo_lib.errors import DataError

kitti_to_yolo = load("kitti_to_yolo")
WIDTH, HEIGHT = 200, 100
REST = "0 0 0 0 0 0 0"  # size, place and angle in space
FREE, EVALUATED = "2011_09_26_drive_0005", "2011_09_30_drive_0027"

ROWS = [
    f"Car 0.00 0 -1.5 20.00 30.00 60.00 70.00 {REST}",
    f"Van 0.00 1 -1.5 100.00 30.00 140.00 70.00 {REST}",
    f"Truck 0.00 0 -1.5 150.00 10.00 190.00 90.00 {REST}",
    f"Car 0.00 0 -1.5 70.00 40.00 76.00 45.00 {REST}",
    f"Pedestrian 0.00 0 -1.5 80.00 40.00 90.00 70.00 {REST}",
    "DontCare -1 -1 -10 0.00 0.00 10.00 10.00 -1 -1 -1 -1000 -1000 -1000 -10",
]


def write_image(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 90, np.uint8))


@pytest.fixture
def objects(tmp_path: Path) -> Path:
    """Six images of KITTI's object set, shuffled by the mapping file; two are from an evaluated drive."""
    root = tmp_path / "object"
    (root / "label_2").mkdir(parents=True)
    for k in range(6):
        write_image(root / "image_2" / f"{k:06d}.png")
        (root / "label_2" / f"{k:06d}.txt").write_text("\n".join(ROWS) + "\n")
    drives = [FREE, EVALUATED, FREE, "2011_09_26_drive_0009", EVALUATED, FREE]
    lines = [f"{drive[:10]} {drive}_sync {k:010d}" for k, drive in enumerate(drives)]
    (root / "train_mapping.txt").write_text("\n".join(lines) + "\n")
    (root / "train_rand.txt").write_text("2,1,3,4,6,5\n")
    return root


def test_permutation_gives_the_drive_of_an_image(objects: Path) -> None:
    result = read_object_set(objects, objects / "train_mapping.txt", objects / "train_rand.txt")
    assert result[0].boxes.class_id.tolist() == [0, 0, 1]  # car, van as car, truck
    assert result[0].boxes.xyxy[0].tolist() == [20, 30, 60, 70]
    evaluated = [one.image.stem for one in result if one.drive == EVALUATED]
    assert evaluated == ["000000", "000005"]
    kept = check_origin(result, allow_evaluated=False)
    assert [one.image.stem for one in kept] == ["000001", "000002", "000003", "000004"]
    assert check_origin(result, allow_evaluated=True) == result
    with pytest.raises(DataError, match=r"raw drive is unknown, .* --allow-evaluated"):
        check_origin(read_object_set(objects), allow_evaluated=False)


def test_split_separates_drives(objects: Path) -> None:
    result = read_object_set(objects, objects / "train_mapping.txt", objects / "train_rand.txt")
    for seed in range(8):
        parts = split(result, 0.3, seed)
        drives = [{one.drive for one in parts[name]} for name in ("train", "valid")]
        assert all(drives)
        assert not drives[0] & drives[1]
        assert len(parts["train"]) + len(parts["valid"]) == 6


def test_a_data_set_survives_a_round_trip(objects: Path, tmp_path: Path) -> None:
    words = [str(objects), str(tmp_path / "set"), "--mapping", str(objects / "train_mapping.txt")]
    assert kitti_to_yolo([*words, "--order", str(objects / "train_rand.txt")]) == 0
    labels = sorted((tmp_path / "set").glob("*/labels/*.txt"))
    assert len(labels) == 4
    assert all(FREE in path.name or "drive_0009" in path.name for path in labels)
    boxes = read_labels(labels[0], WIDTH, HEIGHT)
    assert boxes.xyxy[1] == pytest.approx([100, 30, 140, 70], abs=1e-3)
    image = labels[0].parent.parent / "images" / f"{labels[0].stem}.png"
    assert cv2.imread(str(image)) is not None
    assert "  - car\n  - truck\n  - train\n" in (tmp_path / "set" / "data.yaml").read_text()
