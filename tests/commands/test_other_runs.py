"""A folder with the runs of other inputs is refused in one line, before anything is detected or matched."""

from __future__ import annotations

import functools
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import HEIGHT, WIDTH, write_bands
from tiny_onnx import write_answering

from vo_lib.commands.cli import main
from vo_lib.detection.network_image import yolox_cells

SMALL = ["--methods", "mesvo_f,feature_selection", "--variant", "published", "--seeds", "1"]
COMMANDS = {
    "reproduce": ["reproduce", *SMALL, "--sequences"],
    "sweep": ["sweep", *SMALL, "--set", "selection.sets=10,20", "--sequence"],
    "run": ["run"],
}
PLACES = ["--out", "out", "--cache", "cache"]


def write_inputs(folder: Path) -> Path:
    """Write a sequence, two detectors of the same kind, a mask and two folders of labels; the sequence."""
    bands = write_bands(folder / "street")
    for name, score in (("a", 0.0), ("b", 0.001)):  # both find nothing, in different files
        answer = np.full((1, 5, yolox_cells(64, 64)), score, np.float32)
        write_answering(folder / f"{name}.onnx", answer, names="['car']")
        (folder / name).mkdir()
        (folder / name / "000002.txt").write_text(f"2 0.5 0.5 0.4 0.{4 if name == 'a' else 5} 0.9\n")
    cv2.imwrite(str(folder / "mask.png"), np.eye(HEIGHT, WIDTH, dtype=np.uint8))
    return bands


@pytest.fixture
def street(tmp_path: Path) -> Path:
    """A sequence beside the other inputs."""
    return write_inputs(tmp_path)


@pytest.fixture(scope="module")
def runs_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Path]:
    """A function of a command and its inputs: the folder with the inputs and the results of the command."""

    @functools.cache
    def folder_of(command: str, inputs: str) -> Path:
        folder = tmp_path_factory.mktemp(command)
        write_inputs(folder)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            assert main([*COMMANDS[command], "street", *PLACES, *inputs.split()]) == 0
        return folder

    return folder_of


def change_images(bands: Path) -> None:
    image = cv2.imread(str(bands / "image_0" / "000002.png"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(bands / "image_0" / "000002.png"), 255 - image)


def change_calibration(bands: Path) -> None:
    path = bands / "calib.txt"
    path.write_text(path.read_text(encoding="utf-8").replace("-150.0", "-160.0"), encoding="utf-8")


def nothing(bands: Path) -> None:
    pass


CHANGES: dict[str, tuple[str, str, Callable[[Path], None]]] = {
    "detector": ("--detector a.onnx", "--detector b.onnx", nothing),
    "detector ": ("", "--detector b.onnx", nothing),
    "detector  ": ("--labels a", "--detector b.onnx", nothing),
    "labels": ("--labels a", "--labels b", nothing),
    "labels ": ("--detector a.onnx", "", nothing),
    "masks": ("", "--masks mask.png", nothing),
    "images": ("--detector a.onnx", "--detector a.onnx", change_images),
    "camera.baseline": ("--detector a.onnx", "--detector a.onnx", change_calibration),
}


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("what", CHANGES)
def test_other_inputs_are_refused_before_the_work(
    runs_of: Callable[[str, str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    what: str,
) -> None:
    first, second, change = CHANGES[what]
    shutil.copytree(runs_of(command, first), tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    words = [*COMMANDS[command], "street", *PLACES]
    before = sorted(str(path) for path in Path("cache").rglob("*"))
    change(tmp_path / "street")
    capsys.readouterr()
    assert main([*words, *second.split()]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert f"in {what.strip()}" in error
    assert "--fresh" in error
    assert "choose another folder" in error
    assert re.match(r"vo: error: (\S*/)?out[:/]", error)
    assert sorted(str(path) for path in Path("cache").rglob("*")) == before
    if what == "detector":  # the same inputs as before are no others
        assert main([*words, *first.split()]) == 0
        assert main([*words, *second.split(), "--fresh"]) == 0
