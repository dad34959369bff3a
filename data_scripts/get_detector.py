"""Download a vehicle detector, or register one from disk; without a name, list
the detectors.

examples:
  vo data get_detector
  vo data get_detector yolox-tiny
  vo data get_detector yolov8n                      its licence and commands
  vo data get_detector mine --from runs/best.onnx
"""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from fetch.detectors import FETCHABLE, LICENCE, NAME, YOLOV8, Detector, fetch_detector, register_detector
from fetch.download import confirm, format_bytes
from vo_lib.commands.console import print_lines, reporting, show_table, typed
from vo_lib.detection.models import detector_folder, list_detectors
from vo_lib.errors import DataError, did_you_mean


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script."""
    text = f"{', '.join(FETCHABLE)}, or, with --from, a name of your choice"
    parser.add_argument("name", nargs="?", help=text)
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE", help="register this ONNX file")
    text = f"folder of the detectors; default {detector_folder()}"
    parser.add_argument("--folder", type=Path, metavar="DIR", help=text)
    parser.add_argument("--yes", action="store_true", help="download without confirmation")


def run(options: argparse.Namespace) -> int:
    """List, describe, register or download detectors."""
    folder: Path = options.folder or detector_folder()
    if options.name is None:
        if options.source is not None:
            raise DataError("the name is missing: get_detector NAME --from FILE")
        local = list_detectors(folder)
        rows = [
            [d.name, format_bytes(d.size), d.about, "available" if d.name in local else "not downloaded"]
            for d in FETCHABLE.values()
        ]
        rows += [
            [name, format_bytes(path.stat().st_size), "registered", "available"]
            for name, path in local.items()
            if name not in FETCHABLE
        ]
        print_lines(f"detectors in {folder}")
        show_table(["name", "size", "about", "state"], rows, numbers=False)
    elif options.source is not None:
        path = register_detector(options.name, options.source, folder)
        print_lines(f"registered as {path}; `vo run` says if the detector finds no vehicle")
    elif options.name in FETCHABLE:
        return fetch(FETCHABLE[options.name], folder, options.yes)
    elif (path := Path(options.name)).is_file():
        name = path.stem if NAME.fullmatch(path.stem) else "mine"
        command = typed(shlex.join(["vo", "data", "get_detector", name, "--from", str(path)]))
        raise DataError(f"is a file, expected a name; to register the file: {command}", path)
    elif options.name.startswith("yolov8"):
        print_lines(*YOLOV8)
    else:
        near = did_you_mean(options.name, [*FETCHABLE, "yolov8n"])
        raise DataError(f"unknown detector {options.name!r}; {near}expected one of {', '.join(FETCHABLE)}")
    return 0


def fetch(detector: Detector, folder: Path, yes: bool) -> int:
    """Describe the detector, ask for confirmation, then download and verify the file."""
    print_lines(
        f"{detector.name}: {format_bytes(detector.size)}, licence {LICENCE}, {detector.about}",
        f"from {detector.url}",
        f"SHA-256 {detector.sha256}",
    )
    if detector.name not in list_detectors(folder) and not confirm(f"Download to {folder}?", yes):
        print_lines("nothing was downloaded")
        return 1
    with reporting(detector.name, in_bytes=True) as report:
        path = fetch_detector(detector, folder, report)
    print_lines(f"verified: {path}")
    return 0
