"""The tables of chapters 3 and 4 hold what they say, and their variants stand in the order of the lesson."""

from __future__ import annotations

import numpy as np
import pytest

from course.lessons import CAMERA, Cell, drive, scenes, selection_errors, selections, translation_errors
from course.three_frames import solve_three_frames
from vo_lib.beyond.translation import solve_translation
from vo_lib.config import TranslationConfig
from vo_lib.data.tracks import TrackConfig, simulate_tracks


def test_a_cell_tells_median_spread_and_bad_frames() -> None:
    cell = Cell.of([np.array([1.0, 2.0, 9.0]), np.array([3.0, 4.0, 5.0])], 4.5)
    np.testing.assert_array_equal(cell.medians, [2.0, 4.0])
    assert cell.bad == pytest.approx(2 / 6)
    assert cell.text == "3.000 ± 1.000 (33 %)"


def test_every_scene_gives_an_error_for_every_selection_and_frame() -> None:
    configs = selections("refined")
    for scene in scenes().values():
        errors = selection_errors(scene, configs, 1, 0)
        assert errors.keys() == configs.keys()
        assert all(len(values) == 1 and np.isfinite(values).all() for values in errors.values())


def test_the_drive_has_steps_of_a_metre_and_turns_where_it_is_sharp() -> None:
    for sharp, largest in ((False, 0.4), (True, 4.0)):
        poses = drive(40, sharp)
        steps = np.linalg.inv(poses[:-1]) @ poses[1:]
        np.testing.assert_allclose(np.linalg.norm(steps[:, :3, 3], axis=1), 1.0)
        angle = np.degrees(np.abs(np.arcsin(steps[:, 0, 2])))
        assert angle.max() == pytest.approx(largest, rel=0.01)


def test_stacking_beats_the_other_translations_and_bears_wrong_matches() -> None:
    for wrong, promised in ((0.0, 4.5), (0.3, 8.0)):
        tracks = TrackConfig(points=300, noise=0.3, wrong=wrong)
        found = [translation_errors(tracks, 12, seed) for seed in range(2)]
        median = {name: np.median(np.concatenate([run[name] for run in found])) for name in found[0]}
        assert median["stacked"] <= promised
        assert median["stacked"] < 0.75 * median["unweighted"]
        assert median["unweighted"] < (0.5 * median["feature_median"] if not wrong else np.inf)
        assert median["feature_median"] < median["feature_mean"]
        if wrong:
            assert median["unweighted"] > 10 * median["stacked"]


def three_frame_errors(noise: float, steps: int) -> tuple[list[float], list[float]]:
    """Errors, metres, of the step before by two frames and by three, rotations known."""
    two, three = [], []
    last = None
    tracks = TrackConfig(points=200, noise=noise, survival=0.9)
    for frame in simulate_tracks(drive(steps), CAMERA, tracks, seed=4):
        if last is not None:
            R, R_before = frame.T_cp[:3, :3], last.T_cp[:3, :3]
            both = solve_three_frames(CAMERA, last.matches, frame.matches, R_before, R, TranslationConfig())
            alone = solve_translation(CAMERA, last.matches, R_before, TranslationConfig())
            assert both is not None
            assert alone is not None
            two.append(float(np.linalg.norm(alone[0] - last.T_cp[:3, 3])))
            three.append(float(np.linalg.norm(both[0] - last.T_cp[:3, 3])))
            three_now = np.linalg.norm(both[1] - frame.T_cp[:3, 3])
            assert three_now < 1e-6 if noise == 0 else three_now < 0.02
        last = frame
    return two, three


def test_three_frames_are_exact_on_exact_matches_and_a_little_better_on_noisy_ones() -> None:
    assert max(three_frame_errors(0.0, 4)[1]) < 1e-6
    two, three = three_frame_errors(0.3, 80)
    assert np.sqrt(np.mean(np.square(three))) < np.sqrt(np.mean(np.square(two)))


def test_three_frames_need_matches_in_both_steps() -> None:
    frames = list(simulate_tracks(drive(2), CAMERA, TrackConfig(points=50), seed=0))
    nothing = frames[0].matches[np.zeros(50, bool)]
    R = frames[0].T_cp[:3, :3]
    assert solve_three_frames(CAMERA, nothing, frames[1].matches, R, R, TranslationConfig()) is None
