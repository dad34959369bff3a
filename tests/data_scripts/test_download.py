"""One file over HTTP: it appears whole and verified, or not at all, whatever the server does."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer

from fetch import download
from vo_lib.core.errors import DataError
from vo_lib.core.types import Progress

DATA = np.random.default_rng(0).bytes(1_000_000)
SHA256 = hashlib.sha256(DATA).hexdigest()


def get(server: FileServer, path: Path, progress: Progress | None = None) -> None:
    download.download(server.url + "model.onnx", path, len(DATA), SHA256, progress)


@pytest.fixture
def path(tmp_path: Path, server: FileServer) -> Path:
    server.files["model.onnx"] = DATA
    return tmp_path / "new" / "model.onnx"


def test_a_file_comes_whole_with_its_progress(server: FileServer, path: Path) -> None:
    seen: list[tuple[int, int]] = []
    get(server, path, lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == DATA
    assert [p.name for p in path.parent.iterdir()] == ["model.onnx"]
    assert seen[-1] == (len(DATA), len(DATA))
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_a_connection_that_breaks_is_taken_up_where_it_stopped(server: FileServer, path: Path) -> None:
    server.drop_every = 2  # half of the answers stop half-way
    get(server, path)
    assert path.read_bytes() == DATA
    path.unlink()
    server.sent.clear()
    server.drop_every = 1
    while not path.exists():
        with contextlib.suppress(DataError):
            get(server, path)
        assert server.sent["model.onnx"] <= len(DATA)
    assert path.read_bytes() == DATA


def test_the_next_call_goes_on_with_what_is_there(server: FileServer, path: Path) -> None:
    path.parent.mkdir()
    path.with_name("model.onnx.part").write_bytes(DATA[:900_000])
    get(server, path)
    assert path.read_bytes() == DATA
    assert server.sent["model.onnx"] == 100_000


def test_a_server_without_ranges_sends_it_again_from_the_start(server: FileServer, path: Path) -> None:
    server.ranges = False
    path.parent.mkdir()
    path.with_name("model.onnx.part").write_bytes(b"old" * 1000)
    get(server, path)
    assert path.read_bytes() == DATA


def test_a_file_that_is_not_the_one_expected_is_thrown_away(server: FileServer, path: Path) -> None:
    server.files["model.onnx"] = DATA[:-1] + b"x"
    with pytest.raises(DataError, match="not the file expected"):
        get(server, path)
    assert not any(path.parent.iterdir())
    for other in (DATA[:1000], DATA + b"more"):
        server.files["model.onnx"] = other
        with pytest.raises(DataError, match="another file there"):
            get(server, path)
        assert not any(path.parent.iterdir())


def test_what_a_server_refuses_is_said(server: FileServer, path: Path) -> None:
    for status, words in ((404, "does not give this file"), (418, "HTTP 418"), (0, "no connection to 127")):
        server.status = status
        if not status:
            server.close()
        with pytest.raises(DataError, match=words):
            get(server, path)
    assert not path.exists()


def test_a_short_trouble_of_the_server_goes_unnoticed(server: FileServer, path: Path) -> None:
    server.status = 503
    server.after = (3, lambda: setattr(server, "status", 0))
    get(server, path)
    assert path.read_bytes() == DATA


def test_a_disk_without_room_is_said_before_anything_is_written(
    server: FileServer, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = shutil.disk_usage(path.parents[1])._replace(free=download.SPARE + 10)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: free)
    with pytest.raises(DataError, match=r"1\.0 MB and 100\.0 MB to spare, but only 100\.0 MB are free"):
        get(server, path)
    assert server.gets["model.onnx"] == 0


def test_a_disk_that_fills_up_is_said(server: FileServer, path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    path.parent.mkdir()
    path.with_name("model.onnx.part").symlink_to(full)
    with pytest.raises(DataError, match="the disk is full"):
        get(server, path)
    assert not path.exists()
