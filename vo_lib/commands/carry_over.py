"""Answers of an older notebook in the current version of it.

An answer is a function or a variable that the notebook leaves open with `...`, in the cell of its check. It
is found again by its name and its check, so exercises may have other numbers and texts. The older notebook
stays as it is: this makes the text of the new one.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

CHECK = re.compile(r"^(?:ch\d\d|appendix)\.(\w+)\((\w+)(?:\.facts)?(?:,.*)?\)\s*$")
ANOTHER = "# Your answer to an earlier version of this exercise:"


@dataclass(frozen=True)
class Cell:
    """A code cell with an exercise: its text and statements, and the names of the answer and of its check."""

    source: str
    statements: list[ast.stmt]
    name: str
    check: str

    @property
    def answer(self) -> ast.stmt | None:
        """The statement that defines the answer."""
        return next((each for each in self.statements if _defined(each) == self.name), None)


def carry_over(old: bytes, new: bytes) -> tuple[bytes, list[str]]:
    """The new notebook with the answers of the old one, and the names of these answers.

    A notebook that cannot be read has no answers. An answer whose function takes other arguments now is put
    below the open one, as a comment.
    """
    carried = list[str]()
    try:
        theirs = json.loads(old)["cells"]
        notebook = json.loads(new)
        cells = notebook["cells"]
    except (ValueError, LookupError, TypeError):
        return new, carried
    answered_cells = [cell for _, cell in _exercises(theirs) if not _is_open(cell.answer)]
    answers = {(cell.name, cell.check): cell for cell in answered_cells}
    # A function has one task in a notebook, while a variable may be the answer to several.
    functions = {cell.name: cell for cell in answered_cells if isinstance(cell.answer, ast.FunctionDef)}
    own_functions = _own_functions(theirs, cells)
    for raw, cell in _exercises(cells):
        answered = answers.get((cell.name, cell.check))
        if answered is None and isinstance(cell.answer, ast.FunctionDef):
            answered = functions.get(cell.name)
        if answered is None or not _is_open(cell.answer):
            continue
        raw["source"] = _with_answer(cell, answered, own_functions).splitlines(keepends=True)
        carried.append(cell.name)
    if not carried:
        return new, carried
    return (json.dumps(notebook, indent=1, ensure_ascii=False) + "\n").encode(), carried


def _with_answer(cell: Cell, answered: Cell, own_functions: dict[str, str]) -> str:
    """The text of the new cell with the student's statements in place of the open answer."""
    open_answer = cell.answer
    lines = cell.source.splitlines()
    if open_answer is None or open_answer.end_lineno is None:
        return cell.source
    given = {_text(cell.source, each) for each in cell.statements}
    theirs = [
        _text(answered.source, each)
        for each in answered.statements
        if not CHECK.match(_text(answered.source, each)) and _text(answered.source, each) not in given
    ]
    needed = [own_functions[name] for name in _used("\n".join(theirs)) if name in own_functions]
    between = "\n\n\n" if isinstance(open_answer, ast.FunctionDef) else "\n"
    written = between.join([*needed, *theirs])
    start = open_answer.lineno - 1
    if not _same_arguments(open_answer, answered.answer):
        comment = [ANOTHER, *(f"# {line}".rstrip() for line in written.splitlines())]
        return "\n".join([*lines[: open_answer.end_lineno], *comment, *lines[open_answer.end_lineno :]])
    return "\n".join([*lines[:start], *written.splitlines(), *lines[open_answer.end_lineno :]])


def _exercises(cells: list[Any]) -> Iterator[tuple[dict[str, Any], Cell]]:
    """The code cells that call a check of an answer, as in the file and as a `Cell`."""
    for raw in cells:
        if raw["cell_type"] != "code":
            continue
        source = "".join(raw["source"])
        statements = _statements(source)
        for statement in statements:
            found = CHECK.match(_text(source, statement))
            if found:
                cell = Cell(source, statements, found[2], found[1])
                if cell.answer is not None:
                    yield raw, cell
                break


def _statements(source: str) -> list[ast.stmt]:
    """The statements of a cell; none if it cannot be read, as with a magic command or an unfinished line."""
    with suppress(SyntaxError, ValueError):
        return ast.parse(source).body
    return []


def _text(source: str, statement: ast.stmt) -> str:
    """The lines of a statement, with its decorators."""
    lines = source.splitlines()
    decorators = getattr(statement, "decorator_list", [])
    start = min([statement.lineno, *(each.lineno for each in decorators)]) - 1
    return "\n".join(lines[start : statement.end_lineno])


def _defined(statement: ast.stmt) -> str:
    """The name that a statement defines: of a function, or of a variable."""
    if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
        return statement.name
    if isinstance(statement, ast.Assign) and len(statement.targets) == 1:
        target = statement.targets[0]
        return target.id if isinstance(target, ast.Name) else ""
    return ""


def _is_open(statement: ast.stmt | None) -> bool:
    """Whether an answer is still missing: `...` as the value, or as a line of the function."""
    if isinstance(statement, ast.Assign):
        return _is_dots(statement.value)
    if isinstance(statement, ast.FunctionDef):
        return any(isinstance(line, ast.Expr) and _is_dots(line.value) for line in ast.walk(statement))
    return statement is None


def _is_dots(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and value.value is ...


def _same_arguments(new: ast.stmt, old: ast.stmt | None) -> bool:
    if isinstance(new, ast.FunctionDef) and isinstance(old, ast.FunctionDef):
        return ast.dump(new.args) == ast.dump(old.args)
    return type(new) is type(old)


def _own_functions(theirs: list[Any], cells: list[Any]) -> dict[str, str]:
    """The functions that the student added in cells of the old notebook, by name."""
    known = {name for raw in cells if raw["cell_type"] == "code" for name in _names("".join(raw["source"]))}
    own: dict[str, str] = {}
    for raw in theirs:
        source = "".join(raw["source"]) if raw["cell_type"] == "code" else ""
        if any(CHECK.match(line) for line in source.splitlines()):
            continue  # the statements of this cell come with its answer
        for statement in _statements(source):
            if isinstance(statement, ast.FunctionDef) and statement.name not in known:
                own[statement.name] = _text(source, statement)
    return own


def _names(source: str) -> list[str]:
    return [_defined(statement) for statement in _statements(source)]


def _used(source: str) -> list[str]:
    """The names that a text uses, each once, in their order."""
    nodes = [node for statement in _statements(source) for node in ast.walk(statement)]
    return list(dict.fromkeys(node.id for node in nodes if isinstance(node, ast.Name)))
