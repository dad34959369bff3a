"""The main job with nothing downloaded, on small scenes drawn here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from vo_lib import METHODS
from vo_lib.commands.cli import main
from vo_lib.config import VARIANTS
from vo_lib.data.scenes import SCENES, scene_config


@pytest.fixture
def small_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes of the real names, but short and small."""
    for name in ("traffic", "jam"):
        tiny = scene_config(name, length=12.0, width=480, height=200)
        monkeypatch.setitem(SCENES, name, tiny)


@pytest.mark.slow
@pytest.mark.usefixtures("small_scenes")
def test_the_demo_draws_runs_and_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "runs" / "demo"
    arguments = ["demo", "--cache", str(tmp_path / "cache"), "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "What next" in printed
    assert all(method in printed for method in METHODS)
    page = (out / "report.html").read_text(encoding="utf-8")
    # A frame, two pictures of paths, two of errors by length, what was learnt; one speed makes no curve.
    assert page.count("<img") == page.count("data:image/") == 6
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    runs = [path.parent for path in sorted(out.rglob("poses.txt"))]
    assert len(runs) == sum(map(len, VARIANTS.values()))
    for folder in runs:
        poses = (folder / "poses.txt").read_bytes()
        log = (folder / "frames.csv").read_bytes()
        assert len(poses.splitlines()) == len(log.splitlines()) >= 10
