"""Script, not a test: digests of the poses of every method and rule, to compare before and after a change.

    python tests/compare_paths.py > before.txt
    python tests/compare_paths.py | diff before.txt -
    python tests/compare_paths.py kitti/00 --labels DIR
    python tests/compare_paths.py kitti/00 --detector MODEL

A line for each run: SHA-256 of the poses in KITTI's format, sequence, variant (of kit, the mode), method,
seed and boxes. Without a sequence, the runs are those of `CASES`, as far as this machine has their images
and models. KITTI's sequences are looked for in KITTI_ROOT, else beside the checkout, like the detector.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vo_lib.config import KIT, PUBLISHED, change
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.poses import format_kitti_poses
from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import labelled_sequence
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import run_methods

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
SEEDS = (0, 1)
MODES = ("refined", "literal")
LABELS = "labels"  # stands for the folder that `write_boxes` fills
DETECTOR = SHARED / "models" / "yolox_nano.onnx"


@dataclass(frozen=True)
class Case:
    """Runs of all methods over a sequence, with the boxes of its own labels, of a folder or of a detector."""

    sequence: str
    labels: str | None = None
    detector: str | None = None

    @property
    def boxes(self) -> str:
        """A word for the origin of the boxes."""
        if self.detector is not None:
            return Path(self.detector).stem
        return "own" if self.labels is None else Path(self.labels).name

    def is_here(self) -> bool:
        """Whether this machine has the model and the images; every drawn street can be drawn."""
        if self.detector is not None and not Path(self.detector).is_file():
            return False
        kitti, _, name = self.sequence.partition("/")
        return kitti != "kitti" or (Path(os.environ["KITTI_ROOT"]) / "sequences" / name).is_dir()


CASES = (
    Case("synthetic/traffic"),
    Case("synthetic/jam"),
    Case("kitti/00"),
    Case("kitti/01"),
    Case("kitti/drive_0005"),
    Case("kitti/drive_0013", labels=LABELS),
    Case("kitti/drive_0013", detector=str(DETECTOR)),
)


def write_boxes(folder: Path, frames: tuple[str, ...]) -> None:
    """Write labels of a car and a truck that move through the image, and of a person, who is no vehicle."""
    for index, frame in enumerate(frames):
        share = index / len(frames)
        rows = (
            f"2 {0.2 + 0.5 * share:.4f} 0.6 0.3 0.5 0.9",
            f"7 {0.8 - 0.1 * share:.4f} 0.5 0.1 0.2 0.8",
            "0 0.5 0.5 0.05 0.3 0.7",
        )
        (folder / f"{frame}.txt").write_text("\n".join(rows) + "\n", encoding="ascii")


def configurations(has_scene_truth: bool) -> dict[str, MethodConfig]:
    """The configurations by variant and method; `truth` is a rule of streets that the kit has drawn."""
    configs: dict[str, MethodConfig] = {f"published {method}": config for method, config in PUBLISHED.items()}
    for mode, method in itertools.product(MODES, KIT):
        configs[f"{mode} {method}"] = change(KIT[method], "selection.mode", mode)
    if has_scene_truth:
        configs["refined truth"] = change(KIT["moving_selection"], "filter.rule", "truth")
    return {
        f"{name} {seed}": replace(config, seed=seed)
        for seed, (name, config) in itertools.product(SEEDS, configs.items())
    }


def digests(sequence: Sequence) -> Iterator[str]:
    """A digest and a name for the path of each run over a sequence."""
    # Runs with the same front end share its matches, which take most of the time.
    groups: dict[Any, dict[str, MethodConfig]] = {}
    for name, config in configurations(sequence.name.startswith("synthetic/")).items():
        groups.setdefault((config.variant, config.features, config.matching), {})[name] = config
    for group in groups.values():
        for name, run in run_methods(sequence, group).items():
            text = format_kitti_poses(run.poses)
            yield f"{hashlib.sha256(text.encode('ascii')).hexdigest()} {sequence.name} {name}"


def print_digests(case: Case) -> None:
    """A line for the path of each run of a case."""
    with tempfile.TemporaryDirectory() as folder:
        labels = case.labels
        if labels == LABELS:
            labels = folder
            write_boxes(Path(folder), open_sequence(case.sequence).frames)
        sequence = open_sequence(case.sequence, labels)
        if case.detector is not None:
            sequence = labelled_sequence(sequence, case.detector, cache=Path(folder))
        for line in digests(sequence):
            print(f"{line} {case.boxes}", flush=True)


def main() -> None:
    """Print the digests of the sequences that are named, or of all cases."""
    os.environ.setdefault("KITTI_ROOT", str(SHARED / "kitti_clips"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("sequences", nargs="*", metavar="SEQUENCE")
    parser.add_argument("--labels", metavar="DIR", help="folder of label files")
    parser.add_argument("--detector", metavar="MODEL", help="ONNX file")
    options = parser.parse_args()
    named = [Case(name, options.labels, options.detector) for name in options.sequences]
    for case in named or CASES:
        if named or case.is_here():
            print_digests(case)
        else:
            print(f"left out: {case.sequence}, boxes: {case.boxes}", file=sys.stderr)


if __name__ == "__main__":
    main()
