"""The program from its first moment to its last: Ctrl-C while it starts, and output that nobody reads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VO = [sys.executable, "-m", "vo_lib"]
INTERRUPTED = """
import builtins, os, signal, sys
from vo_lib.__main__ import main

def interrupted(name, *details):
    if name == {module!r}:
        os.kill(os.getpid(), signal.SIGINT)
    return read(name, *details)

read, builtins.__import__ = builtins.__import__, interrupted
sys.exit(main())
"""
posix = pytest.mark.skipif(os.name != "posix", reason="signals and file numbers as POSIX has them")


@posix
@pytest.mark.parametrize("module", ["cv2", "rich.console"])
def test_ctrl_c_while_modules_are_read_is_one_line(module: str) -> None:
    code = INTERRUPTED.format(module=module)
    done = subprocess.run([sys.executable, "-c", code, "list"], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr, done.stdout) == (130, "vo: interrupted\n", "")


@posix
def test_nothing_but_the_standard_library_is_read_before_ctrl_c_is_answered() -> None:
    code = "import sys, vo_lib.__main__; print('numpy' in sys.modules, 'vo_lib.core' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "False False\n"


def test_no_commands_help_and_no_tab_waits_for_matplotlib() -> None:
    code = (
        "import sys; from vo_lib.commands.cli import COMMANDS, make_parser\n"
        "for name in COMMANDS: make_parser([name])\n"
        "print([name for name in ('matplotlib', 'jinja2', 'rich.progress') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "[]\n"


@posix
@pytest.mark.parametrize("words", ["list", "run --help", "--version"])
def test_output_that_is_closed_ends_the_program_quietly(words: str) -> None:
    closed = subprocess.run(
        ["sh", "-c", f'"$@" {words} >&-', "sh", *VO], stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    assert (closed.returncode, closed.stderr) == (0, "")
