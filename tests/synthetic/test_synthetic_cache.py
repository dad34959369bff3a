"""The same settings give the same bytes; a damaged cache is noticed."""

from __future__ import annotations

import errno
import shutil
import threading
from pathlib import Path

import pytest
from data_command import load

from street.cache import draw_scene
from vo_lib.core.errors import DataError
from vo_lib.data.drawn import ensure_scene, is_complete, scene_key
from vo_lib.data.scenes import scene_config

TINY = scene_config("empty", width=160, height=64, length=2.0, speed=8.0)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ensure_scene(TINY, tmp_path_factory.mktemp("cache"), jobs=1)


def test_two_processes_draw_the_same_bytes_as_one(drawn: Path, tmp_path: Path) -> None:
    counts: list[tuple[int, int]] = []
    again = ensure_scene(TINY, tmp_path, lambda done, count: counts.append((done, count)), jobs=2)
    assert again.name == drawn.name
    assert contents(again) == contents(drawn)
    assert counts[-1] == (3, 3)


@pytest.mark.parametrize("damage", ["missing", "truncated", "flipped", "no manifest", "bad manifest"])
def test_damage_is_noticed(drawn: Path, tmp_path: Path, damage: str) -> None:
    copy = shutil.copytree(drawn, tmp_path / drawn.name)
    assert is_complete(copy)
    picture = copy / "image_1" / "000001.png"
    data = picture.read_bytes()
    if damage == "missing":
        picture.unlink()
    elif damage == "truncated":
        picture.write_bytes(data[: len(data) // 2])
    elif damage == "flipped":
        picture.write_bytes(data[:200] + bytes([data[200] ^ 1]) + data[201:])
    elif damage == "no manifest":
        (copy / "manifest.json").unlink()
    else:
        (copy / "manifest.json").write_text("[1, 2")
    assert not is_complete(copy)


def test_two_at_once_mend_a_damaged_scene_and_leave_one_good_one(drawn: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(drawn, tmp_path / drawn.name)
    (copy / "image_0" / "000000.png").unlink()
    workers = [threading.Thread(target=ensure_scene, args=(TINY, tmp_path, None, 1)) for _ in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert contents(tmp_path / drawn.name) == contents(drawn)
    assert [p.name for p in tmp_path.iterdir()] == [drawn.name]


def test_every_setting_counts_in_the_key() -> None:
    names = {
        scene_key(scene_config("parked", **change))
        for change in ({}, {"seed": 2}, {"noise": 1.0}, {"width": 400})
    }
    assert len(names) == 4
    assert scene_key(scene_config("parked")).startswith("parked-")


def test_a_cache_that_cannot_be_written_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        ensure_scene(TINY, tmp_path / "file")


def test_a_disk_that_gets_full_is_one_clear_error_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, text: str, **options: str) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(DataError, match="cannot be written: No space"):
        draw_scene(TINY, tmp_path / "cache", jobs=1)
    assert list((tmp_path / "cache").iterdir()) == []


def test_the_script_finds_the_scene_and_refuses_nonsense(
    drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = load("render_synthetic")
    size = ["--width", "160", "--height", "64", "--length", "2", "--speed", "8", "--cache", str(drawn.parent)]
    before = (drawn / "calib.txt").stat().st_mtime_ns
    assert run(["empty", *size]) == 0
    assert capsys.readouterr().out.strip() == str(drawn)
    assert (drawn / "calib.txt").stat().st_mtime_ns == before  # not drawn again
    bad = [["nowhere"], ["empty", "--width", "ten"], ["empty", "--length", "-4"], ["empty", "--jobs", "0"]]
    part = ["empty", *size[:-1], str(tmp_path), "--jobs", "1", "--frames"]
    for words in (*bad, [*part, "2:1"], [*part, "0:4"], [*part[:-1], "--frames=-1:2"]):  # of three
        assert run(words) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
