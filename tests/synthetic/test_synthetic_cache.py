"""Drawn scenes: identical files for the same settings, and reuse from the cache."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from data_command import load

from vo_lib.data.drawn import ensure_scene
from vo_lib.data.scenes import scene_config

TINY = scene_config("empty", width=160, height=64, length=2.0, speed=8.0)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ensure_scene(TINY, tmp_path_factory.mktemp("cache"), jobs=1)


@pytest.mark.slow  # starts many processes
def test_parallel_drawing_gives_the_same_bytes(drawn: Path, tmp_path: Path) -> None:
    """Two callers draw at the same time, one of them in two processes."""
    workers = [threading.Thread(target=ensure_scene, args=(TINY, tmp_path, None, jobs)) for jobs in (1, 2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    (scene,) = (tmp_path / "stereo-vo-kit" / "synthetic").iterdir()
    assert scene.name == drawn.name
    assert contents(scene) == contents(drawn)


def test_render_synthetic_reuses_a_scene_and_refuses_bad_input(
    drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = load("render_synthetic")
    size = ["--width", "160", "--height", "64", "--length", "2", "--speed", "8", "--cache"]
    before = (drawn / "calib.txt").stat().st_mtime_ns
    assert run(["empty", *size, str(drawn.parents[2])]) == 0
    assert capsys.readouterr().out.strip() == str(drawn)
    assert (drawn / "calib.txt").stat().st_mtime_ns == before  # not drawn again
    part = ["empty", *size, str(tmp_path), "--jobs", "1", "--frames"]
    for words in (["nowhere"], ["empty", "--length", "-4"], [*part, "2:1"], [*part, "0:4"]):  # of three
        assert run(words) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
