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

from fetch.detectors import (
    FETCHABLE,
    LICENCE,
    NAME,
    PAPERS_DETECTOR,
    Detector,
    fetch_detector,
    how_to_export,
    register_detector,
)
from fetch.download import confirm, format_bytes
from vo_lib.commands.console import print_lines, print_wrapped, reporting, show_table
from vo_lib.detection.model_files import external_names
from vo_lib.detection.models import MODELS, ULTRALYTICS, detector_folder, list_detectors
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError, did_you_mean

MAX_CLASSES_SHOWN = 8


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
        show_detectors(folder)
    elif options.source is not None:
        path = register_detector(options.name, options.source, folder)
        print_wrapped(f"registered as {path}", describe_classes(YoloDetector(path)))
    elif options.name in FETCHABLE:
        return fetch(FETCHABLE[options.name], folder, options.yes)
    elif Path(options.name).is_file():
        path = Path(options.name)
        name = path.stem if NAME.fullmatch(path.stem) else "mine"
        command = shlex.join(["vo", "data", "get_detector", name, "--from", str(path)])
        raise DataError(f"is a file, expected a name; to register the file: {command}", path)
    elif ULTRALYTICS.fullmatch(options.name):
        words, commands = how_to_export(options.name)
        print_wrapped(words)
        for command in commands:
            print_lines(f"  {command}")
    else:
        near = did_you_mean(options.name, [*FETCHABLE, PAPERS_DETECTOR])
        raise DataError(f"unknown detector {options.name!r}; {near}expected one of {', '.join(FETCHABLE)}")
    return 0


def show_detectors(folder: Path) -> None:
    """Print the detectors that can be downloaded, exported, or used at once."""
    local = list_detectors(folder)
    rows = [["street", format_bytes(total_size(MODELS["street"])), "drawn streets only", "part of the kit"]]
    for detector in FETCHABLE.values():
        state = "available" if detector.name in local else "not downloaded"
        rows.append([detector.name, format_bytes(detector.size), detector.about, state])
    if PAPERS_DETECTOR not in local:
        rows.append([PAPERS_DETECTOR, "", "COCO, the paper's YOLOv8", "export it, see below"])
    for name, path in local.items():
        if name not in FETCHABLE:
            rows.append([name, format_bytes(total_size(path)), "registered", "available"])
    print_wrapped(f"detectors in {folder}")
    show_table(["name", "size", "about", "state"], rows, numbers=False)
    print_wrapped(
        f"`vo data get_detector {PAPERS_DETECTOR}` says how to export YOLOv8; the same goes for "
        "yolo11n, yolo26n, rtdetr-l and Ultralytics' other models. Your own ONNX file: "
        "`vo data get_detector NAME --from FILE`, or give its path to --detector."
    )


def total_size(path: Path) -> int:
    """Size of a model in bytes, with the files of weights that are there."""
    parts = [path.parent / name for name in external_names(path)]
    return sum(file.stat().st_size for file in (path, *parts) if file.is_file())


def describe_classes(detector: YoloDetector) -> str:
    """A line on the classes of a detector, and on where their names come from."""
    if detector.names is None:
        count = detector.class_count
        numbers = "" if count is None else f", 0 to {count - 1}"
        return f"the file has no class names: choose its classes by number{numbers}"
    listed = ", ".join(detector.names[:MAX_CLASSES_SHOWN])
    if len(detector.names) > MAX_CLASSES_SHOWN:
        listed += ", …"
    if not detector.named:
        return f"the file has no class names; 80 classes are taken as COCO's: {listed}"
    noun = "class" if len(detector.names) == 1 else "classes"
    return f"{len(detector.names)} {noun}: {listed}"


def fetch(detector: Detector, folder: Path, yes: bool) -> int:
    """Describe the detector, ask for confirmation, then download and verify the file."""
    print_wrapped(
        f"{detector.name}: {format_bytes(detector.size)}, licence {LICENCE}, {detector.about}",
        f"from {detector.url}",
        f"SHA-256 {detector.sha256}",
    )
    if detector.name not in list_detectors(folder) and not confirm(f"Download to {folder}?", yes):
        print_wrapped("nothing was downloaded")
        return 1
    with reporting(detector.name, in_bytes=True) as report:
        path = fetch_detector(detector, folder, report)
    print_wrapped(f"verified: {path}")
    return 0
