"""Answers of an older notebook in the current version of it.

An answer is a function or a variable that the notebook leaves open with `...`, and that a check gets. It is
found again by its name and its check, so exercises may have other numbers and texts. What cannot take its
place as code any more is kept as a comment. The older notebook stays as it is: this makes the text of the new
one.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from types import NoneType
from typing import Any, NamedTuple

CHAPTER = re.compile(r"ch\d\d|appendix")
MAGIC = re.compile(r"\s*[%!?]|\s*[\w.]+\?+\s*$")  # beginnings of lines for IPython, not for Python
# In a text that is no Python: what it defines, and the checks that it calls.
DEFINED = re.compile(r"^(?:def|class) +(\w+)|^(\w+) *(?::[^=\n]*)?=", re.MULTILINE)
CHECKED = re.compile(r"^(?:ch\d\d|appendix)\.(\w+)\((\w+)", re.MULTILINE)
CONTINUED = re.compile(
    r"[\s)\]}]|(else|elif|except|finally)\b"
)  # beginnings of lines that belong to those above
ANOTHER = "# Your answer to an earlier version of this exercise:"
LEFT = "# Your answers to exercises that this notebook does not have any more:"


class Carried(NamedTuple):
    """A new notebook, and the names of the answers that it has as code and as comments."""

    content: bytes
    as_code: list[str]
    as_comments: list[str]


@dataclass(frozen=True)
class Statement:
    """A statement of a cell with the comments above it; for a text that is no Python, `node` is None."""

    text: str
    node: ast.stmt | None

    @property
    def check(self) -> tuple[str, str] | None:
        """The check that the statement calls, and the name of its answer."""
        if self.node is None:
            found = CHECKED.search(self.text)
            return (found[1], found[2]) if found else None
        call = getattr(self.node, "value", None)  # of an expression, or of an assignment
        inner = call.args[0] if isinstance(call, ast.Call) and len(call.args) == 1 else call
        return _check(call) or _check(inner)

    @property
    def defined(self) -> list[str]:
        """The names that the statement defines: of a function, a class, or of variables."""
        if self.node is None:
            return [name for found in DEFINED.findall(self.text) for name in found if name]
        if isinstance(self.node, (ast.FunctionDef, ast.ClassDef)):
            return [self.node.name]
        targets = getattr(self.node, "targets", None) or [getattr(self.node, "target", None)]
        names = [each for target in targets if target is not None for each in ast.walk(target)]
        return [each.id for each in names if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)]

    @property
    def is_magic(self) -> bool:
        return self.node is None and all(MAGIC.match(line) for line in self.text.splitlines() if line.strip())


@dataclass(frozen=True)
class Answer:
    """An answer: the names of its check and its own, its cell, and the statement that defines it."""

    check: str
    name: str
    cell: list[Statement]
    statement: Statement
    checked_by: Statement | None = None

    @property
    def is_function(self) -> bool:
        return _arguments(self.statement.node) is not None

    @property
    def is_open(self) -> bool:
        """Whether the answer is still missing: `...` as the value, or as a line of the function."""
        node = self.statement.node
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            return any(value is None or _is_dots(value) for value in values)
        return node is not None and any(
            isinstance(line, ast.Expr) and _is_dots(line.value) for line in ast.walk(node)
        )


def carry_over(old: bytes, new: bytes) -> Carried:
    """The new notebook with the answers of the old one. A notebook that cannot be read has no answers.

    An answer whose function takes other arguments now is put below the open one, as a comment. Answers to
    exercises that are gone are comments in a last cell.
    """
    try:
        theirs = [_statements(_source(raw)) for raw in json.loads(old)["cells"] if raw["cell_type"] == "code"]
        notebook = json.loads(new)
        raw_cells = [raw for raw in notebook["cells"] if raw["cell_type"] == "code"]
        cells = [_statements(_source(raw)) for raw in raw_cells]
    except (ValueError, LookupError, TypeError, AttributeError):
        return Carried(new, [], [])
    answered = [answer for answer in _answers(theirs) if not answer.is_open]
    own_functions, changed_functions = _own_functions(theirs, cells)
    as_code = list[str]()
    as_comments = list[str]()
    placed = list[Statement]()
    for raw, cell in zip(raw_cells, cells, strict=True):
        for number in range(len(_answers([cell]))):
            task = _answers([_statements(_source(raw))])[number]  # an answer before may have moved its lines
            answer = _answer_of(task, answered, theirs)
            if answer is None:
                continue
            placed.append(answer.statement)
            if not task.is_open:
                continue  # a later version of the notebook has an answer
            same = _arguments(task.statement.node) == _arguments(answer.statement.node)
            fits = same and answer.statement.node is not None
            text = _with_answer(_source(raw), task, answer, own_functions, fits)
            value = getattr(answer.statement.node, "value", None)
            if isinstance(value, ast.Name) and value.id in changed_functions:
                # The answer is a function of the notebook that the student changed.
                text += f"\n{ANOTHER}\n{_comment(changed_functions[value.id])}"
                as_comments.append(value.id)
            raw["source"] = text.splitlines(keepends=True)
            (as_code if fits else as_comments).append(task.name)
    left = [
        answer
        for answer in answered
        if not any(answer.statement is each for each in placed)
        # A call whose result the kit's own cell uses may be another than a check.
        and (answer.is_function or isinstance(getattr(answer.checked_by, "node", None), (ast.Expr, NoneType)))
    ]
    texts = dict.fromkeys(answer.statement.text for answer in left)
    texts = {text: None for text in texts if not any(_comment(text) in _source(raw) for raw in raw_cells)}
    if texts:
        as_comments += [answer.name for answer in left if answer.statement.text in texts]
        notebook["cells"].append(_cell_of(notebook, "\n\n".join([LEFT, *map(_comment, texts)])))
    if not as_code and not as_comments:
        return Carried(new, [], [])
    content = (json.dumps(notebook, indent=1, ensure_ascii=False) + "\n").encode()
    return Carried(content, as_code, list(dict.fromkeys(as_comments)))


def _answers(cells: list[list[Statement]]) -> list[Answer]:
    """The answers that checks get, each from the cell of its check or from the last one before."""
    answers = list[Answer]()
    for number, cell in enumerate(cells):
        for statement in cell:
            if statement.check is None:
                continue
            check, name = statement.check
            for place in [cell, *reversed(cells[:number])]:
                defined = [each for each in place if name in each.defined]
                if defined:
                    answers.append(Answer(check, name, place, defined[-1], statement))
                    break
    return answers


def _answer_of(task: Answer, answered: list[Answer], theirs: list[list[Statement]]) -> Answer | None:
    """The old answer to an exercise: that of its check, or a function of its name that no check gets."""
    of_check = [answer for answer in answered if answer.check == task.check]
    same_name = [answer for answer in of_check if answer.name == task.name]
    functions = [answer for answer in of_check if answer.is_function]
    if same_name or (task.is_function and functions):
        return (same_name or functions)[-1]
    # A function has one task in a notebook, while a variable may be the answer to several.
    if task.is_function:
        for cell in reversed(theirs):
            for statement in cell:
                found = Answer(task.check, task.name, cell, statement)
                if task.name in statement.defined and found.is_function and not found.is_open:
                    return found
    return None


def _with_answer(source: str, task: Answer, answer: Answer, own_functions: dict[str, str], fits: bool) -> str:
    """The text of the new cell with the student's statements in place of the open answer."""
    node = task.statement.node
    if node is None or node.end_lineno is None:
        return source
    lines = source.splitlines()
    given = {_without_comments(each.text, lines) for each in _statements(source)}
    same_cell = [each for each in answer.cell if _without_comments(each.text, lines) not in given]
    # The new cell has its check; but one statement may be answer and check, or no Python.
    same_cell = [
        each for each in same_cell if each.check is None or each.node is None or each is answer.statement
    ]
    theirs = list[str]()
    for each in same_cell:
        text = _without_comments(each.text, lines, each is answer.cell[0])
        theirs.append(text if each.node is not None or each.is_magic or not fits else _comment(text))
    used = _used([each.node for each in same_cell])
    needed = [own_functions[name] for name in used if name in own_functions]
    needed = [text for text in needed if text not in theirs]
    renamed = [f"{task.name} = {answer.name}"] if answer.name != task.name else []
    between = "\n\n\n" if isinstance(node, ast.FunctionDef) else "\n"
    written = between.join([*needed, *theirs, *renamed])
    if fits:
        return "\n".join([*lines[: node.lineno - 1], *written.splitlines(), *lines[node.end_lineno :]])
    comment = [ANOTHER, *_comment(written).splitlines()]
    return "\n".join([*lines[: node.end_lineno], *comment, *lines[node.end_lineno :]])


def _cell_of(notebook: dict[str, Any], source: str) -> dict[str, Any]:
    cell: dict[str, Any] = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": []}
    if any("id" in each for each in notebook["cells"]):
        cell["id"] = f"earlier-answers-{len(notebook['cells'])}"
    return {**cell, "source": source.splitlines(keepends=True)}


def _source(raw: dict[str, Any]) -> str:
    return "".join(raw["source"])


def _comment(text: str) -> str:
    return "\n".join(f"# {line}".rstrip() for line in text.splitlines())


def _statements(source: str) -> list[Statement]:
    """The statements of a cell; a line that is no Python, such as a magic command, hides no other."""
    lines = source.splitlines()
    starts = [number for number, line in enumerate(lines) if line.strip() and not CONTINUED.match(line)]
    ends = [*starts[1:], len(lines)]
    statements = list[Statement]()
    first = 0
    while first < len(starts):
        for last in range(first, len(starts)):
            text = "\n".join(lines[starts[first] : ends[last]]).rstrip()
            nodes = [] if MAGIC.match(lines[starts[first]]) else _parsed(text)
            if nodes:
                break
        else:  # no number of further lines completes it
            last = first
            text = "\n".join(lines[starts[first] : ends[first]]).rstrip()
            nodes = [None]
        shift = starts[first]
        moved = [None if node is None else ast.increment_lineno(node, shift) for node in nodes]
        statements += [Statement(text, moved[0])] if len(moved) == 1 else _on_one_line(text, moved)
        first = last + 1
    return statements


def _on_one_line(text: str, nodes: list[Any]) -> list[Statement]:
    """Statements with semicolons between them: the text belongs to the first."""
    return [Statement(text if number == 0 else ast.unparse(node), node) for number, node in enumerate(nodes)]


def _parsed(text: str) -> list[Any]:
    with suppress(SyntaxError, ValueError, RecursionError):
        return list(ast.parse(text).body)
    return []


def _check(node: object) -> tuple[str, str] | None:
    """The name of a check and of its answer, if this is the call of a check."""
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
        return None
    module = node.func.value
    answer = node.args[0]
    if isinstance(module, ast.Name) and CHAPTER.fullmatch(module.id) and isinstance(answer, ast.Name):
        return node.func.attr, answer.id
    return None


def _without_comments(text: str, lines: list[str], is_first: bool = False) -> str:
    """A statement without the comments above it that are the kit's, not the student's.

    These are the comments that the new cell, of these lines, has as well, and the heading of an older cell
    (`is_first`) where the new one has another heading.
    """
    own = text.splitlines()
    if is_first and own[0].startswith("#") and lines[0].startswith("#") and len(own) > 1:
        del own[0]
    while len(own) > 1 and (not own[0].strip() or (own[0].startswith("#") and own[0] in lines)):
        del own[0]
    return "\n".join(own)


def _arguments(node: ast.stmt | None) -> list[str] | None:
    """The names of the arguments of a function or of a lambda with a name; None for other statements."""
    function: Any = node if isinstance(node, ast.FunctionDef) else getattr(node, "value", None)
    if not isinstance(function, (ast.FunctionDef, ast.Lambda)):
        return None
    every = function.args
    plain = [each.arg for each in (*every.posonlyargs, *every.args, *every.kwonlyargs)]
    return [*plain, *(f"*{each.arg}" for each in (every.vararg, every.kwarg) if each is not None)]


def _is_dots(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and value.value is ...


def _own_functions(
    theirs: list[list[Statement]], cells: list[list[Statement]]
) -> tuple[dict[str, str], dict[str, str]]:
    """The functions that the student added to the old notebook, and those with another text now, by name."""
    known = {name: each.text for cell in cells for each in cell for name in each.defined}
    added = dict[str, str]()
    changed = dict[str, str]()
    for each in [each for cell in theirs for each in cell]:
        if isinstance(each.node, ast.FunctionDef):
            name = each.node.name
            if name not in known:
                added[name] = each.text
            elif known[name] != each.text:
                changed[name] = each.text
    return added, changed


def _used(nodes: list[ast.stmt | None]) -> Iterator[str]:
    """The names that statements use, each once, in their order."""
    every = [inner for node in nodes if node is not None for inner in ast.walk(node)]
    return iter(dict.fromkeys(node.id for node in every if isinstance(node, ast.Name)))
