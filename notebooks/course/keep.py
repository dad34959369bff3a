"""A student's functions: kept in `my_vo.py` beside the notebooks once they pass, and what they call."""

from __future__ import annotations

import ast
import dis
import inspect
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from vo_lib.core.files import write_text_atomic

NAME = "my_vo.py"
CALLED = ("LOAD_GLOBAL", "LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM")  # steps that name a function
MARK = "00_start_here.ipynb"  # stands in the folder of the notebooks and in that of their solutions
HEAD = '"""My visual odometry: the functions that passed their checks in the notebooks."""\n'


def keep(function: Any) -> str:
    """Write the source of a function into `my_vo.py` of the current folder; tells so in a sentence.

    Only in a folder with the notebook `00_start_here.ipynb`, where Jupyter runs the course: elsewhere, in a
    test or a script, nothing is written. A function of the same name is replaced, imports that the function
    needs and the file lacks are added, all else stays as it is. Where the source cannot be had (a lambda,
    the lines of a console) nothing is written and "" is given back. Never raises.
    """
    if not (Path(MARK).is_file() and isinstance(function, FunctionType)):
        return ""
    try:
        source = textwrap.dedent(inspect.getsource(function)).rstrip()
        tree = ast.parse(source)
    except (OSError, SyntaxError):
        return ""
    if [getattr(node, "name", "") for node in tree.body] != [function.__name__]:
        return ""
    path = Path(NAME)
    try:
        text = path.read_bytes().decode("utf-8") if path.exists() else HEAD
        write_text_atomic(path, _with(text, function.__name__, source, _imports(tree, function)))
    except Exception as error:  # what the student has made of the file, or a folder that cannot be written
        return f" It could not be kept in `{NAME}`: {error}."
    return f" It is kept in `{NAME}`."


def _with(text: str, name: str, source: str, imports: list[str]) -> str:
    """A module's text with a function added, or put in the place of its last one of that name."""
    lines, body = text.split("\n"), ast.parse(text).body
    heads = [node for node in body if isinstance(node, (ast.Import, ast.ImportFrom))]
    missing = [line for line in imports if line not in map(ast.unparse, heads)]
    place = max((node.end_lineno or 0 for node in heads), default=0)
    if missing and not heads and ast.get_docstring(ast.Module(body, [])) is not None:
        place, missing = body[0].end_lineno or 0, ["", *missing]
    edits = [(place, place, missing)]
    same = [node for node in body if isinstance(node, ast.FunctionDef) and node.name == name]
    if same:
        first = min([same[-1].lineno, *(decorator.lineno for decorator in same[-1].decorator_list)])
        edits.append((first - 1, same[-1].end_lineno or first, source.split("\n")))
    for start, end, new in sorted(edits, reverse=True):
        lines[start:end] = new
    kept = "\n".join(lines)
    return kept if same else f"{kept.rstrip()}\n\n\n{source}\n"


def _imports(tree: ast.AST, function: FunctionType) -> list[str]:
    """Lines that import the modules, functions and classes of others that a function names."""
    lines = set()
    for name in {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}:
        value = function.__globals__.get(name)
        if isinstance(value, ModuleType):
            own, line = value.__name__, f"import {value.__name__}"
        else:
            module, own = str(getattr(value, "__module__", "")), str(getattr(value, "__name__", ""))
            if module == function.__module__ or getattr(sys.modules.get(module), own, ...) is not value:
                continue
            line = f"from {module} import {own}"
        lines.add(line if own == name else f"{line} as {name}")
    return sorted(lines)


def handed_back(answer: Any, names: Sequence[str]) -> str:
    """The first of some functions of the library that an answer is, or calls; "" where it calls none of them.

    The tables of the exercises themselves may call what they like.
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
