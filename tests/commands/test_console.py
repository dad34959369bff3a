"""Progress of long work."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from vo_lib.commands import console


def test_progress_without_a_terminal_is_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for period, lines in ((3600.0, ""), (0.0, "runs: 1 of 2\nruns: 2 of 2\n")):
        monkeypatch.setattr(console, "LOG_PERIOD_S", period)
        with console.reporting("runs") as report:
            report(1, 2)
            report(2, 2)
        assert capsys.readouterr().err == lines


@pytest.mark.skipif(os.name != "posix", reason="a terminal of POSIX")
def test_a_sentence_is_printed_above_the_bar() -> None:
    """In a terminal, the line of the bar is erased before the sentence, and drawn again below it."""
    code = (
        "from vo_lib.commands.console import print_above_bar, reporting\n"
        "with reporting('runs') as report:\n"
        "    report(1, 2)\n"
        "    print_above_bar('The other runs')\n"
    )
    keeper, terminal = os.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    subprocess.run(
        [sys.executable, "-c", code], stdout=terminal, stderr=terminal, env=environment, check=True
    )
    os.close(terminal)
    shown = b""
    while b"\x1b[?25h" not in shown:  # the cursor, hidden for the bar, is shown again
        shown += os.read(keeper, 4096)
    os.close(keeper)
    assert b"\r\x1b[2KThe other runs" in shown
