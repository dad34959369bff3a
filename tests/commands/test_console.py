"""Progress of long work."""

from __future__ import annotations

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
