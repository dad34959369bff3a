"""Data scripts run as `vo data NAME`."""

from __future__ import annotations

from pathlib import Path

import pytest
from data_command import load

from vo_lib.commands.cli import main
from vo_lib.commands.data_scripts import scripts

FOLDER = Path(__file__).resolve().parents[2] / "data_scripts"
NAMES = sorted(path.stem for path in FOLDER.glob("[!_]*.py"))


def test_data_lists_all_scripts(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(scripts()) == NAMES
    assert all(scripts().values())
    assert main(["data"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_scripts_have_help_of_80_columns_with_an_example(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert load(name)(["--help"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: vo data {name} ")
    assert f"\n  vo data {name}" in printed.partition("examples:")[2]
    # A path of this machine may be longer; it is never broken.
    assert [line for line in printed.splitlines() if len(line) > 80 and "/" not in line] == []
