"""The student's stages joined, the sketches, the source that is shown, and some frames of a drawn scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from course import sketches
from course.ch00 import exercises as ch00
from course.ch03 import exercises as ch03
from course.ch04 import exercises as ch04
from course.ch08 import own
from course.checker import Exercise
from course.drawing import raster, show_source
from vo_lib.core.errors import DataError
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config
from vo_lib.data.sequence import open_sequence
from vo_lib.method.selection import nearest_to_prior
from vo_lib.method.translation import feature_rows


def test_a_stage_is_yours_where_it_passes_and_the_librarys_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert own.join().facts == {"borrowed": len(own.STAGES)}
    lines = ["def weights(r, s):", "    return 1 / (1 + (r / s) ** 2)", "def chain(motions): return motions"]
    (tmp_path / "my_vo.py").write_text("\n".join(lines), encoding="utf-8")
    mine = own.join(truncated_error=lambda d, t: np.mean(np.minimum((d / t) ** 2, 1.0)))
    yours = [name for name, whose in mine.whose.items() if whose == "yours"]
    assert yours == ["truncated_error", "weights"]
    assert "yours fails its check" in mine.whose["chain"]
    assert mine.chain is ch00.chain.right
    assert mine.weights(0.5, 0.5) == 0.5
    assert mine.select is ch03.select.right
    assert "fails its check" in mine._repr_html_()
    with pytest.raises(AttributeError, match="no stage is called turn"):
        mine.turn  # noqa: B018
    (tmp_path / "my_vo.py").write_text("1 / 0\n")
    with pytest.raises(DataError, match="ZeroDivisionError"):
        own.join()


def test_exact_rows_leave_nothing_under_the_true_translation() -> None:
    matches, camera = ch04.exact_matches(20, 1), ch04.CAMERA
    A, B, c = feature_rows(camera, matches, ch04.R_CP)
    M = np.concatenate([A, B], axis=2)
    assert own.residuals(M, c, ch04.T_CP).max() < 1e-9
    assert own.residuals(M, c, ch04.T_CP + 0.1).min() > 1e-3


def test_every_sketch_is_another_picture() -> None:
    names = ("stereo_triangle", "epipolar_plane", "eight_rays", "sub_sequence", "pose_chain")
    pictures = {raster(getattr(sketches, name)()).tobytes() for name in names}
    assert len(pictures) == len(names)


@pytest.mark.parametrize("line", ["import sys; sys.exit(0)", "raise KeyboardInterrupt", "1 / 0"])
def test_a_module_of_mine_that_ends_the_program_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_vo.py").write_text(f"{line}\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"my_vo\.py: it cannot be run"):
        own.join()


def test_the_source_of_a_stage_is_the_real_one() -> None:
    shown = str(show_source(nearest_to_prior, Exercise))
    assert shown.startswith("# vo_lib/method/selection.py\ndef nearest_to_prior(")
    assert "# course/checker.py\nclass Exercise" in shown


def test_some_frames_of_a_scene_are_those_of_the_whole_scene(tmp_path: Path) -> None:
    config = scene_config("empty", length=8.0, width=160, height=64)
    part = ensure_scene(config, tmp_path, frames=range(2, 5), jobs=1)
    assert part == ensure_scene(config, tmp_path, frames=range(2, 5))
    whole = ensure_scene(config, tmp_path, jobs=1)
    assert whole != part
    names = sorted(path.name for path in (part / "image_0").iterdir())
    assert names == ["000002.png", "000003.png", "000004.png"]
    for name in names:
        assert (part / "image_1" / name).read_bytes() == (whole / "image_1" / name).read_bytes()
    truth = open_sequence(whole).truth
    assert truth is not None
    np.testing.assert_array_equal(open_sequence(part).truth, truth[2:5])
    assert ensure_scene(config, tmp_path, frames=range(2, 5)) == whole
