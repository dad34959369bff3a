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
from vo_lib.geometry.boxes import Boxes, no_boxes
from vo_lib.geometry.result import Flag
from vo_lib.kit.kit_odometry import KitOdometry, SelfCalibratingOdometry
from vo_lib.kit.refined_selection import sample_sets
from vo_lib.paper.odometry import Odometry
from vo_lib.paper.selection import draw_sets
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


# What the odometry of the kit puts in place of the paper's, and what the sections on the kit call it.
REPLACED = {
    "fit_gain": "`fit_gain`",
    "step": "`Rig`",
    "solve": "`other_solutions`",
    "next_prior": "does not become `e_prev`",
    "five_point_sets": "`sample_sets`",
    "select": "`prior_dropped`",
    "rotation": "`refine`",
    "translate": "`robust_start`",
}


def test_sections_on_variant_kit_name_each_step_that_it_replaces() -> None:
    """From the section's heading up to the next topic."""
    sections = ""
    for page in ROOT.glob("notebooks/*.ipynb"):
        whole = "\n".join(texts(page))
        sections += "".join(
            part for part in re.split(r"^(?=###? )", whole, flags=re.M) if part.startswith(SECTION)
        )
    of_paper = vars(Odometry).keys() - {"__init__", "__doc__", "__module__", "__annotations__"}
    replaced = {
        name for kind in (KitOdometry, SelfCalibratingOdometry) for name in vars(kind) if name in of_paper
    }
    assert {name for name in replaced if not name.startswith("__")} == REPLACED.keys()
    assert [name for name, words in REPLACED.items() if words not in sections] == []


def test_a_frame_without_a_motion_repeats_a_standstill_only_as_published() -> None:
    """Chapter 3 says so in its section on the kit."""
    moved = {}
    repeated = {}
    for variant in ("published", "kit"):
        odometry = make_odometry(CAMERA, preset("solution_selection", variant=variant))
        for frame in simulate_tracks(drive(4), CAMERA, TrackConfig(noise=0.1)):
            moved[variant] = odometry.step(frame.matches, no_boxes()).motion.T_cp
        matches = frame.matches
        same = replace(matches, prev_left=matches.cur_left, prev_right=matches.cur_right)
        assert odometry.step(same, no_boxes()).motion.still
        motion = odometry.step(matches[np.arange(5)], no_boxes()).motion
        assert motion.flags == (Flag.FEW_MATCHES,)
        repeated[variant] = motion.T_cp
    np.testing.assert_array_equal(repeated["published"], np.eye(4))
    np.testing.assert_array_equal(repeated["kit"], moved["kit"])


def test_the_kit_uses_all_matches_about_equally_often_in_its_sets() -> None:
    """Chapter 2 says so in its section on the kit, and that as published, some are in no set."""
    uses = {}
    for rule in (draw_sets, sample_sets):
        sets = rule(np.random.default_rng(0), 303, 200)
        assert sets.shape == (200, 5)
        assert all(len(set(chosen)) == 5 for chosen in sets.tolist())
        uses[rule] = np.bincount(sets.ravel(), minlength=303)
    # Each order of 303 matches gives 60 sets, so 200 sets need four orders, of the last one only a part.
    assert uses[sample_sets].min() >= 1
    assert uses[sample_sets].max() <= 4
    assert uses[draw_sets].min() == 0
    assert uses[draw_sets].max() > 4


@pytest.mark.parametrize(("variant", "flag"), [("published", Flag.FEW_MATCHES), ("kit", Flag.FILTER_OFF)])
def test_boxes_over_all_features_leave_them_to_the_kit(variant: str, flag: Flag) -> None:
    """Chapter 5 says so of a frame whose boxes leave too few features."""
    boxes = Boxes(np.array([[0.0, 0.0, CAMERA.width, CAMERA.height]]), np.array([2]), np.ones(1))
    odometry = make_odometry(CAMERA, preset("feature_selection", variant=variant))
    frame = next(simulate_tracks(drive(1), CAMERA, TrackConfig(noise=0.1)))
    result = odometry.step(frame.matches, boxes)
    assert result.motion.flags == (flag,)
    assert result.removal.kept.all() == (variant == "kit")


CHAPTERS = [*(f"ch{number:02}" for number in range(10)), "appendix"]


@pytest.mark.parametrize("package", ["", ".simulation", *(f".{chapter}" for chapter in CHAPTERS)])
def test_the_first_lines_of_a_package_name_its_modules(package: str) -> None:
    module = importlib.import_module(f"course{package}")
    named = set(re.findall(r"`(\w+)`", module.__doc__ or ""))
    modules = {each.name for each in pkgutil.iter_modules(module.__path__)}
    assert modules - set(CHAPTERS) <= named
