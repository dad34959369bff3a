"""`vo data`: the scripts of the folder data_scripts. A script is imported only to run or describe it."""

from __future__ import annotations

import argparse
import ast
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from ..checkout import kit_subfolder
from ..errors import DataError, did_you_mean
from ..files import read_text
from .console import ENDINGS, OneLineParser, exit_code, print_wrapped, show_table


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo data`."""
    parser.epilog = "example: vo data get_kitti --sequences 07"
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="the script to run; without it, the scripts are listed"
    )
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="…", help="the options of the script")
    parser.set_defaults(command=_data)


def _data(options: argparse.Namespace) -> int:
    """Run a script and return its exit code, or list the scripts."""
    if options.name is None:
        show_table(["script", "purpose"], [[*row] for row in scripts().items()], numbers=False)
        print_wrapped("vo data NAME --help: options and examples of a script")
        return 0
    names = [path.stem for path in _script_files()]
    if options.name not in names:
        near = did_you_mean(options.name, names)
        raise DataError(f"unknown data script {options.name!r}; {near}`vo data` lists the scripts")
    folder = str(kit_subfolder("data_scripts"))
    if folder not in sys.path:
        sys.path.insert(0, folder)  # the scripts import each other as modules of one folder
    return run_script(importlib.import_module(options.name), options.words)


def scripts() -> dict[str, str]:
    """The first paragraph of each script's docstring as one line, by script name."""
    purposes = {}
    for path in _script_files():
        docstring = ast.get_docstring(ast.parse(read_text(path))) or ""
        purposes[path.stem] = " ".join(docstring.partition("\n\n")[0].split())
    return purposes


def _script_files() -> list[Path]:
    """The files of the scripts, by name."""
    return sorted(kit_subfolder("data_scripts").glob("[!_]*.py"))


def run_script(script: ModuleType, words: Sequence[str] | None = None) -> int:
    """Run a script, with its `add_options(parser)` and `run(options)`, and return the exit code."""
    parser = OneLineParser(
        prog=f"vo data {Path(str(script.__file__)).stem}",
        description=script.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    script.add_options(parser)
    options = parser.parse_args(words)
    try:
        return int(script.run(options))
    except ENDINGS as error:
        return exit_code(parser.prog, error)
