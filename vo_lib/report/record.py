"""The record of a reproduction: numbers by seed, versions and processor, to be archived or sent to others."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..files import file_sha256
from ..runs.identity import library_versions, machine_info
from .blocks import Block
from .page import finite_or_none
from .table1 import ERROR_KINDS, Entry

RECORD = "reproduction.json"
FORMAT = 1


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
