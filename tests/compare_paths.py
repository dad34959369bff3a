"""Script, not a test: digests of the poses of every method, for a comparison before and after a change.

    python tests/compare_paths.py [SEQUENCE ...] > before.txt
    python tests/compare_paths.py [SEQUENCE ...] | diff before.txt -

A line for each run: sequence, mode (none for published methods), method, and the SHA-256 of the poses in
KITTI's format. The default sequences are synthetic/traffic, synthetic/jam and, if it exists in
KITTI_ROOT, kitti/00.
"""

from __future__ import annotations

import hashlib
import itertools
import sys
from typing import Any

from vo_lib import MethodConfig, available, open_sequence
from vo_lib.config import KIT, PUBLISHED, change
from vo_lib.data.poses import format_kitti_poses
from vo_lib.runs.drive import run_methods

MODES = ("refined", "literal")
SEQUENCES = ("synthetic/traffic", "synthetic/jam", "kitti/00")


def print_digests(sequence: str) -> None:
    """A line for the path of each run over a sequence."""
    configs: dict[str, MethodConfig] = {
        f"{mode} {method}": change(KIT[method], "selection.mode", mode)
        for mode, method in itertools.product(MODES, KIT)
    }
    configs |= {f"published {method}": config for method, config in PUBLISHED.items()}
    # Runs with the same front end share its matches, which take most of the time.
    groups: dict[Any, dict[str, MethodConfig]] = {}
    for name, config in configs.items():
        groups.setdefault((config.variant, config.features, config.matching), {})[name] = config
    opened = open_sequence(sequence)
    for group in groups.values():
        for name, run in run_methods(opened, group).items():
            digest = hashlib.sha256(format_kitti_poses(run.poses).encode("ascii")).hexdigest()
            print(f"{digest} {sequence} {name}")


if __name__ == "__main__":
    for chosen in sys.argv[1:] or [name for name in SEQUENCES if name in available()]:
        print_digests(chosen)
