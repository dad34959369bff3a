"""Every data script starts as `vo data NAME` and as a file, from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from data_command import load

from vo_lib.commands.cli import main
from vo_lib.commands.data import scripts

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(path.stem for path in (ROOT / "data_scripts").glob("[!_]*.py"))


def test_the_list_has_a_line_for_each_script(capsys: pytest.CaptureFixture[str]) -> None:
    found = scripts()
    assert list(found) == NAMES
    assert all(found.values())
    assert main(["data"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_script_explains_itself_by_name_and_as_a_file(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert load(name)(["--help"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"usage: vo data {name} ")
    assert f"\n  vo data {name}" in shown.partition("examples:")[2]
    command = [sys.executable, str(ROOT / "data_scripts" / f"{name}.py"), "--help"]
    environ = {**os.environ, "COLUMNS": "80"}
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environ, encoding="utf-8"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "".join(done.stdout.split()) == "".join(shown.split())
    assert list(tmp_path.iterdir()) == []


def test_the_library_reads_no_script_before_one_is_wanted() -> None:
    code = (
        "import sys, vo_lib.commands.cli; sys.exit('from_folder' in sys.modules or 'street' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
