"""The promises of the project's own files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def test_environment_txt_and_pyproject_name_the_same_packages() -> None:
    tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    wanted = [line for line in lines if line and not line.startswith("#")]
    assert wanted == [*declared, "-e ."]


def test_nothing_imports_the_plots_the_panels_or_the_command_but_themselves() -> None:
    outer = {"plots", "detection_plots", "panels", "demo", "cli", "commands"}
    for path in (ROOT / "vo_lib").rglob("*.py"):
        if path.stem in outer or path.parent.name in outer:
            continue
        imported = re.findall(r"^from (?:\.+|vo_lib\.)(\w+)", path.read_text(encoding="utf-8"), re.M)
        assert not set(imported) & outer, path


def test_the_library_never_touches_pyplot() -> None:
    for path in (ROOT / "vo_lib").rglob("*.py"):
        assert "pyplot import" not in path.read_text(encoding="utf-8")
        assert "import matplotlib.pyplot" not in path.read_text(encoding="utf-8")


def test_three_lines_give_a_trajectory(bands: Path) -> None:
    from vo_lib import open_sequence, preset, run

    result = run(open_sequence(bands), preset("feature_selection"))
    assert result.poses.shape == (6, 4, 4)
