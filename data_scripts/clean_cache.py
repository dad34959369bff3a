"""Delete the matches of other versions of the code from the cache.

Each version of a front end has its own folder of matches. The matches of the
current version are kept.

examples:
  vo data clean_cache
  vo data clean_cache --cache /scratch/vo
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from fetch.download import format_bytes
from vo_lib.commands.common import add_cache
from vo_lib.commands.console import print_lines
from vo_lib.runs.identity import FRONT_END_CODE
from vo_lib.runs.match_cache import code_folder, folder_size, match_folder


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_cache(parser)


def clean_matches(cache: Path | None = None) -> int:
    """Delete the matches of other versions of the code; return the number of deleted bytes."""
    current = {code_folder(variant, cache) for variant in FRONT_END_CODE}
    stale = [path for path in match_folder(cache).glob("*") if path not in current]
    size = sum(map(folder_size, stale))
    for path in stale:
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    return size


def run(options: argparse.Namespace) -> int:
    """Delete the old matches and print the number of bytes deleted."""
    removed = clean_matches(options.cache)
    folder = match_folder(options.cache)
    print_lines(f"{folder}: {format_bytes(removed)} deleted, {format_bytes(folder_size(folder))} remain")
    return 0
