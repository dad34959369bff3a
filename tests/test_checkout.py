"""An installed copy of the library, without the folders that lie beside it in a checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vo_lib.checkout import checkout_folder

ROOT = Path(__file__).resolve().parents[1]
IN_WORDS = "the kit's folder (with README.md)"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `pip install .` copies, and with what pip writes down about the source."""
    folder = tmp_path_factory.mktemp("installed")
    shutil.copytree(ROOT / "vo_lib", folder / "vo_lib", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "data_scripts" / "vo_street", folder / "vo_street")
    for name in ("notebooks", "data_scripts/vo_street"):
        (folder / "a kit" / name).mkdir(parents=True)
    about = folder / "stereo_vo_kit-0.1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: stereo-vo-kit\nVersion: 0.1.0\n")
    # The copy also lies in the folder of a project of somebody else, which has notebooks.
    (folder / "pyproject.toml").write_text('[project]\nname = "thesis"\n')
    (folder / "notebooks").mkdir()
    return folder


def vo(installed: Path, *words: str, source: dict[str, object] | None = None) -> tuple[int, str, str]:
    """Exit code and output of a command of the installed copy; `source` : pip's note on the kit's folder."""
    note = {"url": (installed / "a kit").as_uri(), "dir_info": {}} if source is None else source
    (about,) = installed.glob("*.dist-info")
    (about / "direct_url.json").write_text(json.dumps(note))
    environment = os.environ | {"PYTHONPATH": str(installed), "COLUMNS": "200"}
    environment.pop("KITTI_ROOT", None)
    environment |= {"XDG_CACHE_HOME": str(installed / "cache"), "XDG_DATA_HOME": str(installed / "data")}
    command = [sys.executable, "-m", "vo_lib", *words]
    done = subprocess.run(command, cwd=installed, env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("words", [("lab",), ("data",), ("data", "get_kitti", "--help")])
def test_commands_that_need_the_checkout_name_it_in_one_line(installed: Path, words: tuple[str, ...]) -> None:
    code, _, message = vo(installed, *words)
    assert code == 2
    (line,) = message.splitlines()
    assert line.endswith(f"run `pip install -e .` in {installed / 'a kit'}")


@pytest.mark.parametrize("name", ["a kit, which is gone", "notebooks", "a kit.whl", ""])
def test_a_source_that_is_not_the_kits_folder_is_not_named(installed: Path, name: str) -> None:
    source: dict[str, object] = {"url": (installed / name).as_uri()} if name else {}
    code, _, message = vo(installed, "data", source=source)
    assert code == 2
    (line,) = message.splitlines()
    assert line.endswith(f"run `pip install -e .` in {IN_WORDS}")


def test_installed_copy_looks_for_kitti_in_the_working_folder(installed: Path) -> None:
    code, printed, _ = vo(installed, "list")
    assert code == 0
    assert "no KITTI sequences in data/kitti" in " ".join(printed.split())


def test_tests_run_in_a_checkout() -> None:
    assert checkout_folder() == ROOT
