"""Runs commands of `vo` in forks of one process, in which the library is imported once.

A line of stdin has the words of a command, its folder and KILL_AT (see `kill_hook`), as JSON. The answer is a
line with its exit code and output, given when every process that it started has ended.
"""

import json
import os
import runpy
import signal
import sys
from contextlib import redirect_stdout, suppress
from pathlib import Path

import matplotlib.figure  # noqa: F401  (takes a second)

HOOK = Path(__file__).with_name("kill_hook")
LIMIT_S = 300  # for a command


def vo(*words: str) -> None:
    """Run a command as `python -m vo_lib` does, which ends this process."""
    sys.argv[1:] = words
    runpy.run_module("vo_lib", run_name="__main__")


def run(words: list[str], folder: str, kill_at: str) -> None:
    """Run a command in this process, the first of a group of its own, with a cache in its folder."""
    os.setsid()
    signal.alarm(LIMIT_S)
    os.chdir(folder)
    os.environ["XDG_CACHE_HOME"] = str(Path(folder, "user"))
    if kill_at:
        os.environ["KILL_AT"] = kill_at
        os.environ["PYTHONPATH"] += os.pathsep + str(HOOK)  # of the worker processes
        runpy.run_path(str(HOOK / "sitecustomize.py"))
    vo(*words)


for name in ("run", "sweep", "data"):
    with open(os.devnull, "w") as nowhere, suppress(SystemExit), redirect_stdout(nowhere):
        vo(name, "--help")  # imports the command
for line in sys.stdin:
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(writer, 1)
        os.dup2(writer, 2)
        os.close(writer)
        run(*json.loads(line))
    os.close(writer)
    with open(reader, encoding="utf-8") as output:
        told = output.read()
    _, status = os.waitpid(child, 0)
    print(json.dumps([os.waitstatus_to_exitcode(status), told]), flush=True)
