"""The main job with nothing downloaded, on small scenes drawn here."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib import METHODS
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
    assert all(words in printed for words in ("What next", *METHODS))
    page = (out / "report.html").read_text(encoding="utf-8")
    # A frame, two pictures of paths, two of errors by length, what was learnt; one speed makes no curve.
    assert page.count("<img") == page.count("data:image/") == 6
    runs = [path.parent for path in sorted(out.rglob("poses.txt"))]
    assert len(runs) == sum(map(len, VARIANTS.values()))
    for folder in runs:
        lines = [len((folder / name).read_bytes().splitlines()) for name in ("poses.txt", "frames.csv")]
        assert lines[0] == lines[1] >= 10
