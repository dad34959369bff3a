"""The main job with nothing downloaded, on a small scene drawn here."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib.commands.cli import main
from vo_lib.config import VARIANTS
from vo_lib.data.scenes import SCENES, scene_config


@pytest.mark.slow
def test_the_demo_draws_runs_and_reports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SCENES, "traffic", scene_config("traffic", length=12.0, width=480, height=200))
    out = tmp_path / "runs" / "demo"
    assert main(["demo", "--cache", str(tmp_path / "cache"), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert (
        printed.index("the paper as published") < printed.index("the kit's way") < printed.index("What next")
    )
    assert "synthetic/traffic TE %" in (out / "table1.md").read_text(encoding="utf-8")
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == page.count("data:image/") == 2
    runs = [path.parent for path in sorted(out.rglob("poses.txt"))]
    assert len(runs) == sum(map(len, VARIANTS.values()))
    assert all(len((folder / "poses.txt").read_bytes().splitlines()) >= 10 for folder in runs)
