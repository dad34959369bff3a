"""The miniature detector of chapter 5: its gradients, its training, and what the chapter says about it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from course.ch05 import FilteringPanel, detector_figures, layers, miniature
from course.ch05 import exercises as ch05
from course.ch05.figures import candidates_picture
from course.colours import GOOD, bgr
from vo_lib.data.sequence import Sequence
from vo_lib.detection.network_image import Letterbox
from vo_lib.detection.yolo import NetworkOutput
from vo_lib.evaluation.statistics import change_limit, standard_deviation
from vo_lib.geometry.boxes import overlap
from vo_lib.geometry.types import Array

CELLS = {
    cell["id"]: "".join(cell["source"])
    for cell in json.loads(miniature.NOTEBOOK.read_text(encoding="utf-8"))["cells"]
}
NAMES = miniature.notebook_functions()
LONGEST_CELL = 25  # lines
FEW_STEPS = 25


def wave(shape: tuple[int, ...], seed: int) -> Array:
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize(("kernel", "stride"), [(1, 1), (3, 1), (3, 2), (6, 4)])
def test_spread_is_the_transpose_of_patches(kernel: int, stride: int) -> None:
    x: Any = wave((2, 8, 16, 3), 0).astype(np.float32)
    columns = layers.patches(x, kernel, stride)
    y: Any = wave(columns.shape, 1).astype(np.float32)
    back = layers.spread(y, x.shape, kernel, stride)
    assert columns.shape == (2, 8 // stride, 16 // stride, kernel**2 * 3)
    assert np.sum(columns * y) == pytest.approx(np.sum(x * back), rel=1e-4)


@pytest.mark.parametrize("network", ["ONE_LEVEL", "THREE_LEVELS"])
def test_the_gradients_of_all_layers_are_those_of_small_steps(network: str) -> None:
    table = NAMES[network]
    weights: Any = [each.astype(np.float64) for each in layers.first_weights(table, np.random.default_rng(0))]
    images: Any = wave((1, 32, 64, 1), 2)
    count = len(table.levels)

    def total() -> float:
        maps, _ = NAMES["forward"](images, weights, table)
        return float(sum(np.sum(each**2) for each in maps[-count:]))

    maps, columns = NAMES["forward"](images, weights, table)
    gradients = layers.backward(table, [2 * each for each in maps[-count:]], maps, columns, weights)
    for weight, gradient in zip(weights, gradients, strict=True):
        place = np.unravel_index(np.abs(gradient).argmax(), gradient.shape)
        step = 1e-6 * max(1.0, abs(float(weight[place])))
        values = []
        for way in (step, -2 * step):
            weight[place] += way
            values.append(total())
        weight[place] += step
        # Where a small step crosses the bend of an activation, the two sides differ a little.
        assert (values[0] - values[1]) / (2 * step) == pytest.approx(float(gradient[place]), rel=0.02)


def test_the_loss_of_a_box_falls_as_its_derivatives_say() -> None:
    own = np.exp(wave((20, 4), 3))
    true = np.exp(wave((20, 4), 4))
    _, change = NAMES["box_loss"](own, true)
    step = 1e-6
    for side in range(4):
        moved = [NAMES["box_loss"](own + way * np.eye(4)[side], true)[0][:, 0] for way in (-step, step)]
        np.testing.assert_allclose(
            -np.diff(np.log(moved), axis=0)[0] / (2 * step), change[:, side], rtol=1e-5
        )
    np.testing.assert_allclose(NAMES["box_loss"](true, true)[0], 1.0)


def test_the_loss_wants_the_quality_of_the_box_as_score() -> None:
    sides = np.zeros((1, 2, 2, 4), np.float32)
    sides[0, 1, 0] = 16.0
    output = np.full((1, 2, 2, 5), -20.0, np.float32)
    output[0, 1, 0] = [20.0, 0.0, 0.0, 0.0, 0.0]  # 16 px to all sides: the right box with the right score
    losses, gradient = NAMES["loss"](output, sides, 16)
    np.testing.assert_allclose(losses, 0.0, atol=1e-4)
    np.testing.assert_allclose(gradient[..., 0], 0.0, atol=1e-4)
    # Cells that are responsible for nothing have no box.
    np.testing.assert_array_equal(gradient[0, 0, :, 1:], 0.0)
    # The left side is too near: the score is too high, and the side moves out.
    output[0, 1, 0, 1] = np.log(0.5)
    _, gradient = NAMES["loss"](output, sides, 16)
    assert gradient[0, 1, 0, 0] == pytest.approx(1 - 0.75, abs=1e-3)
    assert gradient[0, 1, 0, 1] < -0.1


def test_what_the_responsible_cells_should_say_decodes_to_the_labels() -> None:
    boxes = np.array([[20.0, 30.0, 90.0, 80.0], [150.0, 30.0, 171.0, 52.0]])
    sides = NAMES["targets"](boxes, 12, 40, NAMES["ONE_LEVEL"].levels[0])
    output = np.zeros((12, 40, 5))
    output[..., 1:] = np.log(np.maximum(sides, 1e-6) / 16)
    corners, _ = ch05.decoded(output, 16)
    found = corners[sides[..., 0].ravel() > 0]
    assert all(np.abs(found - box).max(axis=1).min() < 1e-3 for box in boxes)
    assert all(np.abs(boxes - each).max(axis=1).min() < 1e-3 for each in found)


@pytest.fixture(scope="module")
def school(street: Sequence) -> list[miniature.Labelled]:
    return miniature.labelled(street, 12)


def test_a_window_shows_its_labels_where_the_image_has_them(school: list[miniature.Labelled]) -> None:
    image, boxes = school[6]
    marked = np.zeros_like(image)
    for x0, y0, x1, y1 in np.rint(boxes).astype(int).tolist():
        marked[y0 : y1 + 1, x0 : x1 + 1] = 255
    for seed in range(6):
        part, inside = NAMES["window"](marked, boxes, np.random.default_rng(seed), True)
        assert part.dtype == np.float32
        for x0, y0, x1, y1 in inside:
            middle = part[int((y0 + y1) / 2), int((x0 + x1) / 2), 0]
            assert middle > 0  # white
            assert x1 - x0 > 3
            assert y1 - y0 > 3


def test_a_seed_gives_the_same_bytes_and_training_lowers_the_loss(school: list[miniature.Labelled]) -> None:
    with threadpool_limits(1):
        first, history = NAMES["train"](school, FEW_STEPS, seed=3)
        again, _ = NAMES["train"](school, FEW_STEPS, seed=3)
        other, _ = NAMES["train"](school, FEW_STEPS, seed=4)
    assert [each.tobytes() for each in first] == [each.tobytes() for each in again]
    assert not np.array_equal(first[0], other[0])
    assert history[-8:, 1].mean() < 0.9 * history[:8, 1].mean()


def test_of_two_boxes_on_one_vehicle_the_better_scored_is_right() -> None:
    label = np.array([[100.0, 100.0, 200.0, 160.0], [300.0, 100.0, 330.0, 120.0]])  # the second one is low
    boxes = np.array(
        [[102.0, 100, 202, 160], [100.0, 100, 200, 160], [301.0, 100, 331, 120], [600, 9, 640, 50]]
    )
    given = boxes, np.array([0.9, 0.8, 0.7, 0.6])
    scores, right, wanted = NAMES["judge"]([(np.zeros((9, 9), np.uint8), label)], lambda image: given)
    # The box of the low vehicle counts neither way.
    np.testing.assert_allclose(scores, [0.9, 0.8, 0.6])
    np.testing.assert_array_equal(right, [True, False, False])
    assert wanted == 1


def test_the_picture_colours_the_boxes_by_the_rule_of_the_notebook() -> None:
    rng = np.random.default_rng(5)
    corner = rng.uniform(0, 200, (12, 2))
    labels = np.concatenate([corner, corner + rng.uniform(30, 90, (12, 2))], axis=1)
    boxes = np.repeat(labels, 3, axis=0) + rng.normal(0, 5, (36, 4))
    scores = rng.permutation(36) / 36.0
    right = detector_figures.right_boxes(boxes, scores, labels)
    order = np.argsort(-scores)
    given = boxes[order], scores[order]
    judged = NAMES["judge"]([(np.zeros((9, 9), np.uint8), labels)], lambda image: given)
    np.testing.assert_array_equal(right[order], judged[1])
    assert 6 < right.sum() <= 12
    assert not detector_figures.right_boxes(boxes, scores, labels[:0]).any()


def test_the_panel_takes_the_network_of_the_notebook(school: list[miniature.Labelled]) -> None:
    image = school[3][0]
    weights = layers.first_weights(NAMES["ONE_LEVEL"], np.random.default_rng(1))
    weights[-1][0] = 0.0  # every cell is half sure
    miniature.offer("of the test", lambda given: NAMES["cell_boxes"](given, weights), NAMES["SCALE"])
    boxes, scores = miniature.boxes_of_model("of the test", image)
    own, own_scores = NAMES["detect"](image, weights)
    assert len(boxes) == len(own)
    np.testing.assert_allclose(np.sort(scores), np.sort(own_scores), atol=1e-6)
    height, width = image.shape
    assert boxes.min() >= -0.5
    assert (boxes.max(axis=0) <= [width - 0.5, height - 0.5] * 2).all()


def test_the_panel_says_of_a_real_drive_that_the_miniature_never_saw_one(bands: Path) -> None:
    weights = layers.first_weights(NAMES["ONE_LEVEL"], np.random.default_rng(0))
    miniature.offer("small", lambda given: NAMES["cell_boxes"](given, weights), NAMES["SCALE"])
    panel = FilteringPanel(str(bands), frame=3, view__model="small")
    panel.wait()
    assert panel.error == ""
    assert "<code>small</code> knows only the streets that you trained it on" in panel._text.value


def test_the_lines_of_the_panel_are_as_thin_for_a_network_with_a_small_image() -> None:
    grey = np.full((384, 1280), 128, np.uint8)
    box = np.array([[160.0, 96.0, 800.0, 288.0]])
    blue = []
    for scale in (0.5, 0.25):
        letterbox = Letterbox(round(1280 * scale), round(384 * scale), scale, 0, 0)
        none = np.zeros((0, 4)), np.zeros((0, 1))
        output = NetworkOutput(letterbox, *none, 1280, 384)
        picture = candidates_picture(grey, output, 0.5, letterbox.to_network(box), "words", 252)
        rows = np.flatnonzero((picture.astype(int)[:, 490] - bgr(GOOD) == 0).all(axis=1))
        blue.append(rows.tolist())
    assert len(blue[0]) == len(blue[1]) >= 2
    np.testing.assert_allclose(blue[0], blue[1], atol=1)


def test_a_sequence_without_labels_has_the_boxes_of_a_detector(street: Sequence) -> None:
    assert miniature.with_boxes_of(street, "street") is street
    bare = replace(street, labels=None)
    found = miniature.with_boxes_of(bare, "street")
    assert len(found.boxes(60)) > 5
    assert overlap(found.boxes(60).xyxy, street.boxes(60).xyxy).max(axis=0).min() > 0.5


def test_the_reason_why_label_rows_are_refused_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert miniature.boxes_of_lines(["2 0.5 0.5 0.25 0.5"], 100, 40).tolist() == [[37.0, 9.5, 62.0, 29.5]]
    assert len(miniature.boxes_of_lines(["2 620 180 30 20"], 1241, 376)) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("The kit refuses this file: 000000.txt, line 1: expected a class number")


def test_the_cells_of_the_miniature_are_short() -> None:
    for name in miniature.CELLS:
        assert CELLS[name].count("\n") + 1 <= LONGEST_CELL, name


def test_the_table_was_measured_with_the_cells_of_the_notebook() -> None:
    rows = detector_figures.MEASURED.read_text(encoding="utf-8").splitlines()[1:]
    assert {row.split(",")[3] for row in rows} == {miniature.code_digest()}
    assert "STEPS = 1200\n" in CELLS["training"]
    counts = {name: len(columns["seed"]) for name, columns in detector_figures.measured().items()}
    assert set(counts.values()) == {5}


STREETS = ("ap parked", "ap another jam", "ap another traffic")
# Sentences of the chapter, and what they say: experiment, column, sign of the change from `one street`, and
# whether one run would show it.
SENTENCES = (
    ("On all three streets the twenty frames come out a little worse", "20 frames", STREETS, -1, False),
    (
        "On the street that is most like the training streets, one run would show",
        "three streets",
        STREETS[2:],
        1,
        True,
    ),
    ("On the other two streets no gain is shown", "three streets", STREETS[:2], 0, False),
    ("trucks are found far more often", "three streets", ("trucks",), 1, True),
    ("No difference that one run would show, in either direction", "without changes", STREETS, 0, False),
    ("On average three times as many trucks are found", "with the jam", ("trucks", *STREETS[1:2]), 1, False),
    ("The three levels find about twice as many small vehicles", "three levels", ("small",), 1, True),
    (
        "nothing else changes so that one run would show it",
        "three levels",
        (*STREETS, "clear", "cut", "hidden", "trucks"),
        0,
        False,
    ),
    ("after 300 instead of 1200, AP is lower on each of the streets", "300 steps", STREETS, -1, True),
)


@pytest.mark.parametrize(("sentence", "experiment", "columns", "sign", "seen"), SENTENCES)
def test_sentences_about_the_experiments_are_true_of_the_table(
    sentence: str, experiment: str, columns: tuple[str, ...], sign: int, seen: bool
) -> None:
    assert sum(sentence in text for text in CELLS.values()) == 1
    table = detector_figures.measured()
    for column in columns:
        before = table["one street"][column]
        after = table[experiment][column]
        assert sign in (0, np.sign(after.mean() - before.mean()))
        assert detector_figures.is_shown(before, after) == seen


def test_two_more_streets_and_more_frames_bring_the_same_on_average() -> None:
    table = detector_figures.measured()
    names = ("20 frames", "one street", "three streets")
    few, one, three = (np.mean([table[name][street] for street in STREETS]) for name in names)
    said = "0.57 with the whole street and 0.60 with three streets: both steps bring 0.03"
    assert said in CELLS["experiment-changes-words"]
    np.testing.assert_allclose([few, one, three], [0.54, 0.57, 0.60], atol=0.005)
    np.testing.assert_allclose([one - few, three - one], 0.03, atol=0.005)
    before = table["one street"]["ap another jam"]
    after = table["20 frames"]["ap another jam"]
    limit = change_limit(float(before.mean()), *(float(standard_deviation(each)) for each in (before, after)))
    assert "on another jam they bring 0.056, and the limit is 0.064" in CELLS["experiment-streets-words"]
    assert (round(before.mean() - after.mean(), 3), round(limit, 3)) == (0.056, 0.064)
    text = "\n".join(CELLS.values()) + miniature.NOTEBOOK.with_name("teaching.md").read_text(encoding="utf-8")
    for wrong in (
        "bring almost nothing",
        "worth more than 241 other frames.",
        "hardly did",
        "*Other streets;",
    ):
        assert wrong not in text


def test_a_reader_s_training_is_judged_on_the_streets_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def images(name: str) -> str:
        asked.append(name)
        return name

    monkeypatch.setattr(miniature, "opened", images)
    monkeypatch.setattr(miniature, "another_street", images)
    monkeypatch.setattr(miniature, "labelled", lambda street, count: [street] * count)
    streets = miniature.judged_streets()
    assert [f"ap {name}" for name in streets] == list(STREETS)
    assert asked == ["synthetic/parked", "jam", "traffic"]
    assert {len(frames) for frames in streets.values()} == {miniature.JUDGED_FRAMES}
    assert "judged_streets()" in CELLS["experiment-report"]
    runs = [text for text in CELLS.values() if "\nif RUN:" in text]
    assert len(runs) == 5
    assert all("report(" in text for text in runs)


def test_numbers_about_the_experiments_are_those_of_the_table() -> None:
    prose = "\n".join(CELLS.values())
    table = detector_figures.measured()["one street"]
    assert "About half of the hidden vehicles are missed, and nearly all of the small ones" in prose
    assert table["clear"].mean() > table["cut"].mean() - 0.01
    assert table["cut"].mean() > 0.9 * table["clear"].mean()
    assert 0.4 < table["hidden"].mean() < 0.6
    assert table["small"].mean() < 0.1
    jam = detector_figures.measured()["with the jam"]
    assert 2.5 < jam["trucks"].mean() / table["trucks"].mean() < 3.5
    three = detector_figures.measured()["three levels"]
    assert 1.7 < three["small"].mean() / table["small"].mean() < 2.3
    assert "our 1200 steps of eight windows are about 37 epochs of 261 windows" in prose
    assert round(1200 * 8 / 261) == 37
