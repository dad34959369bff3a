"""Boxes followed along a street: what moves is found moving, what is parked is left alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from box_scenes import CAMERA, STEP, Vehicle, drive
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vo_lib import open_sequence, preset
from vo_lib.geometry.boxes import MOVING, PARKED, Boxes, no_boxes
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.motion import rotation_from_vector, skew
from vo_lib.geometry.types import Array
from vo_lib.kit.moving import BoxSteps, no_steps
from vo_lib.kit.settings import KitFilterConfig, MovingConfig
from vo_lib.kit.tracks import (
    EVIDENCE_DECAY,
    MIN_TRACK_OVERLAP,
    BoxMotionClassifier,
    Judgement,
    new_tracks,
    pair_up,
    with_evidence,
)
from vo_lib.paper.boxes import inside
from vo_lib.paper.sampson import sampson_distance
from vo_lib.runs.front_end import find_matches

AHEAD = tuple((STEP[:3, 3] * -1.0).tolist())  # the step of a car that keeps its distance
STANDS = (0.0, 0.0, 0.0)
Frames = list[tuple[StereoMatches, Boxes]]


def judged(first: Boxes, frames: Frames, config: KitFilterConfig | None = None) -> list[Judgement]:
    classifier = BoxMotionClassifier(CAMERA, config or KitFilterConfig())
    return [classifier.step(*frame) for frame in [(empty_matches(), first), *frames]][1:]


def states(found: list[Judgement]) -> list[list[int]]:
    return [judgement.state.tolist() for judgement in found]


def test_a_car_ahead_that_keeps_its_distance_is_found_though_it_obeys_the_epipolar_geometry() -> None:
    first, frames = drive([Vehicle((0.3, 0.8, 14.0), AHEAD)], 5)
    E = skew(STEP[:3, 3]) @ STEP[:3, :3]
    for judgement, (matches, _) in zip(judged(first, frames), frames, strict=True):
        assert judgement.state.tolist() == [MOVING]
        assert np.linalg.norm(judgement.step[0] - AHEAD) < 0.1
        x_p, x_c = (CAMERA.normalise(uv[200:]) for uv in (matches.prev_left, matches.cur_left))
        assert np.median(CAMERA.f * sampson_distance(E, x_p, x_c)) < 1.0


@pytest.mark.parametrize("new", [False, True])
def test_what_was_or_is_in_a_box_that_moves_is_removed_the_first_time_too(new: bool) -> None:
    """A car crosses by three metres a frame: some features of the street are in one of its boxes alone."""
    before, frames = drive([Vehicle((-6.0, 0.8, 14.0), (3.0, 0.0, 0.0))], 2)
    before = no_boxes() if new else before
    for judgement, (matches, boxes) in zip(judged(before, frames), frames, strict=True):
        was = inside(matches.prev_left, before.xyxy).any(axis=1)
        now = inside(matches.cur_left, boxes.xyxy).any(axis=1)
        assert min(np.count_nonzero(now & ~was), np.count_nonzero(was & ~now)) >= 3 or not was.any()
        assert judgement.state.tolist() == [MOVING]
        np.testing.assert_array_equal(judgement.removed, was | now)
        before = boxes


def without_features(frames: Frames, where: slice) -> Frames:
    """The same frames, in some of them nothing in the boxes."""
    bare = [
        (matches[np.asarray(~inside(matches.cur_left, boxes.xyxy).any(axis=1))], boxes)
        for matches, boxes in frames[where]
    ]
    return [*frames[: where.start], *bare, *frames[where.stop :]]


def test_evidence_turns_with_the_camera_fades_with_new_evidence_and_waits_without() -> None:
    turn = rotation_from_vector(np.array([0.0, 0.5, 0.1]))
    information, step = np.diag([4.0, 9.0, 1.0]), np.array([0.2, 0.0, -0.5])
    start = new_tracks(np.zeros((1, 4)))
    track = dataclasses.replace(start, information=information[None], vector=(information @ step)[None])
    new = BoxSteps(np.ones((1, 3)), np.eye(3)[None], np.array([5]))
    for fresh, kept in ((no_steps(1), 1.0), (new, EVIDENCE_DECAY)):
        found, more = with_evidence(track, fresh, turn, MovingConfig()), fresh.information[0]
        np.testing.assert_allclose(found.information[0], kept * turn @ information @ turn.T + more)
        np.testing.assert_allclose(found.vector[0], kept * turn @ information @ step + more @ fresh.step[0])


def test_an_oncoming_car_moves_and_a_parked_one_does_not_while_nothing_is_seen_of_them_too() -> None:
    cars = [Vehicle((-3.0, 0.8, 30.0), (0.0, 0.0, -0.3)), Vehicle((4.0, 0.8, 20.0))]
    first, frames = drive(cars, 9)
    found = judged(first, without_features(frames, slice(4, 7)))
    assert states(found[2:]) == [[MOVING, PARKED]] * 7
    assert np.isnan(found[5].step).all()


def test_a_car_that_stops_is_soon_parked() -> None:
    car = Vehicle((1.0, 0.8, 25.0), AHEAD)
    first, driving = drive([car], 4)
    car.step = STANDS
    found = states(judged(first, driving + drive([car], 10)[1]))
    assert found[:4] == [[MOVING]] * 4
    assert found[-1] == [PARKED]


@given(arrays(np.float64, (4, 3), elements=st.floats(0, 1)))
def test_pairs_are_one_to_one_and_overlap_enough(iou: Array) -> None:
    row_of = pair_up(iou)
    used = row_of[row_of >= 0]
    assert len(set(used.tolist())) == len(used)
    assert all(iou[row, column] >= MIN_TRACK_OVERLAP for column, row in enumerate(row_of) if row >= 0)
    # Nothing that could still be paired is left over.
    assert not (iou[np.setdiff1d(np.arange(4), used)][:, row_of < 0] >= MIN_TRACK_OVERLAP).any()


def test_real_clip_drive_0005_the_van_moves_and_the_truck_beside_it_is_parked(clips: Path) -> None:
    sequence = open_sequence(clips / "sequences" / "drive_0005").part(0, 24)
    config = preset("moving_selection", variant="kit")
    classifier = BoxMotionClassifier(sequence.camera, config.filter)
    van, truck = [], []
    for index, (matches, _) in enumerate(find_matches(sequence, config)):
        judgement = classifier.step(matches, sequence.boxes(index))
        x0, _, x1, _ = judgement.boxes.xyxy.T
        # The van drives from u = 890 to u = 540; the truck stands at the right border for 15 frames.
        expected = np.interp(index, [1, 12, 23], [888, 707, 541])
        van.append(judgement.state[np.argmin(np.abs((x0 + x1) / 2 - expected))])
        truck.append(judgement.state[np.argmax(x1)])
    assert van[9:] == [MOVING] * 15
    assert PARKED not in van
    assert truck[1:13] == [PARKED] * 12
