"""How long matches and runs took that are kept from earlier calls, for estimates on the same processor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..errors import DataError
from ..files import read_mapping, write_atomic
from .folder import read_config
from .identity import processor_name
from .match_cache import CachedMatches

FRONT_END_STAGES = ("wait_images", "matching", "cached_matches")  # of a frame, before the back end
ENDING = ".json"  # of the file beside the matches
EXPECTED = "the time that matches took"


def write_seconds(matches: CachedMatches, seconds: float) -> None:
    """Write down how long this machine took for matches in the cache."""
    data = {"seconds": round(seconds, 3), "processor": processor_name()}
    write_atomic(matches.path.with_suffix(ENDING), json.dumps(data) + "\n")


def seconds_of_matches(matches: CachedMatches) -> float | None:
    """How long matches in the cache took; None if that is not known of this processor."""
    path = matches.path.with_suffix(ENDING)
    try:
        data = read_mapping(path, EXPECTED) if path.exists() else {}
    except DataError:
        return None
    return _positive(data.get("seconds")) if data.get("processor") == processor_name() else None


def seconds_of_run(folder: Path, frames: int) -> float | None:
    """How long a finished run took after its matches; None if that is not known of this processor."""
    data = read_config(folder)
    if _mapping(data.get("machine_info")).get("processor") != processor_name():
        return None
    stages = _mapping(_mapping(data.get("timing")).get("ms_per_frame_of"))
    ms = [_positive(value) or 0.0 for stage, value in stages.items() if stage not in FRONT_END_STAGES]
    return _positive(sum(ms) * frames / 1000.0)


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _positive(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) and value > 0 else None
