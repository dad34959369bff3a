"""`vo data`: the scripts of the folder data_scripts, which is not read before one of them is wanted."""

from __future__ import annotations

import argparse
import ast
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from ..errors import DataError, did_you_mean
from ..files import read_text
from .console import say, show_table
from .script import ENDINGS, OneLineParser, exit_code

SCRIPTS = Path(__file__).resolve().parents[2] / "data_scripts"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo data`."""
    parser.epilog = "example: vo data get_kitti --sequences 07"
    parser.add_argument("name", nargs="?", metavar="NAME", help="a script of the list")
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="…", help="its options; try --help")
    parser.set_defaults(command=_data)


def _data(options: argparse.Namespace) -> int:
    purposes = scripts()
    if options.name is None:
        show_table("", ["script", "purpose"], [[*row] for row in purposes.items()], numbers=False)
        say("vo data NAME --help: options, examples")
        return 0
    if options.name not in purposes:
        near = did_you_mean(options.name, purposes)
        raise DataError(f"no data script is called {options.name!r}; {near}`vo data` lists them")
    if str(SCRIPTS) not in sys.path:
        sys.path.insert(0, str(SCRIPTS))  # scripts import each other as programs of one folder do
    return run_script(importlib.import_module(options.name), options.words)


def scripts() -> dict[str, str]:
    """The first line of each script's docstring by the script's name."""
    if not SCRIPTS.is_dir():
        raise DataError("the data scripts lie in the kit's folder: install it from there with -e .", SCRIPTS)
    docs = {path.stem: ast.get_docstring(ast.parse(read_text(path))) for path in SCRIPTS.glob("[!_]*.py")}
    return {name: (docs[name] or "").partition("\n")[0] for name in sorted(docs)}


def run_script(script: ModuleType, words: Sequence[str] | None = None) -> int:
    """The exit code of a script: `add_options(parser)` declares its options, `run(options)` does the work."""
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
