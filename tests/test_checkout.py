"""An installed copy of the library, without the folders that lie beside it in a checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vo_lib.checkout import DISTRIBUTION, checkout_folder, missing_folder_text

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `pip install .` copies, and with what pip writes down about the source."""
    folder = tmp_path_factory.mktemp("installed")
    shutil.copytree(ROOT / "vo_lib", folder / "vo_lib", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "data_scripts" / "vo_street", folder / "vo_street")
    about = folder / f"{DISTRIBUTION.replace('-', '_')}-0.1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {DISTRIBUTION}\nVersion: 0.1.0\n")
    (about / "direct_url.json").write_text(json.dumps({"url": (folder / "a kit").as_uri(), "dir_info": {}}))
    (folder / "a kit").mkdir()
    shutil.copy(ROOT / "pyproject.toml", folder / "a kit")
    return folder


def vo(installed: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of the installed copy."""
    environment = os.environ | {"PYTHONPATH": str(installed)}
    environment.pop("KITTI_ROOT", None)
    command = [sys.executable, "-m", "vo_lib", *words]
    environment |= {"XDG_CACHE_HOME": str(installed / "cache"), "XDG_DATA_HOME": str(installed / "data")}
    return subprocess.run(command, cwd=installed, env=environment, capture_output=True, text=True)


@pytest.fixture
def other_copy(installed: Path, tmp_path: Path) -> Path:
    """A copy of the library of which a test changes the surroundings; its source is the same."""
    return shutil.copytree(installed, tmp_path / "copy")


@pytest.mark.parametrize("words", [("lab",), ("data",), ("data", "get_kitti", "--help")])
def test_commands_that_need_the_checkout_name_it_in_one_line(installed: Path, words: tuple[str, ...]) -> None:
    result = vo(installed, *words)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.endswith(f"run `pip install -e .` in {installed / 'a kit'}")


FOREIGN_PROJECTS = {
    "of another name": '[project]\nname = "thesis"\n',
    "without a name": "[tool.ruff]\nline-length = 100\n",
    "without a table": "project = 3\n",
    "with another type": "project = {name = 3}\n",
    "no TOML": "[project\n",
    "of the kit, without folders": '[project]\nname = "Stereo_VO.kit"\n',
}


@pytest.mark.parametrize(
    ("project", "words"),
    [
        ("of another name", ("lab",)),
        ("of another name", ("data", "get_kitti", "--help")),
        *((project, ("data",)) for project in FOREIGN_PROJECTS),
    ],
)
def test_copy_in_the_folder_of_another_project_is_no_checkout(
    project: str, words: tuple[str, ...], installed: Path, other_copy: Path
) -> None:
    (other_copy / "pyproject.toml").write_text(FOREIGN_PROJECTS[project])
    if project != "of the kit, without folders":
        for name in ("notebooks", "data_scripts"):
            (other_copy / name).mkdir()
    result = vo(other_copy, *words)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.endswith(f"run `pip install -e .` in {installed / 'a kit'}")


def test_copy_does_not_name_a_source_folder_that_is_gone(other_copy: Path) -> None:
    (about,) = other_copy.glob("*.dist-info")
    moved = other_copy / "moved"
    (about / "direct_url.json").write_text(json.dumps({"url": moved.as_uri(), "dir_info": {}}))
    expected = f"in the kit's folder (the one with README.md, which is no longer {moved})"
    for content in (None, "another project"):
        if content:
            moved.mkdir()
            (moved / "pyproject.toml").write_text('[project]\nname = "thesis"\n')
        (line,) = vo(other_copy, "data").stderr.splitlines()
        assert line.endswith(expected)


@pytest.mark.parametrize(
    ("words", "command"),
    [
        (("list",), "lists the commands that download them"),
        (("check",), "optional; commands that add data"),
        (("check",), "downloaded detectors: optional"),
        (("check",), "cache: to free space"),
        (("run", "."), "vo data from_folder --left DIR --right DIR"),
        (("run", "bands"), "vo data kitti_to_yolo converts them"),
        (("run", "bands", "--detector", "yolox-tiny"), "use: vo data get_detector yolox-tiny"),
        (("run", "bands", "--detector", "yolov8n.onnx"), "`vo data get_detector yolov8n` says how to get"),
        (("run", "bands", "--detector", "nothing"), "`vo data get_detector` lists more"),
    ],
)
@pytest.mark.slow  # starts many processes
def test_copy_says_in_the_same_place_what_a_command_of_the_kit_needs(
    words: tuple[str, ...], command: str, installed: Path, other_copy: Path, bands: Path
) -> None:
    (other_copy / "image_0").mkdir()
    shutil.copytree(bands, other_copy / "bands")
    (other_copy / "bands" / "labels").mkdir()
    label = "Car 0.00 0 1.57 614 181 727 284 1.57 1.73 4.15 1.00 1.75 13.22 1.62"
    (other_copy / "bands" / "labels" / "000000.txt").write_text(label)
    result = vo(other_copy, *words, *(["--out", "out"] if words[0] == "run" else []))
    printed = " ".join((result.stdout + result.stderr).split())
    after = printed.partition(command)[2]
    assert after, printed
    assert f"(after `pip install -e .` in {installed / 'a kit'})" in after[:300]


def test_installed_copy_looks_for_kitti_in_the_working_folder(installed: Path) -> None:
    sequences = installed / "data" / "kitti" / "sequences"
    result = vo(installed, "list")
    assert result.returncode == 0
    assert "no KITTI sequences in data/kitti" in " ".join(result.stdout.split())
    assert not sequences.exists()


def test_check_says_that_its_commands_need_the_checkout(installed: Path) -> None:
    result = vo(installed, "check")
    printed = " ".join(result.stdout.split())
    assert "vo data get_kitti" in printed
    remedy = f"run `pip install -e .` in {installed / 'a kit'}"
    assert f"do not work here: this copy of the library lacks the folder data_scripts: {remedy}" in printed


@pytest.mark.parametrize("name", ["a kit.whl", "a kit.tar.gz"])
def test_a_copy_from_a_file_is_not_told_to_install_that_file_in_place(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = tmp_path / f"{DISTRIBUTION.replace('-', '_')}-0.1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {DISTRIBUTION}\nVersion: 0.1.0\n")
    origin = {"url": (tmp_path / name).as_uri(), "archive_info": {}}
    (about / "direct_url.json").write_text(json.dumps(origin))
    monkeypatch.syspath_prepend(tmp_path)
    assert missing_folder_text("notebooks").endswith("in the kit's folder (the one with README.md)")


def test_tests_run_in_a_checkout() -> None:
    assert checkout_folder() == ROOT
