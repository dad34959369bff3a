"""The promises of the project's own files."""

from __future__ import annotations

import ast
import importlib.metadata as metadata
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_dependencies_are_declared_once() -> None:
    lines = (ROOT / "environment.txt").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if not line.startswith("#")] == ["-e ."]


def test_only_the_library_is_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["setuptools"]["packages"]["find"]["include"] == ["vo_lib*"]


def test_the_workflow_runs_the_commands_of_the_readme() -> None:
    workflow = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    commands = re.findall(
        r"```(?:sh|powershell)\n(.*\.venv.*)\n```", (ROOT / "README.md").read_text(encoding="utf-8")
    )
    assert len(commands) == 4
    assert [command for command in commands if command not in workflow] == []


def test_the_citation_names_the_version_that_is_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"\nversion: {project['version']}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    minor = int(project["requires-python"].removeprefix(">=3."))
    named = [word.rpartition(".")[2] for word in project["classifiers"] if ":: 3." in word]
    assert named == [str(minor + more) for more in range(3)]


# The rooms in the order in which they may build upon each other.
ROOMS = "core method front_end baseline beyond evaluation data detection runs tables commands"
LOOSE = {
    "config": "detection",
    "__init__": "runs",
    "__main__": "commands",
}  # modules beside the rooms, and the last room they need


def imports(path: Path) -> set[str]:
    """Dotted names of what a file imports, at its top or inside a function."""
    own = path.relative_to(ROOT).with_suffix("").parts
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            above = own[: len(own) - node.level] if node.level else ()
            found |= {".".join(filter(None, [*above, node.module, alias.name])) for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def rooms(path: Path) -> set[str]:
    """Rooms (or modules beside them) of vo_lib that a file imports."""
    return {name.split(".")[1] for name in imports(path) if name.startswith("vo_lib.")}


def packages(path: Path) -> set[str]:
    """Names of the packages and modules that a file imports."""
    return {name.split(".")[0] for name in imports(path)}


def test_imports_run_one_way_through_the_rooms() -> None:
    order = {name: number for number, name in enumerate(ROOMS.split())}
    for path in (ROOT / "vo_lib").rglob("*.py"):
        parts = path.relative_to(ROOT / "vo_lib").parts
        room = parts[0] if len(parts) > 1 else LOOSE[path.stem]
        for name in rooms(path):
            assert order[LOOSE.get(name, name)] <= order[room], f"{path.relative_to(ROOT)} imports {name}"


def test_the_method_imports_the_core_alone_and_is_read_at_one_sitting() -> None:
    lines = 0
    for path in (ROOT / "vo_lib" / "method").glob("*.py"):
        assert rooms(path) <= {"core", "method"}, path
        lines += len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= 1300


def test_the_library_imports_neither_the_course_nor_the_data_scripts_nor_pyplot() -> None:
    above = {path.stem for folder in ("data_scripts", "notebooks") for path in (ROOT / folder).iterdir()}
    for path in (ROOT / "vo_lib").rglob("*.py"):
        assert not packages(path) & above, path
        assert not any(name.startswith("matplotlib.pyplot") for name in imports(path)), path


def test_what_is_imported_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    lines = [re.split("[<>=]", line)[0].lower() for group in groups for line in group]
    declared = {name for line in lines for name in re.findall(r"[\w-]+", line)}  # dask[distributed] is two
    makers = metadata.packages_distributions()
    for folder in ("vo_lib", "data_scripts", "notebooks/course"):
        for path in (ROOT / folder).rglob("*.py"):
            used = {maker.lower() for name in packages(path) for maker in makers.get(name, [])}
            assert used - {"stereo-vo-kit"} <= declared, path


def test_three_lines_give_a_trajectory(bands: Path) -> None:
    from vo_lib import open_sequence, preset, run

    result = run(open_sequence(bands), preset("feature_selection"))
    assert result.poses.shape == (6, 4, 4)
