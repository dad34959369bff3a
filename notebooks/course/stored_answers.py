"""Functions of a student: storage in `my_vo.py` beside the notebooks, and detection of library calls."""

from __future__ import annotations

import ast
import dis
import inspect
import re
import sys
import textwrap
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from vo_lib.errors import DataError
from vo_lib.files import write_atomic

NAME = "my_vo.py"
SECTION = re.compile(r"^# ---- (\w+) ----\r?\n", re.MULTILINE)  # before a function and its dependencies
# Instructions with the name of a function.
CALLED = "LOAD_GLOBAL", "LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM"
MARK = "00_start_here.ipynb"  # a file of the folders of notebooks and of solutions
LARGEST = 5000  # maximal size of an array that is saved
HEAD = '"""My visual odometry: the functions that passed their checks in the notebooks."""'


def store_answer(function: Any, grade: Callable[[Any], Any] | None = None) -> str:
    """Write a function and its dependencies into its section of `my_vo.py`; return a sentence.

    Dependencies are imports, other functions and classes of the student (by source) and constants of the
    notebook (by value). The rest of the file does not change. In a folder without `00_start_here.ipynb` (of
    tests or scripts), and for a function without source (a lambda, a function of a console), nothing is
    written and the result is "". `grade`, the check, also tests the saved function. Never raises.
    """
    if not (Path(MARK).is_file() and isinstance(function, FunctionType)):
        return ""
    try:
        _source(function)
    except (OSError, SyntaxError, ValueError):
        return ""
    path = Path(NAME)
    name = function.__name__
    try:
        load(path)  # or say that the file cannot be run
        text = path.read_bytes().decode("utf-8") if path.exists() else HEAD
        head, *parts = SECTION.split(text)
        sections = {**dict(zip(parts[::2], parts[1::2], strict=True)), name: _section(function)}
        whole = [head.rstrip(), *(f"# ---- {key} ----\n{part.rstrip()}" for key, part in sections.items())]
        write_atomic(path, "\n\n\n".join(whole) + "\n")
        verdict = grade(load(path)[name]) if grade else None
    except Exception as error:  # an edited file, or a folder without write permission
        return f" It was not saved in `{NAME}`: {error}."
    if verdict is not None and not verdict.passed:
        return f" It is saved in `{NAME}`, but fails there: {verdict.message}"
    return f" It is saved in `{NAME}`."


def load(path: Path) -> dict[str, Any]:
    """Definitions of a file of saved functions; none without a file. `DataError` if the file cannot be run.

    A section can use its own names and the names defined above the first section.
    """
    definitions, faults = load_sections(path)
    if faults:
        raise DataError(f"the file cannot be run, {next(iter(faults.values()))}", path)
    return definitions


def load_sections(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Definitions of a file of saved functions, and the faults of the sections that cannot be run, by name.

    The part above the first section has the name "". Raises `DataError` if the file is no text.
    """
    if not path.is_file():
        return {}, {}
    common: dict[str, Any] = {"__name__": path.stem}
    definitions = dict[str, Any]()
    named = dict[str, Any]()
    faults = dict[str, str]()
    try:
        head, *parts = SECTION.split(path.read_bytes().decode("utf-8"))
    except UnicodeDecodeError as error:
        raise DataError(f"the file cannot be run, {type(error).__name__}: {error}", path) from None
    above = ""  # empty lines in place of the parts before, so that errors have the lines of the file
    for name, part in [("", head), *zip(parts[::2], parts[1::2], strict=True)]:
        own = dict(common) if name else common
        try:
            exec(compile(above + part, path, "exec"), own)
        except ImportError as error:
            faults[name] = f"{_line_of(error, path)}{error}: compare its imports with those of the chapter"
        except (Exception, SystemExit, KeyboardInterrupt) as error:
            faults[name] = f"{_line_of(error, path)}{type(error).__name__}: {error}"
        else:
            definitions |= own
            named |= {name: own[name]} if name in own else {}
        above += "\n" * (part.count("\n") + 1)
    return definitions | named, faults


def _line_of(error: BaseException, path: Path) -> str:
    """The line of a file that raised an error, as the begin of a message; "" if the message names it anyway."""
    lines = [step.lineno for step in traceback.extract_tb(error.__traceback__) if step.filename == str(path)]
    return f"line {lines[-1]}: " if lines else ""


def _source(thing: Any) -> str:
    """The source of a function or class; ValueError if its lines also contain other definitions."""
    source = textwrap.dedent(inspect.getsource(thing)).rstrip()
    if [getattr(node, "name", "") for node in ast.parse(source).body] != [thing.__name__]:
        raise ValueError(f"`{thing.__name__}` has no lines of its own")
    return source


def _section(function: Any) -> str:
    """Imports of a function, its dependencies in the notebook, and its source."""
    definitions = dict[str, str]()
    imports = set[str]()
    around = function.__globals__

    def add(name: str, value: Any) -> None:
        source = _source(value)
        definitions[name] = ""  # so that a recursive function is not added again
        for used in _names(source):
            if used not in around or used in definitions:
                continue
            if line := _import_of(used, around[used], function.__module__):
                imports.add(line)
            elif isinstance(around[used], (FunctionType, type)):
                add(used, around[used])
            else:
                imports.add("import numpy as np")
                definitions[used] = f"{used} = {_written(used, around[used])}"
        del definitions[name]  # its place is after its dependencies
        definitions[name] = source

    add(function.__name__, function)
    return "\n\n\n".join(["\n".join(sorted(imports)), *definitions.values()]).lstrip()


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
        own = value.__name__
        line = f"import {value.__name__}"
    else:
        module = str(getattr(value, "__module__", ""))
        own = str(getattr(value, "__name__", ""))
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


def is_stub(answer: Any) -> bool:
    """Whether an answer is an unchanged function of a notebook, with the line `...`."""
    try:
        lines = ast.walk(ast.parse(_source(answer)))
    except (OSError, SyntaxError, TypeError, ValueError):
        return False
    return any(isinstance(line, ast.Expr) and getattr(line.value, "value", 0) is ... for line in lines)


def handed_back(answer: Any, names: Sequence[str]) -> str:
    """The first function in `names` that an answer calls, or the answer itself if in `names`; otherwise "".

    An answer that is a function of the library or of the course may call any function.
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
