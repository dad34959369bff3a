"""The record of a reproduction: numbers by seed, versions and processor, to be archived or sent to others.

A record may come from somebody else, so `read_record` tests all that a reader computes with. Each of its rows
is an entry of the table; the records of `table1` are something else, the rows of our table, as in table1.csv.
"""

from __future__ import annotations

import json
import math
import os
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from ..config import VARIANTS
from ..errors import DataError
from ..evaluation.kitti_errors import KITTI_PROTOCOL
from ..files import file_sha256, read_mapping
from ..geometry.types import Array
from ..runs.identity import git_commit, library_versions, machine_info
from ..runs.jobs import Job, seconds_of_jobs
from .blocks import Block
from .page import finite_or_none
from .table1 import (
    BENCHMARK_COUNTS,
    BENCHMARK_FRAMES,
    ERROR_KINDS,
    Entry,
    PaperTable,
    paper_fields,
    printed_of,
)

RECORD = "reproduction.json"
FORMAT = 1  # of the record; increase with every change of its fields that a reader must know of
NO_REMOVAL = "none"  # the rule of the methods that remove no feature
MOST_SHOWN = 40  # characters of a value in a message
TOO_LARGE = 10**15  # a whole number from here on is no error and no count, and may not fit a float
REMEDY = "repeat the `vo reproduce` that wrote it, with the same --out: finished runs are kept"


@dataclass(frozen=True)
class Call:
    """A call of `vo reproduce`.

    date : in UTC; command : as typed, but without the places of the machine; seconds : its duration;
    processes : their number; commit : that of the kit, or None outside git.
    """

    date: str
    command: str
    seconds: float
    processes: int
    commit: str | None


def this_call(line: str, seconds: float, processes: int) -> Call:
    """The call that ends now; line : its command as typed."""
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return Call(date, without_places(line), round(seconds, 1), processes, git_commit())


def earlier_calls(folder: Path) -> list[dict[str, Any]]:
    """The calls in the record that is in a folder already; none if there is no readable record."""
    try:
        calls = read_mapping(folder / RECORD, "a record").get("calls")
    except DataError:
        return []
    if not isinstance(calls, list):
        return []
    return [call for call in calls if _is_call(call)]


def _is_call(value: object) -> bool:
    """Whether a value of JSON has the fields of a `Call`, and a duration that can be added."""
    names = {field.name for field in fields(Call)}
    if not isinstance(value, dict) or set(value) != names:
        return False
    seconds = value["seconds"]
    return _is_number(seconds) and bool(seconds >= 0)


def without_places(line: str) -> str:
    """A command line in which paths and addresses of the machine are only names.

    A path that is absolute, or that leaves the folder of the call, becomes its last part; the host of an
    address such as tcp://host:port is left out. "runs/table1" and "kitti/04" stay.
    """
    words = []
    for word in shlex.split(line):
        pieces = re.split(r"([=,])", word)
        words.append("".join(_without_place(piece) for piece in pieces))
    return shlex.join(words)


def _without_place(piece: str) -> str:
    """A part of a command line, as `without_places` describes it."""
    scheme, _, address = piece.partition("://")
    if address:
        return f"{scheme}://..."
    # The command may be that of any system: a backslash or a drive such as C: is a place only on Windows.
    windows = PureWindowsPath(piece)
    posix = PurePosixPath(piece)
    is_absolute = posix.is_absolute() or windows.drive or windows.root
    leaves_folder = ".." in posix.parts or ".." in windows.parts or piece.startswith("~")
    if not is_absolute and not leaves_folder:
        return piece
    name = windows.name  # of a path with slashes, too
    return name if name.strip("~.") else "..."


def reproduction_record(
    entries: list[Entry],
    paper: PaperTable,
    missing: list[str],
    detector: Path | None,
    call: Call,
    earlier: Iterable[Mapping[str, Any]],
    jobs: list[Job],
    cache: Path | None,
    differs: Mapping[Block, list[str]],
) -> dict[str, Any]:
    """What a reader needs to judge a reproduction: no path, image or pose.

    Parameters
    ----------
    entries : the errors of the table.
    paper : the printed numbers beside them.
    missing : sequences that were asked for and not found.
    detector : the ONNX file of the boxes, if they are not labels.
    call : the one that makes the record.
    earlier : the calls before it with the same folder, from `earlier_calls`.
    jobs : all runs, kept ones too.
    cache : folder of their matches.
    differs : for each block, sentences on what differs from the presets.

    A call repeats no finished run, so its duration is not that of the table. "seconds_of_calls" is the sum
    over all calls that ended, and "seconds_of_work" what matches and runs took, each once and in one process,
    with the number of those whose duration is not known.
    """
    boxes = None if detector is None else {"file": detector.name, "sha256": file_sha256(detector)}
    calls = [*map(dict, earlier), asdict(call)]
    seconds_of_work, of_unknown_duration = seconds_of_jobs(jobs, cache)
    return {
        "format": FORMAT,
        "about": "TE and RE of vo reproduce, one number for each seed",
        "date": call.date,
        "command": call.command,
        **machine_info(),
        "cores": os.cpu_count(),
        "versions": library_versions() | {"onnxruntime": _version_of("onnxruntime", "onnxruntime-gpu")},
        "detector": boxes,
        "seconds": call.seconds,
        "seconds_of_calls": round(math.fsum(each["seconds"] for each in calls), 1),
        "seconds_of_work": round(seconds_of_work, 1),
        "work_of_unknown_duration": of_unknown_duration,
        "processes": call.processes,
        "calls": calls,
        "missing": missing,
        "blocks": [
            {"variant": block.variant, "settings": dict(block.changes), "differs": sentences}
            for block, sentences in differs.items()
        ],
        "rows": [_row(entry, paper) for entry in entries],
    }


def _version_of(*packages: str) -> str | None:
    """The version of the first of some packages that is installed; None if none is."""
    for package in packages:
        try:
            return metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return None


def _row(entry: Entry, paper: PaperTable) -> dict[str, Any]:
    """A row of the record, which `_read_row` reads."""
    errors = {}
    for kind, of_seeds in zip(ERROR_KINDS, entry.errors, strict=True):
        errors[kind] = [finite_or_none(value) for value in of_seeds.tolist()]
    return {
        "variant": entry.variant,
        "settings": entry.settings,
        "sequence": entry.sequence,
        "method": entry.method,
        "whole": entry.is_whole,
        "frames": len(entry.truth),
        "sub_sequences": entry.protocol.words,
        "sub_sequence_count": entry.subsequences,
        "removed_share": entry.removed_share,
        "seeds": list(entry.seeds),
        **errors,
        **paper_fields(printed_of(paper, entry), entry.method, entry.errors),
    }


def record_json(record: dict[str, Any]) -> str:
    """The record as the text of its file."""
    return json.dumps(record, indent=1, allow_nan=False) + "\n"


@dataclass(frozen=True, eq=False)
class RecordRow:
    """The errors of a method on a sequence: a row of a record.

    settings : what differs from the presets, as typed.
    whole : whether all frames of a sequence of the benchmark were run, with the benchmark's measure.
    seeds : (S) different seeds.
    removed_share : share of the matches removed in boxes, in [0, 1].
    errors : (S,) of each seed, % or deg/100 m, by kind of `ERROR_KINDS`; NaN for a missing one.
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

    Raises
    ------
    DataError : with the row and what is expected there, for

        - another format, or a field of another type;
        - different numbers of seeds and of errors, or a seed or a row twice;
        - an error that is negative or not finite;
        - a sequence that is called whole with other frames, sub-sequences or another measure than the
          benchmark's, or called a part with the same frames and measure;
        - features that were removed by a method without removal.
    """
    record = read_mapping(path, f"a record of vo reproduce; {REMEDY}")
    if type(record.get("format")) is not int or record["format"] != FORMAT:
        found = json.dumps(record.get("format")) if "format" in record else "missing"
        raise DataError(f"format: expected {FORMAT}, found {found}; {REMEDY}", path)
    rows = record.get("rows")
    if not isinstance(rows, list):
        raise DataError(f"rows: expected a list of rows; {REMEDY}", path)
    read: dict[tuple[str, str, str, str], RecordRow] = {}
    for number, found_row in enumerate(rows, start=1):
        try:
            row = _read_row(found_row)
            key = (row.variant, row.settings, row.sequence, row.method)
            if key in read:
                raise ValueError(
                    "expected one row for each variant, settings, sequence and method, found two"
                )
        except ValueError as error:
            where = f"row {number}{_row_words(found_row)}"
            raise DataError(f"{where}: {error}; {REMEDY}", path) from None
        read[key] = row
    return record, list(read.values())


def _row_words(row: object) -> str:
    """What a message says of a row beside its number: sequence and method, where they are readable."""
    if not isinstance(row, dict):
        return ""
    words = [row.get("sequence"), row.get("method")]
    named = [word for word in words if isinstance(word, str)]
    return f" ({', '.join(named)})" if named else ""


def _read_row(row: object) -> RecordRow:
    """A row, tested field by field; ValueError with what is expected."""
    if not isinstance(row, dict):
        raise ValueError(f"expected an object, found {_shown(row)}")
    variant = _text(row, "variant")
    if variant not in VARIANTS:
        raise ValueError(f"variant: expected {' or '.join(VARIANTS)}, found {_shown(variant)}")
    method = _text(row, "method")
    if method not in VARIANTS[variant]:
        raise ValueError(f"method: expected {', '.join(VARIANTS[variant])}, found {_shown(method)}")
    sequence = _text(row, "sequence")
    frames = _whole_number(row, "frames", least=1)
    whole = _field(row, "whole")
    if type(whole) is not bool:
        raise ValueError(f"whole: expected true or false, found {_shown(whole)}")
    measure = _text(row, "sub_sequences")
    count = _whole_number(row, "sub_sequence_count", least=0)
    if whole:
        _test_whole(sequence, frames, measure, count)
    elif frames == BENCHMARK_FRAMES.get(sequence) and measure == KITTI_PROTOCOL.words:
        raise ValueError(f"whole is false: expected true, or other frames than all {frames} of {sequence}")
    seeds = _seeds(row)
    settings = _text(row, "settings")
    share = _field(row, "removed_share")
    if not _is_number(share) or not 0.0 <= share <= 1.0:
        raise ValueError(f"removed_share: expected a number from 0 to 1, found {_shown(share)}")
    if share > 0 and _filter_rule(variant, method, settings) == NO_REMOVAL:
        raise ValueError(
            f"removed_share: expected 0, since {method} removes no feature, found {_shown(share)}"
        )
    errors = {kind: _errors(row, kind, len(seeds)) for kind in ERROR_KINDS}
    return RecordRow(
        variant=variant,
        settings=settings,
        sequence=sequence,
        method=method,
        whole=whole,
        frames=frames,
        seeds=seeds,
        removed_share=float(share),
        errors=errors,
    )


def _test_whole(sequence: str, frames: int, measure: str, count: int) -> None:
    """ValueError if a row that is called whole has other frames or sub-sequences than the benchmark."""
    if sequence not in BENCHMARK_FRAMES:
        raise ValueError(f"whole is true: expected a sequence of the benchmark, found {_shown(sequence)}")
    if frames != BENCHMARK_FRAMES[sequence]:
        raise ValueError(f"whole is true: expected {BENCHMARK_FRAMES[sequence]} frames, found {frames}")
    if measure != KITTI_PROTOCOL.words:
        raise ValueError(
            f"whole is true: expected sub_sequences {_shown(KITTI_PROTOCOL.words)}, found {_shown(measure)}"
        )
    if count != BENCHMARK_COUNTS[sequence]:
        raise ValueError(
            f"whole is true: expected sub_sequence_count {BENCHMARK_COUNTS[sequence]}, as with the "
            f"benchmark's own poses, found {count}"
        )


def _filter_rule(variant: str, method: str, settings: str) -> str:
    """The rule by which a method removes features: that of the settings as typed, else of the preset."""
    typed = re.search(r"\bfilter\.rule=(\w+)", settings)
    return typed.group(1) if typed else VARIANTS[variant][method].filter.rule


def _field(row: Mapping[str, Any], name: str) -> Any:
    """The value of a field; ValueError if it is missing."""
    if name not in row:
        raise ValueError(f"expected a field {name}, found none")
    return row[name]


def _text(row: Mapping[str, Any], name: str) -> str:
    """The text in a field; ValueError for another value."""
    value = _field(row, name)
    if not isinstance(value, str):
        raise ValueError(f"{name}: expected a text, found {_shown(value)}")
    return value


def _whole_number(row: Mapping[str, Any], name: str, least: int) -> int:
    """The whole number, `least` or more, in a field; ValueError for another value."""
    value = _field(row, name)
    if type(value) is not int or value < least:
        raise ValueError(f"{name}: expected a whole number from {least}, found {_shown(value)}")
    return value


def _seeds(row: Mapping[str, Any]) -> tuple[int, ...]:
    """The different seeds of a row, at least one; ValueError for others."""
    seeds = _field(row, "seeds")
    if not isinstance(seeds, list) or not seeds or not all(type(seed) is int and seed >= 0 for seed in seeds):
        raise ValueError(f"seeds: expected a list of whole numbers from 0, found {_shown(seeds)}")
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: expected each seed once, found {_shown(seeds)}")
    return tuple(seeds)


def _errors(row: Mapping[str, Any], kind: str, seeds: int) -> Array:
    """The errors of a kind, (S,) for S seeds, NaN for a missing one; ValueError for others."""
    values = _field(row, kind)
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
        return abs(value) < TOO_LARGE
    return type(value) is float and math.isfinite(value)


def _shown(value: object) -> str:
    """A value as JSON writes it, shortened."""
    text = json.dumps(value)
    return text if len(text) <= MOST_SHOWN else f"{text[: MOST_SHOWN - 3]}..."
