"""Label files: what is written is read again, and wrong lines are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.data.labels import read_labels, write_labels

shares = st.floats(0, 1)


@given(st.lists(st.tuples(shares, shares, shares, shares, st.integers(0, 90), shares), max_size=8))
def test_written_labels_are_read_again(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float, float, float, int, float]]
) -> None:
    width, height = 1241, 376
    corners = [[min(a, c), min(b, d), max(a, c), max(b, d)] for a, b, c, d, _, _ in rows]
    boxes = Boxes(
        np.array(corners).reshape(-1, 4) * [width, height, width, height] - 0.5,
        np.array([row[4] for row in rows], np.int64),
        np.array([row[5] for row in rows]),
    )
    path = tmp_path_factory.mktemp("labels") / "000000.txt"
    write_labels(path, boxes, width, height)
    found = read_labels(path, width, height)
    assert found.class_id.tolist() == boxes.class_id.tolist()
    assert found.xyxy == pytest.approx(boxes.xyxy, abs=0.002)
    assert found.score == pytest.approx(boxes.score, abs=1e-6)


def test_a_box_beyond_the_border_is_cut_there(tmp_path: Path) -> None:
    boxes = Boxes(np.array([[-20.0, 10, 50, 400]]), np.array([2]), np.array([0.5]))
    write_labels(tmp_path / "a.txt", boxes, 100, 50)
    assert read_labels(tmp_path / "a.txt", 100, 50).xyxy == pytest.approx(
        np.array([[-0.5, 10, 50, 49.5]]), abs=1e-3
    )


def test_labels_without_scores_have_five_fields_and_count_one(tmp_path: Path) -> None:
    boxes = Boxes(np.array([[10.0, 10, 50, 40]]), np.array([2]), np.array([0.5]))
    write_labels(tmp_path / "a.txt", boxes, 100, 50, scores=False)
    assert len((tmp_path / "a.txt").read_text().split()) == 5
    assert read_labels(tmp_path / "a.txt", 100, 50).score.tolist() == [1.0]


def test_no_boxes_make_an_empty_file(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.txt", no_boxes(), 100, 50)
    assert (tmp_path / "a.txt").read_bytes() == b""
    assert len(read_labels(tmp_path / "a.txt", 100, 50)) == 0
