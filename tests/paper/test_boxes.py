"""Boxes: points inside, margin and overlap."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.boxes import Boxes, no_boxes, overlap
from vo_lib.kit.settings import KitFilterConfig
from vo_lib.paper.box_removal import in_boxes


def box(*xyxy: float, score: float = 1.0) -> Boxes:
    return Boxes(np.array([xyxy], float), np.array([2]), np.array([score]))


def test_only_boxes_with_enough_score_count() -> None:
    uv = np.array([[15.0, 15.0], [50.0, 50.0]])
    assert in_boxes(uv, box(10, 10, 20, 20), KitFilterConfig()).tolist() == [True, False]
    assert not in_boxes(uv, box(10, 10, 20, 20, score=0.1), KitFilterConfig()).any()
    assert not in_boxes(uv, no_boxes(), KitFilterConfig()).any()


def test_margin_is_a_fraction_of_the_box() -> None:
    uv = np.array([[21.5, 15.0]])
    assert not in_boxes(uv, box(10, 10, 20, 20), KitFilterConfig(margin=0.1)).any()
    assert in_boxes(uv, box(10, 10, 20, 20), KitFilterConfig(margin=0.2)).all()


def test_overlap_is_intersection_over_union() -> None:
    a = np.array([[0.0, 0.0, 10.0, 10.0], [20.0, 0.0, 30.0, 10.0]])
    np.testing.assert_allclose(overlap(a, a), np.eye(2))
    np.testing.assert_allclose(overlap(a[:1], np.array([[5.0, 0.0, 15.0, 10.0]])), [[1 / 3]])
