"""Whether the Python of this kernel has the kit; imports only what every Python has."""

from __future__ import annotations

import importlib.util
import sys

from .notebook_folder import NOTEBOOKS

NEEDED = ("vo_lib", "numpy", "cv2", "matplotlib", "ipywidgets")
KIT_PYTHON = ".kit_python"  # in the folder of the course: the Python of `vo lab`
# Of the environment that the README's command makes, seen from a clone's notebooks.
ENVIRONMENTS = ("../.venv/bin/python", "../.venv/Scripts/python.exe")


class NoKit(ImportError):
    """The kernel's Python lacks the kit."""


def require_kit() -> None:
    """Raise `NoKit` with the Python that has the kit, unless it is that of this kernel.

    In a notebook, only this sentence is shown, without a traceback.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if not missing:
        return
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    if shell is not None:
        shell.set_custom_exc(
            (NoKit,), lambda self, kind, error, *_, **__: self._showtraceback(kind, error, [str(error)])
        )
    raise NoKit(
        f"The Python of this kernel, {sys.executable}, lacks the kit ({missing[0]} is missing): choose the kernel "
        f"of {_kit_python()}, or open the course with `vo lab`."
    )


def _kit_python() -> str:
    """The Python that has the kit, as far as it is known."""
    written = NOTEBOOKS / KIT_PYTHON
    if written.is_file():
        return written.read_text(encoding="utf-8").strip()
    for place in ENVIRONMENTS:
        python = NOTEBOOKS / place
        if python.is_file():
            # The program itself may be a link to the system's Python, which is another one: it stays as it is.
            environment = python.parents[1].resolve()
            return str(environment / python.parent.name / python.name)
    return "the kit's environment"
