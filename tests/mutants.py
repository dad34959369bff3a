"""Do the tests notice faults? Makes the faults of mutants.txt one by one and runs the tests that must fail.

    python tests/mutants.py                  all of them, two at a time
    python tests/mutants.py five_point       those of files with this in their names

Not part of the test suite: all of them take twenty minutes or more. First the tests must pass without a
fault. In mutants.txt a line `= FILE: TESTS` is followed by faults of that file: `- line` as it is, `+ line`
as it is made, and `? reason` where no test can tell. A line that is no longer there, or is there twice, is
said and counts as survived: mend the list then.
"""

from __future__ import annotations

import argparse
import os
import queue
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_suffix(".txt")
COPIED = ("vo_lib", "data_scripts", "tests", "notebooks", "pyproject.toml", "README.md")
LONGEST = 600  # seconds; a fault that makes tests hang is noticed too
WANTED = 0.95


@dataclass(frozen=True)
class Mutant:
    """One line of a file as it is and as it is made, and the tests that must fail."""

    file: str
    tests: list[str]
    line: str
    made: str
    reason: str = ""


def read_list(text: str) -> list[Mutant]:
    """The faults of mutants.txt; `ValueError` names a line that does not belong."""
    found: list[Mutant] = []
    file, tests, line = "", [""], ""
    for number, row in enumerate(text.splitlines(), 1):
        mark, rest = row[:2], row[2:]
        if mark == "= ":
            file, _, names = rest.partition(": ")
            tests = names.split()
        elif mark == "- ":
            line = rest
        elif mark == "+ " and line:
            found.append(Mutant(file, tests, line, rest))
            line = ""
        elif mark == "? " and found:
            found[-1] = replace(found[-1], reason=rest)
        elif row.strip():
            raise ValueError(f"mutants.txt, line {number}: expected =, -, + or ?")
    return found


def mutated(text: str, mutant: Mutant) -> str | None:
    """The file's text with the fault; None where the line is not there exactly once."""
    lines = text.split("\n")
    at = [i for i, line in enumerate(lines) if line.strip() == mutant.line]
    if len(at) != 1:
        return None
    indent = lines[at[0]][: len(lines[at[0]]) - len(lines[at[0]].lstrip())]
    lines[at[0]] = indent + mutant.made
    return "\n".join(lines)


def passes(tests: list[str], copy: Path) -> bool:
    """Whether the tests pass in a copy of the checkout; hanging is failing."""
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *tests]
    env = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(words, cwd=copy, env=env, capture_output=True, timeout=LONGEST, check=False)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def verdict(mutant: Mutant, copy: Path) -> str:
    """What the tests say in a copy of the checkout: "killed", "survived" or "not there"."""
    path = copy / mutant.file
    before = path.read_text(encoding="utf-8")
    text = mutated(before, mutant)
    if text is None:
        return "not there"
    path.write_text(text, encoding="utf-8")
    try:
        return "survived" if passes(mutant.tests, copy) else "killed"
    finally:
        path.write_text(before, encoding="utf-8")


def main() -> int:
    """Run the faults asked for; 0 when at least 95 % of them are noticed."""
    parser = argparse.ArgumentParser(description="Do the tests notice faults?")
    parser.add_argument("part", nargs="?", default="", help="only faults of files with this in their names")
    parser.add_argument("--jobs", type=int, default=2, help="faults at a time; default 2")
    options = parser.parse_args()
    mutants = [m for m in read_list(LIST.read_text(encoding="utf-8")) if options.part in m.file]
    with tempfile.TemporaryDirectory() as folder:
        copies: queue.Queue[Path] = queue.Queue()
        for job in range(options.jobs):
            copy = Path(folder, str(job))
            copy.mkdir()
            for name in COPIED:
                source = ROOT / name
                (shutil.copytree if source.is_dir() else shutil.copy)(source, copy / name)
            copies.put(copy)

        def judge(mutant: Mutant) -> str:
            copy = copies.get()
            try:
                return verdict(mutant, copy)
            finally:
                copies.put(copy)

        first = copies.get()
        if not passes(sorted({test for mutant in mutants for test in mutant.tests}), first):
            print("the tests fail without a fault, or there are none")
            return 2
        copies.put(first)
        survived = 0
        with ThreadPoolExecutor(options.jobs) as pool:
            for mutant, said in zip(mutants, pool.map(judge, mutants), strict=True):
                survived += said != "killed"
                print(f"{said:9s} {mutant.file}: {mutant.made}", flush=True)
                if said != "killed" and mutant.reason:
                    print(f"          {mutant.reason}")
    share = 1.0 - survived / max(len(mutants), 1)
    print(f"{len(mutants) - survived} of {len(mutants)} faults noticed ({100 * share:.0f} %)")
    return 0 if mutants and share >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
