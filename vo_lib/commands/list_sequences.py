"""`vo list`: the available sequences."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..data.catalogue import KITTI, SYNTHETIC, available, kitti_root, kitti_roots
from ..data.drawn import scene_frames, scenes_folder
from ..data.label_remarks import missing_labels
from ..data.scenes import SCENES
from ..data.sequence import open_folder
from ..errors import DataError
from ..evaluation.kitti_errors import trajectory_distances
from ..report.page import NO_NUMBER
from .console import print_wrapped, show_table

COLUMNS = ["name", "frames", "metres", "truth", "boxes", "image px", "MB"]


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo list`."""
    parser.description = (
        "List the sequences that `vo run` can open by name: KITTI's and the drawn scenes. Others are opened "
        "by the paths of their folders."
    )
    parser.set_defaults(command=_list)


def _list(options: argparse.Namespace) -> int:
    """Print a row for each sequence, and why one cannot be used."""
    rows = list[list[str]]()
    problems = list[str]()
    for name, folder in available().items():
        try:
            rows.append([name, *_facts(name, folder)])
        except DataError as error:
            rows.append([name, *[NO_NUMBER] * (len(COLUMNS) - 1)])
            problems.append(f"{name} is not usable: {error}")
    show_table(COLUMNS, rows)
    print_wrapped("A scene without a size in MB is drawn on first use.", f"drawn scenes: {scenes_folder()}")
    print_wrapped(*(f"KITTI: {root / 'sequences'}" for root in kitti_roots()), *problems)
    if not any(name.startswith(KITTI) for name, *_ in rows):
        remedy = "`vo check` lists the commands that download them"
        print_wrapped(f"no KITTI sequences in {kitti_root()} (KITTI_ROOT may name another folder); {remedy}")
    return 0


def _facts(name: str, folder: Path | None) -> list[str]:
    """Cells of a sequence's row after its name, as in `COLUMNS`.

    folder : None for a scene that is not drawn yet, which has only the cells that its settings tell.
    """
    if folder is None:
        scene = SCENES[name.removeprefix(SYNTHETIC)]
        size = f"{scene.width}×{scene.height}"
        return [str(scene_frames(scene)), f"{scene.length:.0f}", "poses.txt", "yes", size, NO_NUMBER]
    sequence = open_folder(folder, name)
    camera = sequence.camera
    truth = sequence.truth
    length = NO_NUMBER
    if truth is not None:
        # The way across a gap between two pieces is not counted, since no frames show it.
        metres = sum(trajectory_distances(truth[piece.start : piece.stop])[-1] for piece in sequence.pieces)
        length = f"{metres:.0f}"
    boxes = "no"
    if sequence.labels is not None:
        boxes = "part" if missing_labels(sequence) else "yes"
    images = [path for side in sequence.sides for path in (folder / side).iterdir() if path.is_file()]
    megabytes = sum(path.stat().st_size for path in images) / 1e6
    return [
        str(len(sequence)),
        length,
        sequence.truth_name or "no",
        boxes,
        f"{camera.width}×{camera.height}",
        f"{megabytes:.0f}",
    ]
