"""Statements of chapters 1 to 6 about the panels are true on the street of each chapter."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import nbformat
import numpy as np
import pytest

from course.ch01 import MatchingPanel
from course.ch02 import FivePointPanel
from course.ch03 import SelectionPanel
from course.ch04 import TranslationPanel
from course.ch04 import exercises as ch04
from course.ch05 import LorryPanel
from course.ch06 import EvaluationPanel
from course.frames import frame_points
from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.paper.viso2 import ransac_motion
from vo_lib.settings import replace

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"
PANELS = {
    "01": MatchingPanel,
    "02": FivePointPanel,
    "03": SelectionPanel,
    "04": TranslationPanel,
    "05": LorryPanel,
    "06": EvaluationPanel,
}
NONE_MADE_UP = {"view__scale": 0.0, "view__yaw": 0.0, "view__noise": 0.0, "view__jitter": 0.0}
LONG = 300.0  # seconds; a safeguard
Facts = dict[str, float]
Look = Callable[..., tuple[Facts, Facts, list[float]]]


@pytest.fixture(scope="module")
def look(street: Sequence) -> Look:
    """Facts of a chapter's panel before and after a change of settings, and numbers in the chapter."""

    def facts(chapter: str, sentence: str, **settings: Any) -> tuple[Facts, Facts, list[float]]:
        cells = nbformat.read(next(FOLDER.glob(f"{chapter}_*.ipynb")), as_version=4).cells  # type: ignore[no-untyped-call]
        match = re.search(sentence, "\n".join(cell.source for cell in cells))
        assert match is not None, sentence
        panel = PANELS[chapter](street, frame=60)
        panel.wait(LONG)
        before = dict(panel.facts)
        panel.set(**settings)
        panel.wait(LONG)
        assert panel.error == ""
        return panel.facts, before, [float(number) for number in match.groups()]

    return facts


def test_effects_of_row_tolerance_loop_tolerance_and_quality(look: Look) -> None:
    now, _, numbers = look("01", r"\*row tolerance\* to ([.\d]+) px and see", matching__row_tolerance=0.1)
    assert numbers == [0.1]
    assert now["right ones dropped"] > 100
    more, before, numbers = look("01", r"the tolerance to (\d) px: some more", matching__row_tolerance=3.0)
    assert numbers == [3]
    assert (more["wrong among the kept"] - before["wrong among the kept"]) / (
        more["kept"] - before["kept"]
    ) > 0.5
    loop, before, numbers = look("01", r"\*loop tolerance\* to ([.\d]+) px", matching__loop_tolerance=0.1)
    assert numbers == [0.1]
    assert loop["kept"] > 0.9 * before["kept"] > 1.5 * now["kept"]
    strong, before, numbers = look("01", r"\*threshold\* to (\d+) grey levels", features__blob_quality=500)
    assert numbers == [500]
    shares = [each["wrong among the kept"] / each["kept"] for each in (strong, before)]
    assert shares[0] > 0.9 * shares[1]
    kit, before, _ = look("01", r"Switch the \*method\* to `kit`", variant="kit")
    for name in ("features", "wrong among the kept", "median error of the kept"):
        assert kit[name] < before[name]


def test_effects_of_neighbouring_matches_noise_and_threshold(look: Look) -> None:
    median = "rotation error: median of the sets"
    now, before, _ = look("02", r"\*random five\* to `side by side`", view__spread="side by side")
    assert now[median] > 5 * before[median]
    now, before, _ = look("02", r"Raise the \*noise\*", view__noise=1.0)
    assert now[median] > 5 * before[median]
    shares = []
    for threshold in (0.1, 5.0):
        text = r"\*inlier threshold\* to ([.\d]+) px, then raise it to (\d) px"
        bad, _, numbers = look("02", text, selection__threshold=threshold, view__candidate=3)
        good, _, _ = look("02", text, selection__threshold=threshold)
        assert threshold in numbers
        shares.append(bad["inliers"] / good["inliers"])
    assert shares[0] < 0.2 < 0.6 < shares[1]


def test_the_winner_of_few_sets_varies_more_from_draw_to_draw(look: Look) -> None:
    text = r"Lower `n` to (\d+) and press .* five times: .* rises to ([.\d]+)°.* 200 sets .* below ([.\d]+)°"
    largest = {10: 0.0, 200: 0.0}
    for sets in largest:
        for draw in range(6):
            now, _, (few, worst, bound) = look("03", text, selection__sets=sets, view__draw=draw)
            largest[sets] = max(largest[sets], now["error by selection"])
    assert few == 10
    assert round(largest[10], 2) == worst
    assert largest[200] < bound


def test_moving_matches_win_the_vote_and_wrong_ones_do_not(look: Look) -> None:
    now, _, numbers = look("03", r"Set \*moving share\* to ([.\d]+) instead", view__moving=0.6)
    assert numbers == [0.6]
    assert now["error by selection"] > 1.5
    now, _, jump = look("03", r"The winner jumps between ([.\d]+) and ([.\d]+)\.", view__moving=0.5)
    assert jump == [0.5, *numbers]
    assert now["error by selection"] < 0.5
    now, _, numbers = look("03", r"Set \*wrong share\* to ([.\d]+)", view__wrong=0.6)
    assert numbers == [0.6]
    assert now["error by selection"] < 0.05


def test_vote_and_prior_may_take_different_solutions_of_a_plane(look: Look) -> None:
    text = r"set `k` to (\d)\. .* after the first and the seventh press, .* more than ([.\d]+)° wrong"
    for draw in (1, 7):
        plane = {"view__plane": True, "selection__top_k": 1, "view__draw": draw}
        now, _, (keep, wrong) = look("03", text, **plane)
        assert keep == 1
        assert now["error by consensus"] > wrong > 3 * now["error by selection"]
        now, _, _ = look("03", "With `k` = 2 the prior follows the vote", **plane | {"selection__top_k": 2})
        assert now["error by selection"] > 0.7 * now["error by consensus"]


def test_weighting_wrong_matches_and_depth_limit_act_as_the_text_says(look: Look) -> None:
    text = r"about a millimetre, the largest more than a tenth of a metre"
    now, before, _ = look("04", text, view__weighting="mean of features")
    assert 0.5 < before["σ in z"] < 1.5
    assert 100 < now["σ in z"] < 200
    now, before, _ = look("04", r"beats both plain sums of squares", view__weighting="median of features")
    for weighting in ("rows in pixels", "rows in metres"):
        plain, _, _ = look("04", r"beats both plain sums of squares", view__weighting=weighting)
        assert now["error"] < 0.5 * plain["error"]
    text = "compare the errors: below a millimetre, and more than a decimetre"
    now, _, _ = look("04", text, view__wrong=0.5)
    assert now["error"] < 1
    now, _, _ = look("04", text, view__wrong=0.5, view__weighting="rows in pixels")
    assert now["error"] > 100
    text = r"to (\d+) m\. A third of the features is removed, and the error stays below a millimetre"
    now, before, numbers = look("04", text, translation__max_depth=20)
    assert numbers == [20]
    assert now["features used"] / before["features used"] == pytest.approx(2 / 3, abs=0.05)
    assert max(now["error"], before["error"]) < 1
    text = r"At (\d+) m about a dozen features remain, .* and \*σ in z\* jumps"
    now, before, numbers = look("04", text, translation__max_depth=5)
    assert numbers == [5]
    assert 10 <= now["features used"] <= 14
    assert now["σ in z"] > 20 * before["σ in z"]


def test_a_wrong_rotation_slips_by_the_depth_times_the_angle(look: Look) -> None:
    text = r"a rotation error of ([.\d]+)° makes `t` more than (\d+) mm wrong in `x`"
    far, _, (angle, least) = look("04", text, view__turn=0.1)
    assert angle == 0.1
    assert abs(far["error in x"]) > least > 10 * far["σ in x"]
    near, _, _ = look("04", "Use only features nearer than 15 m", view__turn=0.2, translation__max_depth=15)
    assert near["error in x / rotation error"] < 0.7 * far["error in x / rotation error"]
    assert ch04.turned_sideways(near).passed


def test_the_weights_of_viso2_are_worse_on_a_perfect_rig(look: Look, street: Sequence) -> None:
    text = r"the weight is (\d+) times as large as at the border.* move less than half as far"
    _, _, (ratio,) = look("04", text)
    settings = preset("solution_selection")
    weights = settings.reprojection
    assert (1 + weights.centre) / weights.centre == pytest.approx(ratio)
    camera, errors = street.camera, []
    for frame in (35, 50, 60, 70):
        points = frame_points(street, frame, settings)
        matches, T_cp = points.matches, points.T_cp
        assert T_cp is not None
        flow = np.linalg.norm(matches.cur_left - matches.prev_left, axis=1)
        middle = np.abs(matches.cur_left[:, 0] - camera.cx) < 0.2 * camera.cx
        assert 2 * np.median(flow[middle]) < np.median(flow[~middle])
        near = points.X_p[:, 2] < 100
        given = points.X_p[near], matches.cur_left[near], camera.K
        answers = [cv2.solvePnPRansac(*given, None, reprojectionError=1.0)[2].ravel()]
        for each in (weights, replace(weights, "centre", 100.0)):
            solved = ransac_motion(camera, matches, np.random.default_rng(0), each)
            assert solved is not None
            answers.append(solved[1])
        errors.append([float(np.linalg.norm(t - T_cp[:3, 3])) for t in answers])
    pnp, viso2, equal = np.median(errors, axis=0)
    assert viso2 > 2 * pnp > equal


def test_the_lorry_wins_the_vote_and_the_street_wins_it_again(look: Look) -> None:
    lost, street = 50.0, 5.0  # centimetres, of a step of a metre
    text = r"At (\d) m, move the \*share\* from ([.\d]+) to ([.\d]+): .* The lorry wins the vote"
    now, before, numbers = look("05", text, view__share=0.3)
    assert numbers == [5, 0.3, 0.5]
    assert now["error, all features"] < street
    assert before["error, all features"] > lost
    text = r"share of ([.\d]+), set the \*distance\* of the lorry to (\d+) m: the street wins again"
    near, _, numbers = look("05", text, view__share=0.7)
    far, _, _ = look("05", text, view__share=0.7, view__distance=10.0)
    assert numbers == [0.7, 10]
    assert near["error, all features"] > lost
    assert far["error, all features"] < street
    assert far["after the buckets"] < 0.5 * far["on the lorry"]
    assert near["error, box removed"] == before["error, box removed"]
    text = r"is the same at every share\. At 5 m this error is larger than at (\d+) m"
    far, _, numbers = look("05", text, view__distance=15.0)
    assert numbers == [15]
    assert 2 * far["error, box removed"] < near["error, box removed"]


def test_perturbations_have_the_stated_size(look: Look) -> None:
    text = r"TE is (\d) % for every length, and RE is (\d)\. With sim3, ATE is nearly 0"
    now, _, numbers = look("06", text, **NONE_MADE_UP | {"view__scale": 2.0, "view__alignment": "sim3"})
    assert numbers == [round(now["TE"], 1), round(now["RE"], 1)]
    assert now["ATE"] < 0.01
    text = r"\*Noise\* of (\d+) mm alone: RPE is (\d+) mm and ([.\d]+)° a frame, TE ([.\d]+) %"
    now, _, numbers = look("06", text, **NONE_MADE_UP | {"view__noise": 50.0})
    turn = "RPE, rotation"
    assert numbers == [50, round(now["RPE"]), round(now[turn], 2), round(now["TE"], 2)]
    text = r"\*Jitter\* of ([.\d]+)° alone: RPE is ([.\d]+) mm and ([.\d]+)° a frame, TE ([.\d]+) %"
    now, _, numbers = look("06", text, **NONE_MADE_UP | {"view__jitter": 0.1})
    assert numbers == [0.1, round(now["RPE"], 2), round(now[turn], 2), round(now["TE"], 2)]
