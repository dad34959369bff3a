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
    return folder


def vo(installed: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of the installed copy."""
    environment = os.environ | {"PYTHONPATH": str(installed)}
    environment.pop("KITTI_ROOT", None)
    command = [sys.executable, "-m", "vo_lib", *words]
    return subprocess.run(command, cwd=installed, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("words", [("lab",), ("data",), ("data", "get_kitti", "--help")])
def test_commands_that_need_the_checkout_name_it_in_one_line(installed: Path, words: tuple[str, ...]) -> None:
    result = vo(installed, *words)
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.endswith(f"run `pip install -e .` in {installed / 'a kit'}")


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
