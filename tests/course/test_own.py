"""The student's stages: their composition, film, evaluation and marks, on a few drawn frames."""

from __future__ import annotations

import base64
import json
import re
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import small, winding_road

from course import view3d
from course.ch00 import exercises as ch00
from course.ch03 import exercises as ch03
from course.ch08 import exercises as ch08
from course.ch08 import own
from vo_lib import open_sequence, preset, run
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse
from vo_lib.runs.drive import run_methods
from vo_lib.runs.match_cache import CachedMatches


def test_a_stage_is_yours_where_it_passes_and_the_librarys_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert own.join().facts == {"borrowed": len(own.STAGES)}
    lines = "def weights(r, s): return 1 / (1 + (r / s) ** 2)\ndef chain(motions): return motions\n"
    (tmp_path / "my_vo.py").write_text(lines)
    mine = own.join(truncated_error=lambda d, t: np.mean(np.minimum((d / t) ** 2, 1.0)))
    yours = [name for name, whose in mine.whose.items() if whose == "yours"]
    assert yours == ["truncated_error", "weights"]
    assert "yours fails its check" in mine.whose["chain"]
    assert mine.functions["chain"] is ch00.chain.right
    assert mine.weights(0.5, 0.5) == 0.5
    assert mine.functions["select"] is ch03.select.right
    assert mine.name == "2 of 14 stages yours"
    assert "fails its check" in mine._repr_html_()
    with pytest.raises(AttributeError, match="no stage is called turn"):
        mine.turn  # noqa: B018


def test_grade_uses_poses_not_self_reported_error(street: Sequence) -> None:
    part = street.part(0, 30)
    configs = {str(seed): preset("feature_selection", seed=seed) for seed in ch08.SEEDS}
    published = run_methods(part, configs)

    def hands_over(sequence: Any, matches: Any, seed: int) -> Any:
        return run(sequence, configs[str(seed)]).poses

    for answer, words in (
        ({"RE": 0.1, "RE published": 0.5}, "expected your function"),
        (..., "replace the dots"),
        (hands_over, "hands the work to `run`"),
        (lambda sequence, *_, seed: sequence.truth[:, :3], "TypeError"),  # the truth is missing
        (
            lambda *_, seed: published[str(seed)].poses[1:],
            "the path has shape (29, 4, 4), expected (30, 4, 4)",
        ),
        (lambda *_, seed: published[str(seed)].poses, "more than half"),
        (lambda *_, seed: None, "the path is missing: the function returns None"),
        (lambda *_, seed: np.full((30, 4, 4), np.nan), "is not a rotation, or is NaN"),
        (lambda *_, seed: np.array([np.eye(4)] * 30), "this is not the path of the camera"),
    ):
        assert words in ch08.better(answer, part).message


def test_a_film_has_every_frame_of_ones_own_path(bands: Path, tmp_path: Path) -> None:
    road = open_sequence(bands)
    assert road.truth is not None
    mine, matches = own.join(), list(CachedMatches(road, small(), tmp_path))
    last = own.film(tmp_path / "mine.webm", mine, road, matches, road.truth, 1)
    film = cv2.VideoCapture(str(tmp_path / "mine.webm"))
    assert sum(film.read()[0] for _ in range(20)) == len(road) - 1
    still = np.array([np.eye(4)] * len(road))
    assert not np.array_equal(own.film(tmp_path / "other.webm", mine, road, matches, still, 1), last)


def test_a_mixed_path_has_the_turns_of_one_and_the_steps_of_the_other() -> None:
    one, other = winding_road(6, 0.1, 1.0), winding_road(6, 0.0, 2.0)
    both = own.mixed(one, other)
    np.testing.assert_allclose(both[:, :3, :3], one[:, :3, :3], atol=1e-12)
    T, expected = (inverse(path[1:]) @ path[:-1] for path in (both, other))
    np.testing.assert_allclose(T[:, :3, 3], expected[:, :3, 3], atol=1e-12)


def test_a_stage_that_is_much_slower_than_the_librarys_is_reported() -> None:
    def slow_chain(motions: Any) -> Any:
        start = time.thread_time()
        while time.thread_time() < start + 0.2:
            pass
        return ch00.chain.right(motions)

    mine = own.join(chain=slow_chain)
    assert mine.whose["chain"] == "yours"
    assert list(mine.slow) == ["chain"]
    assert "times the library's time" in mine._repr_html_().replace("&#x27;", "'")


def test_a_stage_that_waits_for_other_programs_is_not_called_slow() -> None:
    def waits(r: Any, s: Any) -> Any:
        time.sleep(1.2 * own.LEAST_S)  # as on a loaded computer
        return 1 / (1 + (r / s) ** 2)

    mine = own.join(weights=waits)
    assert mine.whose["weights"] == "yours"
    assert mine.slow == {}


def test_the_reason_for_a_failed_check_is_a_whole_sentence() -> None:
    mine = own.join(chain=lambda motions: np.eye(4), weights=lambda r, s: 1 / 0)
    assert "yours fails its check: the result has shape (4, 4)" in mine.whose["chain"]
    assert "yours fails its check: the code stopped with ZeroDivisionError" in mine.whose["weights"]


def test_a_run_becomes_a_page_in_three_dimensions(bands: Path) -> None:
    sequence, config = open_sequence(bands).part(1, 5), small(filter__rule="none")
    made = run(sequence, config)
    data = json.loads(next(re.finditer(r"= (\{.*\});", view3d.view_of_run(made).page()))[1])
    points, path, truth = data["shapes"]
    np.testing.assert_allclose(path["at"], made.poses[:, :3, 3], atol=1e-3)
    assert len(truth["at"]) == len(path["at"]) == len(data["times"]) == 4
    # Both lines nearly cover each other: a name at an end would not tell which is which.
    assert [shape["in_legend"] for shape in data["shapes"]] == [False, True, True]
    assert path["width"] > truth["width"]
    # Six walls, the farthest at f b / 4 px.
    depths = np.unique(np.round(np.array(points["at"])[:, 2], 0))
    assert 5 < depths.min() < depths.max() < 40


def test_the_example_of_a_view_runs() -> None:
    example = [line.strip() for line in (view3d.__doc__ or "").splitlines() if line.startswith("    ")]
    names: dict[str, Any] = {**vars(view3d), "points": np.eye(3), "corners": np.eye(3), "BAD": "#D55E00"}
    *before, last = example
    exec("\n".join(before), names)
    assert isinstance(eval(last, names), view3d.View)


def test_a_view_needs_no_network_and_is_a_picture_where_no_script_runs() -> None:
    plane = view3d.Shape(np.eye(3), "#D55E00", "area", name="a plane <i>")
    shown = view3d.View(plane, view3d.camera_shape(np.eye(4), "left"), title="One plane")._repr_mimebundle_()
    assert set(re.findall(r"https?://", shown["text/html"])) == set()
    assert 'title="One plane"' in shown["text/html"]
    assert "<i>" not in shown["text/html"]
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(shown["image/png"]), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.min() < 100


MOVED = "from vo_lib.core.geometry import inverse"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("import sys; sys.exit(0)", "SystemExit"),
        ("1 / 0", "line 1: ZeroDivisionError"),
        ("\ndef half():\n    return 1 / 0\n\nhalf()", "line 3: ZeroDivisionError"),
        (MOVED, "compare its imports with those of the chapter"),
    ],
)
def test_a_module_of_ones_own_that_cannot_be_run_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_vo.py").write_text(f"{line}\n", encoding="utf-8")
    with pytest.raises(DataError, match=rf"my_vo\.py: the file cannot be run.*{words}"):
        own.join()


def test_some_frames_of_a_scene_are_those_of_the_whole_scene(tmp_path: Path) -> None:
    config = scene_config("empty", length=8.0, width=160, height=64)
    part = ensure_scene(config, tmp_path, frames=range(2, 5), jobs=1)
    assert part == ensure_scene(config, tmp_path, frames=range(2, 5))
    whole = ensure_scene(config, tmp_path, jobs=1)
    assert whole != part
    names = sorted(path.name for path in (part / "image_1").iterdir())
    assert names == ["000002.png", "000003.png", "000004.png"]
    for name in names:
        assert (part / "image_1" / name).read_bytes() == (whole / "image_1" / name).read_bytes()
    np.testing.assert_array_equal(open_sequence(part).truth, np.asarray(open_sequence(whole).truth)[2:5])
    assert ensure_scene(config, tmp_path, frames=range(2, 5)) == whole
