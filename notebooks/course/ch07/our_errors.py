"""Chapter 7: our errors from a folder of `vo reproduce`, in the places of the printed table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib.data.catalogue import KITTI
from vo_lib.data.tables import read_csv
from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import mean_and_deviation
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.record import RECORD, RecordRow, read_record
from vo_lib.report.table1 import ERROR_KINDS
from vo_lib.report.table1_page import TABLE

MAKE_ONE = "run the command above, or name its folder in the first line"


@dataclass(frozen=True, eq=False)
class Ours:
    """Our errors of a method on a row of the table.

    whole : whether the sequence was run as a whole; boxes : whether the run had vehicle boxes; seeds : their
    count; values : (S,) errors of the seeds, or None if only mean and deviation (over n - 1) are known;
    seed_numbers : the seeds of the values.
    """

    whole: bool
    boxes: bool
    seeds: int
    mean: float
    deviation: float
    values: Array | None = None
    seed_numbers: tuple[int, ...] = ()


OursByCell = dict[tuple[str, str, str], Ours]  # by the row of the table, the method and the kind of error


def read_report(folder: Path) -> OursByCell:
    """Our errors by (row, method, kind) of variant `published`, from a folder of `vo reproduce`; maybe none.

    `reproduction.json` has the numbers of each seed. An older folder has only `table1.csv`, with means and
    deviations. Raises `DataError` if the file is damaged.
    """
    if (folder / RECORD).is_file():
        _, record_rows = read_record(folder / RECORD)
        return _from_record(record_rows)
    if (folder / TABLE).is_file():
        return _from_table(folder / TABLE)
    return {}


def open_report(folder: Path) -> tuple[OursByCell, list[str]]:
    """The errors of `read_report`, and sentences on the report; without errors, they say why."""
    record_path = folder / RECORD
    record: dict[str, Any] = {}
    try:
        if record_path.is_file():
            # Read here, not by `read_report`: the sentences need the record and its rows as well.
            record, record_rows = read_record(record_path)
            found = _from_record(record_rows)
        else:
            found = read_report(folder)
    except DataError as error:
        return {}, [f"The report cannot be used: {error}."]
    if record:
        sentence = _about(record, folder) if found else _why_empty(record_rows, record_path)
    elif not (folder / TABLE).is_file():
        sentence = f"There is no report in {folder}: {MAKE_ONE}."
    elif found:
        sentence = f"{folder} has a table without a record: no number of a single seed."
    else:
        sentence = f"{folder / TABLE} has no row of variant published with its presets and with errors."
    sentences = [sentence]
    if found and not set(table1.PAPER_ROWS) & {row for row, _, _ in found}:
        sentences.append(f"{folder} has no row of the printed table: it was made from other sequences.")
    return found, sentences


def _about(record: Mapping[str, Any], folder: Path) -> str:
    """Where a record comes from, and the detector, which is another one than the paper's."""
    facts = [str(record[name]) for name in ("date", "commit", "processor") if record.get(name)]
    origin = f"The report in {folder}"
    if facts:
        origin += f" ({', '.join(facts)})"
    detector = record.get("detector")
    boxes = "labels of the sequences, if any"
    if isinstance(detector, dict) and detector.get("file"):
        boxes = str(detector["file"])
    return f"{origin}. Boxes: {boxes}; the paper trained a YOLOv8 of its own, a known deviation."


def _why_empty(record_rows: list[RecordRow], path: Path) -> str:
    """Why no row of a record can be compared with the paper."""
    if not record_rows:
        return f"{path} has no row: no run has errors."
    published = [record_row for record_row in record_rows if record_row.variant == "published"]
    if not published:
        return (
            f"{path} has only rows of variant kit; the paper's numbers are compared with variant published: "
            "repeat the command without --variant kit."
        )
    settings = ", ".join(dict.fromkeys(record_row.settings for record_row in published))
    return (
        f"{path} has variant published only with changed settings ({settings}): repeat the command without "
        "--set and --config."
    )


def _from_record(record_rows: list[RecordRow]) -> OursByCell:
    """Our errors from the rows of a record, which have those of each seed, and their averages."""
    found: OursByCell = {}
    for record_row in record_rows:
        if record_row.variant != "published" or record_row.settings:
            continue
        row = record_row.sequence.removeprefix(KITTI)
        boxes = record_row.removed_share > 0
        for kind in ERROR_KINDS:
            values = record_row.errors[kind]
            found[row, record_row.method, kind] = _of_seeds(record_row.whole, boxes, values, record_row.seeds)
    return found | _averages(found)


def _of_seeds(whole: bool, boxes: bool, values: Array, seed_numbers: tuple[int, ...]) -> Ours:
    """Our errors (S,) of the seeds with these numbers."""
    mean, deviation = mean_and_deviation(values)
    return Ours(whole, boxes, len(values), mean, deviation, values, seed_numbers)


def _averages(found: OursByCell) -> OursByCell:
    """The row Avg, the plain mean of the ten whole sequences, for each seed that all of them have."""
    averages = {}
    for method, kind in itertools.product(table1.PAPER_METHODS, ERROR_KINDS):
        complete = []
        errors_of_seeds = []  # the errors of each complete sequence by the number of the seed
        for row in table1.SUB_SEQUENCES:
            ours = found.get((row, method, kind))
            if ours is not None and ours.whole and ours.values is not None:
                complete.append(ours)
                errors_of_seeds.append(dict(zip(ours.seed_numbers, ours.values, strict=True)))
        if len(complete) < len(table1.SUB_SEQUENCES):
            continue
        common = sorted(set.intersection(*map(set, errors_of_seeds)))
        if not common:
            continue
        by_sequence = [[errors[seed] for seed in common] for errors in errors_of_seeds]
        means = np.mean(by_sequence, axis=0)
        boxes = all(ours.boxes for ours in complete)
        averages[table1.AVERAGE, method, kind] = _of_seeds(True, boxes, means, tuple(common))
    return averages


def _from_table(path: Path) -> OursByCell:
    """Our errors from a table without the errors of each seed."""
    found: OursByCell = {}
    place = None
    try:
        (_, columns), *lines = read_csv(path)
        for line, cells in lines:
            place = line
            cell_of = dict(zip(columns, cells, strict=True))
            if cell_of["variant"] != "published" or cell_of.get("settings"):
                continue
            for kind in ERROR_KINDS:
                if not cell_of[kind]:
                    continue
                key = (cell_of["sequence"].removeprefix(KITTI), cell_of["method"], kind)
                if key in found:
                    raise ValueError("this sequence and method have a row already")
                found[key] = _of_cells(cell_of, kind)
    except (KeyError, ValueError) as error:
        raise DataError(
            f"is not a table of vo reproduce: {type(error).__name__} {error}", path, place
        ) from None
    return found


def _of_cells(cell_of: Mapping[str, str], kind: str) -> Ours:
    """Our errors from the cells of a row of table1.csv, by column; ValueError for a number that is none."""
    mean = float(cell_of[kind])
    deviation = float(cell_of[f"{kind}_std"] or "nan")
    seeds = int(cell_of["seeds"])
    # The row of averages has no share of its own: its sequences were judged by theirs.
    share = float(cell_of["removed_share"] or "1")
    known = (mean, deviation if seeds > 1 else 0.0, share)  # one seed has no deviation
    if seeds < 1 or not all(math.isfinite(value) and value >= 0 for value in known):
        raise ValueError(f"expected seeds from 1 and finite numbers from 0, found {seeds}, {known}")
    whole = bool(cell_of[f"paper_{kind}"])  # only a whole sequence has the paper's number beside it
    return Ours(whole, share > 0, seeds, mean, deviation)
