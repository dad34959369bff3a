"""What each rule around the selection is for, on simulated drives: without it the error is larger."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from course.lessons import CAMERA, Pair, Scene, drive, frames_of, selection_errors, selections
from vo_lib.beyond.odometry import KitOdometry
from vo_lib.beyond.selection import choose, motion_of_winner, sample_sets
from vo_lib.config import Config, SelectionConfig, preset
from vo_lib.core import settings
from vo_lib.core.boxes import no_boxes
from vo_lib.core.geometry import essential_from_motion, essential_vector, rotation_angle, rotation_from_vector
from vo_lib.core.types import Array
from vo_lib.data.tracks import TrackConfig, simulate_tracks
from vo_lib.method.five_point import five_point
from vo_lib.method.selection import truncated_errors
from vo_lib.runs.runner import make_odometry

TRACKS = TrackConfig(points=300, noise=0.3)
OFF, ON, NEAREST = SelectionConfig(prior=False), SelectionConfig(), SelectionConfig(keep=1)


def test_sets_hold_five_different_features_and_use_all_equally_often() -> None:
    sets = sample_sets(np.random.default_rng(0), 52, 200)
    assert sets.shape == (200, 5)
    assert (np.diff(np.sort(sets, axis=1), axis=1) > 0).all()
    assert np.ptp(np.bincount(sets.ravel(), minlength=52)) <= 4


def test_every_other_set_takes_one_feature_from_each_fifth() -> None:
    angle = np.random.default_rng(1).uniform(-np.pi, np.pi, 52)
    sets = sample_sets(np.random.default_rng(0), 52, 201, angle)
    np.testing.assert_array_equal(sets[::2], sample_sets(np.random.default_rng(0), 52, 201)[::2])
    # Two features of the 52 stay out, so a fifth may begin up to two places later.
    place = np.argsort(np.argsort(angle))[sets[1::2]]
    assert (np.diff(place, axis=1) > 0).all()
    assert np.all((place >= [0, 10, 20, 30, 40]) & (place <= [11, 21, 31, 41, 51]))


def test_rotation_noise_of_clean_tracks_is_as_small_as_promised() -> None:
    """Over 300 frames: refined 0.011°, literal 0.036° ± 0.001°."""
    modes = {mode: SelectionConfig(mode=mode) for mode in ("literal", "refined")}
    found = medians(Scene(TRACKS), modes, 30, 3)
    assert found["refined"] <= 0.012
    assert found["literal"] <= 0.039


def medians(
    scene: Scene, configs: dict[str, SelectionConfig], frames: int = 15, seeds: int = 2
) -> dict[str, float]:
    """Median error of each selection over some seeds, degrees."""
    runs = [selection_errors(scene, configs, frames, seed) for seed in range(seeds)]
    return {name: float(np.median(np.concatenate([run[name] for run in runs]))) for name in configs}


@pytest.mark.parametrize(
    ("scene", "most"),
    [(Scene(replace(TRACKS, wrong=wrong)), 0.03) for wrong in (0.3, 0.5)]
    + [(Scene(TRACKS, sharp=True), np.inf)],
)
def test_among_random_mismatches_and_on_a_sharp_turn_prior_and_consensus_choose_alike(
    scene: Scene, most: float
) -> None:
    found = medians(scene, {"off": OFF, "on": ON})
    assert found["on"] == pytest.approx(found["off"], rel=0.05)
    assert found["on"] < most


def test_many_matches_on_one_crossing_car_mislead_consensus_and_prior_alike() -> None:
    """An essential matrix that fits the car and much of the street beats the true one: remove the car."""
    crossing = replace(TRACKS, moving=0.5, objects=1, object_heading=90.0)
    configs = {"off": OFF, "on": ON, "k = 1": NEAREST}
    assert min(medians(Scene(crossing), configs, 8).values()) > 0.5
    assert medians(Scene(TRACKS), configs, 8)["on"] < 0.03


def errors(
    scene: Scene, before: Callable[[np.random.Generator, Pair], Array], sets: int, config: SelectionConfig
) -> Array:
    """Errors of the winner's rotation, degrees, over three drives of twenty frames.

    before : from random numbers and a frame to the essential matrix that the frame before is said to have.
    """
    found = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        for pair in frames_of(scene, 20, seed):
            chosen = sample_sets(rng, len(pair.x_p), sets)
            E, set_index = five_point(pair.x_p[chosen], pair.x_c[chosen])
            e_prev = essential_vector(before(rng, pair))
            winner, _ = choose(E, set_index, pair.x_p, pair.x_c, e_prev, config, CAMERA.f)
            R = motion_of_winner(E[winner], pair.x_p, pair.x_c, pair.X_p, config, CAMERA.f)[0]
            found.append(np.degrees(rotation_angle(R.T @ pair.R_cp)))
    return np.array(found)


def test_of_the_two_solutions_of_a_plane_the_prior_takes_the_right_one() -> None:
    """Points of one plane fit two essential matrices equally well, and consensus tosses a coin."""

    def nearly(rng: np.random.Generator, pair: Pair) -> Array:
        turned = rotation_from_vector(0.005 * rng.normal(size=3)) @ pair.R_cp
        return essential_from_motion(turned, np.array([0.02, 0.0, -1.0]))

    plane, ways = Scene(TRACKS, plane=True), selections()
    wrong = {name: np.mean(errors(plane, nearly, 200, way) > 0.5) for name, way in ways.items()}
    assert wrong["consensus"] > 0.3
    assert wrong["k = 2"] < 0.75 * wrong["consensus"]
    assert wrong["k = 1"] < 0.3 * wrong["consensus"]


def test_after_a_restart_a_misleading_prior_is_dropped() -> None:
    """Of few sets the nearest candidates to a wrong vector are wrong themselves."""
    nearest = selections()["k = 1"]
    trusting, guarded = (
        errors(Scene(TRACKS), lambda rng, _: rng.normal(size=(3, 3)), 20, config)
        for config in (replace(nearest, prior_rejection_ratio=1000.0), nearest)
    )
    assert np.mean(trusting > 0.5) > 0.05
    assert np.mean(guarded > 0.5) == 0.0
    assert np.mean(guarded) < 0.5 * np.mean(trusting)


@pytest.mark.parametrize(("ratio", "dropped"), [(ON.prior_rejection_ratio, True), (10.0, False)])
def test_a_prior_that_allows_only_a_bad_candidate_is_dropped_and_said_so(ratio: float, dropped: bool) -> None:
    (pair,) = frames_of(Scene(TRACKS), 1, 4)
    sets = sample_sets(np.random.default_rng(0), len(pair.x_p), 1)
    E, set_index = five_point(pair.x_p[sets], pair.x_c[sets])
    scores = truncated_errors(E, pair.x_p, pair.x_c, 1.0 / CAMERA.f)
    best, worst = int(np.argmin(scores)), int(np.argmax(scores))
    config = SelectionConfig(keep=1, prior_rejection_ratio=ratio)
    winner = choose(E, set_index, pair.x_p, pair.x_c, essential_vector(E[worst]), config, CAMERA.f)
    assert winner == (best if dropped else worst, dropped)


def test_a_standing_camera_keeps_its_place_and_its_essential_vector() -> None:
    """Without parallax the essential matrix is undefined, so what is found is noise and spoils the prior."""
    # Five steps, a rest of five frames, and five steps more.
    poses, config = drive(10)[np.r_[:6, [5] * 5, 6:11]], preset("solution_selection")
    frames = list(simulate_tracks(poses, CAMERA, replace(TRACKS, noise=0.1), seed=2))
    eager = settings.replace(config, "selection.standstill_flow", 0.0)
    usual, careless = make_odometry(CAMERA, config), make_odometry(CAMERA, eager)
    found = [usual.step(frame.matches, no_boxes()) for frame in frames]
    assert [motion.flags for motion in found[5:10]] == [("standstill",)] * 5
    turns = np.array([motion.T_cp[:3, :3] for motion in found[5:10]])
    assert np.degrees(rotation_angle(turns)).max() < 0.02
    assert found[10].prior_angle < 5.0
    angles = [careless.step(frame.matches, no_boxes()).prior_angle for frame in frames]
    assert max(angles[5:11]) > 20.0


def test_where_the_last_geometry_holds_fewer_sets_do_but_never_where_matches_are_wrong() -> None:
    """Fifty sets without an outlier are enough to start a refinement; the winner itself needs all of them."""
    before, frame = list(simulate_tracks(drive(3), CAMERA, TRACKS, seed=0))[:2]
    mixed = np.random.default_rng(0).permutation(150)

    def drawn(config: Config, wrong: int = 0, prior: bool = True) -> int:
        odometry = make_odometry(CAMERA, config)
        assert isinstance(odometry, KitOdometry)
        if prior:
            E = essential_from_motion(before.T_cp[:3, :3], before.T_cp[:3, 3])
            odometry.e_prev = essential_vector(E)
        x_p, x_c = odometry.points(frame.matches)
        x_c[:wrong] = x_c[mixed[:wrong]]
        return len(odometry.draw_sets(x_p, x_c))

    refined = preset("solution_selection")
    assert 50 <= drawn(refined) < 80
    assert drawn(refined) < drawn(refined, wrong=30) < 200
    assert drawn(refined, wrong=150) == drawn(refined, prior=False) == 200
    assert drawn(settings.replace(refined, "selection.mode", "literal")) == 200
    assert drawn(settings.replace(refined, "selection.sets", 20)) == 20
