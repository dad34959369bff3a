"""The kit's cache folder: what a killed process leaves there, and what `clean_cache` deletes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from data_command import load
from tiny_onnx import write_answering

from vo_lib import open_sequence, preset
from vo_lib.commands.cli import main
from vo_lib.data.drawn import MARKER, ensure_scene
from vo_lib.data.image_hashes import image_hashes
from vo_lib.data.scenes import scene_config
from vo_lib.detection.label_folders import labelled_sequence
from vo_lib.detection.network_image import yolox_cells
from vo_lib.files import only_process
from vo_lib.runs.match_cache import CachedMatches

KIT = "stereo-vo-kit"
TINY = {"width": 160, "height": 64, "length": 2.0, "speed": 8.0}
POSIX = pytest.mark.skipif(os.name != "posix", reason="signals and links of POSIX")


def hidden(folder: Path) -> list[Path]:
    """The drafts in a folder, and their locks."""
    return list(folder.rglob(".*"))


def clean(*words: str | Path) -> int:
    return load("clean_cache")([str(word) for word in words])


@POSIX
@pytest.mark.parametrize("work", ["drawing", "matching"])
@pytest.mark.parametrize("cleans", [False, True], ids=["next call", "clean_cache"])
def test_draft_of_a_killed_process_is_deleted(bands: Path, tmp_path: Path, work: str, cleans: bool) -> None:
    cache = tmp_path / "cache"
    words = ["run", str(bands), "--keep-matches", "--out", str(tmp_path / "out")]
    if work == "drawing":
        settings = [word for name, value in TINY.items() for word in (f"--{name}", str(value))]
        words = ["data", "render_synthetic", "empty", "--jobs", "1", *settings]
    command = [sys.executable, "-m", "vo_lib", *words, "--cache", str(cache)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True) as process:
        while process.poll() is None and not hidden(cache):
            time.sleep(0.001)
        os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL, "the work was done before it could be killed"
    assert hidden(cache)
    if cleans:
        assert clean("--cache", cache) == 0
        assert [path.name for path in (cache / KIT).iterdir()] == [MARKER]
    elif work == "drawing":
        scene = ensure_scene(scene_config("empty", **TINY), cache, jobs=1)
        assert list(scene.parent.iterdir()) == [scene]
    else:
        CachedMatches(open_sequence(bands), preset("feature_selection"), cache).fill()
        assert len(list(cache.rglob("*.npz"))) == 1
    assert not hidden(cache)


def fill(bands: Path, cache: Path | None) -> set[str]:
    """Draw a scene, store matches, detect vehicles; return the kinds of files."""
    ensure_scene(scene_config("empty", **TINY), cache, jobs=1)
    sequence = open_sequence(bands)
    CachedMatches(sequence, preset("feature_selection"), cache).fill()
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    model = write_answering(bands.parent / "blind.onnx", answer, names="['car']")
    labelled_sequence(sequence, model, cache=cache)
    return {"synthetic", "matches", "labels"}


@pytest.mark.parametrize("given", [True, False])
def test_everything_in_the_cache_is_deleted_but_the_detectors(
    given: bool,
    bands: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = tmp_path / "place"
    cache = place / KIT
    words: list[str | Path] = ["--cache", place] if given else []
    if given:
        kinds = fill(bands, place)
    else:
        for name in ("XDG_CACHE_HOME", "XDG_DATA_HOME"):  # detectors are in the user's data folder
            monkeypatch.setenv(name, str(place))
        monkeypatch.setattr("vo_lib.data.image_hashes.cache_folder", lambda: cache)
        kinds = fill(bands, None) | {"hashes"}
        image_hashes(bands, ["image_0/000000.png"])
    assert {path.name for path in cache.iterdir()} == kinds | {MARKER}
    assert {path.name for path in place.iterdir()} == {KIT}
    detector = cache / "detectors" / "mine.onnx"
    detector.parent.mkdir()
    detector.write_bytes(b"weights")
    assert clean(*words) == 0
    printed = capsys.readouterr().out
    assert all(f"{kind}: " in printed for kind in kinds)
    assert "detectors: 7 bytes kept" in printed
    assert "synthetic: 0 bytes" not in printed
    assert {path.name for path in cache.iterdir()} == {MARKER, "detectors"}
    assert detector.read_bytes() == b"weights"
    assert clean(*words) == 0  # nothing more to delete
    assert fill(bands, place if given else None) <= {path.name for path in cache.iterdir()}


@POSIX
def test_a_link_is_deleted_and_what_it_leads_to_stays(bands: Path, tmp_path: Path) -> None:
    fill(bands, tmp_path)
    disk = tmp_path / "other disk"
    (disk / "folder").mkdir(parents=True)
    (disk / "folder" / "file.txt").write_text("mine", encoding="utf-8")
    for folder in (tmp_path / KIT, tmp_path / KIT / "synthetic", next((tmp_path / KIT / "labels").iterdir())):
        (folder / "link").symlink_to(disk, target_is_directory=True)
        (folder / "file").symlink_to(disk / "folder" / "file.txt")
    assert clean("--cache", tmp_path) == 0
    assert [path.name for path in (tmp_path / KIT).iterdir()] == [MARKER]
    assert [path.name for path in disk.rglob("*")] == ["folder", "file.txt"]


@POSIX
def test_a_cache_that_the_kit_has_not_made_is_refused(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other" / KIT / "notes").mkdir(parents=True)  # such as a clone of the kit
    fill(bands, tmp_path / "other")
    fill(bands, tmp_path / "own")
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / KIT).symlink_to(tmp_path / "own" / KIT)
    before = sorted(tmp_path.rglob("*"))
    for name in ("other", "link"):
        assert clean("--cache", tmp_path / name) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{name}/{KIT}: was not made by the kit" in line
    assert sorted(tmp_path.rglob("*")) == before
    assert clean("--cache", tmp_path / "nothing") == 0


@pytest.mark.parametrize("work", ["matching", "detecting"])
def test_nothing_is_deleted_while_a_process_writes(
    work: str, bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(bands, tmp_path)
    (labels,) = (tmp_path / KIT / "labels").iterdir()
    matches = iter(CachedMatches(open_sequence(bands).part(0, 4), preset("feature_selection"), tmp_path))
    held, end = threading.Event(), threading.Event()

    def detect() -> None:
        with only_process(labels):
            held.set()
            end.wait()

    detection = threading.Thread(target=detect)
    if work == "matching":
        next(matches)
    else:
        detection.start()
        held.wait()
    before = sorted(tmp_path.rglob("*"))
    assert clean("--cache", tmp_path) == 2
    assert "another process is writing into it" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before
    if work == "matching":
        assert sum(1 for _ in matches) == 3
    else:
        end.set()
        detection.join()
    assert clean("--cache", tmp_path) == 0


def test_cache_takes_a_folder_and_never_the_sequence(
    bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    for words in (["--cache", str(bands)], ["--cache", "kitti/98"]):
        assert main(["run", *words, "--out", str(tmp_path / "out")]) == 2
        assert f"missing: a sequence (`vo list`); --cache takes a folder, here {words[1]}" in " ".join(
            capsys.readouterr().err.split()
        )
    assert not (tmp_path / "out").exists()
    # The flag for the matches has no value, so the next word is the sequence.
    assert main(["run", "--keep-matches", str(bands), "--out", str(tmp_path / "out")]) == 0
    assert len(list((tmp_path / "user").rglob("*.npz"))) == 1
    assert not list(bands.rglob("*.npz"))
