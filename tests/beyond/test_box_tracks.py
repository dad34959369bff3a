"""Boxes followed along a street: what moves is found moving, what is parked is left alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from box_scenes import CAMERA, STEP, Vehicle, drive, match_points, street_points
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vo_lib import open_sequence, preset
from vo_lib.beyond.box_tracks import (
    MOVING,
    PARKED,
    UNKNOWN,
    BoxMotionClassifier,
    Judgement,
    new_tracks,
    pair_up,
    with_evidence,
)
from vo_lib.beyond.moving import no_steps
from vo_lib.config import FilterConfig, MovingConfig
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.geometry import rigid, rotation_from_vector, skew, transform
from vo_lib.core.matches import StereoMatches
from vo_lib.core.sampson import sampson_distance
from vo_lib.core.types import Array
from vo_lib.method.boxes import inside
from vo_lib.runs.runner import FoundMatches

AHEAD = tuple((STEP[:3, 3] * -1.0).tolist())  # the step of a car that keeps its distance


def judged(
    first: Boxes, frames: list[tuple[StereoMatches, Boxes]], config: FilterConfig | None = None
) -> list[Judgement]:
    classifier = BoxMotionClassifier(CAMERA, config or FilterConfig())
    classifier.start(first)
    return [classifier.step(matches, boxes) for matches, boxes in frames]


def box_round(X: Array) -> Boxes:
    """The box of a car in the image, from points of it (N, 3)."""
    uv = CAMERA.project(X)[0]
    return Boxes(np.concatenate([uv.min(axis=0), uv.max(axis=0)])[None], np.array([2]), np.ones(1))


def test_an_oncoming_car_moves_and_a_parked_one_does_not() -> None:
    cars = [Vehicle((-3.0, 0.8, 30.0), (0.0, 0.0, -0.8)), Vehicle((4.0, 0.8, 16.0))]
    found = judged(*drive(cars, 6))
    assert [j.state.tolist() for j in found[1:]] == [[MOVING, PARKED]] * 5
    assert not any(j.few_background for j in found)


def test_a_car_ahead_that_keeps_its_distance_is_found_though_it_obeys_the_epipolar_geometry() -> None:
    first, frames = drive([Vehicle((0.3, 0.8, 14.0), AHEAD)], 5)
    for judgement, (matches, boxes) in zip(judged(first, frames), frames, strict=True):
        assert judgement.state.tolist() == [MOVING]
        assert np.linalg.norm(judgement.step[0] - AHEAD) < 0.1
        x_p, x_c = (CAMERA.normalise(uv[200:]) for uv in (matches.prev_left, matches.cur_left))
        E = skew(STEP[:3, 3]) @ STEP[:3, :3]
        assert np.median(CAMERA.f * sampson_distance(E, x_p, x_c)) < 1.0
        assert len(boxes) == 1


def test_a_far_car_that_may_stand_or_move_is_unknown() -> None:
    found = judged(*drive([Vehicle((2.0, 0.8, 70.0), (0.0, 0.0, 0.1), points=4)], 2, noise=0.3))
    assert found[-1].state.tolist() == [UNKNOWN]


def without_features(
    frames: list[tuple[StereoMatches, Boxes]], where: slice
) -> list[tuple[StereoMatches, Boxes]]:
    """The same frames, in some of them nothing in the boxes."""
    bare = [
        (matches[np.asarray(~inside(matches.cur_left, boxes.xyxy).any(axis=1))], boxes)
        for matches, boxes in frames[where]
    ]
    return [*frames[: where.start], *bare, *frames[where.stop :]]


def test_evidence_turns_with_the_camera_fades_with_new_evidence_and_waits_without() -> None:
    turn = rotation_from_vector(np.array([0.0, 0.5, 0.1]))
    information, step = np.diag([4.0, 9.0, 1.0]), np.array([0.2, 0.0, -0.5])
    track = dataclasses.replace(
        new_tracks(np.zeros((1, 4))), information=information[None], vector=(information @ step)[None]
    )
    waited = with_evidence(track, no_steps(1), turn, MovingConfig())
    np.testing.assert_allclose(waited.information[0], turn @ information @ turn.T)
    assert waited.state.tolist() == [UNKNOWN]  # half a metre, known to half a metre
    np.testing.assert_allclose(np.linalg.solve(waited.information[0], waited.vector[0]), turn @ step)
    new = dataclasses.replace(no_steps(1), information=np.eye(3)[None], step=np.ones((1, 3)))
    both, memory = with_evidence(track, new, turn, MovingConfig()), MovingConfig().memory
    np.testing.assert_allclose(both.information[0], memory * waited.information[0] + np.eye(3))
    np.testing.assert_allclose(both.vector[0], memory * waited.vector[0] + 1.0)


@pytest.mark.parametrize("missed", [9, 2])
def test_the_evidence_of_a_turning_camera_is_that_of_the_step_seen_now(missed: int) -> None:
    """A car goes straight on while the camera turns by ten degrees a frame; one frame may miss its box."""
    R, t = rotation_from_vector(np.array([0.0, np.radians(10.0), 0.0])), np.array([0.0, 0.0, -0.5])
    rng = np.random.default_rng(2)
    step, X = np.array([0.0, 0.0, 0.4]), (-1.0, 0.5, 12.0) + rng.uniform(-1, 1, (40, 3)) * (0.9, 0.75, 0.5)
    classifier = BoxMotionClassifier(CAMERA, FilterConfig())
    for frame in range(4):
        fixed, step = street_points(rng, 300), R @ step
        before, X = np.concatenate([fixed, X]), X @ R.T + t + step
        matches = match_points(before, np.concatenate([fixed @ R.T + t, X]))
        if frame == 0:
            classifier.start(box_round(X))
        else:
            classifier.step(matches, no_boxes() if frame == missed else box_round(X))
    tracks = classifier._tracks
    seen = np.linalg.solve(tracks.information[0], tracks.vector[0])
    np.testing.assert_allclose(seen, step, atol=0.03)


def test_a_feature_of_a_new_box_is_judged_by_where_it_is_now() -> None:
    crossing = Vehicle((-6.0, 0.8, 14.0), (3.0, 0.0, 0.0))
    _, frames = drive([crossing], 2)
    found = judged(no_boxes(), [(frames[0][0], no_boxes()), frames[1]])
    on_car = inside(frames[1][0].cur_left, frames[1][1].xyxy)[:, 0]
    assert on_car[-20:].all()
    assert not found[1].agrees[-20:].any()


def test_a_box_without_features_follows_its_history() -> None:
    cars = [Vehicle((-3.0, 0.8, 30.0), (0.0, 0.0, -0.3)), Vehicle((4.0, 0.8, 20.0))]
    first, frames = drive(cars, 9)
    found = judged(first, without_features(frames, slice(4, 7)))
    assert [j.state.tolist() for j in found[2:]] == [[MOVING, PARKED]] * 7
    assert np.isnan(found[5].step).all()


def test_a_car_that_stops_is_soon_parked() -> None:
    car = Vehicle((1.0, 0.8, 25.0), AHEAD)
    first, driving = drive([car], 4)
    car.step = (0.0, 0.0, 0.0)
    _, standing = drive([car], 10)
    states = [j.state[0] for j in judged(first, driving + standing)]
    assert states[:4] == [MOVING] * 4
    assert states[-1] == PARKED


@pytest.mark.parametrize("gap", [3, 4])
def test_a_track_waits_a_few_frames_for_its_box(gap: int) -> None:
    first, frames = drive([Vehicle((1.0, 0.8, 20.0), AHEAD)], 10)
    # Unseen for `gap` frames; when it comes back, its features are not found in that frame.
    hidden = [(matches, no_boxes()) for matches, _ in frames[4 : 4 + gap]]
    back = without_features(frames[4 + gap : 5 + gap], slice(0, 1))
    found = judged(first, frames[:4] + hidden + back)
    assert found[-1].state.tolist() == [MOVING if gap <= MovingConfig().patience else UNKNOWN]


def test_where_boxes_hold_nearly_everything_parked_ones_are_background_too() -> None:
    cars = [Vehicle((3.5, 0.8, 12.0 + 8 * k), points=30) for k in range(3)]
    first, frames = drive([*cars, Vehicle((-1.0, 0.8, 14.0), AHEAD, points=60)], 8)
    few = frames[:4] + [(matches[np.r_[:10, 200 : len(matches)]], boxes) for matches, boxes in frames[4:]]
    found = judged(first, few)
    assert not any(j.few_background for j in found)
    assert found[-1].state.tolist() == [PARKED, PARKED, PARKED, MOVING]
    alone = judged(few[4][1], few[5:])
    assert alone[0].few_background


def test_with_hardly_any_features_nothing_is_judged() -> None:
    first, frames = drive([Vehicle((4.0, 0.8, 16.0))], 2)
    found = judged(first, [(matches[np.arange(5)], boxes) for matches, boxes in frames])
    assert found[-1].state.tolist() == [UNKNOWN]
    assert found[-1].few_background
    assert judged(no_boxes(), [(frames[0][0], no_boxes())])[0].state.tolist() == []


def test_features_that_disagree_with_the_background_are_told() -> None:
    first, frames = drive([Vehicle((0.3, 0.8, 14.0), AHEAD)], 1, noise=0.1)
    (found,) = judged(first, frames)
    assert found.agrees[:200].mean() > 0.9
    assert not found.agrees[200:].any()


def test_a_higher_significance_makes_it_harder_to_move() -> None:
    cars = [Vehicle((1.0, 0.8, 25.0), (0.0, 0.0, 0.3))]
    config = FilterConfig(moving=MovingConfig(significance=50.0))
    assert judged(*drive(cars, 4))[-1].state.tolist() == [MOVING]
    cars = [Vehicle((1.0, 0.8, 25.0), (0.0, 0.0, 0.3))]
    assert judged(*drive(cars, 4), config)[-1].state.tolist() != [MOVING]


@given(arrays(np.float64, (4, 3), elements=st.floats(0, 1)))
def test_pairs_are_one_to_one_and_overlap_enough(iou: Array) -> None:
    row_of = pair_up(iou, 0.3)
    used = row_of[row_of >= 0]
    assert len(set(used.tolist())) == len(used)
    assert all(iou[row, column] >= 0.3 for column, row in enumerate(row_of) if row >= 0)
    # Nothing that could still be paired is left over.
    left = iou[np.setdiff1d(np.arange(4), used)][:, row_of < 0]
    assert not (left >= 0.3).any()


@pytest.mark.parametrize("place", [(-4.0, 0.6, 14.0), (5.0, 0.6, 18.0), (-6.0, 0.6, 26.0)])
@pytest.mark.parametrize("yaw", [3.0, -3.0])
def test_a_parked_car_stays_parked_while_the_camera_turns(
    place: tuple[float, float, float], yaw: float
) -> None:
    T_cp = rigid(rotation_from_vector(np.radians([0.0, yaw, yaw / 2])), np.array([0.05, 0.0, -0.8]))
    half = np.array([0.9, 0.7, 1.5])
    corners = place + np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    points = place + np.random.default_rng(5).uniform(-1, 1, (40, 3)) * half
    rng, states = np.random.default_rng(6), []
    classifier = BoxMotionClassifier(CAMERA, FilterConfig())
    classifier.start(box_round(corners))
    for _ in range(5):
        before = np.concatenate([street_points(rng, 200), points])
        after = transform(T_cp, before)
        points, corners = after[200:], transform(T_cp, corners)
        judgement = classifier.step(match_points(before, after, 0.15, rng), box_round(corners))
        assert not judgement.few_background
        states += judgement.state.tolist()
    assert MOVING not in states
    assert states[-1] == PARKED


def test_real_clip_drive_0005_the_van_moves_and_the_truck_beside_it_is_parked(clips: Path) -> None:
    sequence = open_sequence(clips / "sequences" / "drive_0005").part(0, 24)
    config = preset("moving_selection")
    classifier = BoxMotionClassifier(sequence.camera, config.filter)
    classifier.start(sequence.boxes(0))
    van, truck = [], []
    for index, (matches, _) in enumerate(FoundMatches(sequence, config.features, config.matching)):
        if index == 0:
            continue
        judgement = classifier.step(matches, sequence.boxes(index))
        x0, _, x1, _ = judgement.boxes.xyxy.T
        # The van drives from u = 890 to u = 540; the truck stands at the right border for 15 frames.
        expected = np.interp(index, [1, 12, 23], [888, 707, 541])
        van.append(judgement.state[np.argmin(np.abs((x0 + x1) / 2 - expected))])
        if index <= 12:
            truck.append(judgement.state[np.argmax(x1)])
    assert van[8:] == [MOVING] * len(van[8:])
    assert PARKED not in van
    assert truck == [PARKED] * len(truck)
