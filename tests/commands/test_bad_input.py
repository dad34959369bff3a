"""Invalid input to any command gives a one-line error and exit code 2 before any work."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import write_bands
from file_readers import expanded

from vo_lib.commands.cli import main

# A command line and a part of the error; words in capitals are names of paths, <9*50> is 50 nines.
CASES = json.loads((Path(__file__).parent / "bad_input.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Paths of inputs by name: images, poses, settings, three unusable masks, a link to itself."""
    bands = write_bands(tmp_path_factory.mktemp("bad") / "bands")
    config = {"method": "mesvo_f", "variant": "published", "settings": {}}
    (bands / "config.json").write_text(json.dumps(config), encoding="utf-8")
    (bands / "number.json").write_text(json.dumps(config | {"frames": 5}), encoding="utf-8")
    (bands / "list.json").write_text(json.dumps(config | {"method": ["mesvo_f"]}), encoding="utf-8")
    (bands / "unknown.json").write_text(json.dumps(config | {"method": "mesvo"}), encoding="utf-8")
    nameless = {"variant": "published", "settings": {}}
    (bands / "nameless.json").write_text(json.dumps(nameless), encoding="utf-8")
    os.mkfifo(bands / "fifo")
    (bands / "loop").symlink_to(bands / "loop")
    cv2.imwrite(str(bands / "mask.png"), np.zeros((120, 480), np.uint8))
    cv2.imwrite(str(bands / "empty.jpg"), np.zeros((240, 480), np.uint8))
    (bands / "seven.txt").write_text("0 0 0 0 0 0 1\n", encoding="utf-8")
    paths = {
        "MASK": bands / "mask.png",
        "JPEG": bands / "empty.jpg",
        "SEVEN": bands / "seven.txt",
        "BANDS": bands,
        "LEFT": bands / "image_0",
        "RIGHT": bands / "image_1",
        "POSES": bands / "poses.txt",
        "OUT": bands / "out",
        "FIFO": bands / "fifo",
        "NUMBER": bands / "number.json",
        "LIST": bands / "list.json",
        "UNKNOWN": bands / "unknown.json",
        "NAMELESS": bands / "nameless.json",
    }
    paths |= {"CONFIG": bands / "config.json", "LOOP/x": bands / "loop" / "x"}
    return {name: str(path) for name, path in paths.items()}


@pytest.mark.parametrize(("line", "expected"), CASES, ids=[line[:60] for line, _ in CASES])
def test_bad_input_gives_one_line_and_exit_code_2(
    places: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    line: str,
    expected: str,
) -> None:
    monkeypatch.setenv("KITTI_ROOT", places["LEFT"])  # no KITTI there, as no command here needs
    try:
        code = main([places.get(word, expanded(word)) for word in shlex.split(line)])
    except SystemExit as stop:
        code = int(str(stop.code))
    error = capsys.readouterr().err
    assert code == 2
    assert expected in error
    assert len(error.splitlines()) == 1
    # A long word loses its middle, but not the path of a file.
    assert max(map(len, error.split())) <= 120 or "File name too long" in error
    assert not Path(places["OUT"]).exists()
