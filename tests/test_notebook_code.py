"""Code that students read says one thing a statement: cells of the notebooks and answers of the exercises."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest
from IPython.core.inputtransformer2 import TransformerManager
from test_notebooks import APPENDICES, CHAPTERS, FOLDER, SOLUTIONS, name, read

EXERCISES = sorted((FOLDER / "course").glob("*/exercises.py"))
UNRELATED = "assigns unrelated values in one statement: write one assignment a line"
UNPACKED = "unpacks a comprehension: write one assignment a line, or a loop"
TIMES_CONDITION = "multiplies a text by a condition: write an if"
LAMBDA = "has a lambda: define a function with a name"
WALRUS = "assigns within an expression: assign on a line of its own"
ONE_LINE = "has several statements in one line: write one a line"


def is_row(node: ast.expr) -> bool:
    return isinstance(node, (ast.Tuple, ast.List))


def fault_of_assignment(statement: ast.Assign) -> str:
    """What is wrong with an assignment to several names; "" if it swaps, or unpacks one value."""
    value = statement.value
    for target in statement.targets:
        if not isinstance(target, (ast.Tuple, ast.List)):
            continue
        if isinstance(value, (ast.Tuple, ast.List)):
            names = sorted(ast.unparse(each) for each in target.elts)
            if names != sorted(ast.unparse(each) for each in value.elts):
                return UNRELATED
        if isinstance(value, ast.IfExp) and (is_row(value.body) or is_row(value.orelse)):
            return UNRELATED
        if isinstance(value, (ast.GeneratorExp, ast.ListComp)):
            return UNPACKED
        if isinstance(value, ast.Call) and ast.unparse(value.func) == "map":
            return UNPACKED
    return ""


def is_text_times_condition(node: ast.AST) -> bool:
    if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult)):
        return False
    sides = (node.left, node.right)
    has_text = any(
        isinstance(side, ast.JoinedStr) or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in sides
    )
    return has_text and any(
        isinstance(side, (ast.Compare, ast.BoolOp))
        or (isinstance(side, ast.UnaryOp) and isinstance(side.op, ast.Not))
        or (isinstance(side, ast.Call) and ast.unparse(side.func) == "bool")
        for side in sides
    )


def lines_with_several_statements(tree: ast.AST) -> Iterator[int]:
    """Numbers of the lines in which a second statement begins, as after a semicolon."""
    for node in ast.walk(tree):
        for field in ("body", "orelse", "finalbody"):
            block = getattr(node, field, None)
            if not isinstance(block, list):
                continue
            for before, statement in itertools.pairwise(block):
                if statement.lineno == before.end_lineno:
                    yield statement.lineno


def faults(source: str, short_forms: bool = False) -> list[str]:
    """What a student would read twice in some code, as "line N: `code` what to do".

    short_forms : whether lambdas and assignments within an expression are allowed.
    """
    lines = source.splitlines()
    tree = ast.parse(source)
    found = [(number, ONE_LINE) for number in lines_with_several_statements(tree)]
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and (fault := fault_of_assignment(node)):
            found.append((node.lineno, fault))
        elif isinstance(node, ast.BinOp) and is_text_times_condition(node):
            found.append((node.lineno, TIMES_CONDITION))
        elif isinstance(node, ast.Lambda) and not short_forms:
            found.append((node.lineno, LAMBDA))
        elif isinstance(node, ast.NamedExpr) and not short_forms:
            found.append((node.lineno, WALRUS))
    return [f"line {number}: `{lines[number - 1].strip()}` {fault}" for number, fault in sorted(found)]


@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES, *SOLUTIONS], ids=name)
def test_cells_say_one_thing_a_statement(path: Path) -> None:
    without_magic = TransformerManager().transform_cell  # type: ignore[no-untyped-call]
    found = []
    for cell in read(path).cells:
        if cell.cell_type == "code":
            found += [
                f"{name(path)}, cell {cell.id}, {fault}" for fault in faults(without_magic(cell.source))
            ]
    assert not found, "\n".join(["", *found])


@pytest.mark.parametrize("path", EXERCISES, ids=lambda path: path.parent.name)
def test_answers_of_exercises_say_one_thing_a_statement(path: Path) -> None:
    found = faults(path.read_text(encoding="utf-8"), short_forms=True)
    assert not found, "\n".join(["", *(f"{path.parent.name}/{path.name}, {fault}" for fault in found)])


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("front, largest = [], 0.0", UNRELATED),
        ("path, first = distances(truth), 0", UNRELATED),
        ("[x, y] = 1, 2", UNRELATED),
        ("if known:\n    first, last = 0, len(path)", UNRELATED),
        ("drive, k = (real, 3) if has_real else (street, 5)", UNRELATED),
        ("te, re = (mean(each) for each in errors)", UNPACKED),
        ("(a, b), (c, d) = [value(what) for what in names]", UNPACKED),
        ("x, y = map(float, words)", UNPACKED),
        ("words = ', shows' * (change > limit)", TIMES_CONDITION),
        ("words = (not known) * f'{unit}'", TIMES_CONDITION),
        ("rows = sorted(rows, key=lambda row: row[1])", LAMBDA),
        ("if len(pairs := visits()):\n    print(pairs)", WALRUS),
        ("a = 1; b = 2", ONE_LINE),
        ("for a in rows:\n    b = a; print(b)", ONE_LINE),
    ],
)
def test_a_statement_that_says_two_things_is_found(source: str, fault: str) -> None:
    assert [each for each in faults(source) if each.endswith(fault)]


@pytest.mark.parametrize(
    "source",
    [
        "first, second = second, first",
        "te, re = mean_errors(truth, path)",
        "picture, (axis,) = figure(200)",
        "x, y, z = T[:3, 3]",
        "pair = (left, right)",
        "line = '-' * 40",
        "def chain(motions): ...",
        "vo(['check']);",
        "if known:\n    a = 1\nelse:\n    a = 2",
    ],
)
def test_plain_statements_are_no_fault(source: str) -> None:
    assert faults(source) == []
