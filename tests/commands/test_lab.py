"""`vo lab` finds the notebooks, copies them when asked, and says clearly what is missing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from vo_lib import DataError
from vo_lib.commands import lab
from vo_lib.commands.cli import main
from vo_lib.commands.script import Ended, unbroken


def test_the_command_is_a_list_that_opens_the_first_notebook(tmp_path: Path) -> None:
    folder = tmp_path / "a b; c"
    words = lab.command(folder, 8899, browser=True)
    assert words[1:3] == ["-m", "jupyterlab"]
    assert str(folder / "00_start_here.ipynb") in words
    assert "--ServerApp.port=8899" in words
    assert "--no-browser" not in words
    assert lab.command(folder, 8899, browser=False)[-1] == "--no-browser"


def test_a_copy_keeps_what_the_reader_wrote(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / lab.FIRST).write_text("my own answers", encoding="utf-8")
    assert lab.copy_notebooks(lab.NOTEBOOKS, mine) == mine.resolve()
    assert (mine / lab.FIRST).read_text(encoding="utf-8") == "my own answers"
    copied = {path.relative_to(mine) for path in mine.rglob("*.ipynb")}
    there = {path.relative_to(lab.NOTEBOOKS) for path in lab.NOTEBOOKS.rglob("*.ipynb")}
    assert copied == {path for path in there if ".ipynb_checkpoints" not in path.parts}
    assert len(copied) > 2


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(DataError, match="cannot be copied"):
        lab.copy_notebooks(lab.NOTEBOOKS, tmp_path / "file" / "copy")


def test_missing_notebooks_are_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(lab, "NOTEBOOKS", tmp_path / "nowhere")
    assert main(["lab", "--no-browser"]) == 2
    error = capsys.readouterr().err
    assert "00_start_here.ipynb" in error
    assert len(error.splitlines()) == 1


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_who_ends_the_command_ends_the_server() -> None:
    server = "['sh', '-c', 'echo begun; exec sleep 60']"
    code = (
        "import sys; from vo_lib.commands.cli import main; from vo_lib.commands import lab\n"
        f"lab.command = lambda *about: {server}\n"
        "sys.exit(main(['lab']))"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    while process.stdout.readline() != "begun\n":
        assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    # The end of the output means that the server, which holds it too, is gone.
    process.communicate(timeout=30)
    assert process.returncode not in (None, 0)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_what_is_begun_is_ended_before_the_command_is() -> None:
    before, done = signal.getsignal(signal.SIGTERM), []

    def work() -> None:
        with unbroken():
            signal.raise_signal(signal.SIGTERM)
            done.append(True)

    with pytest.raises(Ended):
        work()
    assert done
    assert signal.getsignal(signal.SIGTERM) is before
