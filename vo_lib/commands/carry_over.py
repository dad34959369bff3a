"""Answers of an older notebook in the current version of it.

An answer is a function or a variable that the notebook leaves open with `...`, and that a check gets. A check
is the call of a function of a chapter's module with the answer as its first argument, such as
ch01.maxima(maxima). An answer is found again by its name and its check, so exercises may have other numbers
and texts. What cannot take its place as code any more is kept as a comment. The older notebook stays as it
is: this makes the text of the new one.
"""

from __future__ import annotations

import ast
import json
import re
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

CHAPTER = re.compile(r"ch\d\d|appendix")
MAGIC = re.compile(r"\s*[%!?]|\s*[\w.]+\?+\s*$")  # beginnings of lines for IPython, not for Python
# In a text that is no Python: what it defines, and the checks that it calls.
DEFINED = re.compile(r"^(?:def|class) +(\w+)|^(\w+) *(?::[^=\n]*)?=", re.MULTILINE)
CHECKED = re.compile(r"^(?:ch\d\d|appendix)\.(\w+)\((\w+)", re.MULTILINE)
# Beginnings of lines that belong to those above.
CONTINUED = re.compile(r"[\s)\]}]|(else|elif|except|finally)\b")
ANOTHER = "# Your answer to an earlier version of this exercise:"
LEFT = "# Your answers to exercises that this notebook does not have any more:"


class Carried(NamedTuple):
    """A new notebook, and the names of the answers that it has as code and as comments."""

    content: bytes
    as_code: list[str]
    as_comments: list[str]


@dataclass(frozen=True)
class Statement:
    """A statement of a cell with the comments above it.

    node : the parsed statement, with the line numbers of the cell; None for a text that is no Python.
    """

    text: str
    node: ast.stmt | None

    @property
    def check(self) -> tuple[str, str] | None:
        """The name of the check that the statement calls, and of its answer; None without a check."""
        if self.node is None:
            found = CHECKED.search(self.text)
            return (found[1], found[2]) if found else None
        call = _value_of(self.node)
        if isinstance(call, ast.Call) and len(call.args) == 1:
            # The call may be that of the check, or show the result of a check, as print does.
            return _check(call) or _check(call.args[0])
        return _check(call)

    @property
    def defined(self) -> list[str]:
        """The names that the statement defines: of a function, a class, or of variables."""
        if self.node is None:
            # `DEFINED` finds a pair: the name of a function, or that of a variable; the other one is empty.
            return [function or variable for function, variable in DEFINED.findall(self.text)]
        if isinstance(self.node, (ast.FunctionDef, ast.ClassDef)):
            return [self.node.name]
        names = []
        for target in _targets_of(self.node):
            for part in ast.walk(target):
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                    names.append(part.id)
        return names

    @property
    def is_magic(self) -> bool:
        """Whether all lines are commands for IPython."""
        lines = [line for line in self.text.splitlines() if line.strip()]
        return self.node is None and all(MAGIC.match(line) for line in lines)


@dataclass(frozen=True)
class Answer:
    """An answer of a notebook.

    In the new notebook, an exercise is an `Answer` too, which is still open unless a later version answers
    it.

    check, name : names of the check that gets it, and of the function or variable.
    cell : the statements of its cell.
    statement : the one that defines it.
    checked_by : the one that calls the check; None if no check gets it.
    """

    check: str
    name: str
    cell: list[Statement]
    statement: Statement
    checked_by: Statement | None = None

    @property
    def is_function(self) -> bool:
        """Whether the answer is a function, and not a variable."""
        return _arguments(self.statement.node) is not None

    @property
    def is_open(self) -> bool:
        """Whether the answer is still missing: `...` as the value, or as a line of the function."""
        node = self.statement.node
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            return any(value is None or _is_dots(value) for value in values)
        parts = [] if node is None else ast.walk(node)
        return any(isinstance(part, ast.Expr) and _is_dots(part.value) for part in parts)

    @property
    def is_kept_as_comment(self) -> bool:
        """Whether the new notebook keeps the answer as a comment if it lacks the exercise.

        It does not keep a variable in a call such as `x = ch03.solve(E)`: since the result is used, this is
        probably no check.
        """
        if self.is_function or self.checked_by is None:
            return True
        return self.checked_by.node is None or isinstance(self.checked_by.node, ast.Expr)


@dataclass(frozen=True)
class _OldNotebook:
    """What an old notebook has of its student.

    cells : the statements of each code cell.
    answers : those that are not open any more.
    added_functions : texts of the functions that the student added, by name.
    changed_functions : texts of the functions that are different in the new notebook, by name.
    """

    cells: list[list[Statement]]
    answers: list[Answer]
    added_functions: dict[str, str]
    changed_functions: dict[str, str]


class _Filled(NamedTuple):
    """The exercises of a cell to which the student has an answer.

    as_code, as_comments : names of the answers that were written into the cell.
    found : the statements of all answers, also of those to exercises that a later version answers itself.
    """

    as_code: list[str]
    as_comments: list[str]
    found: list[Statement]


def carry_over(old: bytes, new: bytes) -> Carried:
    """The new notebook with the answers of the old one. A notebook that cannot be read has no answers.

    An answer whose function takes other arguments now is put below the open one, as a comment. Answers to
    exercises that are gone are comments in a last cell.
    """
    try:
        old_cells = [_statements(_source(raw)) for raw in _code_cells(json.loads(old))]
        notebook = json.loads(new)
        raw_cells = _code_cells(notebook)
        new_cells = [_statements(_source(raw)) for raw in raw_cells]
    except (ValueError, LookupError, TypeError, AttributeError):
        return Carried(new, [], [])
    answers = [answer for answer in _answers(old_cells) if not answer.is_open]
    student = _OldNotebook(old_cells, answers, *_own_functions(old_cells, new_cells))
    filled = [_fill_cell(raw, student) for raw in raw_cells]
    found = [statement for cell in filled for statement in cell.found]
    left = [
        answer
        for answer in answers
        if answer.is_kept_as_comment and not any(answer.statement is statement for statement in found)
    ]
    as_code = [name for cell in filled for name in cell.as_code]
    as_comments = [name for cell in filled for name in cell.as_comments]
    as_comments += _append_left_answers(notebook, left)
    if not as_code and not as_comments:
        return Carried(new, [], [])
    content = (json.dumps(notebook, indent=1, ensure_ascii=False) + "\n").encode()
    return Carried(content, as_code, list(dict.fromkeys(as_comments)))


def _fill_cell(raw: dict[str, Any], student: _OldNotebook) -> _Filled:
    """Write the student's answers to the exercises of a cell into the cell, which is part of a notebook."""
    filled = _Filled([], [], [])
    for number in range(len(_answers_in(raw))):
        # The cell is read anew for each exercise, because an answer to the one before has moved its lines.
        exercise = _answers_in(raw)[number]
        answer = _answer_to(exercise, student)
        if answer is None:
            continue
        filled.found.append(answer.statement)
        if not exercise.is_open:
            continue  # a later version of the notebook has an answer
        same_arguments = _arguments(exercise.statement.node) == _arguments(answer.statement.node)
        fits = same_arguments and answer.statement.node is not None
        text = _with_answer(_source(raw), exercise, answer, student.added_functions, fits)
        value = _value_of(answer.statement.node)
        if isinstance(value, ast.Name) and value.id in student.changed_functions:
            # The answer names a function of the notebook whose text is another one now: the student, or a
            # later version of the notebook, changed it.
            text += f"\n{ANOTHER}\n{_comment(student.changed_functions[value.id])}"
            filled.as_comments.append(value.id)
        raw["source"] = text.splitlines(keepends=True)
        if fits:
            filled.as_code.append(exercise.name)
        else:
            filled.as_comments.append(exercise.name)
    return filled


def _answers_in(raw: dict[str, Any]) -> list[Answer]:
    """The answers of a single cell, as in the notebook's JSON."""
    return _answers([_statements(_source(raw))])


def _append_left_answers(notebook: dict[str, Any], left: list[Answer]) -> list[str]:
    """Add a last cell with answers as comments, unless the notebook has them already; return their names."""
    present = [_source(raw) for raw in _code_cells(notebook)]
    comments: dict[str, None] = {}  # each once
    names = []
    for answer in left:
        comment = _comment(answer.statement.text)
        if not any(comment in source for source in present):
            comments[comment] = None
            names.append(answer.name)
    if comments:
        notebook["cells"].append(_cell_of(notebook, "\n\n".join([LEFT, *comments])))
    return names


def _answers(cells: list[list[Statement]]) -> list[Answer]:
    """The answers that checks get, each from the cell of its check or from the last one before."""
    answers = list[Answer]()
    for number, cell in enumerate(cells):
        for statement in cell:
            if statement.check is None:
                continue
            check, name = statement.check
            for place in [cell, *reversed(cells[:number])]:
                definitions = [each for each in place if name in each.defined]
                if definitions:
                    answers.append(Answer(check, name, place, definitions[-1], statement))
                    break
    return answers


def _answer_to(exercise: Answer, student: _OldNotebook) -> Answer | None:
    """The student's answer to an exercise: that of its check, or a function of its name that no check gets.

    Of several, the last one counts; one of the same name goes before a function of another name.
    """
    of_check = [answer for answer in student.answers if answer.check == exercise.check]
    same_name = [answer for answer in of_check if answer.name == exercise.name]
    if same_name:
        return same_name[-1]
    # A function answers one exercise of a notebook, while a variable may be the answer to several.
    if not exercise.is_function:
        return None
    functions = [answer for answer in of_check if answer.is_function]
    if functions:
        return functions[-1]
    for cell in reversed(student.cells):
        for statement in cell:
            answer = Answer(exercise.check, exercise.name, cell, statement)
            if exercise.name in statement.defined and answer.is_function and not answer.is_open:
                return answer
    return None


def _with_answer(
    source: str, exercise: Answer, answer: Answer, added_functions: dict[str, str], fits: bool
) -> str:
    """The text of the new cell with the student's statements in place of the open answer.

    added_functions : texts of the functions that the student added anywhere in the old notebook, by name.
    fits : whether the answer can be code here; otherwise it stands below the open answer, as a comment.
    """
    node = exercise.statement.node
    if node is None or node.end_lineno is None:
        return source
    lines = source.splitlines()
    before = lines[: node.lineno - 1]
    open_answer = lines[node.lineno - 1 : node.end_lineno]
    after = lines[node.end_lineno :]
    own_statements = _statements_of_student(answer, source)
    texts = list[str]()
    for statement in own_statements:
        text = _without_comments(statement.text, lines, is_first=statement is answer.cell[0])
        can_be_code = statement.node is not None or statement.is_magic
        texts.append(_comment(text) if fits and not can_be_code else text)
    used = _used([statement.node for statement in own_statements])
    needed = [added_functions[name] for name in used if name in added_functions]
    needed = [text for text in needed if text not in texts]
    renamed = [f"{exercise.name} = {answer.name}"] if answer.name != exercise.name else []
    between = "\n\n\n" if isinstance(node, ast.FunctionDef) else "\n"
    written = between.join([*needed, *texts, *renamed])
    if fits:
        return "\n".join([*before, *written.splitlines(), *after])
    return "\n".join([*before, *open_answer, ANOTHER, *_comment(written).splitlines(), *after])


def _statements_of_student(answer: Answer, source: str) -> list[Statement]:
    """The statements in the cell of an answer that the new cell, with this source, lacks.

    The call of the check is not among them, since the new cell has its own. But a statement may be answer and
    check at once, and a text that is no Python may have both; these stay.
    """
    lines = source.splitlines()
    given = {_without_comments(statement.text, lines) for statement in _statements(source)}
    own_statements = list[Statement]()
    for statement in answer.cell:
        is_given = _without_comments(statement.text, lines) in given
        is_python = statement.node is not None
        is_only_check = statement.check is not None and is_python and statement is not answer.statement
        if not is_given and not is_only_check:
            own_statements.append(statement)
    return own_statements


def _cell_of(notebook: dict[str, Any], source: str) -> dict[str, Any]:
    """A code cell for a notebook, with an id if its cells have ids."""
    cell: dict[str, Any] = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": []}
    if any("id" in each for each in notebook["cells"]):
        cell["id"] = f"earlier-answers-{len(notebook['cells'])}"
    cell["source"] = source.splitlines(keepends=True)
    return cell


def _code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """The code cells of a notebook, as in its JSON."""
    return [raw for raw in notebook["cells"] if raw["cell_type"] == "code"]


def _source(raw: dict[str, Any]) -> str:
    """The text of a cell."""
    return "".join(raw["source"])


def _comment(text: str) -> str:
    """A text with each of its lines as a comment."""
    return "\n".join(f"# {line}".rstrip() for line in text.splitlines())


def _statements(source: str) -> list[Statement]:
    """The statements of a cell; a line that is no Python, such as a magic command, hides no other."""
    lines = source.splitlines()
    # A block is a line that may begin a statement, with those that belong to it.
    starts = [number for number, line in enumerate(lines) if line.strip() and not CONTINUED.match(line)]
    ends = [*starts[1:], len(lines)]
    statements = list[Statement]()
    first = 0
    while first < len(starts):
        last, nodes = _first_complete(lines, starts, ends, first)
        text = "\n".join(lines[starts[first] : ends[last]]).rstrip()
        if not nodes:
            statements.append(Statement(text, None))
        for number, node in enumerate(nodes):
            # Of statements with semicolons between them, the text belongs to the first.
            of_node = text if number == 0 else ast.unparse(node)
            statements.append(Statement(of_node, ast.increment_lineno(node, starts[first])))
        first = last + 1
    return statements


def _first_complete(
    lines: list[str], starts: list[int], ends: list[int], first: int
) -> tuple[int, list[ast.stmt]]:
    """The fewest blocks, from `first` on, that are Python: the number of the last, and their statements.

    If no number of blocks is Python, the first one stands alone, without statements.
    """
    if not MAGIC.match(lines[starts[first]]):
        for last in range(first, len(starts)):
            nodes = _parsed("\n".join(lines[starts[first] : ends[last]]).rstrip())
            if nodes:
                return last, nodes
    return first, []


def _parsed(text: str) -> list[ast.stmt]:
    """The statements of a text; none for a text that is no Python."""
    with suppress(SyntaxError, ValueError, RecursionError):
        return list(ast.parse(text).body)
    return []


def _value_of(node: ast.stmt | None) -> ast.expr | None:
    """The expression of a statement that is one, or what an assignment assigns; None for other statements."""
    value: ast.expr | None = getattr(node, "value", None)
    return value


def _targets_of(node: ast.stmt) -> list[ast.expr]:
    """What an assignment or a loop assigns to; none for other statements."""
    targets: list[ast.expr] = list(getattr(node, "targets", []))
    target: ast.expr | None = getattr(node, "target", None)
    return targets if target is None else [target]


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
    function = node if isinstance(node, ast.FunctionDef) else _value_of(node)
    if not isinstance(function, (ast.FunctionDef, ast.Lambda)):
        return None
    every = function.args
    names = [argument.arg for argument in (*every.posonlyargs, *every.args, *every.kwonlyargs)]
    for argument in (every.vararg, every.kwarg):
        if argument is not None:
            names.append(f"*{argument.arg}")
    return names


def _is_dots(value: ast.expr) -> bool:
    """Whether an expression is `...`."""
    return isinstance(value, ast.Constant) and value.value is ...


def _own_functions(
    old_cells: list[list[Statement]], new_cells: list[list[Statement]]
) -> tuple[dict[str, str], dict[str, str]]:
    """The functions that the student added to the old notebook, and those that are different now.

    Both are texts by name.
    """
    new_texts = dict[str, str]()
    for cell in new_cells:
        for statement in cell:
            new_texts |= dict.fromkeys(statement.defined, statement.text)
    added = dict[str, str]()
    changed = dict[str, str]()
    for cell in old_cells:
        for statement in cell:
            if isinstance(statement.node, ast.FunctionDef):
                name = statement.node.name
                if name not in new_texts:
                    added[name] = statement.text
                elif new_texts[name] != statement.text:
                    changed[name] = statement.text
    return added, changed


def _used(nodes: list[ast.stmt | None]) -> list[str]:
    """The names that statements use, each once, in their order."""
    names: dict[str, None] = {}
    for node in nodes:
        parts = [] if node is None else ast.walk(node)
        for part in parts:
            if isinstance(part, ast.Name):
                names[part.id] = None
    return list(names)
