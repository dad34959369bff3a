"""Measure what the miniature detector of chapter 5 learns, by data and network.

examples:
  vo data measure_miniature --out notebooks/miniature.csv
  vo data measure_miniature --experiments "20 frames" --seeds 1

Each experiment trains the network of the notebook's cells with several seeds
and judges it on three streets that it has not seen. A row is written after
each training (half a minute or more); a second call with the same --out
continues. Rows of other cells, after a change of the notebook, are replaced.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import cv2
from threadpoolctl import threadpool_limits

from measure.detector_experiments import EXPERIMENTS, SEEDS, Experiment, judged, row_head
from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import print_wrapped, reporting
from vo_lib.data.tables import csv_text, read_csv
from vo_lib.errors import DataError
from vo_lib.files import write_atomic

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    names = ", ".join(each.name for each in EXPERIMENTS)
    parser.add_argument("--experiments", metavar="E,E,…", help=f"experiments; default: {names}")
    parser.add_argument("--seeds", default=str(SEEDS), metavar="N", help=f"number of seeds; default {SEEDS}")
    parser.add_argument("--out", default="runs/miniature.csv", metavar="FILE", help="CSV file of the table")


def chosen_experiments(text: str | None) -> list[Experiment]:
    """The experiments of a comma-separated list; without a list, all."""
    if text is None:
        return list(EXPERIMENTS)
    known = {each.name: each for each in EXPERIMENTS}
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in known:
            raise DataError(f"--experiments {name!r}: expected names from {', '.join(known)}")
    return [known[name] for name in names]


def run(options: argparse.Namespace) -> int:
    """Run the missing trainings, the first seed of all experiments first, and write a row after each."""
    seeds = parse_whole("--seeds", options.seeds)
    experiments = chosen_experiments(options.experiments)
    if str(NOTEBOOKS) not in sys.path:
        sys.path.append(str(NOTEBOOKS))
    from course.ch05 import miniature

    head = row_head(miniature.JUDGED_STREETS)
    rows = _rows_before(Path(options.out), head, miniature.code_digest())
    missing = []
    for seed in range(seeds):
        for experiment in experiments:
            if (experiment.name, str(seed)) not in rows:
                missing.append((experiment, seed))
    streets = _Streets(miniature)
    cv2.setNumThreads(1)
    with reporting(f"{len(missing)} trainings") as report, threadpool_limits(1):
        for number, (experiment, seed) in enumerate(missing, start=1):
            values = _trained(experiment, seed, streets, miniature)
            named = [experiment.name, str(seed), str(experiment.steps), miniature.code_digest()]
            rows[experiment.name, str(seed)] = named + values
            write_atomic(Path(options.out), csv_text([head, *_in_order(rows)]))
            report(number, len(missing))
    print_wrapped(f"written to {options.out}")
    return 0


def _in_order(rows: dict[tuple[str, str], list[str]]) -> list[list[str]]:
    """The rows in the order of `EXPERIMENTS`, and of the seeds."""
    names = [each.name for each in EXPERIMENTS]
    return sorted(rows.values(), key=lambda row: (names.index(row[0]), int(row[1])))


def _rows_before(path: Path, head: list[str], digest: str) -> dict[tuple[str, str], list[str]]:
    """The rows of an earlier call with the same cells, by experiment and seed."""
    if not path.exists():
        return {}
    lines = [cells for _, cells in read_csv(path)]
    if not lines or lines[0] != head:
        raise DataError("expected a table of this script: choose another --out", path)
    names = {each.name for each in EXPERIMENTS}
    return {(row[0], row[1]): row for row in lines[1:] if row[3] == digest and row[0] in names}


class _Streets:
    """The images of streets, each read once. `miniature` : the module of chapter 5 that opens the streets."""

    def __init__(self, miniature: Any) -> None:
        self.miniature = miniature
        self._training: dict[tuple[str, int | None], list[Any]] = {}
        self._tests: dict[str, Any] = {}

    def training(self, name: str, count: int | None) -> list[Any]:
        """Labelled images of a street to learn from: `count` of them, or all."""
        if (name, count) not in self._training:
            street = self.miniature.street(name)
            self._training[name, count] = self.miniature.labelled(street, count)
        return list(self._training[name, count])

    def tests(self) -> dict[str, Any]:
        """Images with their labels, classes included, of the streets that no training sees."""
        if not self._tests:
            for name in self.miniature.JUDGED_STREETS:
                self._tests[name] = self._test_images(self.miniature.street(name))
        return dict(self._tests)

    def _test_images(self, sequence: Any) -> list[Any]:
        """Left images of frames spread over a street, each with its labels."""
        chosen = self.miniature.spread_frames(sequence, self.miniature.JUDGED_FRAMES)
        return [(sequence.stereo(index)[0], sequence.boxes(index)) for index in chosen]


def _trained(experiment: Experiment, seed: int, streets: _Streets, miniature: Any) -> list[str]:
    """Train a network and judge it; return the cells of a row that come after the digest.

    miniature : the module of chapter 5 that has the functions of the notebook's cells.
    """
    functions = miniature.notebook_functions()
    network = functions[experiment.network]
    frames = []
    for street, count in experiment.images.items():
        frames += streets.training(street, count)
    weights, _ = functions["train"](
        frames, steps=experiment.steps, seed=seed, network=network, **experiment.settings
    )

    def find(image: Any) -> Any:
        return functions["detect"](image, weights, network=network)

    values = judged(streets.tests(), find, functions["judge"])
    number_of_weights = sum(each.size for each in weights)
    return [str(number_of_weights), *(f"{value:.4f}".rstrip("0").rstrip(".") for value in values)]
