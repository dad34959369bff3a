"""Functions of a student: storage in `my_vo.py` beside the notebooks, and detection of library calls."""

from __future__ import annotations

import ast
import codecs
import dis
import inspect
import re
import sys
import textwrap
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

import vo_lib
from vo_lib.errors import DataError
from vo_lib.files import read_bytes, write_atomic

NAME = "my_vo.py"
SECTION = re.compile(r"^# ---- (\w+) ----\r?\n", re.MULTILINE)  # before a function and its dependencies
# Instructions with the name of a function.
CALLED = ("LOAD_GLOBAL", "LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM")
COURSE_FILE = "00_start_here.ipynb"  # a folder with this file is one of notebooks or of solutions
LARGEST = 5000  # maximal size of an array that is saved
KIT = ("vo_lib", __package__)  # whose functions are nobody's answers
KIT_FOLDERS = (Path(vo_lib.__path__[0]), Path(__file__).parent)
# The encoding of a Python file, in lines 1 and 2.
DECLARED = re.compile(rb"^[ \t\f]*#.*?coding[:=][ \t]*([-\w.]+)")
USUAL = "cp1252"  # the encoding of editors on Windows that do not write UTF-8
NOT_SAVED = "was not saved"  # in the sentences about functions that my_vo.py does not get
LAYERS = 20  # of wrappers round a function
HEAD = '"""My visual odometry: the functions that passed their checks in the notebooks."""'


def store_answer(function: Any, grade: Callable[[Any], Any] | None = None) -> str:
    """Write a function and its dependencies into its section of `my_vo.py`; return a sentence.

    Dependencies are imports, other functions and classes of the student (by source) and constants of the
    notebook (by value). The rest of the file does not change. In a folder without `00_start_here.ipynb` (of
    tests or scripts), and for a function without source (a lambda, a function of a console), nothing is
    written and the result is "". `grade`, the check, also tests the saved function. Never raises.
    """
    if not (Path(COURSE_FILE).is_file() and isinstance(function, FunctionType)):
        return ""
    if module := kit_module_of(function):
        return f" It {NOT_SAVED} in `{NAME}`: it is the kit's own, of `{module}`."
    try:
        _source(function)
    except (OSError, SyntaxError, ValueError):
        return ""
    path = Path(NAME)
    name = function.__name__
    try:
        load_functions(path)  # or say that the file cannot be run
        text = HEAD
        if path.exists():
            text, _ = decoded(read_bytes(path), path)
        head, written = _split_sections(text)
        sections = {**dict(written), name: _section(function)}
        parts = [head.rstrip()]
        for section, source in sections.items():
            parts.append(f"# ---- {section} ----\n{source.rstrip()}")
        write_atomic(path, "\n\n\n".join(parts) + "\n")
        verdict = grade(load_functions(path)[name]) if grade else None
    except Exception as error:  # an edited file, or a folder without write permission
        return f" It {NOT_SAVED} in `{NAME}`: {error}."
    if verdict is not None and not verdict.passed:
        return f" It is saved in `{NAME}`, but fails there: {verdict.message}"
    return f" It is saved in `{NAME}`."


def _split_sections(text: str) -> tuple[str, list[tuple[str, str]]]:
    """The part of a file above its sections, and the name and the source of each section."""
    head, *others = SECTION.split(text)  # names and sources in turn
    names = others[::2]
    sources = others[1::2]
    return head, list(zip(names, sources, strict=True))


def load_functions(path: Path) -> dict[str, Any]:
    """Definitions of a file of saved functions; none without a file. `DataError` if the file cannot be run.

    A section can use its own names and the names defined above the first section.
    """
    definitions, faults = load_sections(path)
    if faults:
        raise DataError(f"the file cannot be run, {next(iter(faults.values()))}", path)
    return definitions


def load_sections(
    path: Path, skipped: Collection[str] = (), begin: Callable[[str], None] | None = None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Definitions of a file of saved functions, and the faults of the sections that cannot be run, by name.

    The part above the first section has the name "". Sections in `skipped` are not run; `begin` is called with
    the name of each other one, before it runs. Raises `DataError` if the file is no text.
    """
    if not path.is_file():
        return {}, {}
    common: dict[str, Any] = {"__name__": path.stem}
    definitions = dict[str, Any]()
    named = dict[str, Any]()
    faults = dict[str, str]()
    text, _ = decoded(read_bytes(path), path)
    head, sections = _split_sections(text)
    above = ""  # empty lines in place of the parts before, so that errors have the lines of the file
    for name, source in [("", head), *sections]:
        own = dict(common) if name else common
        code = above + source
        lines = source.count("\n") + 1  # with the line of the next section's name
        above += "\n" * lines
        if name in skipped:
            continue
        if begin is not None:
            begin(name)
        try:
            exec(compile(code, path, "exec"), own)
        except ImportError as error:
            faults[name] = f"{_line_of(error, path)}{error}: compare its imports with those of the chapter"
        except (Exception, SystemExit, KeyboardInterrupt) as error:
            faults[name] = f"{_line_of(error, path)}{type(error).__name__}: {error}"
        else:
            definitions |= own
            if name in own:
                named[name] = own[name]
    # A section also has copies of the functions that its own one calls, as they were when it was saved. So a
    # function is taken from the section with its name, which has the version that passed last.
    return definitions | named, faults


def _line_of(error: BaseException, path: Path) -> str:
    """The line of a file that raised an error, as the beginning of a message; "" if the message names it anyway."""
    lines = [step.lineno for step in traceback.extract_tb(error.__traceback__) if step.filename == str(path)]
    return f"line {lines[-1]}: " if lines else ""


def decoded(content: bytes, path: Path) -> tuple[str, str]:
    """The text of a Python file, and a remark if its encoding is not UTF-8; "" otherwise.

    Without UTF-8, the encoding is that of its byte order mark, of its line `# coding: …`, or that of Windows.
    Raises `DataError`, with the line, if the bytes are no text in it.
    """
    try:
        return content.decode("utf-8-sig"), ""
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    else:
        encoding = USUAL
        for each in content.splitlines()[:2]:
            declared = DECLARED.match(each)
            if declared:
                encoding = declared[1].decode("ascii")
                break
    with suppress(LookupError, ValueError):  # an unknown encoding, or bytes that it does not have
        return content.decode(encoding), f"line {line} is not in UTF-8, so the file was read as {encoding}"
    raise DataError("is not text in UTF-8: save the file with the encoding UTF-8", path, line)


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
        for used in _global_names(source):
            if used not in around or used in definitions:
                continue
            line = _import_line(used, around[used], function.__module__)
            if line:
                imports.add(line)
            elif isinstance(around[used], (FunctionType, type)):
                add(used, around[used])
            else:
                imports.add("import numpy as np")
                definitions[used] = f"{used} = {_constant_source(used, around[used])}"
        del definitions[name]  # its place is after its dependencies
        definitions[name] = source

    add(function.__name__, function)
    return "\n\n\n".join(["\n".join(sorted(imports)), *definitions.values()]).lstrip()


def _global_names(source: str) -> list[str]:
    """Global names in the source of a function or class: all names except parameters and assigned names."""
    tree = ast.parse(source)
    parameters = {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    own = parameters | {node.id for node in names if isinstance(node.ctx, ast.Store)}
    return sorted({node.id for node in names} - own)


def _import_line(name: str, value: Any, home: str) -> str:
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


def _constant_source(name: str, value: Any) -> str:
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


def kit_module_of(answer: Any) -> str:
    """The module of the library or of the course from which the code of a function comes; "" for any other.

    Looks through `functools.partial`, decorators and methods. A function that only calls one of the kit is not
    recognised here.
    """
    for each in _layers(answer):
        module = str(getattr(each, "__module__", ""))
        code = getattr(each, "__code__", None)
        file = Path(code.co_filename) if isinstance(code, CodeType) else Path()
        if module.partition(".")[0] in KIT or any(file.is_relative_to(folder) for folder in KIT_FOLDERS):
            return module
    return ""


def _layers(answer: Any) -> Iterator[Any]:
    """An answer and the functions that it wraps."""
    layer = answer
    for _ in range(LAYERS):
        yield layer
        if isinstance(layer, partial):
            layer = layer.func
        elif hasattr(layer, "__wrapped__"):
            layer = layer.__wrapped__
        elif hasattr(layer, "__func__"):
            layer = layer.__func__
        elif not isinstance(layer, FunctionType) and isinstance(type(layer).__call__, FunctionType):
            layer = type(layer).__call__
        else:
            return


def library_call_in(answer: Any, names: Sequence[str]) -> str:
    """The first function in `names` that an answer calls, or the answer itself if in `names`; otherwise "".

    An answer that is a function of the library or of the course may call any function.
    """
    module = str(getattr(answer, "__module__", ""))
    if not isinstance(answer, FunctionType) or module.startswith(("vo_lib.", __package__)):
        name = str(getattr(answer, "__name__", ""))
        return name if name in names and not module.startswith(__package__) else ""
    for code in _codes_of(answer.__code__):
        for step in dis.get_instructions(code):
            value = answer.__globals__.get(step.argval) if step.opname == "LOAD_GLOBAL" else None
            name = str(getattr(value, "__name__", step.argval))
            own = value is not None and getattr(value, "__module__", "") == module
            if step.opname.startswith(CALLED) and name in names and not own:
                return name
    return ""


def _codes_of(code: CodeType) -> Iterator[CodeType]:
    """The code of a function, then that of the functions and comprehensions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes_of(constant)
