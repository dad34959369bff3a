"""Training a detector: data sets, augmentation, quality measures; with PyTorch also loss and a tiny run."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from data_command import load
from hypothesis import given
from hypothesis import strategies as st

from training.augment import fitted, training_picture
from training.config import DetectionSetConfig, TrainingConfig
from training.dataset import DetectionSet, Example, open_set
from training.evaluated import ODOMETRY_DRIVES, evaluated_sequence, refuse_evaluated
from training.mean_ap import average_precision, judge, recall_precision
from training.street_set import Street, draw_street, random_scene, streets
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.errors import DataError
from vo_lib.data.labels import read_labels
from vo_lib.detection.yolo import YoloDetector

train_detector = load("train_detector")
DARK, BRIGHT = 40, 220


def boxes(*rows: tuple[float, ...], score: list[float] | None = None, kind: int = 0) -> Boxes:
    scores = np.array(score if score is not None else [1.0] * len(rows))
    return Boxes(np.array(rows, float).reshape(-1, 4), np.full(len(rows), kind, np.int64), scores)


def bright_example(rng: np.random.Generator, width: int = 400, height: int = 120) -> Example:
    """A dark image with one bright rectangle: its box can be seen in the pixels."""
    image = np.full((height, width), DARK, np.uint8)
    w, h = int(rng.integers(30, 90)), int(rng.integers(24, 60))
    x, y = int(rng.integers(0, width - w)), int(rng.integers(0, height - h))
    image[y : y + h, x : x + w] = BRIGHT
    return Example(image, boxes((x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5)), no_boxes())


PLAIN = TrainingConfig(width=192, height=64, size=256, tones=0.0, blur=0.0, noise=0.0)


@pytest.mark.parametrize("mosaic", [0.0, 1.0])
def test_boxes_follow_their_pixels_through_every_change(mosaic: float) -> None:
    config = dataclasses.replace(PLAIN, mosaic=mosaic)
    seen = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        target = training_picture(functools.partial(bright_example, rng), config, rng)
        inside = np.zeros(target.image.shape, bool)
        for x0, y0, x1, y1 in [*np.rint(target.corners).astype(int), *np.rint(target.ignored).astype(int)]:
            inside[max(y0 - 1, 0) : y1 + 1, max(x0 - 1, 0) : x1 + 1] = True
        assert not (target.image[~inside] > 200).any()  # nothing bright outside of the boxes
        for x0, y0, x1, y1 in np.rint(target.corners).astype(int):
            piece = target.image[y0 + 2 : y1 - 2, x0 + 2 : x1 - 2]
            assert (piece > 200).all()  # and nothing dark inside
            seen += piece.size > 0
    assert seen > 30


def test_the_same_seed_makes_the_same_picture() -> None:
    example = bright_example(np.random.default_rng(1))
    one, two = (
        training_picture(lambda: example, TrainingConfig(), np.random.default_rng(5)) for _ in range(2)
    )
    assert np.array_equal(one.image, two.image)
    assert np.array_equal(one.corners, two.corners)


def test_an_evaluated_picture_is_the_whole_image() -> None:
    example = bright_example(np.random.default_rng(2))
    target = fitted(example, 192)
    x0, y0, x1, y1 = np.rint(target.corners[0]).astype(int)
    assert target.image.shape == (64, 192)
    assert (target.image[y0 + 1 : y1 - 1, x0 + 1 : x1 - 1] > 200).all()
    assert target.image[:, x1 + 2 :].max(initial=0) < 200


def test_a_second_detection_of_one_vehicle_is_wrong() -> None:
    truth = boxes((0, 0, 20, 20))
    found = boxes((0, 0, 20, 20), (1, 0, 21, 20), score=[0.8, 0.9])
    judged = judge(found, truth, np.zeros((0, 4)))
    assert judged.right.tolist() == [True, False]
    assert recall_precision([judged]) == (1.0, 0.5)


def test_small_and_ignored_vehicles_count_neither_way() -> None:
    truth = boxes((0, 0, 20, 10), (50, 0, 90, 40))
    region = np.array([[100.0, 0, 200, 100]])
    found = boxes((0, 0, 20, 10), (50, 0, 90, 40), (110, 10, 150, 50), score=[0.9, 0.8, 0.7])
    judged = judge(found, truth, region, min_height=16)
    assert judged.right.tolist() == [True]
    assert recall_precision([judged]) == (1.0, 1.0)
    assert recall_precision([judge(found, truth, np.zeros((0, 4)), min_height=16)]) == (1.0, 0.5)


def test_average_precision_by_hand() -> None:
    truth = boxes((0, 0, 20, 20), (40, 0, 60, 20))
    found = boxes((0, 0, 20, 20), (80, 0, 99, 20), (40, 0, 60, 20), score=[0.9, 0.8, 0.7])
    # Precision 1 up to recall 1/2 (51 of 101 points), 2/3 up to recall 1 (the other 50).
    expected = (51 * 1.0 + 50 * 2 / 3) / 101
    assert average_precision([judge(found, truth, np.zeros((0, 4)))]) == pytest.approx(expected)


@given(st.permutations(range(6)))
def test_average_precision_does_not_depend_on_the_order_of_detections(order: list[int]) -> None:
    rows = [(20.0 * k, 0.0, 20.0 * k + 15, 20.0) for k in range(6)]
    scores = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4]
    truth = boxes(rows[0], rows[2], rows[5])
    shuffled = boxes(*(rows[k] for k in order), score=[scores[k] for k in order])
    plain = judge(boxes(*rows, score=scores), truth, np.zeros((0, 4)))
    assert average_precision([judge(shuffled, truth, np.zeros((0, 4)))]) == average_precision([plain])


def test_no_detections_give_zero_and_no_truth_gives_nan() -> None:
    assert average_precision([judge(no_boxes(), boxes((0, 0, 9, 9)), np.zeros((0, 4)))]) == 0.0
    assert np.isnan(average_precision([judge(no_boxes(), no_boxes(), np.zeros((0, 4)))]))


def test_no_street_of_one_split_is_in_another() -> None:
    config = DetectionSetConfig(train=480, valid=48, test_seeds=2, frames=24)
    every = streets(config)
    seeds = {split: {s.scene.seed for s in every if s.split == split} for split in ("train", "valid", "test")}
    assert [len(seeds[split]) for split in ("train", "valid", "test")] == [20, 2, 12]
    assert not seeds["train"] & seeds["valid"]
    assert not (seeds["train"] | seeds["valid"]) & seeds["test"]
    assert sum(s.frames for s in every if s.split == "train") == 480
    assert streets(config) == every


def test_a_drawn_image_has_its_boxes_and_is_not_drawn_twice(tmp_path: Path) -> None:
    config = DetectionSetConfig(frames=2)
    scene = dataclasses.replace(random_scene(7), width=320, height=96, focal=190.0, length=30.0, parked=0.9)
    scene = dataclasses.replace(scene, layout="city", exposure_change=0.1, shutter=0.0)
    for kind in ("images", "labels", "ignored"):
        (tmp_path / "train" / kind).mkdir(parents=True)
    street = Street("train", 0, scene, 2)
    assert draw_street(street, tmp_path, config) == 2
    first = tmp_path / "train" / "images" / "0000_00.jpg"
    image = cv2.imread(str(first), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (96, 320)
    found = read_labels(tmp_path / "train" / "labels" / "0000_00.txt", 320, 96)
    assert len(found) >= 3
    assert set(found.class_id.tolist()) <= {0, 1, 2}
    assert (found.xyxy[:, 3] - found.xyxy[:, 1] >= config.min_height - 0.01).all()
    first.write_bytes(b"mark")
    draw_street(street, tmp_path, config)
    assert first.read_bytes() == b"mark"


@pytest.mark.parametrize(("drive", "sequence"), list(ODOMETRY_DRIVES.items()))
def test_images_of_evaluated_drives_are_known_by_their_path(drive: str, sequence: str) -> None:
    assert evaluated_sequence(f"/data/raw/{drive}_sync/image_00/data/0000000001.png") == sequence
    assert evaluated_sequence(f"{drive}_000001") == sequence
    assert evaluated_sequence(f"kitti/sequences/{sequence}/image_0/000000.png") == sequence


def test_other_images_are_free_and_evaluated_ones_are_refused_with_the_reason(tmp_path: Path) -> None:
    free = tmp_path / "2011_09_26_drive_0005_000001.png"
    refuse_evaluated([free, tmp_path / "sequences" / "11" / "000000.png"])
    with pytest.raises(
        DataError, match=r"sequence 07, which is evaluated: .* look smaller .* --allow-evaluated"
    ):
        refuse_evaluated([free, tmp_path / "2011_09_30_drive_0027_000001.png"])


# From here on PyYAML or PyTorch of the extra [train] is needed.


def write_set(folder: Path, count: int = 12, roboflow: bool = False, prefix: str = "") -> Path:
    """A data set of bright rectangles, as ours or with the entries of a Roboflow export."""
    rng = np.random.default_rng(3)
    for split in ("train", "valid"):
        for kind in ("images", "labels"):
            (folder / split / kind).mkdir(parents=True)
        for k in range(count):
            example = bright_example(rng)
            cv2.imwrite(str(folder / split / "images" / f"{prefix}{k:03d}.png"), example.image)
            x0, y0, x1, y1 = (example.boxes.xyxy[0] + 0.5) / (400, 120, 400, 120)
            row = f"0 {(x0 + x1) / 2:.6f} {(y0 + y1) / 2:.6f} {x1 - x0:.6f} {y1 - y0:.6f}\n"
            (folder / split / "labels" / f"{prefix}{k:03d}.txt").write_text(row)
    if roboflow:
        text = "train: ../train/images\nval: ../valid/images\ntest: ../test/images\n\nnc: 1\nnames: ['car']\n"
        text += "\nroboflow:\n  workspace: w\n  version: 3\n  license: CC BY 4.0\n"
    else:
        text = "train: train/images\nval: valid/images\nnames:\n  0: car\n"
    (folder / "data.yaml").write_text(text)
    return folder


@pytest.mark.parametrize("roboflow", [False, True])
def test_a_data_set_is_read_as_ours_or_as_roboflows(tmp_path: Path, roboflow: bool) -> None:
    pytest.importorskip("yaml", reason="PyYAML belongs to the extra [train]")
    data = open_set(write_set(tmp_path / "set", 3, roboflow))
    assert data.names == ("car",)
    assert [len(data.images[split]) for split in ("train", "valid", "test")] == [3, 3, 0]
    example = data.read(data.images["train"][0])
    x0, y0, x1, y1 = np.rint(example.boxes.xyxy[0] + 0.5).astype(int)
    assert (example.image[y0:y1, x0:x1] == BRIGHT).all()
    assert np.count_nonzero(example.image == BRIGHT) == (x1 - x0) * (y1 - y0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("names: [car]\nval: valid/images\n", "expected `train:` with a folder of images; found None"),
        ("train: train/images\nval: valid/images\n", "expected `names:`"),
        ("train: [\n", r"data\.yaml, line 2: is not YAML"),
        ("- a\n", "expected the keys train, val and names"),
    ],
)
def test_a_wrong_description_is_one_clear_line(tmp_path: Path, text: str, message: str) -> None:
    pytest.importorskip("yaml", reason="PyYAML belongs to the extra [train]")
    (write_set(tmp_path / "set", 1) / "data.yaml").write_text(text)
    with pytest.raises(DataError, match=message):
        open_set(tmp_path / "set")


def test_a_label_of_an_unnamed_class_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("yaml", reason="PyYAML belongs to the extra [train]")
    data = open_set(write_set(tmp_path / "set", 1))
    (tmp_path / "set" / "train" / "labels" / "000.txt").write_text("4 0.5 0.5 0.1 0.1\n")
    with pytest.raises(DataError, match=r"class 4: data\.yaml names the classes 0 to 0"):
        data.read(data.images["train"][0])


@pytest.fixture
def torch() -> Any:
    return pytest.importorskip("torch", reason="PyTorch belongs to the extra [train]")


TINY = TrainingConfig(
    epochs=2, batch=4, width=128, height=64, size=256, threads=1, rate=3e-3, average=0.5, mosaic=0.2
)


def tiny_set(tmp_path: Path) -> DetectionSet:
    pytest.importorskip("yaml", reason="PyYAML belongs to the extra [train]")
    return open_set(write_set(tmp_path / "set", 16))


def test_the_overlap_of_equal_boxes_is_one_and_falls_with_distance(torch: Any) -> None:
    from training.loss import complete_overlap
    from training.loss import overlap as differentiable

    box = torch.tensor([[0.0, 0, 10, 10]])
    for shift, known in ((0.0, 1.0), (5.0, 1 / 3), (50.0, 0.0)):
        moved = box + torch.tensor([shift, 0, shift, 0])
        assert float(differentiable(box, moved)) == pytest.approx(known, abs=1e-5)
        assert float(complete_overlap(box, moved)) <= known + 1e-5
    near, far = (complete_overlap(box, box + torch.tensor([d, 0.0, d, 0.0])) for d in (20.0, 80.0))
    assert float(far) < float(near) < 0  # apart, but still told the way


def test_cells_learn_the_boxes_they_lie_in_and_none_on_ignored_ones(torch: Any) -> None:
    from training.loss import Truth, assign
    from training.network import cells_of

    cells = torch.cat([cells_of(torch.zeros(1, 1, 8 // k, 16 // k), 8 * k) for k in (1, 2, 4)])
    truth = Truth(
        torch.tensor([[10.0, 10, 50, 40], [70, 5, 74, 9]]),
        torch.tensor([0, 0]),
        torch.tensor([[90.0, 30, 126, 62]]),
    )
    corners = torch.cat([cells[:, :2] - cells[:, 2:], cells[:, :2] + cells[:, 2:]], 1)
    found = assign(corners, torch.full((len(cells), 1), 0.1), cells, truth, 5)
    first = cells[found.box == 0]
    assert 1 <= len(first) <= 5
    assert ((first[:, 0] > 10) & (first[:, 0] < 50) & (first[:, 1] > 10) & (first[:, 1] < 40)).all()
    assert (found.box == 1).any()  # even a box between all centres has a cell
    aside = (cells[:, 0] > 90) & (cells[:, 1] > 30) & (cells[:, 0] < 126) & (cells[:, 1] < 62)
    assert not found.counts[aside].any()
    assert found.counts[~aside].all()
    assert (found.score[found.box < 0] == 0).all()
    assert float(found.score.max()) <= 1.0


def test_a_short_training_lowers_the_loss_and_exports_what_it_learnt(torch: Any, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx", reason="onnx belongs to the extra [train]")
    del onnx
    from training.export import export_onnx
    from training.network import Exported
    from training.trainer import new_state, train

    state = new_state(dataclasses.replace(TINY, epochs=6), ("car",))
    for _ in train(tiny_set(tmp_path), state, tmp_path):
        pass
    total = [sum(pair) for pair in state.losses]
    assert total[-1] < 0.9 * total[0]
    export_onnx(state.average, ("car",), tmp_path / "a.onnx", 256)
    detector = YoloDetector(tmp_path / "a.onnx")
    assert detector.layout == "yolov8"
    assert detector.names == ("car",)
    assert detector.input_size(1000, 250) == (256, 64)  # the size told in the metadata
    for height, width in ((64, 256), (160, 96)):  # any multiple of 32
        images = np.random.default_rng(0).random((1, 3, height, width), np.float32)
        with torch.no_grad():
            expected = Exported(state.average)(torch.from_numpy(images)).numpy()[0]
        assert detector._run(images) == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_a_training_begins_with_an_exported_network(torch: Any, tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx belongs to the extra [train]")
    from training.export import export_onnx
    from training.start import starting_network
    from training.trainer import batches, new_state, to_tensor, train

    data = tiny_set(tmp_path)
    taught = list(train(data, new_state(TINY, ("car",)), tmp_path))[-1].average
    export_onnx(taught, ("car",), tmp_path / "a.onnx", 256)
    again = starting_network(tmp_path / "a.onnx", data, TINY)
    pictures = to_tensor(next(batches(data, TINY, 0)))
    with torch.no_grad():
        expected = taught(pictures)
        for training in (False, True):  # and normalising by the batch changes nothing here
            found = again.train(training)(pictures)
            for one, other in zip(found, expected, strict=True):
                assert torch.allclose(one, other, rtol=1e-3, atol=0.02), training
    with pytest.raises(DataError, match="not those of this network for these classes"):
        starting_network(
            tmp_path / "a.onnx", dataclasses.replace(data, names=("car", "bus"), merged=None), TINY
        )
    (tmp_path / "b.onnx").write_bytes(b"no network")
    with pytest.raises(DataError, match="is no ONNX file"):
        starting_network(tmp_path / "b.onnx", data, TINY)
    with pytest.raises(DataError, match="cannot be read"):
        starting_network(tmp_path / "c.onnx", data, TINY)


def test_a_resumed_training_equals_one_that_was_not_stopped(torch: Any, tmp_path: Path) -> None:
    from training.trainer import CHECKPOINT, load_state, new_state, train

    data, once, twice = tiny_set(tmp_path), tmp_path / "once", tmp_path / "twice"
    for folder in (once, twice):
        folder.mkdir()
    for _ in train(data, new_state(TINY, ("car",)), once):
        pass
    for _ in train(data, new_state(TINY, ("car",)), twice):
        break  # stopped after the first epoch
    for _ in train(data, load_state(twice / CHECKPOINT), twice):
        pass
    one, two = load_state(once / CHECKPOINT), load_state(twice / CHECKPOINT)
    assert one.losses == two.losses
    for name, weights in one.average.state_dict().items():
        assert torch.equal(weights, two.average.state_dict()[name]), name


def test_a_file_that_is_no_checkpoint_is_refused(torch: Any, tmp_path: Path) -> None:
    from training.trainer import load_state

    (tmp_path / "last.pt").write_bytes(b"nothing")
    with pytest.raises(DataError, match="no checkpoint of this training"):
        load_state(tmp_path / "last.pt")


def test_the_script_trains_and_goes_on_only_with_the_same_settings(
    torch: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("onnx", reason="onnx belongs to the extra [train]")
    tiny_set(tmp_path)
    words = [str(tmp_path / "set"), "--out", str(tmp_path / "run"), "--width", "128", "--height", "64"]
    words += ["--size", "256", "--batch", "8", "--one-class", "vehicle"]
    assert train_detector([*words, "--epochs", "1"]) == 0
    assert "mAP50" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"last.pt", "curves.png", "detector.onnx"}
    assert train_detector([*words, "--epochs", "2"]) == 0
    assert "after 2 epochs" in capsys.readouterr().out
    assert train_detector([*words, "--epochs", "2", "--export-size", "320"]) == 0
    assert YoloDetector(tmp_path / "run" / "detector.onnx").input_size(640, 128) == (320, 64)
    capsys.readouterr()
    assert train_detector([*words, "--epochs", "2", "--export-size", "9"]) == 2
    assert "--export-size 9: expected 32 to 4096 px" in capsys.readouterr().err
    assert train_detector([*words, "--epochs", "2", "--decay", "0.5"]) == 2
    assert "is a training with decay 0.02" in capsys.readouterr().err


def test_the_script_refuses_evaluated_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yaml", reason="PyYAML belongs to the extra [train]")
    write_set(tmp_path / "set", 2, prefix="2011_09_30_drive_0027_")
    assert train_detector([str(tmp_path / "set"), "--out", str(tmp_path / "run")]) == 2
    assert "KITTI odometry sequence 07, which is evaluated" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
