"""Whether moving code changes a path: a digest of the poses of every method, before and after. No test.

    python tests/compare_paths.py write FILE [SEQUENCE ...]     before: one line for each run
    python tests/compare_paths.py compare FILE [SEQUENCE ...]   after: says which lines differ; 1 if any does

A run is a sequence, a mode and a method, or a published method; its digest is the SHA-256 of its
poses as KITTI writes them. Without sequences: synthetic/traffic and synthetic/jam, and
kitti/00 where there is one (KITTI_ROOT). `compare` looks at the sequences it is given, or all of FILE.
"""

from __future__ import annotations

import hashlib
import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vo_lib import open_sequence, preset
from vo_lib.config import METHODS, PUBLISHED, PublishedConfig, change
from vo_lib.core.poses import format_kitti_poses
from vo_lib.data.sequence import available
from vo_lib.runs.runner import run_methods

MODES = ("refined", "literal")
SEQUENCES = ("synthetic/traffic", "synthetic/jam")
WHERE_FOUND = "kitti/00"


def configs() -> Iterator[tuple[str, PublishedConfig]]:
    """Every name and configuration: the kit's with each mode, the published ones as such."""
    for mode, method in itertools.product(MODES, METHODS):
        yield f"{mode} {method}", change(preset(method), "selection.mode", mode)
    for method, published in PUBLISHED.items():
        yield f"published {method}", published


def digests(sequence: str) -> dict[str, str]:
    """Digest of the path of each run over a sequence, by "sequence mode method"."""
    opened = open_sequence(sequence)
    # Runs with the same front end share its matches, which take most of the time.
    groups: dict[Any, dict[str, PublishedConfig]] = {}
    for name, made in configs():
        groups.setdefault((made.features, made.matching), {})[name] = made
    found = {}
    for group in groups.values():
        for name, run in run_methods(opened, group).items():
            text = format_kitti_poses(run.poses)
            found[f"{sequence} {name}"] = hashlib.sha256(text.encode("ascii")).hexdigest()
    return found


def read(path: Path) -> dict[str, str]:
    """Digests by run, as `write` left them."""
    pairs = (line.split(" ", 1) for line in path.read_text(encoding="utf-8").splitlines())
    return {name: digest for digest, name in pairs}


def main(words: list[str]) -> int:
    if len(words) < 2 or words[0] not in ("write", "compare"):
        print(__doc__, file=sys.stderr)
        return 2
    path, chosen = Path(words[1]), words[2:]
    before = read(path) if words[0] == "compare" else {}
    if before:
        chosen = chosen or list(dict.fromkeys(name.split(" ")[0] for name in before))
    chosen = chosen or [*SEQUENCES, *([WHERE_FOUND] if WHERE_FOUND in available() else [])]
    found: dict[str, str] = {}
    for sequence in chosen:
        print(f"{sequence} …", file=sys.stderr, flush=True)
        found |= digests(sequence)
    if words[0] == "write":
        path.write_text("".join(f"{digest} {name}\n" for name, digest in found.items()), encoding="utf-8")
        return 0
    wanted = {name: digest for name, digest in before.items() if name.split(" ")[0] in chosen}
    for name in sorted(found.keys() - wanted.keys()):
        print(f"{name}: is new")
    differ = [name for name, digest in wanted.items() if found.get(name) != digest]
    for name in differ:
        print(f"{name}: {'differs' if name in found else 'is gone'}")
    print(f"{len(wanted) - len(differ)} of {len(wanted)} paths are the same to the byte")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
