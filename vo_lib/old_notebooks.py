"""A sentence in place of a traceback where a notebook of an older version uses a name that is gone.

A student's notebook stays as it is when the kit is updated, while the code that it imports is replaced. The
current notebook then lies beside it, as NAME.new.ipynb (`vo lab`).
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any

FIRST_NOTEBOOK = "00_start_here.ipynb"  # a file of every folder of the course
NOTEBOOK = ".ipynb"
# A notebook NAME.ipynb that its reader has changed stays. Beside it, the current version is NAME.new.ipynb
# or, if that was changed as well, NAME.new.new.ipynb.
NEW = ".new"
PACKAGES = ("course", "vo_lib")  # the kit's; only for their names is there an explanation


def watch_notebook() -> None:
    """In a notebook in a folder of the course, explain names that are gone; elsewhere, nothing changes."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    if shell is not None and Path(FIRST_NOTEBOOK).is_file():
        shell.set_custom_exc((ImportError, AttributeError), _show_error)


def explanation(error: BaseException, notebook: str = "") -> str:
    """Why a name is not there, and which notebook to open; "" for an error of another kind.

    notebook : file name of the notebook, if it is known.
    """
    current = _current_versions_of(notebook) if notebook else _current_versions()
    # An attribute that an object lacks is mostly a slip of the reader. It is put down to an old notebook only
    # where a single newer one lies beside it, which can be named.
    missing = _missing_name(error, also_objects=len(current) == 1)
    if not missing:
        return ""
    this = notebook or "this notebook"
    if len(current) == 1:
        remedy = f"open {current[0]} beside it, which is current and has your answers"
    elif current:
        remedy = f"open its current version, with your answers, beside it: one of {', '.join(current)}"
    else:
        remedy = "`vo lab --copy-only` puts the current one beside it, with your answers"
    return f"{missing} is not there: {this} is of an older version; {remedy}. ({error})"


def _missing_name(error: BaseException, also_objects: bool) -> str:
    """The module or name that is missing, if it belongs to the kit; "" otherwise.

    also_objects : whether an attribute of an object counts, not only that of a module.
    """
    if isinstance(error, ImportError):
        module = error.name or ""
        if not _is_ours(module):
            return ""
        found = re.match(r"cannot import name '(\w+)'", str(error))
        return f"{module}.{found[1]}" if found else module
    if isinstance(error, AttributeError):
        thing = error.obj
        if isinstance(thing, ModuleType):
            return f"{thing.__name__}.{error.name}" if _is_ours(thing.__name__) else ""
        kind = thing if isinstance(thing, type) else type(thing)
        if also_objects and _is_ours(kind.__module__):
            return f"{kind.__name__}.{error.name}"
    return ""


def _is_ours(module: str) -> bool:
    """Whether a module, by its dotted name, is the kit's."""
    return module.partition(".")[0] in PACKAGES


def _current_versions_of(notebook: str) -> list[str]:
    """The current version of a notebook beside it, if there is one: that with the most `NEW` in its name."""
    old = notebook.removesuffix(NOTEBOOK)
    newest = old
    while Path(f"{newest}{NEW}{NOTEBOOK}").is_file():
        newest += NEW
    return [] if newest == old else [f"{newest}{NOTEBOOK}"]


def _current_versions() -> list[str]:
    """The current versions in this folder of all notebooks that their reader has changed."""
    new_versions = {path.name.removesuffix(NOTEBOOK) for path in Path().glob(f"*{NEW}{NOTEBOOK}")}
    current = [name for name in new_versions if f"{name}{NEW}" not in new_versions]
    return sorted(f"{name}{NOTEBOOK}" for name in current)


def _notebook(shell: Any) -> str:
    """The file name of this kernel's notebook, as Jupyter's server or VS Code tells it; "" if unknown."""
    path = os.environ.get("JPY_SESSION_NAME") or shell.user_ns.get("__vsc_ipynb_file__") or ""
    name = Path(str(path)).name
    return name if name.endswith(NOTEBOOK) else ""


def _show_error(
    shell: Any,
    kind: type[BaseException],
    error: BaseException,
    traceback: TracebackType | None,
    tb_offset: int | None = None,
) -> None:
    """IPython's handler: show the explanation, or the usual traceback of an error of another kind."""
    words = explanation(error, _notebook(shell))
    if words:
        shell._showtraceback(kind, error, [words])
    else:
        shell.showtraceback((kind, error, traceback), tb_offset=tb_offset)
