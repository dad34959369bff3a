"""How long it took to compute the matches and runs that are kept, for estimates of further ones.

A time counts only on the processor on which it was measured.
"""

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
TIME_ENDING = ".json"  # the file with the time is beside that of the matches, with this ending
EXPECTED = "the time that matches took"  # in the message on such a file
NO_TIME = 1e12  # a number from here on is no time that anything took; it may not even fit a float


def write_seconds(matches: CachedMatches, seconds: float) -> None:
    """Write down how long this machine took for matches in the cache."""
    data = {"seconds": round(seconds, 3), "processor": processor_name()}
    write_atomic(matches.path.with_suffix(TIME_ENDING), json.dumps(data) + "\n")


def seconds_of_matches(matches: CachedMatches) -> float | None:
    """How long matches in the cache took, in seconds; None if that is not known of this processor."""
    path = matches.path.with_suffix(TIME_ENDING)
    try:
        data = read_mapping(path, EXPECTED) if path.exists() else {}
    except DataError:
        return None
    if data.get("processor") != processor_name():
        return None
    return _positive_number(data.get("seconds"))


def seconds_of_run(folder: Path, frames: int) -> float | None:
    """How long a finished run took, in seconds and without its matches; None if not known of this processor.

    frames : number of frames of the run.
    """
    data = read_config(folder)
    machine = _mapping_or_empty(data.get("machine_info"))
    if machine.get("processor") != processor_name():
        return None
    timing = _mapping_or_empty(data.get("timing"))
    ms_of_stages = _mapping_or_empty(timing.get("ms_per_frame_of"))
    of_back_end = [ms for stage, ms in ms_of_stages.items() if stage not in FRONT_END_STAGES]
    ms_per_frame = sum(_positive_number(ms) or 0.0 for ms in of_back_end)
    return _positive_number(ms_per_frame * frames / 1000.0)


def _mapping_or_empty(value: Any) -> dict[str, Any]:
    """A value of JSON if it is an object, else {}: a person may have edited the file."""
    return value if isinstance(value, dict) else {}


def _positive_number(value: Any) -> float | None:
    """A value of JSON if it is a number above 0 and below `NO_TIME`, else None; `true` is no number."""
    return float(value) if type(value) in (int, float) and 0 < value < NO_TIME else None
