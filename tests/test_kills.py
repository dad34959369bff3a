"""What survives a kill? Nothing looks finished that is not, and the repeated command gives the same bytes.

A command is killed at a moment that `kill_hook/sitecustomize.py` finds: before a file appears under its name,
or before OpenCV reads or writes an image. Then it is repeated, and compared with a command left in peace.
"""

from __future__ import annotations

import csv
import functools
import io
import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from signal import SIGINT, SIGKILL, SIGTERM, Signals
from typing import Any

import numpy as np
import pytest
from conftest import write_bands
from file_server import FileServer
from tiny_onnx import write_answering

pytestmark = [
    pytest.mark.slow,  # more than fifty commands
    pytest.mark.skipif(sys.platform != "linux", reason="a process with many libraries forks"),
]
TESTS = Path(__file__).parent
# Times of the clock, and the digests of files with such times.
CLOCK = {"timing", "files", "seconds"}
# A folder with one of these looks like a finished run, or like a whole sequence.
MARKS = ("config.json", "times.txt")

RUN = "run ../bands --keep-matches --cache cache --out out"
DRAW = "data render_synthetic empty --layout highway --width 160 --height 64 --length 2 --speed 8 --jobs 1"
DRAW += " --cache scenes"
LABELS = "data write_labels ../bands --model ../model.onnx --out labels"
SWEEP = "sweep --sequence ../bands --method mesvo_f --seeds 1 --set selection.sets=5,6,7 --jobs 2"
SWEEP += " --cache cache --out out"
DOWNLOAD = "data get_kitti --sequences 07 --root kitti --yes --host {host}"
CONTINUES = {LABELS: "; repeat the command to continue"}  # what Ctrl-C answers
# The command, and how often it passes which name until it is killed.
MOMENTS = {
    "matches are stored": (RUN, 1, "*.npz"),
    "in the middle of a run": (RUN, 7, "image"),
    "between two files of a run": (RUN, 1, "*out/metrics.json"),
    "before the config.json of a run": (RUN, 1, "*out/config.json"),
    "a scene is drawn": (DRAW, 6, "image"),
    "labels are detected": (LABELS, 1, "*/000003.txt"),
    # The second of three runs in one of the two processes, so that a finished run is kept.
    "a sweep in two processes": (SWEEP, 2, "*/config.json"),
    "in a download": (DOWNLOAD, 1, "*/image_0/000002.png"),
}
CASES = [
    pytest.param(moment, number, id=f"{moment}, {number.name}")
    for moment in MOMENTS
    for number in (SIGKILL, SIGINT, SIGTERM)
]
# Runs a command in a folder of this name, with KILL_AT; returns the folder, the exit code and the output.
Vo = Callable[..., tuple[Path, int, str]]


@pytest.fixture(scope="module")
def vo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Vo]:
    """Commands on a sequence, with a detector, and with a server of the sequence as KITTI's archives."""
    base = tmp_path_factory.mktemp("kills")
    bands = write_bands(base / "bands")
    answer = np.zeros((1, 5, 84), np.float32)  # 8² + 4² + 2² cells of an image of 64² pixels
    answer[0, :, 0] = 32, 32, 20, 10, 0.9
    write_answering(base / "model.onnx", answer, names="['car']")
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for path in bands.rglob("*.*"):
            archive.write(path, f"dataset/sequences/07/{path.relative_to(bands)}")
        archive.write(bands / "poses.txt", "dataset/poses/07.txt")
    server = FileServer()
    server.files = {f"data_odometry_{kind}.zip": packed.getvalue() for kind in ("gray", "calib", "poses")}
    environ = {**os.environ, "PYTHONPATH": str(TESTS.parent), "XDG_CACHE_HOME": str(base / "user")}
    command, pipe = [sys.executable, str(TESTS / "vo_forks.py")], subprocess.PIPE
    with subprocess.Popen(command, env=environ, stdin=pipe, stdout=pipe, text=True) as forks:

        def run(words: str, name: str, kill_at: str = "") -> tuple[Path, int, str]:
            (base / name).mkdir(exist_ok=True)
            line = json.dumps([words.format(host=server.url).split(), str(base / name), kill_at])
            assert forks.stdin is not None
            assert forks.stdout is not None
            print(line, file=forks.stdin, flush=True)
            code, told = json.loads(forks.stdout.readline())
            return base / name, code, told

        yield run
    server.close()


@pytest.fixture(scope="module")
def undisturbed(vo: Vo) -> Callable[[str], dict[str, Any]]:
    """A function: the results of a command that nobody kills, which runs once."""

    @functools.cache
    def whole(words: str) -> dict[str, Any]:
        folder, code, told = vo(words, f"undisturbed {len(words)}")
        assert code == 0, told
        return results(folder)

    return whole


def results(folder: Path) -> dict[str, Any]:
    """Contents of all files by name; drafts, locks and the user's cache are left out."""
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*.*") if path.is_file()}
    return {name: content(folder / name) for name in names if not re.search(r"^user/|/\.", name)}


def content(path: Path) -> Any:
    """What a file holds, without times of the clock."""
    if path.suffix == ".json":
        return {key: value for key, value in json.loads(path.read_bytes()).items() if key not in CLOCK}
    if path.suffix == ".csv":
        rows = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
        return [[cell for name, cell in row.items() if not name.endswith("_ms")] for row in rows]
    return path.read_bytes()


def require_whole(found: dict[str, Any], expected: dict[str, Any]) -> None:
    """Require that each file of a killed command is whole, and that no file is missing beside a mark."""
    for name, data in found.items():
        if name.endswith(".sha256"):  # a list that grows line by line
            assert expected[name].startswith(data)
            assert data.endswith(b"\n")
        else:
            assert data == expected[name], name
        folder, _, file = name.rpartition("/")
        if file in MARKS:
            assert {other for other in expected if other.startswith(folder + "/")} <= found.keys()


def left_over(folder: Path) -> list[Path]:
    """Drafts and locks."""
    return list(folder.rglob(".*"))


@pytest.mark.parametrize(("moment", "number"), CASES)
def test_a_killed_command_is_repeated_to_the_same_bytes(
    vo: Vo, undisturbed: Callable[[str], dict[str, Any]], moment: str, number: Signals
) -> None:
    words, count, pattern = MOMENTS[moment]
    expected, name = undisturbed(words), f"{moment}, {number.name}"
    folder, code, told = vo(words, name, f"{number.value} {count} {pattern}")
    if number == SIGINT:
        assert code == 130
        assert told.endswith(": interrupted" + CONTINUES.get(words, "") + "\n")
        # A sweep ends its worker processes at once, in the middle of their work.
        assert words == SWEEP or left_over(folder) == []
    else:
        assert code == -number
    found = results(folder)
    require_whole(found, expected)
    assert found.keys() < expected.keys()
    finished = {path: path.stat().st_mtime_ns for path in folder.rglob("config.json")}
    assert bool(finished) == (words == SWEEP)
    _, code, told = vo(words, name)
    assert code == 0, told
    assert results(folder) == expected
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    assert left_over(folder) == []
