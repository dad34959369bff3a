"""Label files: clipping, optional scores, and empty files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vo_lib.data.label_files import read_labels, write_labels
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
