"""Features in vehicle boxes go, before bucketing, unless too few would be left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vo_lib import DataError
from vo_lib.config import FilterConfig
from vo_lib.detection import Boxes, no_boxes, read_labels
from vo_lib.filtering import in_boxes, static_matches
from vo_lib.matching import StereoMatches


def matches_at(prev: list[list[float]], cur: list[list[float]]) -> StereoMatches:
    p, c = np.array(prev, float), np.array(cur, float)
    whole = np.ones(len(p), np.int64)
    return StereoMatches(p, p - [5, 0], c, c - [5, 0], whole, np.ones(len(p)), np.arange(len(p)))


def box(*xyxy: float, class_id: int = 2, score: float = 1.0) -> Boxes:
    return Boxes(np.array([xyxy], float), np.array([class_id]), np.array([score]))


def test_only_vehicle_boxes_of_enough_score_count() -> None:
    uv = np.array([[15.0, 15.0], [50.0, 50.0]])
    assert in_boxes(uv, box(10, 10, 20, 20), FilterConfig()).tolist() == [True, False]
    assert not in_boxes(uv, box(10, 10, 20, 20, class_id=0), FilterConfig()).any()
    assert not in_boxes(uv, box(10, 10, 20, 20, score=0.1), FilterConfig()).any()
    assert not in_boxes(uv, no_boxes(), FilterConfig()).any()


def test_the_margin_is_a_share_of_the_box() -> None:
    uv = np.array([[21.5, 15.0]])
    assert not in_boxes(uv, box(10, 10, 20, 20), FilterConfig(margin=0.1)).any()
    assert in_boxes(uv, box(10, 10, 20, 20), FilterConfig(margin=0.2)).all()


def test_a_match_goes_when_either_left_point_lies_in_a_box() -> None:
    matches = matches_at([[15, 15], [50, 50], [80, 80]], [[16, 15], [15, 15], [81, 80]])
    config = FilterConfig(min_matches=0, min_share=0.0)
    keep, off = static_matches(matches, box(10, 10, 20, 20), box(10, 10, 20, 20), config)
    assert keep.tolist() == [False, False, True]
    assert not off
    keep, _ = static_matches(matches, box(10, 10, 20, 20), no_boxes(), config)
    assert keep.tolist() == [False, True, True]


def test_with_too_few_left_the_filter_is_off_and_says_so() -> None:
    matches = matches_at([[15.0, 15.0]] * 9 + [[50.0, 50.0]], [[15.0, 15.0]] * 9 + [[50.0, 50.0]])
    for config in (FilterConfig(min_matches=2, min_share=0.0), FilterConfig(min_matches=0, min_share=0.3)):
        keep, off = static_matches(matches, box(10, 10, 20, 20), box(10, 10, 20, 20), config)
        assert off
        assert keep.all()
    # Few matches from the start are not the filter's fault.
    assert not static_matches(matches, no_boxes(), no_boxes(), FilterConfig())[1]


def test_the_rule_none_keeps_everything() -> None:
    matches = matches_at([[15.0, 15.0]], [[15.0, 15.0]])
    everywhere = box(0, 0, 100, 100)
    assert static_matches(matches, everywhere, everywhere, FilterConfig(rule="none"))[0].all()


@given(
    st.lists(
        st.tuples(
            st.integers(0, 80),
            st.floats(0, 1),
            st.floats(0, 1),
            st.floats(0, 1),
            st.floats(0, 1),
            st.floats(0, 1),
        ),
        max_size=5,
    )
)
def test_labels_are_read_as_written(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]]
) -> None:
    path = tmp_path_factory.mktemp("labels") / "000000.txt"
    path.write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows), encoding="utf-8")
    boxes = read_labels(path, 1241, 376)
    assert boxes.class_id.tolist() == [row[0] for row in rows]
    np.testing.assert_allclose(boxes.score, [row[5] for row in rows])
    for found, (_, cx, cy, w, h, _) in zip(boxes.xyxy, rows, strict=True):
        np.testing.assert_allclose((found[:2] + found[2:]) / 2 + 0.5, [cx * 1241, cy * 376], atol=1e-9)
        np.testing.assert_allclose(found[2:] - found[:2], [w * 1241, h * 376], atol=1e-9)


@pytest.mark.parametrize(
    "line",
    ["2 0.5 0.5 0.1", "2 0.5 0.5 0.1 0.1 0.9 1", "2 0.5 1.5 0.1 0.1", "car 0.5 0.5 0.1 0.1", "2 nan 0 0 0"],
)
def test_a_wrong_label_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "000003.txt"
    path.write_text(f"2 0.5 0.5 0.1 0.1\n{line}\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"000003\.txt, line 2: expected"):
        read_labels(path, 100, 100)
