"""Data scripts run as `vo data NAME`, or as a file from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from data_command import load

from vo_lib.commands.cli import main
from vo_lib.commands.scripts import scripts

FOLDER = Path(__file__).resolve().parents[2] / "data_scripts"
NAMES = sorted(path.stem for path in FOLDER.glob("[!_]*.py"))


def test_data_lists_all_scripts(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(scripts()) == NAMES
    assert all(scripts().values())
    assert main(["data"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_scripts_have_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert load(name)(["--help"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: vo data {name} ")
    assert f"\n  vo data {name}" in printed.partition("examples:")[2]


def test_script_runs_as_a_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert load("get_kitti")(["--help"]) == 0
    command = [sys.executable, str(FOLDER / "get_kitti.py"), "--help"]
    environ = {**os.environ, "COLUMNS": "80"}
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environ)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.split() == capsys.readouterr().out.split()
    assert list(tmp_path.iterdir()) == []
