"""Download of one file over HTTP: the file is complete and verified, or is not written."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer

from fetch import download
from vo_lib.errors import DataError
from vo_lib.geometry.types import Progress

DATA = np.random.default_rng(0).bytes(1_000_000)
SHA256 = hashlib.sha256(DATA).hexdigest()


def get(server: FileServer, path: Path, progress: Progress | None = None) -> None:
    download.download(server.url + "model.onnx", path, len(DATA), SHA256, progress)


@pytest.fixture
def path(tmp_path: Path, server: FileServer) -> Path:
    server.files["model.onnx"] = DATA
    return tmp_path / "new" / "model.onnx"


def test_download_reports_progress(server: FileServer, path: Path) -> None:
    reports: list[tuple[int, int]] = []
    get(server, path, lambda done, total: reports.append((done, total)))
    assert path.read_bytes() == DATA
    assert [p.name for p in path.parent.iterdir()] == ["model.onnx"]
    assert reports[-1] == (len(DATA), len(DATA))
    assert reports == sorted(reports)


def test_download_refuses_another_file(server: FileServer, path: Path) -> None:
    for other in (DATA[:-1] + b"x", DATA + b"more"):
        server.files["model.onnx"] = other
        with pytest.raises(DataError, match="unexpected file"):
            get(server, path)
        assert not path.exists()


def test_server_errors_are_one_line(server: FileServer, path: Path) -> None:
    server.status = 404
    with pytest.raises(DataError, match="HTTP 404"):
        get(server, path)
    server.status = 0
    server.drop_every = 1
    with pytest.raises(DataError, match="connection"):
        get(server, path)
    server.close()
    with pytest.raises(DataError, match="no connection to 127"):
        get(server, path)
