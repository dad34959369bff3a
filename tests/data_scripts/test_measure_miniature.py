"""`vo data measure_miniature`: groups of vehicles, average precision, and a table that is continued."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from data_command import load

import measure_miniature
from course.ch05 import exercises as ch05
from course.ch05 import miniature
from measure import detector_experiments
from measure.detector_experiments import Experiment, average_precision, found_labels, groups_of
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import read_csv
from vo_lib.geometry.boxes import Boxes


def test_a_vehicle_is_in_the_groups_of_its_size_place_and_class() -> None:
    xyxy = np.array(
        [
            [100.0, 100, 200, 160],  # covered by the next one
            [150.0, 110, 260, 190],  # nearer: its lower edge is lower
            [400.0, 100, 430, 120],  # low
            [-0.5, 100, 60, 160],  # at the edge
            [600.0, 80, 700, 180],  # a truck
        ]
    )
    boxes = Boxes(xyxy, np.array([2, 2, 2, 2, 7]), np.ones(5))
    found = {name: np.flatnonzero(mask).tolist() for name, mask in groups_of(boxes, 1241).items()}
    assert found == {"clear": [1], "small": [2], "hidden": [0], "cut": [3], "trucks": [4]}
    none = Boxes(np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0))
    assert not any(mask.any() for mask in groups_of(none, 1241).values())


def test_a_vehicle_is_found_by_a_box_with_enough_overlap_and_score() -> None:
    labels = np.array([[0.0, 0, 100, 100], [200.0, 0, 300, 100]])
    boxes = np.array([[0.0, 0, 100, 100], [200.0, 0, 300, 49]])
    assert found_labels(labels, boxes, np.array([0.5, 0.5])).tolist() == [True, False]
    assert found_labels(labels, boxes, np.array([0.09, 0.5])).tolist() == [False, False]
    assert found_labels(labels[:0], boxes, np.ones(2)).tolist() == []


def test_average_precision_is_that_of_the_notebook() -> None:
    # By hand, as in the chapter: (1 + 1 + 0.75 + 0 + 0) / 5.
    scores, right, wanted = ch05.verdicts()[0]
    assert average_precision(scores, right, wanted) == pytest.approx(0.55)
    for scores, right, wanted in ch05.verdicts():
        precision, recall = ch05.precision_recall_of(scores, right, wanted)
        area = float(np.sum(np.diff(recall, prepend=0) * precision))
        assert average_precision(scores, right, wanted) == pytest.approx(area)


def test_a_second_call_continues_and_another_table_is_refused(
    street: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = (
        Experiment("tiny", {"traffic": 3}, steps=2),
        Experiment("three", {"traffic": 3}, {}, "THREE_LEVELS", 2),
    )
    monkeypatch.setattr(measure_miniature, "EXPERIMENTS", tiny)
    monkeypatch.setattr(miniature, "JUDGED_STREETS", ("traffic",))
    trained = measure_miniature._trained
    done = []

    def counted(experiment: Experiment, *rest: Any) -> list[str]:
        done.append(experiment.name)
        return trained(experiment, *rest)

    monkeypatch.setattr(measure_miniature, "_trained", counted)
    main = load("measure_miniature")
    out = tmp_path / "table.csv"
    assert main(["--seeds", "1", "--experiments", "tiny", "--out", str(out)]) == 0
    first = out.read_text(encoding="utf-8")
    rows = [cells for _, cells in read_csv(out)]
    assert rows[0] == detector_experiments.row_head(("traffic",))
    assert rows[1][:3] == ["tiny", "0", "2"]
    assert main(["--seeds", "1", "--out", str(out)]) == 0
    assert done == ["tiny", "three"]
    assert out.read_text(encoding="utf-8").startswith(first)
    assert len(read_csv(out)) == 3
    # The rows of other cells are measured again.
    out.write_text(first.replace(rows[1][3], "other"), encoding="utf-8")
    assert main(["--seeds", "1", "--experiments", "tiny", "--out", str(out)]) == 0
    assert out.read_text(encoding="utf-8") == first
    out.write_text("a,b\n1,2\n", encoding="utf-8")
    assert main(["--out", str(out)]) == 2
    assert "expected a table of this script" in capsys.readouterr().err
    assert out.read_text(encoding="utf-8") == "a,b\n1,2\n"
