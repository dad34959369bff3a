"""What the texts of the notebooks name in the code exists there: files, functions, settings and flags."""

from __future__ import annotations

import ast
import importlib
import json
import pkgutil
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from course.simulation.drives import CAMERA, drive
from course.simulation.tracks import TrackConfig, simulate_tracks
from vo_lib.config import preset
from vo_lib.geometry.boxes import no_boxes
from vo_lib.geometry.result import Flag
from vo_lib.runs.drive import make_odometry

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("notebooks/*.md"), ROOT / "README.md"])
SECTION = "### Differences in variant `kit`"
CONFIGS = (preset("feature_selection"), preset("feature_selection", variant="kit"), preset("viso2"))
GROUPS = {group.name for config in CONFIGS for group in fields(config)}


def texts(page: Path) -> list[str]:
    """The text of a page, or of each text cell of a notebook."""
    if page.suffix == ".md":
        return [page.read_text(encoding="utf-8")]
    cells = json.loads(page.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]


def defined_names(module: Path) -> set[str]:
    """Names of the functions, classes, methods and values that a module defines."""
    names = set[str]()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


def has_setting(name: str) -> bool:
    """Whether a method of one of the variants has a setting such as "selection.sets"."""
    group, setting = name.split(".")
    groups = [getattr(config, group) for config in CONFIGS if hasattr(config, group)]
    return any(hasattr(each, setting) for each in groups)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_files_functions_and_settings_exist(page: Path) -> None:
    for text in texts(page):
        for file in re.findall(r"`(vo_lib/[\w/]+\.py)`", text):
            assert (ROOT / file).is_file(), file
        for name, file in re.findall(r"`(\w+)` in `(vo_lib/[\w/]+\.py)`", text):
            assert name in defined_names(ROOT / file), f"{name} in {file}"
        for name in re.findall(r"`(?:--)?([a-z]+\.[a-z_]+)(?: [^`]*)?`", text):
            if name.split(".")[0] in GROUPS and not name.endswith(".py"):
                assert has_setting(name), name


def test_sections_on_variant_kit_name_its_files_and_flags() -> None:
    sections = [text for page in PAGES for text in texts(page) if text.startswith(SECTION)]
    assert len(sections) == 5  # chapters 1, 2 and 3, and two in chapter 4
    kit_files = {path.name for path in (ROOT / "vo_lib" / "kit").glob("*.py")}
    for text in sections:
        assert set(re.findall(r"`(\w+\.py)`", text)) <= kit_files
    chapter_3 = "".join(texts(ROOT / "notebooks" / "03_solution_selection.ipynb"))
    flags = {flag.value for flag in Flag}
    assert set(re.findall(r"frame `(\w+)`", chapter_3)) == {"prior_dropped", "contradicts_stereo"} <= flags


@pytest.mark.parametrize("variant", ["published", "kit"])
def test_at_a_standstill_both_variants_return_no_motion_and_keep_the_vector(variant: str) -> None:
    """Chapter 3 says so at the end of its section on the kit."""
    odometry = make_odometry(CAMERA, preset("solution_selection", variant=variant))
    for frame in simulate_tracks(drive(4), CAMERA, TrackConfig(noise=0.1)):
        moved = odometry.step(frame.matches, no_boxes()).motion
    assert np.linalg.norm(moved.T_cp[:3, 3]) > 0.5
    before = odometry.e_prev
    matches = frame.matches
    same = replace(
        matches,
        prev_left=matches.cur_left,
        prev_right=matches.cur_right,
        age=matches.age + 1,
    )
    rest = odometry.step(same, no_boxes()).motion
    assert rest.flags == (Flag.STANDSTILL,)
    np.testing.assert_array_equal(rest.T_cp, np.eye(4))
    assert before is not None
    np.testing.assert_array_equal(odometry.e_prev, before)


CHAPTERS = [*(f"ch{number:02}" for number in range(10)), "appendix"]


@pytest.mark.parametrize("package", ["", ".simulation", *(f".{chapter}" for chapter in CHAPTERS)])
def test_the_first_lines_of_a_package_name_its_modules(package: str) -> None:
    module = importlib.import_module(f"course{package}")
    named = set(re.findall(r"`(\w+)`", module.__doc__ or ""))
    modules = {each.name for each in pkgutil.iter_modules(module.__path__)}
    assert modules - set(CHAPTERS) <= named
