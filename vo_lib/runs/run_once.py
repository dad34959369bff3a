"""A run in a folder: done once, read back when it is asked for again, and refused where another one is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..config import PublishedConfig
from ..core.errors import DataError
from ..core.files import only_process
from ..core.types import Progress
from ..data.sequence import Sequence
from .identity import NOT_USED, run_identity
from .match_cache import CachedMatches
from .results import CONFIG, RUN_FILES, is_finished, mend_metrics, read_config, read_run, write_run
from .runner import Run, run_methods


def run_once(
    folder: Path,
    sequence: Sequence,
    config: PublishedConfig,
    method: str,
    *,
    cached: bool = False,
    cache: Path | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> tuple[Run, bool]:
    """A run whose files are in `folder`: done from the first frame, or only read where it is finished.

    Files are written after the last frame. Killed at any moment and started again it gives the same bytes.

    Parameters
    ----------
    folder : an existing folder, best from `results.run_folder`.
    method : the name written into the folder.
    cached : take the matches from the match cache, and keep them there; `cache` is its folder, by default in
        the user's cache folder.
    fresh : do it whatever the folder holds; finished files stay until new ones replace them.
    progress : called with (frames done, frames in all) after each frame.

    Returns
    -------
    The run, and whether it was finished before.

    Raises
    ------
    DataError : the folder holds another run or results of something else, another process works in it, or it
        cannot be written.
    """
    # As it comes back from JSON: lists in place of tuples.
    identity = json.loads(json.dumps(run_identity(sequence, config, method)))
    with only_process(folder):
        if not fresh:
            _refuse_another(folder, identity)
            if is_finished(folder):
                result = read_run(folder, sequence)
                mend_metrics(folder, result)
                return result, True
        matches = CachedMatches(sequence, config.features, config.matching, cache) if cached else None
        result = run_methods(sequence, {method: config}, progress, matches)[method]
        write_run(folder, result, method, identity)
    return result, False


def _refuse_another(folder: Path, wanted: dict[str, Any]) -> None:
    """`DataError` naming what differs, where the folder holds anything else than the run that is wanted."""
    if not (folder / CONFIG).exists():
        for name in RUN_FILES:
            if (folder / name).exists():
                raise DataError(
                    f"of something else, for there is no {CONFIG} beside it; choose another folder, or start "
                    "anew with --fresh",
                    folder / name,
                )
        return
    there = read_config(folder, unfinished=True)
    try:
        differs = list(_differences(there, wanted))
    except (AttributeError, TypeError, ValueError, RecursionError):
        differs = ["what it says of that run is damaged"]
    if differs:
        more = f" and {len(differs) - 3} more" if len(differs) > 3 else ""
        raise DataError(
            f"the folder holds another run: {'; '.join(differs[:3])}{more}; "
            "choose another folder, or start anew with --fresh",
            folder,
        )


def _differences(there: dict[str, Any], wanted: dict[str, Any]) -> Iterator[str]:
    """In words, everything that decides the poses and differs; the name of a sequence does not."""
    if there.get("frames") != wanted["frames"] or there.get("images") != wanted["images"]:
        old, new = (f"{d.get('sequence')} {'-'.join(map(str, d.get('frames', [])))}" for d in (there, wanted))
        yield "other images" if old == new else f"it has {old} and this is {new}"
    elif there.get("camera") != wanted["camera"]:
        yield "another calib.txt"
    if there.get("calibration") != wanted["calibration"]:
        yield "it started from another calibration"
    if len({there.get("labels"), wanted["labels"]} - {NOT_USED}) > 1:
        yield "other labels"
    kept = ("method", "variant", "settings", "made_with")
    before, now = (_flat({name: each.get(name) for name in kept}) for each in (there, wanted))
    for name in now | before:
        if before.get(name) == now.get(name):
            continue
        short = name.removeprefix("settings.").removeprefix("made_with.")
        values = f"{short} is {before.get(name)} there and {now.get(name)} here"
        yield "the kit's code has changed" if name == "made_with.code" else values


def _flat(nested: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by their dotted names."""
    flat: dict[str, Any] = {}
    for name, value in nested.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat
