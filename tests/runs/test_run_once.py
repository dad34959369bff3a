"""Run folders: restart after an interruption, errors for folders of other runs, and locks."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from conftest import small, with_box, write_bands

from vo_lib import DataError, Sequence, open_sequence, run
from vo_lib.data.poses import format_kitti_poses
from vo_lib.files import only_process, write_atomic
from vo_lib.kit.settings import KitConfig
from vo_lib.runs.folder import is_finished, read_run, run_folder, timing
from vo_lib.runs.jobs import run_once
from vo_lib.runs.match_cache import CachedMatches

FRAMES = 14


class Stopped(Exception):
    """Exception that a test raises in the middle of a run."""


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


def boxed(**changes: object) -> KitConfig:
    return small("feature_selection", **{"filter.min_matches": 10, "selection.sets": 20, **changes})


def stop_at(frame: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done == frame:
            raise Stopped

    return progress


def require_same(folder: Path, sequence: Sequence) -> None:
    """Require that the folder has the results of an uninterrupted run, apart from times."""
    whole, done = run(sequence, boxed()), read_run(folder, sequence)
    assert (folder / "poses.txt").read_text(encoding="utf-8") == format_kitti_poses(whole.poses)
    for one, other in zip(whole.motions, done.motions, strict=True):
        for name in ("matches", "removed", "inliers", "flags"):
            assert getattr(one, name) == getattr(other, name)


def test_stopped_run_leaves_no_files(sequence: Sequence, folder: Path, tmp_path: Path) -> None:
    matches = CachedMatches(sequence, boxed(), tmp_path)
    for stop in (1, 14):
        with pytest.raises(Stopped):
            run_once(folder, sequence, boxed(), "m", matches=matches, progress=stop_at(stop))
        assert list(folder.iterdir()) == []
    assert not run_once(folder, sequence, boxed(), "m", matches=matches)[1]
    require_same(folder, sequence)


@pytest.mark.parametrize("written", [0, 3, 5, 6])
def test_run_stopped_while_writing_is_repeated(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    sequence = sequence.part(0, 4)
    run_once(folder, sequence, boxed(seed=1), "m")
    missing = iter(range(written))

    def stops(path: Path, text: str) -> None:
        if next(missing, None) is None:
            raise Stopped
        write_atomic(path, text)

    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.folder.write_atomic", stops)
        with suppress(Stopped):
            run_once(folder, sequence, boxed(), "m", fresh=True)
    assert is_finished(folder) == (written == 6)  # config.json is the last of six files
    assert run_once(folder, sequence, boxed(), "m")[1] == (written == 6)
    require_same(folder, sequence)


def test_finished_run_is_read_only(sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = run_once(folder, sequence, boxed(), "m")
    written = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr("vo_lib.data.sequence.read_image", None)
    second, before = run_once(folder, sequence, boxed(), "m")
    assert before
    np.testing.assert_allclose(second.poses, first.poses, atol=1e-8)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == written


def test_folder_of_another_run_is_refused(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_once(folder, sequence, boxed(), "m")

    def refused(other: Sequence = sequence, method: str = "m", **changes: object) -> str:
        with pytest.raises(DataError) as error:
            run_once(folder, other, boxed(**changes), method)
        return str(error.value)

    assert "another run, which differs in settings.selection.sets;" in refused(selection__sets=50)
    assert "and 1 more" in refused(seed=4, filter__classes=(2,), min_matches=13, buckets__size=40)
    assert "differs in method;" in refused(method="n")
    assert "differs in frames, images, times" in refused(sequence.part(0, 7))
    camera = dataclasses.replace(sequence.camera, f=301.0)
    assert "differs in camera.f;" in refused(dataclasses.replace(sequence, camera=camera))
    for name, words in (
        ("labels/000012.txt", "differs in labels"),
        ("image_0/000012.png", "differs in images"),
    ):
        path = sequence.folder / name
        data = path.read_bytes()
        path.write_bytes(path.with_stem("000011").read_bytes() + b"\n")
        assert words in refused()
        path.write_bytes(data)
    assert "differs in times;" in refused(dataclasses.replace(sequence, times=2 * sequence.times))
    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.identity.code_digest", lambda modules: "changed")
        assert "differs in made_with.code;" in refused()
    # Another name for the same data is the same run.
    assert run_once(folder, dataclasses.replace(sequence, name="x"), boxed(), "m")[1]


def test_folder_with_other_files_needs_fresh(sequence: Sequence, folder: Path) -> None:
    (folder / "notes.md").write_text("mine", encoding="utf-8")
    with pytest.raises(DataError, match=r"other files, such as notes\.md: .*--fresh"):
        run_once(folder, sequence, boxed(), "m")
    run_once(folder, sequence, boxed(), "m", fresh=True)
    assert run_once(folder, sequence, boxed(), "m")[1]
    assert (folder / "notes.md").read_text(encoding="utf-8") == "mine"


def test_run_folder_round_trip(sequence: Sequence, folder: Path) -> None:
    result, _ = run_once(folder, sequence, boxed(), "m")
    back = read_run(folder, sequence)
    assert back.config == result.config
    np.testing.assert_allclose(back.poses, result.poses, atol=1e-9)
    for one, other in zip(back.motions, result.motions, strict=True):
        np.testing.assert_allclose(one.T_cp, other.T_cp, atol=1e-8)
        np.testing.assert_allclose(one.prior_angle, other.prior_angle, atol=1e-4)
    times = timing(result)
    assert sum(times["ms_per_frame_of"].values()) == pytest.approx(times["ms_per_frame"])
    assert back.ms_per_frame == pytest.approx(result.ms_per_frame, abs=0.05)
    with pytest.raises(DataError, match="expected a row for each of the 5 frames of bands"):
        read_run(folder, sequence.part(0, 5))


def test_run_folder_protects_sequences(bands: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="contains images of a sequence"), run_folder(bands):
        pass
    with pytest.raises(DataError, match="empty"), run_folder(""):
        pass
    with pytest.raises(RuntimeError), run_folder(tmp_path / "a" / "b"):
        raise RuntimeError
    assert not (tmp_path / "a").exists()


def test_lock_of_a_killed_process_is_released(sequence: Sequence, folder: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from vo_lib.files import only_process\n"
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
