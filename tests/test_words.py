"""Terms and names of methods have one spelling in the documentation and in all help texts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from vo_lib.commands.cli import COMMANDS, main
from vo_lib.config import METHODS
from vo_lib.report.table1 import PRINTED_NAMES

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*ROOT.glob("*.md"), *ROOT.glob("data_scripts/*.md"), *ROOT.glob("vo_lib/**/*.md")]
METHOD = re.compile(
    r"\b(?:(?:feature|solution|moving)[ _-]?selection|viso[ _-]?2|mesvo[ _-]?f)\b", re.IGNORECASE
)
# The paper's names for numbers of the paper, and the names of the techniques in running text.
SPELLINGS = {*METHODS, *PRINTED_NAMES.values(), "feature selection", "solution selection"}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_documents_spell_methods_consistently(path: Path) -> None:
    assert set(METHOD.findall(path.read_text(encoding="utf-8"))) <= SPELLINGS


@pytest.mark.parametrize("command", [*COMMANDS, "run --help-settings"])
def test_help_texts_spell_methods_consistently(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    if " " in command:
        main(command.split())
    else:
        with pytest.raises(SystemExit):
            main([command, "--help"])
    assert set(METHOD.findall(capsys.readouterr().out)) <= SPELLINGS
