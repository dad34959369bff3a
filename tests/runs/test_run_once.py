"""Run folders: restart after an interruption, errors for folders of other runs, and locks."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from conftest import small, with_box, write_bands

from vo_lib import DataError, Sequence, open_sequence, run
from vo_lib.commands.cli import main
from vo_lib.data.poses import format_kitti_poses
from vo_lib.files import only_process
from vo_lib.kit.settings import KitConfig
from vo_lib.runs.folder import RUN_FILES, changed_files, is_finished, read_run, run_folder, timing, write_run
from vo_lib.runs.identity import run_identity
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


# Runs a method in a folder, and kills itself when it has replaced a number of files.
KILLED_WHILE_WRITING = """
import os, signal, sys
from pathlib import Path
from conftest import small
from vo_lib import open_sequence
from vo_lib.runs.jobs import run_once
replace, left = os.replace, iter(range(int(sys.argv[3])))
def stopping(draft, path):
    if Path(path).parent == Path(sys.argv[1]) and next(left, None) is None:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(draft, path)
os.replace = stopping
config = small("feature_selection", filter__min_matches=10, selection__sets=20)
run_once(Path(sys.argv[1]), open_sequence(sys.argv[2]).part(0, 4), config, "m", fresh=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("written", [0, 1, 6])
def test_run_killed_while_it_replaces_another_is_repeated(
    sequence: Sequence, folder: Path, written: int
) -> None:
    sequence = sequence.part(0, 4)
    run_once(folder, sequence, boxed(seed=1), "m")
    old = {path.name: path.read_bytes() for path in folder.iterdir()}
    code = [sys.executable, "-c", KILLED_WHILE_WRITING, str(folder), str(sequence.folder), str(written)]
    environ = {**os.environ, "XDG_CACHE_HOME": str(folder.parent / "cache")}
    killed = subprocess.run(code, cwd=Path(__file__).parents[1], env=environ, check=False)
    assert killed.returncode == (0 if written == 6 else -signal.SIGKILL)  # config.json is the last of six
    if written == 0:
        assert {name: (folder / name).read_bytes() for name in old} == old
    assert is_finished(folder)
    # The repetition is not taken for the other run.
    fresh = written < 6
    assert bool(changed_files(folder)) == (0 < written < 6)
    with suppress(Stopped):  # a second interruption, of another kind
        run_once(folder, sequence, boxed(), "m", fresh=fresh, progress=stop_at(2))
    assert run_once(folder, sequence, boxed(), "m", fresh=fresh)[1] == (written == 6)
    require_same(folder, sequence)
    assert {path.name for path in folder.iterdir()} <= set(RUN_FILES)


@pytest.mark.parametrize("room", [0, 3])  # for no file, and for all but the largest ones
def test_full_disk_keeps_the_run_before(sequence: Sequence, folder: Path, room: int) -> None:
    resource = pytest.importorskip("resource")
    run_once(folder, sequence, boxed(seed=1), "m")
    old = {path.name: path.read_bytes() for path in folder.iterdir()}
    sizes = sorted(len(content) for content in old.values())
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    result = run(sequence, boxed())
    identity = run_identity(sequence, boxed(), "m")
    # A larger file than this cannot be written, as on a full disk.
    resource.setrlimit(resource.RLIMIT_FSIZE, (sizes[room] - 1, before[1]))
    try:
        with pytest.raises(DataError, match="cannot be written: File too large"):
            write_run(folder, result, identity)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == old
    assert run_once(folder, sequence, boxed(seed=1), "m")[1]


DAMAGE: dict[str, Callable[[bytes], bytes | None]] = {
    "cut": lambda data: data[:-5],
    "digit": lambda data: data.replace(b"1", b"2", 1),
    "empty": lambda data: b"",
    "longer": lambda data: data + data[-40:],
    "missing": lambda data: None,
}


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *(("poses.txt", damage) for damage in DAMAGE),
        ("frames.csv", "cut"),
        ("metrics.json", "digit"),
        ("poses_tum.txt", "longer"),
        ("calibration.json", "missing"),
    ],
)
def test_run_with_a_changed_file_is_computed_again(
    sequence: Sequence, folder: Path, name: str, damage: str
) -> None:
    sequence = sequence.part(0, 4)
    run_once(folder, sequence, boxed(), "m")
    timed = {"frames.csv", "config.json", "metrics.json"}  # these have times of computation
    whole = {path.name: path.read_bytes() for path in folder.iterdir() if path.name not in timed}
    content = DAMAGE[damage]((folder / name).read_bytes())
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(content)
    assert changed_files(folder) == [name]
    with pytest.raises(DataError, match=f"{name}: is missing or is not as the run wrote it"):
        read_run(folder, sequence)
    assert not run_once(folder, sequence, boxed(), "m")[1]
    assert {name: (folder / name).read_bytes() for name in whole} == whole
    assert run_once(folder, sequence, boxed(), "m")[1]


@pytest.mark.parametrize("name", RUN_FILES)
@pytest.mark.parametrize("fresh", [False, True])
def test_files_of_somebody_else_are_never_replaced(
    sequence: Sequence, folder: Path, name: str, fresh: bool
) -> None:
    (folder / name).write_text('{"settings": {}}', encoding="utf-8")
    with pytest.raises(DataError, match=f"run/{name}: is not the kit's file: choose another folder"):
        run_once(folder, sequence, boxed(), "m", fresh=fresh)
    assert [path.name for path in folder.iterdir()] == [name]
    assert (folder / name).read_text(encoding="utf-8") == '{"settings": {}}'


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
    assert "and 1 more" in refused(seed=4, filter__classes=("car",), min_matches=13, buckets__size=40)
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


def test_folder_with_other_files_needs_fresh(
    sequence: Sequence, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "notes.md").write_text("mine", encoding="utf-8")
    with pytest.raises(DataError, match=r"other files, such as notes\.md: choose another folder, or"):
        run_once(folder, sequence, boxed(), "m")
    words = ["run", str(sequence.folder), "--out", str(folder)]
    assert main(words) == 2
    assert "choose another folder, or add --fresh" in capsys.readouterr().err
    run_once(folder, sequence, boxed(), "m", fresh=True)
    assert run_once(folder, sequence, boxed(), "m")[1]
    assert (folder / "notes.md").read_text(encoding="utf-8") == "mine"


def test_a_run_survives_a_round_trip_through_its_folder(sequence: Sequence, folder: Path) -> None:
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
    with pytest.raises(
        DataError, match=r"poses.txt: expected a pose for each of the 5 frames of bands, found 14"
    ):
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
