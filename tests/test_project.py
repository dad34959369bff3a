"""Consistency of the project's files and imports."""

from __future__ import annotations

import ast
import functools
import graphlib
import importlib.metadata as metadata
import json
import re
import shlex
import tomllib
from collections import defaultdict
from pathlib import Path

from packaging.requirements import Requirement

from vo_lib.commands.cli import make_parser

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = ROOT / "vo_lib"
COURSE = ROOT / "notebooks" / "course"
SCRIPTS = ROOT / "data_scripts"


def test_measured_versions_are_within_the_ranges() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (ROOT / ".ci" / "versions.txt").read_text(encoding="utf-8").splitlines()[1:]
    versions = dict(line.split("==") for line in lines)
    for line in project["dependencies"]:
        requirement = Requirement(line)
        assert requirement.specifier.contains(versions[requirement.name]), line
    measured = (ROOT / "notebooks" / "results.md").read_text(encoding="utf-8")
    assert f"numpy {versions['numpy']}, OpenCV {versions['opencv-python-headless'][:5]}" in measured


def test_container_starts_the_course() -> None:
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    program, *words = shlex.split(container["postAttachCommand"])
    options = make_parser(words).parse_args(words)
    assert (program, options.command.__module__) == ("vo", "vo_lib.commands.lab")


def test_workflow_runs_the_readme_commands() -> None:
    workflow = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    commands = re.findall(
        r"```(?:sh|powershell)\n(.* -m venv .*)\n```", (ROOT / "README.md").read_text(encoding="utf-8")
    )
    assert len(commands) == 4
    assert [command for command in commands if command not in workflow] == []


def test_citation_has_the_installed_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"\nversion: {project['version']}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    minor = int(project["requires-python"].removeprefix(">=3."))
    named = [word.rpartition(".")[2] for word in project["classifiers"] if ":: 3." in word]
    assert named == [str(minor + more) for more in range(3)]


# Packages (or single modules) that each package may import.
BASE = {"errors", "settings", "files", "parallel", "checkout", "geometry"}
ABOVE_DATA = BASE | {"paper", "data", "evaluation"}
MAY_IMPORT: dict[str, set[str]] = {
    "geometry": {"errors", "settings", "files"},
    "paper": BASE,
    "kit": BASE | {"paper"},
    "evaluation": BASE,
    "data": BASE,
    "detection": BASE | {"data"},
    "config": BASE | {"paper", "kit"},
    "loops": BASE | {"paper", "data"},
    "runs": ABOVE_DATA | {"kit", "config"},
    "report": ABOVE_DATA | {"kit", "config", "detection", "runs"},
    "commands": ABOVE_DATA | {"kit", "config", "detection", "loops", "runs", "report"},
    "__init__": ABOVE_DATA | {"config", "runs"},
    "__main__": {"commands"},
    "errors": set(),
    "settings": {"errors"},
    "files": {"errors"},
    "parallel": set(),
    "checkout": {"errors"},
}


@functools.cache
def imports(path: Path) -> frozenset[str]:
    """Dotted names of all imports in a file, at the top level or inside a function."""
    own = path.relative_to(ROOT).with_suffix("").parts
    result: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            above = own[: len(own) - node.level] if node.level else ()
            result |= {".".join(filter(None, [*above, node.module, alias.name])) for alias in node.names}
        elif isinstance(node, ast.Import):
            result |= {alias.name for alias in node.names}
    return frozenset(result)


def imported_packages(path: Path) -> set[str]:
    """Packages and single modules of vo_lib that a file imports."""
    return {name.split(".")[1] for name in imports(path) if name.startswith("vo_lib.")}


def packages(path: Path) -> set[str]:
    """Names of the packages and modules that a file imports."""
    return {name.split(".")[0] for name in imports(path)}


def package_of(path: Path) -> str:
    """The package of a file in vo_lib, or the name of a single module."""
    parts = path.relative_to(ROOT / "vo_lib").with_suffix("").parts
    return parts[0]


def test_packages_import_only_packages_above_them() -> None:
    for path in (ROOT / "vo_lib").rglob("*.py"):
        package = package_of(path)
        assert imported_packages(path) - {package} <= MAY_IMPORT[package], path.relative_to(ROOT)


def test_renderer_imports_little_of_the_library() -> None:
    for path in (ROOT / "data_scripts" / "vo_street").glob("*.py"):
        assert imported_packages(path) <= BASE | {"data"}, path


# Modules of the library that call the renderer. It reads the library's settings of scenes, so they import it
# inside the functions that need it.
CALLS_RENDERER = {"data/drawn.py": "draws a scene that is missing, and counts the frames of its route"}


def test_the_library_reaches_the_renderer_only_through_drawn_scenes() -> None:
    callers = [path for path in LIBRARY.rglob("*.py") if "vo_street" in packages(path)]
    assert {path.relative_to(LIBRARY).as_posix() for path in callers} == CALLS_RENDERER.keys()


# Outside the library: the packages of the data scripts that each of them may import; of the course, none.
SCRIPT_PACKAGES: dict[str, set[str]] = {
    "vo_street": set(),
    "fetch": set(),
    "measure": set(),
    "training": {"vo_street"},
}
# Scripts that import the course, inside a function.
IMPORTS_COURSE = {"measure_miniature.py": "trains the network that the cells of chapter 5 define"}


def test_packages_of_the_data_scripts_import_neither_scripts_nor_the_course() -> None:
    scripts = {path.stem for path in SCRIPTS.glob("*.py")}
    folders = {path.parent.relative_to(SCRIPTS).parts[0] for path in SCRIPTS.glob("*/*.py")}
    assert folders == SCRIPT_PACKAGES.keys()
    for package, allowed in SCRIPT_PACKAGES.items():
        others = (SCRIPT_PACKAGES.keys() | scripts | {"course"}) - allowed - {package}
        for path in (SCRIPTS / package).rglob("*.py"):
            assert not packages(path) & others, path.relative_to(ROOT)


def test_one_script_imports_the_course_which_imports_only_the_renderer() -> None:
    callers = {path.name for path in SCRIPTS.glob("*.py") if "course" in packages(path)}
    assert callers == IMPORTS_COURSE.keys()
    others = {path.stem for path in SCRIPTS.iterdir()} - {"vo_street"}
    for path in COURSE.rglob("*.py"):
        assert not packages(path) & others, path.relative_to(ROOT)


# Files that import a module whose name is a value, so that no other test here sees what they import.
IMPORTS_BY_NAME = {
    "vo_lib/__init__.py": "the names that `import vo_lib` offers, each from its module in the library",
    "vo_lib/commands/cli.py": "the command that was typed",
    "vo_lib/commands/data_scripts.py": "the script of `vo data NAME`",
    "notebooks/course/tasks.py": "the exercises of each chapter, for handing in and marking",
}


def test_imports_by_name_are_known() -> None:
    found = set()
    for folder in (LIBRARY, COURSE, SCRIPTS):
        for path in folder.rglob("*.py"):
            if re.search(r"\bimport_module\(|\b__import__\(", path.read_text(encoding="utf-8")):
                found.add(path.relative_to(ROOT).as_posix())
    assert found == IMPORTS_BY_NAME.keys()


def modules_by_name() -> dict[str, Path]:
    """All modules of the library, the course and the data scripts, by the names of their imports."""
    result = {}
    for place, folder in ((ROOT, LIBRARY), (COURSE.parent, COURSE), (SCRIPTS, SCRIPTS)):
        for path in folder.rglob("*.py"):
            parts = path.relative_to(place).with_suffix("").parts
            result[".".join(parts).removesuffix(".__init__")] = path
    return result


def test_no_module_imports_itself_in_a_circle() -> None:
    """Imports inside functions count, too; those by name do not."""
    modules = modules_by_name()
    graph: dict[str, set[str]] = {}
    for own, path in modules.items():
        graph[own] = set()
        for name in imports(path):
            whole = name.removeprefix("notebooks.").removeprefix("data_scripts.")  # of relative imports
            module = whole if whole in modules else whole.rpartition(".")[0]
            if module in modules and module != own:
                graph[own].add(module)
    assert "course.panel" in graph["course.ch05.panel"]
    assert "vo_street.cache" in graph["vo_lib.data.drawn"]
    list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, with the circle


def test_packages_of_the_course_do_not_import_each_other_in_a_circle() -> None:
    """A chapter imports what all share, and this imports the simulation, which imports neither."""
    modules = modules_by_name()
    graph: dict[str, set[str]] = {}
    for own, path in modules.items():
        if path.is_relative_to(COURSE):
            package = course_package(own)
            names = {name.removeprefix("notebooks.") for name in imports(path)}
            imported = {course_package(name) for name in names if name.split(".")[0] == "course"}
            graph.setdefault(package, set()).update(imported - {package})
    assert "course.simulation" in graph["course"]
    assert graph["course.simulation"] == set()
    list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, with the circle


def course_package(name: str) -> str:
    """The package of a module of the course or of a name in one: a folder, or `course`, which all share."""
    folder = COURSE.joinpath(*name.split(".")[1:2])
    return f"course.{folder.name}" if folder != COURSE and folder.is_dir() else "course"


# Names that several modules may have, since the folder says which one it is.
SAME_ROLE = {
    "__init__": "of each package",
    "settings": "declared thresholds: of one package of the library, or how they are declared",
    "exercises": "of one chapter",
    "figures": "of one chapter",
    "panel": "of one chapter, or what all panels share",
}


def test_no_two_modules_have_one_name() -> None:
    """In the library, the course, the data scripts and what tests share."""
    places = defaultdict(list)
    for path in modules_by_name().values():
        places[path.stem].append(path.relative_to(ROOT).as_posix())
    for path in (ROOT / "tests").rglob("*.py"):
        if not path.stem.startswith("test_"):
            places[path.stem].append(path.relative_to(ROOT).as_posix())
    shared = {stem: paths for stem, paths in places.items() if len(paths) > 1}
    assert shared.keys() == SAME_ROLE.keys(), {s: p for s, p in shared.items() if s not in SAME_ROLE}
    for stem in ("exercises", "figures", "panel"):
        folders = {Path(path).parent for path in shared[stem]} - {COURSE.relative_to(ROOT)}
        assert {folder.parent for folder in folders} == {COURSE.relative_to(ROOT)}, shared[stem]
    assert {Path(path).parts[0] for path in shared["settings"]} == {"vo_lib"}


def test_library_does_not_import_course_scripts_or_pyplot() -> None:
    above = {path.stem for folder in ("data_scripts", "notebooks") for path in (ROOT / folder).iterdir()}
    above.remove("vo_street")  # imported inside functions of drawn.py, see above
    for path in (ROOT / "vo_lib").rglob("*.py"):
        assert not packages(path) & above, path
        assert not any(name.startswith("matplotlib.pyplot") for name in imports(path)), path


def test_imported_packages_are_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    lines = [re.split("[<>=]", line)[0].lower() for group in groups for line in group]
    declared = {name for line in lines for name in re.findall(r"[\w-]+", line)}  # dask[distributed] is two
    makers = metadata.packages_distributions()
    for folder in ("vo_lib", "data_scripts", "notebooks/course"):
        for path in (ROOT / folder).rglob("*.py"):
            used = {maker.lower() for name in packages(path) for maker in makers.get(name, [])}
            assert used - {"stereo-vo-kit"} <= declared, path


def test_a_chapter_imports_no_later_chapter() -> None:
    """What all chapters share imports none (`tasks` does, by name), and no chapter imports the appendix."""
    for path in COURSE.rglob("*.py"):
        folder = path.relative_to(COURSE).parts[0]
        if folder == "appendix":
            continue
        own = int(folder[2:]) if re.fullmatch(r"ch\d\d", folder) else -1
        for name in imports(path):
            chapter = re.search(r"course\.(?:ch(\d\d)|(appendix))\b", name)
            if chapter is not None:
                is_later = chapter[2] is not None or int(chapter[1]) > own
                assert not is_later, (path.relative_to(ROOT), name)


def test_deviations_over_seeds_come_from_one_module() -> None:
    """`evaluation/statistics.py` alone; what an exercise shows to students may write the formula out."""
    sources = {}
    for folder in ("vo_lib", "data_scripts", "notebooks"):
        for path in (ROOT / folder).rglob("*.py"):
            if path.name not in ("statistics.py", "exercises.py"):
                sources[str(path)] = path.read_text(encoding="utf-8")
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = [line for cell in cells if cell["cell_type"] == "code" for line in cell["source"]]
        sources[str(path)] = "".join(code)
    own = re.compile(r"\bddof\b|\b(?:nan)?std\(\w|\bp?stdev\(")
    assert [path for path, text in sources.items() if own.search(text)] == []
