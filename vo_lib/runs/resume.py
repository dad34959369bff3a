"""A run in a folder that can be stopped at any moment and started again."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..beyond.odometry import State
from ..config import Config
from ..core.errors import DataError
from ..core.types import Progress
from ..data.sequence import Sequence
from .identity import NOT_USED, run_identity
from .match_cache import CachedMatches
from .results import CONFIG, mend_metrics, read_config, read_run, write_run
from .run_log import EVERY, RunLog, discard, logged_frames
from .runner import Chain, FoundMatches, Run, one_blas_thread

LOCK = ".lock"
ABANDONED = 60.0  # seconds; no write takes so long
ODOMETRY, FRONT_END = "odometry.", "front_end."


def resumable_run(
    folder: Path,
    sequence: Sequence,
    config: Config,
    method: str,
    *,
    cached: bool = False,
    cache: Path | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> tuple[Run, bool]:
    """A run whose files are in `folder`: begun, continued, or only read where it is finished.

    Killed at any moment and started again it gives the same bytes; at most 50 frames are done twice.

    Parameters
    ----------
    folder : an existing folder, best from `results.run_folder`.
    method : the name written into the folder.
    cached : take the matches from the match cache, and keep them there; `cache` is its folder, by default in
        the user's cache folder.
    fresh : start anew whatever the folder holds; finished files stay until new ones replace them.
    progress : called with (frames done, frames in all) after each frame.

    Returns
    -------
    The run, and whether it was finished before.

    Raises
    ------
    DataError : the folder holds another run, another process works in it, or it cannot be written.
    """
    identity = _as_read(run_identity(sequence, config, method))
    with only_process(folder):
        log = None if fresh else RunLog.find(folder)
        if log is None and not fresh and is_finished(folder):
            _refuse_another(folder, read_config(folder), identity)
            result = read_run(folder, sequence)
            mend_metrics(folder, result)
            return result, True
        if log is not None:
            _refuse_another(folder, log.identity, identity)
        log = log or RunLog.start(folder, identity)
        try:
            chain = _go_on(log, sequence, config, cached, cache, progress)
        except BaseException:
            log.close()
            if log.frames == 0:
                discard(folder)
            raise
        log.close()
        result = chain.result()
        write_run(folder, result, method, identity)
        discard(folder)
    return result, False


def is_finished(folder: Path) -> bool:
    """Whether a folder holds a finished run, and none in progress."""
    return (folder / CONFIG).exists() and logged_frames(folder) is None


def _go_on(
    log: RunLog,
    sequence: Sequence,
    config: Config,
    cached: bool,
    cache: Path | None,
    progress: Progress | None,
) -> Chain:
    """The chain after the last frame, each frame from the log's checkpoint on logged as it is done."""
    chain = Chain(sequence, config)
    done, front_end = log.frames, _part(log.state, FRONT_END)
    for motion in log.motions:
        chain.add(motion)
    if done > 0:
        chain.odometry.restore(_part(log.state, ODOMETRY))
    if progress is not None and done > 0:
        progress(done, len(sequence))
    if done == len(sequence):
        return chain
    front = config.features, config.matching
    matches: CachedMatches | FoundMatches
    if cached:
        matches = CachedMatches(sequence, *front, cache, start=done)
    elif done > 0 and not front_end:
        # The frames so far came from the cache, which knows the front end's state.
        matches = CachedMatches(sequence, *front, cache, start=done)
    else:
        matches = FoundMatches(sequence, *front, start=done, state=front_end)
    with one_blas_thread():
        for index, frame in enumerate(matches, start=done):
            chain.step(index, frame, sequence.boxes(index))
            if index > 0:
                log.append(chain.motions[-1])
            if (index + 1) % EVERY == 0 or index + 1 == len(sequence):
                states = {ODOMETRY: chain.odometry.state(), FRONT_END: matches.state()}
                log.checkpoint({p + name: a for p, state in states.items() for name, a in state.items()})
            if progress is not None:
                progress(index + 1, len(sequence))
    return chain


@contextmanager
def only_process(folder: Path) -> Iterator[None]:
    """A context in which no other process works in the folder; the system's lock ends with the process."""
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise DataError("another process is working in this folder", folder) from None
    except (OSError, NotImplementedError) as error:
        raise DataError(f"the folder cannot be locked: {error}", folder) from None
    try:
        _clear_abandoned(folder)
        yield
        _clear_abandoned(folder)
    finally:
        # Removed while it is held: whoever waits for it sees that the name is gone, and starts over.
        with suppress(OSError):
            (folder / LOCK).unlink()
        lock.release()


def _clear_abandoned(folder: Path) -> None:
    """Remove the half-written files of processes that were killed."""
    with suppress(OSError):
        for left in folder.glob(".*.tmp"):
            if time.time() - left.stat().st_mtime > ABANDONED:
                left.unlink()


def _part(state: State, prefix: str) -> State:
    return {name.removeprefix(prefix): a for name, a in state.items() if name.startswith(prefix)}


def _as_read(identity: dict[str, Any]) -> dict[str, Any]:
    """An identity as it comes back from JSON: lists in place of tuples."""
    plain: dict[str, Any] = json.loads(json.dumps(identity))
    return plain


def _refuse_another(folder: Path, there: dict[str, Any], wanted: dict[str, Any]) -> None:
    """`DataError` naming what differs, unless the folder holds the run that is wanted."""
    try:
        differs = list(_differences(there, wanted))
    except (AttributeError, TypeError, ValueError):
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
        yield "another calibration"
    labels = {there.get("labels"), wanted["labels"]}
    if len(labels - {NOT_USED}) > 1:
        yield "other labels"
    before, now = ({"method": d.get("method")} | _flat(d.get("settings", {})) for d in (there, wanted))
    before |= there.get("made_with", {})
    now |= wanted["made_with"]
    if before.pop("code", None) != now.pop("code"):
        yield "the kit's code has changed"
    for name in now | before:
        if before.get(name) != now.get(name):
            yield f"{name} is {before.get(name)} there and {now.get(name)} here"


def _flat(nested: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by their dotted names."""
    flat: dict[str, Any] = {}
    for name, value in nested.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat
