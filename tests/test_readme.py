"""The Python of the README runs as it stands there."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vo_lib

README = Path(__file__).resolve().parents[1] / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def run_block(block: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names of a block after it ran on a short sequence instead of the whole street."""
    short = vo_lib.open_sequence(folder)
    monkeypatch.setattr(vo_lib, "open_sequence", lambda name: short, raising=False)
    script = folder.parent / "block.py"
    script.write_text(block, encoding="utf-8")
    return runpy.run_path(str(script))


def test_a_run_and_its_loop_written_out_give_the_same_motions(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, loop = BLOCKS
    motions = run_block(whole, bands, monkeypatch)["result"].motions
    last = run_block(loop, bands, monkeypatch)
    assert last["frame"].index == len(motions) == 5
    np.testing.assert_array_equal(last["motion"].T_cp, motions[-1].T_cp)
    assert len(capsys.readouterr().out.splitlines()) == 4 * len(motions)
