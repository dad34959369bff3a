"""Scenes in the user's cache: drawn under another name, listed in a manifest, then given their own."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from pathlib import Path

from loky.process_executor import BrokenProcessPool

from vo_lib.core.errors import DataError
from vo_lib.core.types import Progress
from vo_lib.data.drawn import MANIFEST, find_scene, fingerprint, is_complete
from vo_lib.data.scenes import SceneConfig

from .folder import write_scene

ABANDONED = 6 * 3600.0  # seconds after which a half-written scene is thrown away


def draw_scene(
    config: SceneConfig,
    parent: Path,
    progress: Progress | None = None,
    jobs: int = 2,
    frames: range | None = None,
) -> Path:
    """The folder of a scene in the cache `parent`; draws it unless it lies there complete.

    Parameters
    ----------
    progress : called with (frames done, frames) while drawing.
    jobs : processes that draw. The pictures do not depend on it.
    frames : draw no others where the whole scene is not there: a part in a folder of its own.

    Raises `DataError` where the cache cannot be written.
    """
    folder, complete = find_scene(config, parent, frames)
    if complete:
        return folder
    try:
        parent.mkdir(parents=True, exist_ok=True)
        _sweep(parent, folder.name)
        prefix = f".{folder.name}."
        with tempfile.TemporaryDirectory(prefix=prefix, dir=parent, ignore_cleanup_errors=True) as draft:
            write_scene(config, Path(draft), progress, jobs, frames)
            _write_manifest(Path(draft))
            _publish(Path(draft), folder)
    except OSError as error:
        raise DataError(f"the cache cannot be written: {error.strerror}", parent) from None
    except BrokenProcessPool:
        raise DataError("a process that draws was killed, perhaps for too much memory") from None
    return folder


def _write_manifest(folder: Path) -> None:
    """List every file with its size and checksum; the last file written, so that it stands for the end."""
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    manifest = {name: fingerprint(folder / name) for name in names}
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=0) + "\n")


def _publish(draft: Path, folder: Path) -> None:
    """Give a finished scene its name; of two drawn at the same time one stays."""
    for _ in range(5):
        try:
            os.rename(draft, folder)
            return
        except OSError:
            if is_complete(folder):
                return
            broken = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
            try:
                os.rename(folder, broken / "broken")
            except OSError:
                time.sleep(0.05)  # another process is about to put its own there
            shutil.rmtree(broken, ignore_errors=True)
    raise DataError("the finished scene cannot take its place; is the folder in use?", folder)


def _sweep(parent: Path, name: str) -> None:
    """Throw away what a process that was killed left half written."""
    for left in parent.glob(f".{name}.*"):
        if time.time() - left.stat().st_mtime > ABANDONED:
            shutil.rmtree(left, ignore_errors=True)
