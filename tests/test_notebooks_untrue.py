"""The notebooks run on another sequence: a short drive without truth."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from test_notebooks import APPENDICES, CHAPTERS, complaints, execute, name

from vo_lib.data.sequence import Sequence

UNTRUE_FRAMES = 54  # length of the shortest drive in the notebooks


@pytest.fixture(scope="module")
def untrue(street: Sequence, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first frames of the drawn street, without true poses and depth."""
    folder = tmp_path_factory.mktemp("untrue") / "street"
    late = [f"{number:06d}.*" for number in range(UNTRUE_FRAMES, len(street))]
    shutil.copytree(street.folder, folder, ignore=shutil.ignore_patterns("poses.txt", "truth", *late))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_chapters_run_without_truth(path: Path, untrue: Path, tmp_path: Path) -> None:
    notebook = execute(path, tmp_path, str(untrue), KITTI_ROOT="")
    assert complaints(notebook) == []
