"""`vo demo` on a small drawn scene."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib.commands.cli import main
from vo_lib.config import PUBLISHED
from vo_lib.data.scenes import SCENES, scene_config


@pytest.mark.slow
def test_demo_ends_with_the_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SCENES, "jam", scene_config("jam", length=53.0, speed=25.0, width=480, height=200))
    out = tmp_path / "runs" / "demo"
    assert main(["demo", "--cache", str(tmp_path / "cache"), "--out", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    places = [
        printed.index(words)
        for words in (
            "variant published: sub-sequences",
            "variant published: feature_selection",
            "gains nothing.",
            "report.html",
            "What next: ",
        )
    ]
    assert places == sorted(places)
    assert "vo lab" in printed[places[-1] :][:80]
    assert printed.count("compared with") == 1
    assert "synthetic/jam" in (out / "table1.md").read_text(encoding="utf-8")
    page = (out / "report.html").read_text(encoding="utf-8")
    # The style sheet also names this kind of address, in a selector.
    assert page.count("<img") == page.count('src="data:image/') > 0
    runs = [path.parent for path in sorted(out.rglob("poses.txt"))]
    assert len(runs) == 3 * len(PUBLISHED)
    assert all(len((folder / "poses.txt").read_bytes().splitlines()) >= 10 for folder in runs)
