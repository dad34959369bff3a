"""The rendered street against its own geometry: depth, disparity, motion, labels."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from street.antialias import soften_edges
from street.atlas import TextureSet
from street.mesh import Faces
from street.render import NEAR, Renderer, rasterise
from street.sensor import image_velocity
from street.truth_files import MIN_HEIGHT, MIN_PIXELS, encode_depth
from street.world import World, make_world
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import inverse, transform
from vo_lib.core.matches import StereoMatches
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import SceneConfig, scene_config
from vo_lib.data.sequence import Sequence, open_sequence
from vo_lib.data.truth import Truth, decode_depth, open_truth

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


def grid(truth: Truth, step: int = 5) -> np.ndarray:
    u, v = np.meshgrid(
        np.arange(4.0, truth.camera.width - 4, step), np.arange(4.0, truth.camera.height - 4, step)
    )
    return np.stack([u.ravel(), v.ravel()], axis=1)


def away_from_edges(truth: Truth, frame: int) -> np.ndarray:
    """Pixels whose neighbourhood shows one thing at a smoothly changing depth."""
    near = (1.0 / truth.depth(frame)).astype(np.float32)
    kernel = np.ones((5, 5))
    one_thing = cv2.erode(near, kernel) > 0.85 * cv2.dilate(near, kernel)
    ids = truth.ids(frame).astype(np.float32)
    return np.asarray(one_thing & (cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)))


def test_the_folder_is_a_sequence_in_kittis_layout(sequence: Sequence, truth: Truth) -> None:
    assert len(sequence) == len(truth.poses) >= 7
    assert len(list((sequence.folder / "labels").iterdir())) == len(sequence)
    np.testing.assert_allclose(np.diff(sequence.times), 0.1, atol=1e-6)
    np.testing.assert_allclose(dataclasses.astuple(sequence.camera), dataclasses.astuple(SMALL.camera))
    np.testing.assert_allclose(truth.poses[0], np.eye(4), atol=1e-8)


def cast(faces: Faces, T_s_c: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Depth (N,) of the nearest face along each ray, found by testing every face: slow and independent."""
    corners = transform(inverse(T_s_c), faces.corners.reshape(-1, 3)).reshape(-1, 4, 3)
    best = np.full(len(rays), np.inf)
    for face in corners[corners[:, :, 2].max(axis=1) > NEAR]:
        for a, b, c in ((face[0], face[1], face[2]), (face[0], face[2], face[3])):
            M = np.stack([b - a, c - a], axis=1)
            normal = np.cross(M[:, 0], M[:, 1])
            # Clockwise from outside: seen only from there.
            if np.linalg.norm(normal) < 1e-9 or normal @ a < 0:
                continue
            z = (normal @ a) / (rays @ normal)
            inside = np.linalg.lstsq(M, (rays * z[:, None] - a).T, rcond=None)[0]
            hit = (z > 0) & (inside >= 0).all(axis=0) & (inside.sum(axis=0) <= 1)
            best = np.where(hit, np.minimum(best, z), best)
    return best


def test_depth_equals_the_nearest_face_along_the_ray(world: World, truth: Truth) -> None:
    """Walls, vehicles, trees: an independent ray caster agrees within 1e-4 away from edges."""
    frame = 3
    rng = np.random.default_rng(0)
    row, column = np.nonzero(away_from_edges(truth, frame) & np.isfinite(truth.depth(frame)))
    some = rng.permutation(len(row))[:150]
    uv = np.stack([column[some], row[some]], axis=1).astype(float)
    rays = np.concatenate([truth.camera.normalise(uv), np.ones((len(uv), 1))], axis=1)
    T_s_c = world.drive.poses[frame]
    faces, _ = Renderer(world)._in_sight(frame, inverse(T_s_c))
    expected = cast(faces, T_s_c, rays)
    error = np.abs(truth.depth(frame)[row[some], column[some]] / expected - 1)
    assert np.mean(error < 1e-4) > 0.97
    assert np.median(error) < 5e-5


def test_depth_codes_keep_one_part_in_ten_thousand() -> None:
    z = np.geomspace(0.3, 2900.0, 5000).reshape(50, 100)
    back = decode_depth(encode_depth((1.0 / z).astype(np.float32)))
    assert np.abs(back / z - 1).max() < 1e-4
    assert np.isinf(decode_depth(encode_depth(np.zeros((2, 2), np.float32)))).all()


def track(
    first: np.ndarray, second: np.ndarray, start: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    found, good, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        start.astype(np.float32)[:, None],
        guess.astype(np.float32)[:, None].copy(),
        winSize=(9, 9),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 0.003),
    )
    return found[:, 0].astype(float), good[:, 0] > 0


@pytest.mark.parametrize("step", [0, 1])
def test_pictures_agree_with_the_truth_to_a_twentieth_of_a_pixel(
    sequence: Sequence, truth: Truth, step: int
) -> None:
    """Lucas-Kanade from left to right (step 0) and from frame to frame (1): no bias, rows equal."""
    errors = []
    for frame in range(0, len(truth.poses) - 1, 2):
        left, right = sequence.stereo(frame)
        corners = cv2.goodFeaturesToTrack(left, 600, 0.01, 5)[:, 0].astype(float)
        corners = corners[away_from_edges(truth, frame)[tuple(np.rint(corners).astype(int).T[::-1])]]
        left_true, right_true, valid = truth.predict(frame, frame + step, corners)
        goal = left_true if step else right_true
        second = sequence.stereo(frame + 1)[0] if step else right
        found, good = track(left, second, corners[valid], goal[valid])
        error = (found - goal[valid])[good]
        errors.append(error[np.linalg.norm(error, axis=1) < 1.0])
    error = np.concatenate(errors)
    assert len(error) > 300
    assert np.abs(np.median(error, axis=0)).max() < 0.05
    assert np.median(np.linalg.norm(error, axis=1)) < 0.2


def test_prediction_of_the_same_frame_is_the_stereo_pair(truth: Truth) -> None:
    uv = grid(truth)
    left, right, valid = truth.predict(2, 2, uv)
    np.testing.assert_allclose(left[valid], uv[valid], atol=1e-9)
    np.testing.assert_allclose(right[valid, 1], uv[valid, 1], atol=1e-9)
    z = truth.depth(2)[uv[:, 1].astype(int), uv[:, 0].astype(int)]
    disparity = truth.camera.f * truth.camera.baseline / z
    np.testing.assert_allclose((left - right)[valid, 0], disparity[valid], rtol=1e-9)


def test_right_matches_are_told_from_wrong_ones(truth: Truth) -> None:
    uv = grid(truth)
    _, prev_right, valid_p = truth.predict(2, 2, uv)
    left, right, valid = truth.predict(2, 3, uv)
    good = np.flatnonzero(valid & valid_p)
    count = len(good)
    shift = np.where(np.arange(count) % 3 == 0, 1.5, 0.3)[:, None] * (0.6, 0.8)
    number = np.arange(count)
    matches = StereoMatches(
        uv[good], prev_right[good], left[good] + shift, right[good], number + 1, np.ones(count), number
    )
    np.testing.assert_allclose(truth.match_errors(matches, 3), np.linalg.norm(shift, axis=1))


def test_boxes_surround_the_visible_vehicle_pixels(sequence: Sequence, truth: Truth) -> None:
    seen = 0
    for frame in range(len(sequence)):
        ids = truth.ids(frame)
        expected = set()
        for number in np.unique(ids[(ids > 0) & (ids <= len(truth.instance))]).tolist():
            row, column = np.nonzero(ids == number)
            if len(row) >= MIN_PIXELS and np.ptp(row) + 1 >= MIN_HEIGHT:
                corners = column.min(), row.min(), column.max() + 1, row.max() + 1
                expected.add((int(truth.kind[number - 1]), *map(int, corners)))
        boxes = sequence.boxes(frame)
        corners = np.rint(boxes.xyxy + 0.5).astype(int).tolist()
        assert {(kind, *box) for kind, box in zip(boxes.class_id.tolist(), corners, strict=True)} <= expected
        seen += len(boxes)
    assert seen > 3 * len(sequence)


def test_motion_blur_follows_the_true_flow(world: World, truth: Truth) -> None:
    """Image velocity of pixels, vehicles included, is the flow to the next frame times the frame rate."""
    frame = 3
    view = Renderer(world).view(frame)
    velocity = image_velocity(world, frame, view, right=False)
    uv = grid(truth)
    uv = uv[away_from_edges(truth, frame)[tuple(uv.astype(int).T[::-1])]]
    # Central difference: half of the way from the frame before to the frame after.
    after, _, valid_after = truth.predict(frame, frame + 1, uv)
    before, _, valid_before = truth.predict(frame, frame - 1, uv)
    expected = 0.5 * (after - before) * SMALL.rate
    told = velocity[:, uv[:, 1].astype(int), uv[:, 0].astype(int)].T
    use = valid_after & valid_before & (np.linalg.norm(expected, axis=1) < 150)
    assert use.sum() > 500
    error = np.linalg.norm(told - expected, axis=1)[use]
    assert np.median(error / (10.0 + np.linalg.norm(expected, axis=1)[use])) < 0.05


def test_textures_do_not_shift_from_level_to_level() -> None:
    """A step edge in the middle stays in the middle at every scale of the atlas."""
    store = TextureSet()
    image = np.zeros((64, 128), np.float32)
    image[:, 64:] = 100.0
    number = store.add("edge", image)
    atlas = store.build()
    for i in range(int(atlas.top[number, 0]) + 1):
        for j in range(int(atlas.top[number, 1]) + 1):
            u = np.array([[atlas.column[number, i] + 64.0 / 2**i]], np.float32)
            v = np.array([[atlas.row[number, j] + 20.0 / 2**j]], np.float32)
            assert cv2.remap(atlas.texels, u, v, cv2.INTER_LINEAR)[0, 0] == pytest.approx(50.0, abs=0.01)


def test_outlines_are_smooth_at_a_tenth_of_a_pixel() -> None:
    """The mean brightness of a white board tells its area, also between whole pixels."""
    camera = SceneConfig(width=160, height=96, focal=100.0).camera
    areas = []
    for width in np.linspace(1.0, 1.1, 11):
        board = np.array([[-width, 1.0, 5.0], [-width, -1.0, 5.0], [width, -1.0, 5.0], [width, 1.0, 5.0]])
        seen = rasterise(board[None], camera)
        edges = np.cross(board, np.roll(board, -1, axis=0))
        edges *= np.sign(edges[0] @ (0.0, 0.0, 1.0))
        table = np.stack([np.zeros((4, 3)), edges])
        light = np.where(seen > 0, 100.0, 0.0).astype(np.float32)
        soft = soften_edges(light, np.where(seen > 0, 0.2, 0.0).astype(np.float32), seen, table, camera)
        areas.append(float(soft.sum()) / 100.0)
    expected = 2 * 20.0 * np.linspace(1.0, 1.1, 11) * 40.0
    np.testing.assert_allclose(areas, expected, atol=0.1 * 2 * 40 * 0.5)


def test_truth_of_a_folder_without_truth_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no synthetic truth"):
        open_truth(tmp_path)
