"""Delete the matches of other versions of the code from the cache.

Each version of a front end has its own folder of matches. The matches of the
current version are kept.

examples:
  vo data clean_cache
  vo data clean_cache --cache /scratch/vo
"""

from __future__ import annotations

import argparse
import sys

from fetch.download import in_words
from vo_lib.commands.common import add_cache
from vo_lib.commands.console import say
from vo_lib.commands.scripts import run_script
from vo_lib.runs.matches import clean_matches, folder_size, match_folder


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_cache(parser)


def run(options: argparse.Namespace) -> int:
    """Delete the folders and print the number of bytes."""
    removed, folder = clean_matches(options.cache), match_folder(options.cache)
    say(f"{folder}: {in_words(removed)} deleted, {in_words(folder_size(folder))} remain")
    return 0


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
