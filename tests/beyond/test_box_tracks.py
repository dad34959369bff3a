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
    MEMORY,
    MOVING,
    OVERLAP,
    PARKED,
    PATIENCE,
    UNKNOWN,
    BoxMotionClassifier,
    Judgement,
    new_tracks,
    pair_up,
    with_evidence,
)
from vo_lib.beyond.moving import BoxSteps, no_steps
from vo_lib.config import FilterConfig, MovingConfig
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.geometry import rigid, rotation_from_vector, skew, transform
from vo_lib.core.matches import StereoMatches, empty_matches
from vo_lib.core.sampson import sampson_distance
from vo_lib.core.types import Array
from vo_lib.method.boxes import inside
from vo_lib.runs.runner import FoundMatches

AHEAD = tuple((STEP[:3, 3] * -1.0).tolist())  # the step of a car that keeps its distance
STANDS = (0.0, 0.0, 0.0)
Frames = list[tuple[StereoMatches, Boxes]]


def judged(first: Boxes, frames: Frames, config: FilterConfig | None = None) -> list[Judgement]:
    classifier = BoxMotionClassifier(CAMERA, config or FilterConfig())
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
    for fresh, kept in ((no_steps(1), 1.0), (new, MEMORY)):
        found, more = with_evidence(track, fresh, turn, MovingConfig()), fresh.information[0]
        np.testing.assert_allclose(found.information[0], kept * turn @ information @ turn.T + more)
        np.testing.assert_allclose(found.vector[0], kept * turn @ information @ step + more @ fresh.step[0])


@pytest.mark.parametrize(
    ("yaw", "place", "step", "missed"),
    [(10.0, (-1.0, 0.5, 12.0), (0.0, 0.0, 0.4), missed) for missed in (9, 2)]
    + [(yaw, (x, 0.6, z), STANDS, 9) for yaw in (3.0, -3.0) for x, z in ((-4, 14), (5, 18), (-6, 26))],
)
def test_the_evidence_of_a_turning_camera_is_that_of_the_step_seen_now(
    yaw: float, place: tuple[float, ...], step: tuple[float, ...], missed: int
) -> None:
    """A car goes straight on, or is parked, while the camera turns; one frame may miss its box."""
    T_cp = rigid(rotation_from_vector(np.radians([0.0, yaw, yaw / 5])), np.array([0.05, 0.0, -0.6]))
    rng, step_now, found = np.random.default_rng(2), np.array(step), []
    X = place + rng.uniform(-1, 1, (40, 3)) * (0.9, 0.7, 0.5)
    classifier, matches = BoxMotionClassifier(CAMERA, FilterConfig()), empty_matches()
    for frame in range(5):
        uv = CAMERA.project(X)[0]
        round_it = Boxes(np.concatenate([uv.min(axis=0), uv.max(axis=0)])[None], np.array([2]), np.ones(1))
        found.append(classifier.step(matches, no_boxes() if frame == missed else round_it))
        fixed, step_now = street_points(rng, 300), T_cp[:3, :3] @ step_now
        before, X = np.concatenate([fixed, X]), transform(T_cp, X) + step_now
        matches = match_points(before, np.concatenate([transform(T_cp, fixed), X]), 0.1, rng)
    tracks = classifier._tracks
    seen = np.linalg.solve(tracks.information[0], tracks.vector[0])
    np.testing.assert_allclose(seen, T_cp[:3, :3].T @ step_now, atol=0.03)
    assert found[-1].state.tolist() == [MOVING if any(step) else PARKED]
    assert any(step) or not any(MOVING in each for each in states(found))


def test_an_oncoming_car_moves_and_a_parked_one_does_not_while_nothing_is_seen_of_them_too() -> None:
    cars = [Vehicle((-3.0, 0.8, 30.0), (0.0, 0.0, -0.3)), Vehicle((4.0, 0.8, 20.0))]
    first, frames = drive(cars, 9)
    found = judged(first, without_features(frames, slice(4, 7)))
    assert states(found[2:]) == [[MOVING, PARKED]] * 7
    assert np.isnan(found[5].step).all()
    assert not any(judgement.few_background for judgement in found)


def test_a_car_that_stops_is_soon_parked() -> None:
    car = Vehicle((1.0, 0.8, 25.0), AHEAD)
    first, driving = drive([car], 4)
    car.step = STANDS
    found = states(judged(first, driving + drive([car], 10)[1]))
    assert found[:4] == [[MOVING]] * 4
    assert found[-1] == [PARKED]


@pytest.mark.parametrize("gap", [PATIENCE, PATIENCE + 1])
def test_a_track_waits_a_few_frames_for_its_box(gap: int) -> None:
    first, frames = drive([Vehicle((1.0, 0.8, 20.0), AHEAD)], 10)
    # Unseen for `gap` frames; when it comes back, its features are not found in that frame.
    hidden = [(matches, no_boxes()) for matches, _ in frames[4 : 4 + gap]]
    back = without_features(frames[4 + gap : 5 + gap], slice(0, 1))
    assert states(judged(first, frames[:4] + hidden + back))[-1] == [MOVING if gap == PATIENCE else UNKNOWN]


def test_where_boxes_hold_nearly_everything_parked_ones_are_background_too() -> None:
    cars = [Vehicle((3.5, 0.8, 12.0 + 8 * k), points=30) for k in range(3)]
    first, frames = drive([*cars, Vehicle((-1.0, 0.8, 14.0), AHEAD, points=60)], 8)
    few = frames[:4] + [(matches[np.r_[:10, 200 : len(matches)]], boxes) for matches, boxes in frames[4:]]
    found = judged(first, few)
    assert not any(j.few_background for j in found)
    assert found[-1].state.tolist() == [PARKED, PARKED, PARKED, MOVING]
    assert judged(few[4][1], few[5:])[0].few_background


def test_with_hardly_any_features_nothing_is_judged() -> None:
    first, frames = drive([Vehicle((4.0, 0.8, 16.0))], 2)
    found = judged(first, [(matches[np.arange(5)], boxes) for matches, boxes in frames])
    assert found[-1].state.tolist() == [UNKNOWN]
    assert found[-1].few_background
    assert not found[-1].removed.any()


@pytest.mark.parametrize(
    ("car", "frames", "noise", "significance", "said"),
    [
        # May stand or move: with four features seventy metres away it is not to be told.
        (Vehicle((2.0, 0.8, 70.0), (0.0, 0.0, 0.1), points=4), 2, 0.3, 4.0, {UNKNOWN}),
        (Vehicle((1.0, 0.8, 25.0), (0.0, 0.0, 0.3)), 4, 0.15, 4.0, {MOVING}),
        (Vehicle((1.0, 0.8, 25.0), (0.0, 0.0, 0.3)), 4, 0.15, 50.0, {PARKED, UNKNOWN}),
    ],
)
def test_what_may_stand_or_move_is_unknown_the_more_so_the_more_is_asked(
    car: Vehicle, frames: int, noise: float, significance: float, said: set[int]
) -> None:
    config = FilterConfig(moving=MovingConfig(significance=significance))
    assert set(states(judged(*drive([car], frames, noise), config))[-1]) <= said


@given(arrays(np.float64, (4, 3), elements=st.floats(0, 1)))
def test_pairs_are_one_to_one_and_overlap_enough(iou: Array) -> None:
    row_of = pair_up(iou)
    used = row_of[row_of >= 0]
    assert len(set(used.tolist())) == len(used)
    assert all(iou[row, column] >= OVERLAP for column, row in enumerate(row_of) if row >= 0)
    # Nothing that could still be paired is left over.
    assert not (iou[np.setdiff1d(np.arange(4), used)][:, row_of < 0] >= OVERLAP).any()


def test_real_clip_drive_0005_the_van_moves_and_the_truck_beside_it_is_parked(clips: Path) -> None:
    sequence = open_sequence(clips / "sequences" / "drive_0005").part(0, 24)
    config = preset("moving_selection")
    classifier = BoxMotionClassifier(sequence.camera, config.filter)
    van, truck = [], []
    for index, (matches, _) in enumerate(FoundMatches(sequence, config.features, config.matching)):
        judgement = classifier.step(matches, sequence.boxes(index))
        x0, _, x1, _ = judgement.boxes.xyxy.T
        # The van drives from u = 890 to u = 540; the truck stands at the right border for 15 frames.
        expected = np.interp(index, [1, 12, 23], [888, 707, 541])
        van.append(judgement.state[np.argmin(np.abs((x0 + x1) / 2 - expected))])
        truck.append(judgement.state[np.argmax(x1)])
    assert van[9:] == [MOVING] * 15
    assert PARKED not in van
    assert truck[1:13] == [PARKED] * 12
