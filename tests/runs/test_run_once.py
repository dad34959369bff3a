"""A run killed at any moment and started again gives the same bytes; a folder belongs to one run."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import small, with_box, write_bands

from vo_lib import DataError, Sequence, open_sequence, run
from vo_lib.config import Config
from vo_lib.core.files import only_process, write_text_atomic
from vo_lib.core.poses import format_kitti_poses
from vo_lib.runs.jobs import run_once
from vo_lib.runs.match_cache import CachedMatches
from vo_lib.runs.results import is_finished, read_run

FRAMES = 14


class Stopped(Exception):
    """Raised by a test in the middle of a run."""


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    """Fourteen frames with boxes."""
    folder = write_bands(tmp_path / "bands", frames=FRAMES)
    return open_sequence(with_box(folder, FRAMES))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty run folder."""
    (tmp_path / "run").mkdir()
    return tmp_path / "run"


def boxed(**changes: object) -> Config:
    return small("feature_selection", **{"filter.min_matches": 10, "selection.sets": 20, **changes})


def stop_at(frame: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done == frame:
            raise Stopped

    return progress


def require_same(folder: Path, sequence: Sequence) -> None:
    """The folder holds what a run in one go gives, but for milliseconds."""
    whole, done = run(sequence, boxed()), read_run(folder, sequence)
    assert (folder / "poses.txt").read_text(encoding="utf-8") == format_kitti_poses(whole.poses)
    for one, other in zip(whole.motions, done.motions, strict=True):
        for name in ("matches", "removed", "inliers", "flags"):
            assert getattr(one, name) == getattr(other, name)


@pytest.mark.parametrize("cached", [False, True])
def test_a_stopped_run_leaves_nothing_and_starts_over_to_the_same_bytes(
    sequence: Sequence, folder: Path, tmp_path: Path, cached: bool
) -> None:
    config = boxed()
    matches = CachedMatches(sequence, config.features, config.matching, tmp_path) if cached else None
    for stop in (1, 6, 14):
        with pytest.raises(Stopped):
            run_once(folder, sequence, boxed(), "m", matches=matches, progress=stop_at(stop))
        assert list(folder.iterdir()) == []
    seen: list[int] = []
    result, before = run_once(
        folder, sequence, boxed(), "m", matches=matches, progress=lambda n, _: seen.append(n)
    )
    assert not before
    assert len(result.motions) == FRAMES - 1
    assert seen == list(range(1, FRAMES + 1))
    require_same(folder, sequence)


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("written", range(6))
def test_a_run_stopped_between_two_of_its_files_is_no_finished_run_and_is_done_again(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch, written: int, old: bool
) -> None:
    sequence = sequence.part(0, 4)
    if old:
        run_once(folder, sequence, boxed(seed=1), "m")
    left = [None] * written

    def stops(path: Path, text: str) -> None:
        if not left:
            raise Stopped
        left.pop()
        write_text_atomic(path, text)

    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.results.write_text_atomic", stops)
        with pytest.raises(Stopped):
            run_once(folder, sequence, boxed(), "m", fresh=True)
    # Before the first new file the old run is still whole.
    assert is_finished(folder) == (old and written == 0)
    if is_finished(folder):
        assert read_run(folder, sequence).config.seed == 1
        return
    if written:
        with pytest.raises(
            DataError, match=r"config\.json: the run was stopped while its files were written"
        ):
            read_run(folder, sequence)
    assert not run_once(folder, sequence, boxed(), "m")[1]
    assert is_finished(folder)
    require_same(folder, sequence)


def test_a_finished_run_is_only_read(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _ = run_once(folder, sequence, boxed(), "m")
    written = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr("vo_lib.data.sequence.read_image", None)
    second, before = run_once(folder, sequence, boxed(), "m")
    assert before
    np.testing.assert_allclose(second.poses, first.poses, atol=1e-8)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == written


def test_other_settings_method_sequence_label_or_code_are_refused_by_name(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_once(folder, sequence, boxed(), "m")

    def refused(other: Sequence = sequence, method: str = "m", **changes: object) -> str:
        with pytest.raises(DataError) as error:
            run_once(folder, other, boxed(**changes), method)
        return str(error.value)

    assert "selection.sets is 20 there and 50 here" in refused(selection__sets=50)
    assert "seed is 0 there and 4 here" in refused(seed=4)
    assert "and 1 more" in refused(seed=4, filter__classes=(2,), min_matches=13, buckets__size=40)
    assert "method is m there and n here" in refused(method="n")
    words = "frames is ['000000', '000013'] there and ['000000', '000006'] here"
    assert words in refused(sequence.part(0, 7))
    camera = dataclasses.replace(sequence.camera, f=301.0)
    assert "camera.f is 300.0 there and 301.0 here" in refused(dataclasses.replace(sequence, camera=camera))
    for name, words in (("labels/000012.txt", "other labels"), ("image_0/000012.png", "other images")):
        path = sequence.folder / name
        data = path.read_bytes()
        path.write_bytes(path.with_stem("000011").read_bytes() + b"\n")
        assert words in refused()
        path.write_bytes(data)
    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.identity.code_digest", lambda: "changed")
        assert "the kit's code has changed" in refused()
        patch.setattr("vo_lib.runs.identity.np.__version__", "1.0")
        assert "numpy is" in refused()
    # A name of the same data is no other run.
    assert run_once(folder, dataclasses.replace(sequence, name="x"), boxed(), "m")[1]


@pytest.mark.parametrize("text", ["[1]", '{"settings": {}, "frames": 5, "labels": [1], "made_with": 3}'])
def test_a_folder_of_something_else_is_refused(sequence: Sequence, folder: Path, text: str) -> None:
    (folder / "config.json").write_text(text, encoding="utf-8")
    with pytest.raises(DataError):
        run_once(folder, sequence, boxed(), "m")


@pytest.mark.parametrize("name", ["poses.txt", "metrics.json"])
def test_a_result_of_another_program_is_not_written_over(sequence: Sequence, folder: Path, name: str) -> None:
    (folder / name).write_text("mine", encoding="utf-8")
    with pytest.raises(DataError, match=f"{name}: of something else, for there is no config.json"):
        run_once(folder, sequence, boxed(), "m")
    assert [path.name for path in folder.iterdir()] == [name]
    assert (folder / name).read_text(encoding="utf-8") == "mine"
    run_once(folder, sequence, boxed(), "m", fresh=True)
    assert run_once(folder, sequence, boxed(), "m")[1]


def test_one_process_at_a_time_and_the_lock_of_a_killed_one_is_gone(sequence: Sequence, folder: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from vo_lib.core.files import only_process\n"
        "with only_process(Path(sys.argv[1])):\n    print('in', flush=True); time.sleep(600)"
    )
    other = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    try:
        assert other.stdout.readline() == "in\n"
        with pytest.raises(DataError, match="another process is working in this folder"):
            run_once(folder, sequence, boxed(), "m")
    finally:
        other.kill()
        other.wait()
        other.stdout.close()
    assert (folder / ".lock").exists()
    run_once(folder, sequence, boxed(), "m")
    with only_process(folder), pytest.raises(DataError, match="another process"), only_process(folder):
        pass
