"""Functions of a student: storage in `my_vo.py` beside the notebooks, and detection of library calls."""

from __future__ import annotations

import ast
import dis
import importlib.util
import inspect
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from vo_lib.errors import DataError
from vo_lib.files import write_atomic

NAME = "my_vo.py"
# Instructions with the name of a function.
CALLED = "LOAD_GLOBAL", "LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM"
MARK = "00_start_here.ipynb"  # a file of the folders of notebooks and of solutions
LARGEST = 5000  # maximal size of an array that is saved
HEAD = '"""My visual odometry: the functions that passed their checks in the notebooks."""\n'


def keep(function: Any, judge: Callable[[Any], Any] | None = None) -> str:
    """Write a function and its dependencies into `my_vo.py` of the current folder; return a sentence.

    Dependencies are imports, other functions and classes of the student (by source) and constants of the
    notebook (by value). Definitions of the same name are replaced; the rest of the file does not change.
    Nothing is written, and the result is "", in folders without `00_start_here.ipynb` (folders of tests or
    scripts), and for functions without source (a lambda, a function of a console). `judge`, the check of the
    exercise, then tests the saved function. Never raises.
    """
    if not (Path(MARK).is_file() and isinstance(function, FunctionType)):
        return ""
    try:
        _source(function)
    except (OSError, SyntaxError, ValueError):
        return ""
    path = Path(NAME)
    try:
        text = path.read_bytes().decode("utf-8") if path.exists() else HEAD
        needed = _needed(function)
        _refuse_clash(text, function.__name__, needed)
        for name, definition in needed.items():
            text = _with(text, name, *definition)
        write_atomic(path, text)
        verdict = judge(load(path)[function.__name__]) if judge else None
    except Exception as error:  # an edited file, or a folder without write permission
        return f" It was not saved in `{NAME}`: {error}."
    if verdict is not None and not verdict.passed:
        return f" It is saved in `{NAME}`, but fails there: {verdict.message}"
    return f" It is saved in `{NAME}`."


def load(path: Path) -> dict[str, Any]:
    """Definitions of a module of saved functions; empty if there is no file. `DataError` if the file cannot be run."""
    spec = importlib.util.spec_from_file_location(path.stem, path) if path.is_file() else None
    if spec is None or spec.loader is None:
        return {}
    module = importlib.util.module_from_spec(spec)
    try:
        exec(compile(path.read_bytes(), path, "exec"), vars(module))  # never from the cache of compiled files
    except ImportError as error:
        raise DataError(
            f"the file cannot be run, {error}: CONTRIBUTING.md lists the new names of imports", path
        ) from None
    except (Exception, SystemExit, KeyboardInterrupt) as error:
        raise DataError(f"the file cannot be run, {type(error).__name__}: {error}", path) from None
    return vars(module)


def _source(thing: Any) -> str:
    """The source of a function or class; ValueError if its lines also contain other definitions."""
    source = textwrap.dedent(inspect.getsource(thing)).rstrip()
    if [getattr(node, "name", "") for node in ast.parse(source).body] != [thing.__name__]:
        raise ValueError(f"`{thing.__name__}` has no lines of its own")
    return source


def _needed(function: Any) -> dict[str, tuple[str, list[str]]]:
    """Source and imports by name, first of a function's dependencies in the notebook, then of the function."""
    definitions: dict[str, tuple[str, list[str]]] = {}

    def add(name: str, value: Any, around: Any) -> None:
        source, imports = _source(value), set()
        definitions[name] = ("", [])  # for recursive functions
        for used in _names(source):
            if used not in around or used in definitions:
                continue
            if line := _import_of(used, around[used], function.__module__):
                imports.add(line)
            elif isinstance(around[used], (FunctionType, type)):
                add(used, around[used], around)
            else:
                definitions[used] = (f"{used} = {_written(used, around[used])}", ["import numpy as np"])
        del definitions[name]  # its place is after its dependencies
        definitions[name] = (source, sorted(imports))

    add(function.__name__, function, function.__globals__)
    return definitions


def _names(source: str) -> list[str]:
    """Global names in the source of a function or class: all names except parameters and assigned names."""
    tree = ast.parse(source)
    parameters = {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    own = parameters | {node.id for node in names if isinstance(node.ctx, ast.Store)}
    return sorted({node.id for node in names} - own)


def _import_of(name: str, value: Any, home: str) -> str:
    """The import line of a module, or of a definition outside the student's module `home`; else ""."""
    if isinstance(value, ModuleType):
        own, line = value.__name__, f"import {value.__name__}"
    else:
        module, own = str(getattr(value, "__module__", "")), str(getattr(value, "__name__", ""))
        if module == home or getattr(sys.modules.get(module), own, ...) is not value:
            return ""
        line = f"from {module} import {own}"
    return line if own == name else f"{line} as {name}"


def _written(name: str, value: Any) -> str:
    """Python source of a constant: an array, numbers or text, also in lists, tuples and dicts."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.size <= LARGEST:
        return f"np.array({value.tolist()!r}, np.{value.dtype.name})"
    text = repr(value.item() if isinstance(value, np.generic) else value)
    try:
        ast.literal_eval(text)
    except (SyntaxError, ValueError):
        raise ValueError(f"it uses `{name}`, which is not a constant; make it an argument") from None
    return text


def _refuse_clash(text: str, name: str, needed: Mapping[str, tuple[str, list[str]]]) -> None:
    """ValueError if a definition that other functions of the file use would be replaced."""
    body = ast.parse(text).body
    for helper, (source, _) in needed.items():
        here = [node for node in body if helper in _defined(node)]
        if helper == name or not here or ast.dump(here[-1]) == ast.dump(ast.parse(source).body[0]):
            continue
        for node in body:
            others = set(_defined(node)) - set(needed)
            if others and any(isinstance(each, ast.Name) and each.id == helper for each in ast.walk(node)):
                raise ValueError(f"`{others.pop()}` uses another `{helper}` there; rename yours")


def _defined(node: ast.stmt) -> list[str]:
    """Names that a statement of a module defines by def, class or =."""
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _with(text: str, name: str, source: str, imports: list[str]) -> str:
    """Text of a module in which `source` replaces the last definition of `name`, or is appended if there is none."""
    lines, body = text.split("\n"), ast.parse(text).body
    heads = [node for node in body if isinstance(node, (ast.Import, ast.ImportFrom))]
    new_imports = [line for line in imports if line not in map(ast.unparse, heads)]
    place = max((node.end_lineno or 0 for node in heads), default=0)
    if new_imports and not heads and ast.get_docstring(ast.Module(body, [])) is not None:
        place, new_imports = body[0].end_lineno or 0, ["", *new_imports]
    edits = [(place, place, new_imports)]
    same = [node for node in body if _defined(node) == [name]]
    if same:
        first = min([same[-1].lineno, *(each.lineno for each in getattr(same[-1], "decorator_list", []))])
        edits.append((first - 1, same[-1].end_lineno or first, source.split("\n")))
    for start, end, new in sorted(edits, reverse=True):
        lines[start:end] = new
    result = "\n".join(lines)
    return result if same else f"{result.rstrip()}\n\n\n{source}\n"


def is_stub(answer: Any) -> bool:
    """Whether an answer is an unchanged function of a notebook, with the line `...`."""
    try:
        lines = ast.walk(ast.parse(_source(answer)))
    except (OSError, SyntaxError, TypeError, ValueError):
        return False
    return any(isinstance(line, ast.Expr) and getattr(line.value, "value", 0) is ... for line in lines)


def handed_back(answer: Any, names: Sequence[str]) -> str:
    """The first library function in `names` that an answer calls, or hands in as the answer; else "".

    An answer of the library or of the course may call any function.
    """
    module = str(getattr(answer, "__module__", ""))
    if not isinstance(answer, FunctionType) or module.startswith(("vo_lib.", __package__)):
        name = str(getattr(answer, "__name__", ""))
        return name if name in names and not module.startswith(__package__) else ""
    codes = [answer.__code__]
    for code in codes:
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
        for step in dis.get_instructions(code):
            value = answer.__globals__.get(step.argval) if step.opname == "LOAD_GLOBAL" else None
            name = str(getattr(value, "__name__", step.argval))
            own = value is not None and getattr(value, "__module__", "") == module
            if step.opname.startswith(CALLED) and name in names and not own:
                return name
    return ""
