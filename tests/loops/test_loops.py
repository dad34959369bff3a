"""Places, loops and closed paths of a street that is driven twice."""

from __future__ import annotations

import dataclasses
import functools
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import with_box

from vo_lib.commands.cli import main
from vo_lib.config import preset
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import read_csv
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.twist import motion_from_twist
from vo_lib.geometry.types import Array
from vo_lib.loops.find import PlacePairs, find_loops
from vo_lib.loops.graph import close_path, interpolate_corrections
from vo_lib.loops.places import candidate_pairs, place_frames
from vo_lib.loops.settings import LoopConfig
from vo_lib.report.film import LOOP_LINE_COLOUR, Film, film_frames
from vo_lib.report.plots import png, trajectories_figure
from vo_lib.runs.drive import run
from vo_lib.settings import replace

CONFIG = LoopConfig(every=2, gap=6, similarity=-1.0)
METHOD = preset("feature_selection")
compared = functools.partial(find_loops, config=CONFIG, progress=lambda done, of: None)


def twice(folder: Path) -> Sequence:
    """A sequence that contains the six frames of a folder twice."""
    for image in folder.glob("image_*/*.png"):
        shutil.copy(image, image.with_name(f"{int(image.stem) + 6:06d}.png"))
    poses = folder / "poses.txt"
    poses.write_text(2 * poses.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "times.txt").write_text("".join(f"{0.1 * i:.6e}\n" for i in range(12)), encoding="utf-8")
    return open_sequence(folder)


def circle(count: int, drift: float) -> Array:
    """Poses on a circle, 40 frames per round, with a heading error of `drift` radians in every frame."""
    step = motion_from_twist(np.array([0.0, 2 * np.pi / 40 + drift, 0.0, 0.0, 0.0, 1.0]))
    return np.array([np.linalg.matrix_power(step, k) for k in range(count)])


def loops_between(truth: Array, pairs: list[tuple[int, int]]) -> PlacePairs:
    """Loops with the true motion between the frames; each has 100 matches, all of which are inliers."""
    (first, second), whole = np.array(pairs).T, np.full(len(pairs), 100)
    motion = inverse(truth[first]) @ truth[second]
    return PlacePairs(first, second, np.ones(len(pairs)), whole, whole, np.zeros(len(pairs)), motion)


def worst(poses: Array, truth: Array) -> float:
    return float(np.linalg.norm((poses - truth)[:, :3, 3], axis=1).max())


def test_a_second_visit_is_recognised_and_measured(bands: Path) -> None:
    sequence = twice(bands)
    loops = compared(sequence, METHOD)
    assert np.all(loops.second_frame - loops.first_frame >= CONFIG.gap)
    accepted = loops[loops.accepted(CONFIG)]
    same = accepted.second_frame - accepted.first_frame == 6
    assert np.count_nonzero(same) == 3
    assert sequence.truth is not None
    true = inverse(sequence.truth[accepted.first_frame]) @ sequence.truth[accepted.second_frame]
    assert accepted.motion == pytest.approx(true, abs=0.01)
    assert accepted.residual[same].max() < 0.2


def test_features_in_vehicle_boxes_and_masks_are_left_out(bands: Path, tmp_path: Path) -> None:
    with_box(bands, 12, "2 0.5 0.5 1.0 1.0\n")
    covered = twice(bands)
    assert compared(covered, METHOD).matches.max(initial=0) == 0
    bare = preset("solution_selection")
    assert compared(covered, bare).accepted(CONFIG).any()
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((240, 480), 255, np.uint8))
    masked = dataclasses.replace(covered, masks=tmp_path / "mask.png")
    assert compared(masked, bare).matches.max(initial=0) == 0


def test_the_rule_truth_needs_no_boxes_for_loops_either(bands: Path) -> None:
    """The truth tells what moves from frame to frame; without boxes there is nothing to leave out."""
    by_truth = replace(preset("solution_selection", variant="kit"), "filter.rule", "truth")
    without_labels = compared(twice(bands), by_truth)
    assert without_labels.accepted(CONFIG).any()
    with_box(bands, 12, "0 0.5 0.5 1.0 1.0\n")
    labelled = open_sequence(bands)
    # With a box over each image; then with labels in which no class can be a vehicle.
    for name in ("car", "tree"):
        (bands / "labels" / "classes.txt").write_text(f"{name}\n", encoding="utf-8")
        assert np.array_equal(compared(labelled, by_truth).matches, without_labels.matches)
    with pytest.raises(DataError, match="tree"):
        compared(labelled, METHOD)


def test_each_frame_has_its_own_mask_in_a_folder(bands: Path, tmp_path: Path) -> None:
    street = twice(bands)
    masks = tmp_path / "masks"
    masks.mkdir()
    for frame in street.frames:
        value = 255 if frame == "000002" else 0
        cv2.imwrite(str(masks / f"{frame}.png"), np.full((240, 480), value, np.uint8))
    masked = dataclasses.replace(street, masks=masks)
    pairs = compared(masked, preset("solution_selection"))
    is_hidden = pairs.first_frame == 2
    assert np.all(pairs.matches[is_hidden] == 0)
    assert np.all(pairs.matches[~is_hidden] > 0)
    assert 0 < np.count_nonzero(is_hidden) < len(pairs)


def test_a_mask_of_another_size_is_refused(bands: Path, tmp_path: Path) -> None:
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), np.zeros((120, 240), np.uint8))
    masked = dataclasses.replace(twice(bands), masks=mask)
    with pytest.raises(DataError, match="expected 480×240 as in the first left image"):
        compared(masked, METHOD)


def test_a_sequence_shorter_than_the_gap_has_no_loops(bands: Path) -> None:
    loops = compared(open_sequence(bands), METHOD)
    assert len(loops) == 0
    poses = circle(6, 0.01)
    assert np.array_equal(close_path(poses, loops, CONFIG).poses, poses)


def test_place_is_compared_with_similar_places_beyond_the_gap() -> None:
    similarity = np.array([[1.0, 0.0, 0.9, 0.3], [0, 1, 0, 0.8], [0.9, 0, 1, 0.9], [0.3, 0.8, 0.9, 1]])
    config = LoopConfig(gap=20, candidates=1, similarity=0.5)
    assert candidate_pairs(similarity, np.array([0, 10, 20, 30]), config).tolist() == [[0, 2], [1, 3]]
    assert len(place_frames(4541, LoopConfig(every=10))) == 455
    assert len(place_frames(4541, LoopConfig())) <= LoopConfig().places


def test_pose_graph_of_all_places_fits_in_memory() -> None:
    """The dense system of a graph has 6 × 6 numbers for each pair of places."""
    with pytest.raises(DataError, match="places"):
        LoopConfig(places=601)
    assert LoopConfig(places=600).places ** 2 * 36 * 8 < 110e6


def test_true_loops_remove_the_drift_and_a_false_loop_has_no_weight() -> None:
    truth, drifted = circle(80, 0.0), circle(80, 0.004)
    config = LoopConfig(frame_turn=0.2)
    pairs = [(k, k + 40) for k in range(0, 40, 5)]
    closed = close_path(drifted, loops_between(truth, pairs), config)
    assert worst(closed.poses, truth) < 0.2 * worst(drifted, truth)
    assert closed.gap_m.max() < 0.05
    assert np.array_equal(closed.poses[0], drifted[0])
    loops = loops_between(truth, [*pairs, (0, 60)])
    loops.motion[-1] = np.eye(4)  # a false motion: frame 60, which is on the opposite side, at the start
    with_false = close_path(drifted, loops, config)
    assert with_false.weight[-1] < 0.01
    assert worst(with_false.poses, closed.poses) < 0.02
    believed = close_path(drifted, loops, dataclasses.replace(config, scale=1e6))
    assert worst(believed.poses, truth) > worst(drifted, truth)


def test_frames_between_places_move_with_their_neighbours() -> None:
    poses, frames = circle(23, 0.0), np.arange(0, 23, 5)
    assert interpolate_corrections(poses, frames, poses[frames]) == pytest.approx(poses, abs=1e-12)
    drifted = circle(23, 0.01)
    moved = interpolate_corrections(drifted, frames, poses[frames])
    assert moved[frames] == pytest.approx(poses[frames], abs=1e-12)
    assert worst(moved, poses) < 0.1 * worst(drifted, poses)
    assert inverse(moved[21]) @ moved[22] == pytest.approx(inverse(drifted[21]) @ drifted[22], abs=1e-12)


@pytest.mark.parametrize("variant", ["published", "kit"])
def test_a_run_with_loops_adds_files_and_changes_no_other(bands: Path, tmp_path: Path, variant: str) -> None:
    twice(bands)
    short = f"--loops.every 2 --loops.gap 6 --loops.similarity -1 --variant {variant}".split()

    def vo_run(name: str, *words: str) -> dict[str, bytes]:
        assert main(["run", str(bands), "--out", str(tmp_path / name), *short, *words]) == 0
        return {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}

    bare, closed, again = vo_run("a"), vo_run("b", "--loops"), vo_run("b", "--loops", "--fresh")
    assert set(closed) - set(bare) == {"poses_loops.txt", "loops.csv"}
    assert all(bare[name] == closed[name] for name in ("poses.txt", "poses_tum.txt"))
    assert all(closed[name] == again[name] for name in ("poses_loops.txt", "loops.csv", "trajectory.png"))
    (_, heading), *rows = read_csv(tmp_path / "b" / "loops.csv")
    loops = [dict(zip(heading, cells, strict=True)) for _, cells in rows]
    assert ("000000", "000006") in [(loop["first"], loop["second"]) for loop in loops]
    assert all(int(loop["inliers"]) >= 60 and float(loop["residual_px"]) < 0.5 for loop in loops)


def test_the_film_and_the_trajectory_picture_show_the_loops(bands: Path) -> None:
    result = run(twice(bands), METHOD)
    pictures = []
    for loops in ([], [(0, 6)]):
        film = Film(bands / "film.webm", result, "bands", loops)
        paths = trajectories_figure({"bands": (None, {"a path": result.poses})}, loops)
        drawn = cv2.imdecode(np.frombuffer(png(paths), np.uint8), cv2.IMREAD_COLOR)
        with film:
            last = [film.picture(frame) for frame in film_frames(result)][-1]
        same = (np.equal(np.asarray(each), LOOP_LINE_COLOUR) for each in (drawn, last))
        pictures.append([np.count_nonzero(np.all(each, axis=2)) for each in same])
    assert pictures[0] == [0, 0]
    assert min(pictures[1]) > 20


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_reproduction_adds_loops_below_the_papers_table(bands: Path, tmp_path: Path) -> None:
    twice(bands)
    words = f"reproduce --sequences {bands} --variant published --methods feature_selection --seeds 1"
    assert main([*words.split(), "--lengths", "2", "--loops", "--out", str(tmp_path)]) == 0
    tables = (tmp_path / "table1.md").read_text(encoding="utf-8")
    assert 0 < tables.index("feature_selection") < tables.index("Not in the paper: loops closed")
    assert "Not in the paper: loops closed" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(list(tmp_path.glob("runs/published/**/loops.csv"))) == 1
