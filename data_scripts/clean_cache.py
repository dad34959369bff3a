"""Delete from the cache what this version of the kit has no use for.

These are drawn scenes, matches and detected boxes of other versions, hashes of
images (computed again in seconds), notes on imported sequences that are gone,
and the drafts of killed processes. With --all, everything that the kit wrote
into the cache is deleted. Other files are never touched, nor are links: files
of your own in a scene's folder stay, and so do labels that write_labels put
there, and drawn labels or images that you changed. The command names them.

examples:
  vo data clean_cache
  vo data clean_cache --cache /scratch/vo
  vo data clean_cache --all
"""

from __future__ import annotations

import argparse
import os

from fetch.download import format_bytes
from vo_lib.commands.cache_contents import cache_items, clean_cache
from vo_lib.commands.common import add_cache
from vo_lib.commands.console import print_wrapped
from vo_lib.data.drawn import user_cache

NAMED = 10  # files and folders that are kept, at most


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_cache(parser)
    text = "delete everything that the kit wrote into the cache"
    parser.add_argument("--all", dest="everything", action="store_true", help=text)


def run(options: argparse.Namespace) -> int:
    """Clean the cache and print the number of bytes deleted."""
    deleted, kept = clean_cache(options.cache, options.everything)
    remain = sum(item.size for item in cache_items(options.cache))
    folder = options.cache or user_cache()
    print_wrapped(f"{folder}: {format_bytes(deleted)} deleted, {format_bytes(remain)} remain")
    if kept:
        names = [os.path.relpath(path, folder) for path in kept[:NAMED]]
        more = f" and {len(kept) - NAMED} more" if len(kept) > NAMED else ""
        print_wrapped(f"kept, as files or links of your own: {', '.join(names)}{more}")
    return 0
