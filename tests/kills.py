"""Is anything lost when a command is killed? Kills commands at random moments and starts them again.

    python tests/kills.py                 60 kills, about six minutes
    python tests/kills.py --kills 200 --seed 7

Not part of the test suite. Each command runs once undisturbed. Then it is killed at a random moment, and each
file with a final name must be as in the undisturbed run, or say that it is unfinished; the same command again
must end with 0 and leave the same files. Milliseconds and what is hashed with them may differ, nothing else.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from conftest import write_bands

# SEQUENCE and OUT stand for the folders of the sequence and of the results.
COMMANDS = {
    "run": "run SEQUENCE --method feature_selection --out OUT/run",
    "run as published": "run SEQUENCE --variant published --method mesvo_f --out OUT/run",
    "run with a cache and a film": "run SEQUENCE --cache OUT/cache --video OUT/film.avi --out OUT/run",
    "sweep": "sweep --sequence SEQUENCE --set selection.sets=20,50 --seeds 2 --jobs 2 --out OUT/sweep",
    "reproduce": "reproduce --sequences SEQUENCE --seeds 1 --jobs 2 --lengths 1,2 --out OUT/table",
    "calibrate": "calibrate SEQUENCE --out OUT/calibration.json",
    "write_labels": "data write_labels SEQUENCE --model street --out OUT/labels --pictures OUT/seen",
    "render_synthetic": "data render_synthetic empty --length 12 --width 320 --height 120 --cache OUT/cache",
    "from_folder": "data from_folder --left SEQUENCE/image_0 --right SEQUENCE/image_1 --out OUT/mine "
    "--focal 300 --centre 240,120 --baseline 0.5 --copy",
    "evaluate": "evaluate --truth SEQUENCE/poses.txt --estimate SEQUENCE/poses.txt --lengths 1,2 --out OUT/e",
}
# Of JSON: what may differ, and the hashes of the files that hold it.
CHANGES = {"commit", "timing", "back_end_ms", "files"}


def run(words: str, sequence: Path, out: Path, limit: float | None = None) -> str:
    """How a command ended, "" where it ended well; "killed" where it took longer than `limit` seconds."""
    filled = [w.replace("SEQUENCE", str(sequence)).replace("OUT", str(out)) for w in words.split()]
    process = subprocess.Popen(
        [sys.executable, "-m", "vo_lib", *filled],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=os.environ | {"XDG_CACHE_HOME": str(out / "user")},
        start_new_session=True,
    )
    try:
        _, error = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return "killed"
    return f"ended with {process.returncode}: {error.decode()}" if process.returncode else ""


def without_times(data: Any) -> Any:
    """JSON data without what may differ."""
    if isinstance(data, dict):
        return {key: without_times(value) for key, value in data.items() if key not in CHANGES}
    return [without_times(value) for value in data] if isinstance(data, list) else data


def content(path: Path, out: Path) -> Any:
    """What a file says, without times and without the name of the folder; ValueError where it is cut."""
    if path.suffix == ".json":
        return without_times(json.loads(path.read_text(encoding="utf-8").replace(str(out), "OUT")))
    if path.suffix == ".csv":
        with open(path, encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))
        timed = {i for i, name in enumerate(rows[0] if rows else []) if "ms" in name.split("_")}
        return [[cell for i, cell in enumerate(row) if i not in timed] for row in rows]
    return path.read_bytes()


def files(out: Path) -> dict[str, Any]:
    """Contents by name of all files that have their final names, those of other libraries left out."""
    names = [str(path.relative_to(out)) for path in sorted(out.rglob("*")) if path.is_file()]
    ours = [name for name in names if not re.search(r"^user/(?!stereo-vo-kit)|(^|/)\.|\.lock$", name)]
    return {name: content(out / name, out) for name in ours}


def whole(name: str, now: Any, wanted: Any) -> bool:
    """Whether a file is as in the end, or says itself that more is to come."""
    if name.endswith("written.csv"):  # a list that grows
        return bool(now == wanted[: len(now)])
    return bool(now == wanted or (name.endswith("config.json") and now.get("unfinished")))


def losses(words: str, sequence: Path, out: Path, wanted: dict[str, Any], moment: float) -> list[str]:
    """Kill a command after `moment` seconds and start it again: what was lost."""
    ended = run(words, sequence, out, moment)
    left = files(out)
    lost = [f"{name} is not whole" for name in left if not whole(name, left[name], wanted.get(name))]
    again = run(words, sequence, out) if ended == "killed" else ended
    after = files(out)
    lost += [again] if again else []
    differing = [name for name in wanted | after if after.get(name) != wanted.get(name)]
    return lost + [f"{name} differs afterwards" for name in differing]


def main() -> int:
    """Kill commands; 0 when nothing was lost or half-written."""
    parser = argparse.ArgumentParser(description="Is anything lost when a command is killed?")
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        sequence = write_bands(Path(folder, "bands"), frames=14)
        time.sleep(3.0)  # hashes of images that are younger are not kept
        undisturbed = {}
        for name, words in COMMANDS.items():
            out = Path(folder, "whole", name)
            out.mkdir(parents=True)
            began = time.monotonic()
            if error := run(words, sequence, out):
                print(f"{name} {error}")
                return 2
            undisturbed[name] = files(out), time.monotonic() - began
        for number in range(options.kills):
            name = list(COMMANDS)[number % len(COMMANDS)]
            wanted, seconds = undisturbed[name]
            out = Path(folder, str(number))
            out.mkdir()
            # The first file is written late: more kills in the second half.
            moment = seconds * chance.betavariate(2.0, 1.2)
            lost = losses(COMMANDS[name], sequence, out, wanted, moment)
            faults += bool(lost)
            what = "; ".join(lost) or "nothing lost"
            print(f"{number + 1:3d} {name}, {moment:.2f} of {seconds:.2f} s: {what}", flush=True)
    print(f"{options.kills} kills, {faults} with a loss")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
