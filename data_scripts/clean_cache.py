"""Delete what the kit keeps in its cache: drawn streets, matches, detected
boxes and hashes of images. The kit draws and computes them again where it
needs them. Registered detectors stay. A link is deleted, but not what it leads
to.

examples:
  vo data clean_cache
  vo data clean_cache --cache /scratch/vo
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from filelock import FileLock, Timeout

from fetch.download import format_bytes
from vo_lib.commands.common import add_cache
from vo_lib.commands.console import print_wrapped
from vo_lib.data.drawn import MARKER, cache_folder, cache_sizes
from vo_lib.detection.models import detector_folder
from vo_lib.errors import DataError
from vo_lib.files import LOCK


def add_options(parser: argparse.ArgumentParser) -> None:
    """The option."""
    add_cache(parser)


def run(options: argparse.Namespace) -> int:
    """Clean the cache, and print what was deleted."""
    cache = cache_folder(options.cache)
    if not cache.exists():
        print_wrapped(f"{cache}: there is no cache")
        return 0
    marker = cache / MARKER
    if cache.is_symlink() or marker.is_symlink() or not marker.is_file():
        raise DataError(f"was not made by the kit (no {MARKER}, or a link), so nothing was deleted", cache)
    refuse_in_use(cache)
    sizes = cache_sizes(options.cache)
    # Moved away first: a process that begins to write meanwhile then fails, and never gets half a folder.
    doomed = Path(tempfile.mkdtemp(dir=cache))
    print_wrapped(f"{cache}: drawn streets and what was computed go, registered detectors stay")
    for path in sorted(cache.iterdir()):
        stays = path.name in (MARKER, detector_folder().name, doomed.name)
        if not stays:
            path.rename(doomed / path.name)
        size = f" {format_bytes(sizes[path.name])}" if path.name in sizes else ""
        if path.name not in (MARKER, doomed.name):
            print_wrapped(f"{path.name}:{size} {'kept' if stays else 'deleted'}")
    shutil.rmtree(doomed)
    return 0


def refuse_in_use(cache: Path) -> None:
    """Raise `DataError` if a process is writing into the cache."""
    for file in cache.rglob(f"*{LOCK}"):
        if file.is_symlink() or not file.is_file():
            continue
        try:
            with FileLock(file, timeout=0):
                pass
        except Timeout:
            raise DataError("another process is writing into it: try again when it ends", cache) from None
