"""Fetch a vehicle detector by name, or register one from disk. Without a name: the list.

examples:
  python get_detector.py
  python get_detector.py yolox-tiny
  python get_detector.py yolov8n                      says how to make it, and its licence
  python get_detector.py mine --from runs/best.onnx --licence "own work"
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from data_scripts.fetch.download import in_words
from vo_lib.commands.console import OneLineParser, say, show_table
from vo_lib.commands.script import confirm, guarded, transferring
from vo_lib.core.errors import DataError
from vo_lib.data.places import detector_folder, script_command
from vo_lib.detection.detectors import FETCHABLE, YOLOV8, fetch_detector, known, register_detector


def parser() -> argparse.ArgumentParser:
    """Options of the script."""
    made = OneLineParser(
        prog="get_detector.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("name", nargs="?", help=f"{', '.join(FETCHABLE)}, or a name of your own with --from")
    made.add_argument("--from", dest="source", type=Path, metavar="FILE", help="an ONNX file on disk")
    made.add_argument("--licence", default="", metavar="TEXT", help="to be remembered with --from")
    made.add_argument("--folder", type=Path, metavar="DIR", help=f"where to; default {detector_folder()}")
    made.add_argument("--url", help="a mirror that has the same file")
    made.add_argument("--yes", action="store_true", help="start without asking")
    return made


def main(words: list[str] | None = None) -> int:
    """Run the script."""
    options = parser().parse_args(words)
    return guarded("get_detector.py", lambda: get(options))


def get(options: argparse.Namespace) -> int:
    """List, explain, register or fetch."""
    folder: Path = options.folder or detector_folder()
    if options.name is None:
        if options.source is not None:
            raise DataError("say under which name: get_detector.py NAME --from FILE")
        rows = [
            [d.name, in_words(d.size), d.licence, d.about, "here" if path else "not fetched"]
            for d, path in known(folder).values()
        ]
        show_table(
            f"detectors in {folder}", ["name", "size", "licence", "about", "state"], rows, numbers=False
        )
    elif options.source is not None:
        detector = register_detector(options.name, options.source, folder, options.licence)
        say(f"{detector.name}: {in_words(detector.size)}, SHA-256 {detector.sha256}")
        say(f"registered as {folder / detector.file}")
    elif options.name.startswith("yolov8"):
        example = f"{script_command('get_detector.py')} yolov8n --from yolov8n.onnx --licence AGPL-3.0"
        say(*YOLOV8, f"  {example}")
    else:
        return fetch(options, folder)
    return 0


def fetch(options: argparse.Namespace, folder: Path) -> int:
    """Say what comes, ask, fetch, verify."""
    if options.name not in FETCHABLE:
        raise DataError(f"no detector is called {options.name!r}; expected one of {', '.join(FETCHABLE)}")
    detector = FETCHABLE[options.name]
    say(
        f"{detector.name}: {in_words(detector.size)}, licence {detector.licence}, {detector.about}",
        f"from {options.url or detector.url}",
        f"SHA-256 {detector.sha256}",
    )
    if known(folder)[options.name][1] is None and not confirm(f"Fetch it into {folder}?", options.yes):
        say("nothing was written")
        return 1
    with transferring(detector.file) as report:
        path = fetch_detector(options.name, folder, report, options.url)
    say(f"verified: {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
