"""Comparison of the rendered street with its geometry: depth, disparity, motion, labels."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from course.simulation.true_matches import depth, predict
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import Truth, open_truth
from vo_lib.geometry.motion import inverse, transform
from vo_street.mesh import Faces
from vo_street.render import NEAR, Renderer
from vo_street.truth_files import MIN_HEIGHT, MIN_PIXELS
from vo_street.world import World, make_world

SMALL = scene_config("traffic", width=496, height=152, length=7.0, oncoming=6.0, parked=0.9, noise=1.0)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return open_sequence(ensure_scene(SMALL, tmp_path_factory.mktemp("scenes"), jobs=1))


@pytest.fixture(scope="module")
def truth(sequence: Sequence) -> Truth:
    return open_truth(sequence.folder)


@pytest.fixture(scope="module")
def world() -> World:
    return make_world(SMALL)


def away_from_edges(truth: Truth, frame: int) -> np.ndarray:
    """Mask of the pixels whose neighbourhood shows one object with smooth depth."""
    near = (1.0 / depth(truth, frame)).astype(np.float32)
    kernel = np.ones((5, 5))
    one_thing = cv2.erode(near, kernel) > 0.85 * cv2.dilate(near, kernel)
    ids = truth.instances(frame).astype(np.float32)
    return np.asarray(one_thing & (cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)))


def test_scene_folder_is_a_kitti_sequence(sequence: Sequence, truth: Truth) -> None:
    assert len(sequence) == len(truth.poses) >= 7
    assert len(list((sequence.folder / "labels").iterdir())) == len(sequence)
    np.testing.assert_allclose(np.diff(sequence.times), 0.1, atol=1e-6)
    np.testing.assert_allclose(dataclasses.astuple(sequence.camera), dataclasses.astuple(SMALL.camera))
    np.testing.assert_allclose(truth.poses[0], np.eye(4), atol=1e-8)


def cast(faces: Faces, T_s_c: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Depth (N,) of the nearest face along each ray, by a slow but independent test of every face."""
    corners = transform(inverse(T_s_c), faces.corners.reshape(-1, 3)).reshape(-1, 4, 3)
    best = np.full(len(rays), np.inf)
    for face in corners[corners[:, :, 2].max(axis=1) > NEAR]:
        for a, b, c in ((face[0], face[1], face[2]), (face[0], face[2], face[3])):
            M = np.stack([b - a, c - a], axis=1)
            normal = np.cross(M[:, 0], M[:, 1])
            # Corners are clockwise from outside; faces are invisible from behind.
            if np.linalg.norm(normal) < 1e-9 or normal @ a < 0:
                continue
            z = (normal @ a) / (rays @ normal)
            inside = np.linalg.lstsq(M, (rays * z[:, None] - a).T, rcond=None)[0]
            hit = (z > 0) & (inside >= 0).all(axis=0) & (inside.sum(axis=0) <= 1)
            best = np.where(hit, np.minimum(best, z), best)
    return best


def test_depth_equals_ray_casting(world: World, truth: Truth) -> None:
    """Walls, vehicles, trees: an independent ray caster agrees within 1e-4 away from edges."""
    frame = 3
    rng = np.random.default_rng(0)
    row, column = np.nonzero(away_from_edges(truth, frame) & np.isfinite(depth(truth, frame)))
    some = rng.permutation(len(row))[:150]
    uv = np.stack([column[some], row[some]], axis=1).astype(float)
    rays = np.concatenate([truth.config.camera.normalise(uv), np.ones((len(uv), 1))], axis=1)
    T_s_c = world.drive.poses[frame]
    faces, _ = Renderer(world)._in_sight(frame, inverse(T_s_c))
    expected = cast(faces, T_s_c, rays)
    error = np.abs(depth(truth, frame)[row[some], column[some]] / expected - 1)
    assert np.mean(error < 1e-4) > 0.97
    assert np.median(error) < 5e-5


def track(
    first: np.ndarray, second: np.ndarray, start: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    result, good, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        start.astype(np.float32)[:, None],
        guess.astype(np.float32)[:, None].copy(),
        winSize=(9, 9),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 0.003),
    )
    return result[:, 0].astype(float), good[:, 0] > 0


@pytest.mark.parametrize("step", [0, 1])
def test_images_agree_with_true_positions(sequence: Sequence, truth: Truth, step: int) -> None:
    """Lucas-Kanade, from left to right (step 0) or to the next frame (step 1): no bias, equal rows."""
    errors = []
    for frame in range(0, len(truth.poses) - 1, 2):
        left, right = sequence.stereo(frame)
        corners = cv2.goodFeaturesToTrack(left, 600, 0.01, 5)[:, 0].astype(float)
        corners = corners[away_from_edges(truth, frame)[tuple(np.rint(corners).astype(int).T[::-1])]]
        left_true, right_true, valid = predict(truth, frame, frame + step, corners)
        goal = left_true if step else right_true
        second = sequence.stereo(frame + 1)[0] if step else right
        result, good = track(left, second, corners[valid], goal[valid])
        error = (result - goal[valid])[good]
        errors.append(error[np.linalg.norm(error, axis=1) < 1.0])
    error = np.concatenate(errors)
    assert len(error) > 300
    assert np.abs(np.median(error, axis=0)).max() < 0.05
    assert np.median(np.linalg.norm(error, axis=1)) < 0.2


def test_is_moving_covers_vehicles_and_their_shadows(truth: Truth) -> None:
    ids, count = truth.instances(0), truth.objects.shape[1]
    steps = np.linalg.norm(np.diff(truth.objects[:2, :, :3, 3], axis=0)[0], axis=1)
    moving = np.flatnonzero(steps > 0.0) + 1
    expected = np.isin(ids, [*moving, *(moving + count)])
    assert expected[ids > count].any()
    assert not expected[(ids > 0) & (ids <= count)].all()
    row, column = np.nonzero(ids >= 0)
    moves = truth.is_moving(0, np.stack([column, row], axis=1).astype(float), 1)
    np.testing.assert_array_equal(moves, expected[row, column])


def test_boxes_enclose_visible_vehicle_pixels(sequence: Sequence, truth: Truth) -> None:
    visible = 0
    with np.load(sequence.folder / "truth" / "objects.npz") as objects:
        kind = objects["kind"]
    for frame in range(len(sequence)):
        ids = truth.instances(frame)
        expected = set()
        for number in np.unique(ids[(ids > 0) & (ids <= len(kind))]).tolist():
            row, column = np.nonzero(ids == number)
            if len(row) >= MIN_PIXELS and np.ptp(row) + 1 >= MIN_HEIGHT:
                corners = column.min(), row.min(), column.max() + 1, row.max() + 1
                expected.add((int(kind[number - 1]), *map(int, corners)))
        boxes = sequence.boxes(frame)
        corners = np.rint(boxes.xyxy + 0.5).astype(int).tolist()
        assert {(kind, *box) for kind, box in zip(boxes.class_id.tolist(), corners, strict=True)} <= expected
        visible += len(boxes)
    assert visible > 3 * len(sequence)
