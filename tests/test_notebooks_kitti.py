"""The notebooks run on KITTI 00 if it exists."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_notebooks import APPENDICES, CHAPTERS, complaints, execute, name


@pytest.mark.slow
@pytest.mark.usefixtures("street")
@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_chapters_run_on_kitti(path: Path, clips: Path, tmp_path: Path) -> None:
    notebook = execute(path, tmp_path, "kitti/00", KITTI_ROOT=str(clips))
    assert complaints(notebook) == []
