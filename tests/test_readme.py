"""The Python of the README runs as it stands there, and its commands are understood."""

from __future__ import annotations

import importlib
import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vo_lib
from vo_lib.commands.cli import main, make_parser
from vo_lib.commands.console import OneLineParser
from vo_lib.config import preset
from vo_lib.report.blocks import parse_axis

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


def commands() -> list[str]:
    """The `vo` commands in the README's code, whole ones, in the order in which they appear."""
    text = README.read_text(encoding="utf-8")
    blocks = re.findall(r"```(?:sh|powershell)\n(.*?)```", text, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    lines += [" ".join(code.split()) for code in re.findall(r"`(vo [^`]+)`", prose)]
    found = []
    for line in lines:
        for part in re.split(r"&&|;", line):
            words = part.strip().replace(".venv/bin/vo ", "vo ").replace(".venv\\Scripts\\vo ", "vo ")
            if words.startswith("vo "):
                found.append(words)
    return list(dict.fromkeys(found))


def script_parser(name: str) -> OneLineParser:
    """The parser of a script of `vo data`."""
    parser = OneLineParser()
    importlib.import_module(name).add_options(parser)
    return parser


# What stands for a person's own file or name.
PLACES = {"SEQUENCE": "synthetic/jam", "S": "synthetic/jam", "RUN_OR_FILE": "poses.txt", "…": "other.txt"}


@pytest.mark.parametrize("line", commands())
def test_every_command_is_understood(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The parser takes each command as it stands there; a name of a placeholder is a word like any other."""
    words = [PLACES.get(word, word) for word in shlex.split(line)[1:]]
    if len(words) == 1 or words == ["data", "from_folder"]:
        words.append("--help")
        with pytest.raises(SystemExit) as stop:
            main(words)
        assert stop.value.code == 0
        return
    if words[0] == "data":
        script_parser(words[1]).parse_args(words[2:])
        return
    options = [word for word in words if word.startswith("--")]
    if words[0] == "run" and not any(word == "--out" for word in options):
        words += ["synthetic/jam", "--out", "DIR"]  # an option on its own, named in a sentence
    make_parser(words).parse_args(words)


def test_settings_in_the_readme_exist() -> None:
    for name, values in re.findall(r"--set ([a-z_.]+)=([0-9.,]+)", README.read_text(encoding="utf-8")):
        parse_axis(f"{name}={values}", preset("feature_selection"))
