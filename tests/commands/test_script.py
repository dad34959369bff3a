"""How the command and the scripts end: interrupted, ended, with an output that takes nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from vo_lib.commands.script import guarded


def test_what_the_system_refuses_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def work() -> int:
        (tmp_path / "a" / "b").write_text("x", encoding="utf-8")
        return 0

    assert guarded("x.py", work) == 2
    assert capsys.readouterr().err == f"x.py: error: {tmp_path / 'a' / 'b'}: No such file or directory\n"


def start(code: str, **options: Any) -> subprocess.Popen[str]:
    """A program of its own that does `code` guarded."""
    whole = f"import sys, time\nfrom vo_lib.commands.script import guarded\ndef work():\n {code}\n return 0\n"
    command = [sys.executable, "-c", whole + "sys.exit(guarded('x.py', work))"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, encoding="utf-8", **options)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_program_that_is_to_end_clears_up_first(tmp_path: Path) -> None:
    code = "try: open('begun', 'w').close(); time.sleep(60)\n finally: open('cleared', 'w').close()"
    process = start(code, cwd=tmp_path)
    while not (tmp_path / "begun").exists():
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (130, "x.py: interrupted\n")
    assert (tmp_path / "cleared").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_an_output_that_takes_nothing_is_one_line() -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        process = start("print('much')", stdout=full)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 2
    assert error.startswith("x.py: error: ")
    assert "Traceback" not in error


def test_a_letter_that_the_output_lacks_is_a_question_mark() -> None:
    environ = {**os.environ, "PYTHONIOENCODING": "ascii"}
    process = start("print('3 \\u00d7 4')", stdout=subprocess.PIPE, env=environ)
    assert process.communicate(timeout=60) == ("3 ? 4\n", "")


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
def test_an_output_that_nobody_reads_ends_quietly() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    process = start("print('much ' * 10**6)", stdout=writing)
    os.close(writing)
    assert process.communicate(timeout=60)[1] == ""
    assert process.returncode == 1
