"""The data scripts called as `vo data NAME`."""

from __future__ import annotations

from collections.abc import Callable

from vo_lib.commands.cli import main


def load(name: str) -> Callable[[list[str]], int]:
    """A function that runs a script with arguments and returns the exit code, including argparse's codes."""

    def run(words: list[str]) -> int:
        try:
            return main(["data", name, *words])
        except SystemExit as stop:
            return int(str(stop.code))

    return run
