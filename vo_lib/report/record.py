"""The record of a reproduction: numbers by seed, versions and processor, to be archived or sent to others.

A record may come from somebody else, so `read_record` tests all that a reader computes with.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..config import VARIANTS
from ..errors import DataError
from ..files import file_sha256, read_mapping
from ..geometry.types import Array
from ..runs.identity import library_versions, machine_info
from .blocks import Block
from .page import finite_or_none
from .table1 import BENCHMARK_FRAMES, ERROR_KINDS, Entry

RECORD = "reproduction.json"
FORMAT = 1
REMEDY = "repeat the `vo reproduce` that wrote it, with the same --out: finished runs are kept"


def reproduction_record(
    entries: list[Entry],
    missing: list[str],
    detector: Path | None,
    seconds: float,
    processes: int,
    differs: Mapping[Block, list[str]],
) -> dict[str, Any]:
    """What a reader needs to judge a reproduction: no path, image or pose.

    entries : the errors of the table; missing : sequences that were asked for and not found; detector : the
    ONNX file of the boxes, if they are not labels; seconds : duration of the call, and of nothing that an
    earlier call with the same folder has done; processes : number of processes; differs : for each block,
    sentences on what differs from the presets.
    """
    boxes = None if detector is None else {"file": detector.name, "sha256": file_sha256(detector)}
    return {
        "format": FORMAT,
        "about": "TE and RE of vo reproduce, one number for each seed",
        **machine_info(),
        "cores": os.cpu_count(),
        "versions": library_versions(),
        "detector": boxes,
        "seconds": round(seconds, 1),
        "processes": processes,
        "missing": missing,
        "blocks": [
            {"variant": block.variant, "settings": dict(block.changes), "differs": sentences}
            for block, sentences in differs.items()
        ],
        "rows": [_row(entry) for entry in entries],
    }


def _row(entry: Entry) -> dict[str, Any]:
    errors = {
        kind: [finite_or_none(value) for value in values.tolist()]
        for kind, values in zip(ERROR_KINDS, entry.errors, strict=True)
    }
    return {
        "variant": entry.variant,
        "settings": entry.settings,
        "sequence": entry.sequence,
        "method": entry.method,
        "whole": entry.is_whole,
        "frames": len(entry.truth),
        "sub_sequences": entry.measure.words,
        "sub_sequence_count": entry.subsequences,
        "removed_share": entry.removed_share,
        "seeds": list(entry.seeds),
        **errors,
    }


def record_json(record: dict[str, Any]) -> str:
    """The record as the text of its file."""
    return json.dumps(record, indent=1, allow_nan=False) + "\n"


@dataclass(frozen=True, eq=False)
class RecordRow:
    """The errors of a method on a sequence: a row of a record.

    settings : what differs from the presets, as typed; whole : whether all frames of a sequence of the
    benchmark were run, with the benchmark's measure; seeds : (S) different seeds; removed_share : share of
    the matches removed in boxes; errors : (S,) of each seed by kind of `ERROR_KINDS`, NaN for a missing one.
    """

    variant: str
    settings: str
    sequence: str
    method: str
    whole: bool
    frames: int
    seeds: tuple[int, ...]
    removed_share: float
    errors: Mapping[str, Array]


def read_record(path: Path) -> tuple[dict[str, Any], list[RecordRow]]:
    """A record as it is, and its rows, tested.

    Raises `DataError` with the row and what is expected there: another format, a field of another type,
    different numbers of seeds and of errors, a seed or a row twice, an error that is negative or not finite,
    or a sequence that is called whole with another number of frames than the benchmark's.
    """
    record = read_mapping(path, f"a record of vo reproduce; {REMEDY}")
    if type(record.get("format")) is not int or record["format"] != FORMAT:
        found = json.dumps(record.get("format")) if "format" in record else "missing"
        raise DataError(f"format: expected {FORMAT}, found {found}; {REMEDY}", path)
    rows = record.get("rows")
    if not isinstance(rows, list):
        raise DataError(f"rows: expected a list of rows; {REMEDY}", path)
    read: dict[tuple[str, str, str, str], RecordRow] = {}
    for number, fields in enumerate(rows, start=1):
        try:
            row = _read_row(fields)
            key = (row.variant, row.settings, row.sequence, row.method)
            if key in read:
                raise ValueError(
                    "expected one row for each variant, settings, sequence and method, found two"
                )
        except ValueError as error:
            where = f"row {number}{_row_words(fields)}"
            raise DataError(f"{where}: {error}; {REMEDY}", path) from None
        read[key] = row
    return record, list(read.values())


def _row_words(fields: object) -> str:
    """What a message says of a row beside its number: sequence and method, where they are readable."""
    if not isinstance(fields, dict):
        return ""
    words = [fields.get("sequence"), fields.get("method")]
    named = [word for word in words if isinstance(word, str)]
    return f" ({', '.join(named)})" if named else ""


def _read_row(fields: object) -> RecordRow:
    """A row, tested; ValueError with what is expected."""
    if not isinstance(fields, dict):
        raise ValueError(f"expected an object, found {_shown(fields)}")
    variant = _text(fields, "variant")
    if variant not in VARIANTS:
        raise ValueError(f"variant: expected {' or '.join(VARIANTS)}, found {_shown(variant)}")
    method = _text(fields, "method")
    if method not in VARIANTS[variant]:
        raise ValueError(f"method: expected {', '.join(VARIANTS[variant])}, found {_shown(method)}")
    sequence = _text(fields, "sequence")
    frames = _field(fields, "frames")
    if type(frames) is not int or frames < 1:
        raise ValueError(f"frames: expected a whole number from 1, found {_shown(frames)}")
    whole = _field(fields, "whole")
    if type(whole) is not bool:
        raise ValueError(f"whole: expected true or false, found {_shown(whole)}")
    if whole and frames != BENCHMARK_FRAMES.get(sequence):
        expected = BENCHMARK_FRAMES.get(sequence, "a sequence of the benchmark with all its")
        raise ValueError(f"whole is true: expected {expected} frames, found {frames}")
    seeds = _field(fields, "seeds")
    if not isinstance(seeds, list) or not seeds or not all(type(s) is int and s >= 0 for s in seeds):
        raise ValueError(f"seeds: expected a list of whole numbers from 0, found {_shown(seeds)}")
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: expected each seed once, found {_shown(seeds)}")
    share = _field(fields, "removed_share")
    if not _is_number(share) or not 0.0 <= share <= 1.0:
        raise ValueError(f"removed_share: expected a number from 0 to 1, found {_shown(share)}")
    return RecordRow(
        variant=variant,
        settings=_text(fields, "settings"),
        sequence=sequence,
        method=method,
        whole=whole,
        frames=frames,
        seeds=tuple(seeds),
        removed_share=float(share),
        errors={kind: _errors(fields, kind, len(seeds)) for kind in ERROR_KINDS},
    )


def _field(fields: Mapping[str, Any], name: str) -> Any:
    if name not in fields:
        raise ValueError(f"expected a field {name}, found none")
    return fields[name]


def _text(fields: Mapping[str, Any], name: str) -> str:
    value = _field(fields, name)
    if not isinstance(value, str):
        raise ValueError(f"{name}: expected a text, found {_shown(value)}")
    return value


def _errors(fields: Mapping[str, Any], kind: str, seeds: int) -> Array:
    values = _field(fields, kind)
    if not isinstance(values, list):
        raise ValueError(f"{kind}: expected a list of errors, found {_shown(values)}")
    if len(values) != seeds:
        raise ValueError(f"{kind}: expected an error for each of {seeds} seeds, found {len(values)}")
    for value in values:
        if value is not None and not (_is_number(value) and value >= 0):
            raise ValueError(
                f"{kind}: expected numbers from 0, or null for a missing one, found {_shown(value)}"
            )
    return np.array([math.nan if value is None else value for value in values], np.float64)


def _is_number(value: object) -> bool:
    """Whether a value of JSON is a finite number; true and false are none."""
    if type(value) is int:
        return abs(value) < 10**15  # a larger one is no error, and may not fit a float
    return type(value) is float and math.isfinite(value)


def _shown(value: object) -> str:
    """A value as JSON writes it, shortened."""
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
