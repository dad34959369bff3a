"""The student's stages joined, filmed, judged and marked; sources, slides, some drawn frames."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import write_bands

import course
from course import drawing, marks, slides
from course.ch00 import exercises as ch00
from course.ch03 import exercises as ch03
from course.ch04 import exercises as ch04
from course.ch08 import exercises as ch08
from course.ch08 import own
from course.checker import any_order
from course.drawing import figure, show_source
from vo_lib import open_sequence, preset, run
from vo_lib.core.errors import DataError
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import Sequence
from vo_lib.method.selection import nearest_to_prior
from vo_lib.method.translation import feature_rows


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
    assert mine.chain is ch00.chain.right
    assert mine.weights(0.5, 0.5) == 0.5
    assert mine.select is ch03.select.right
    assert mine.name == "2 of 10 stages yours"
    assert "fails its check" in mine._repr_html_()
    with pytest.raises(AttributeError, match="no stage is called turn"):
        mine.turn  # noqa: B018


def test_a_drive_is_judged_and_not_what_is_said_of_it(street: Sequence) -> None:
    part = street.part(0, 30)

    def peeks(sequence: Any, matches: Any, seed: int) -> Any:
        return sequence.truth[:, :3]

    def hands_over(sequence: Any, matches: Any, seed: int) -> Any:
        return run(sequence, preset("feature_selection", seed=seed)).poses

    configs = [preset("feature_selection", variant="published", seed=seed) for seed in ch08.SEEDS]
    published = [run(part, config).poses for config in configs]
    assert "expected your function" in ch08.better({"RE": 0.1, "RE published": 0.5}, part).message
    assert "replace the dots" in ch08.better(..., part).message
    assert "hands the work to `run`" in ch08.better(hands_over, part).message
    assert "TypeError" in ch08.better(peeks, part).message
    assert "gave back no path" in ch08.better(lambda *_, seed: published[seed][1:], part).message
    assert "not yet a quarter" in ch08.better(lambda *_, seed: published[seed], part).message


def test_a_film_has_every_frame_of_ones_own_path(tmp_path: Path) -> None:
    road = open_sequence(write_bands(tmp_path / "bands"))
    assert road.truth is not None
    last = own.film(tmp_path / "mine.mp4", road, road.truth)
    film = cv2.VideoCapture(str(tmp_path / "mine.mp4"))
    assert sum(film.read()[0] for _ in range(20)) == len(road) - 1
    assert not np.array_equal(own.film(tmp_path / "other.mp4", road, np.array([np.eye(4)] * len(road))), last)


def test_marks_say_of_each_function_whether_it_passes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    anna, ben = tmp_path / "anna.py", tmp_path / "ben.py"
    anna.write_text("""from vo_lib.method.five_point import five_point
def weights(r, s): return 1 / (1 + (r / s) ** 2)
def chain(motions): return motions
def solve_five(x_p, x_c): return five_point(x_p, x_c)
""")
    ben.write_text("1 / 0")
    words = ["marks", str(anna), str(ben)]
    monkeypatch.setattr(sys, "argv", words)
    assert marks.main() == 2
    told = capsys.readouterr()
    weights, select = "4.7  weights              passes", "3.5  select               not there"
    for line in (f"1 of {len(marks.asked())} pass", weights, select, "hands the work to `five_point`"):
        assert line in told.out
    assert re.fullmatch("error: .*ben.py: it cannot be run.*\n", told.err)
    monkeypatch.setattr(sys, "argv", ["marks", "--json", words[1]])
    assert marks.main() == 0
    functions = json.loads(capsys.readouterr().out)[words[1]]["functions"]
    assert functions["weights"] == {"exercise": "4.7", "passed": True, "says": ""}
    assert not functions["chain"]["passed"]
    assert functions["chain"]["says"]


def test_what_is_shown_is_written_for_slides(tmp_path: Path) -> None:
    written = []
    for name in ("one", "two"):
        with pytest.MonkeyPatch.context() as patch:
            for place in (course, drawing):
                patch.setattr(place, "show", place.show)  # both are put back
            slides.export(tmp_path / name, "03")
            made, (axis,) = figure(120)
            axis.plot([0, 1], [0, 1])
            shown = course.show(made, np.zeros((20, 30), np.uint8))
        assert (tmp_path / name / "03_01.png").read_bytes() == shown.data
        written.append((tmp_path / name / "03_01a.svg").read_text(encoding="utf-8"))
    assert written[0] == written[1]
    assert "<path" in written[0]


def test_exact_rows_leave_nothing_under_the_true_translation() -> None:
    matches, camera = ch04.exact_matches(20, 1), ch04.CAMERA
    A, B, c = feature_rows(camera, matches, ch04.R_CP)
    M = np.concatenate([A, B], axis=2)
    assert own.residuals(M, c, ch04.T_CP).max() < 1e-9
    assert own.residuals(M, c, ch04.T_CP + 0.1).min() > 1e-3


@pytest.mark.parametrize("line", ["import sys; sys.exit(0)", "raise KeyboardInterrupt", "1 / 0"])
def test_a_module_of_mine_that_ends_the_program_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_vo.py").write_text(f"{line}\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"my_vo\.py: it cannot be run"):
        own.join()


def test_the_source_of_a_stage_is_the_real_one() -> None:
    shown = str(show_source(nearest_to_prior, any_order))
    assert shown.startswith("# vo_lib/method/selection.py\ndef nearest_to_prior(")
    assert "# course/checker.py\ndef any_order" in shown


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
