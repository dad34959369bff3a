"""`vo check`: the state of packages, data and caches, with a remedy for each problem."""

from __future__ import annotations

import argparse
import os
import platform
from importlib import metadata
from typing import NamedTuple

from ..data.catalogue import KITTI, available, kitti_root, kitti_roots
from ..data.drawn import cache_folder, cache_sizes
from ..data.kitti import count_pairs, wanted_frames
from ..detection.models import detector_folder, list_detectors
from ..errors import DataError
from ..runs.identity import library_versions
from .console import install, print_wrapped, show_table, steps


class Finding(NamedTuple):
    """The state of a part of the installation.

    state : "ok", "note" (optional data are missing or incomplete) or "problem".
    remedy : what to do, as a sentence without its subject; "" where there is nothing to do.
    """

    subject: str
    state: str
    facts: str
    remedy: str = ""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo check`."""
    parser.description = (
        "Check packages, data and caches, and say what to do where something is missing. The exit code is 1 "
        "only for a problem that must be solved."
    )
    parser.set_defaults(command=_check)


def _check(options: argparse.Namespace) -> int:
    """Print the findings and their remedies; exit code 1 for a problem."""
    findings = [_packages(), _kitti(), _detectors(), _cache()]
    rows = [[finding.subject, finding.state, finding.facts] for finding in findings]
    show_table(["subject", "state", "facts"], rows, numbers=False)
    print_wrapped(*(f"{finding.subject}: {finding.remedy}" for finding in findings if finding.remedy))
    has_problem = any(finding.state == "problem" for finding in findings)
    return 1 if has_problem else 0


def _packages() -> Finding:
    """Versions; a problem if several packages of OpenCV have overwritten each other's files."""
    names = {str(package.metadata["Name"]) for package in metadata.distributions()}
    opencv_packages = sorted(name for name in names if name.startswith("opencv-"))
    python = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}"
    facts = "\n".join([python, *(f"{name} {version}" for name, version in library_versions().items())])
    if len(opencv_packages) < 2:
        return Finding("packages", "ok", facts)
    conflict = f"{' and '.join(opencv_packages)} are installed in one folder"
    remedy = f"pip uninstall -y {' '.join(opencv_packages)}, then {install()}"
    return Finding("packages", "problem", facts, f"{conflict}: {remedy}")


def _kitti() -> Finding:
    """KITTI's sequences on this machine, those that lack images, and a KITTI_ROOT that is wrong."""
    ways = {
        "vo data get_kitti --help": f"KITTI's sequences from the web or archives, into {kitti_root()}",
        "vo data from_folder --help": "your own stereo images or video",
    }
    try:
        roots = kitti_roots()
    except DataError as error:
        return Finding("KITTI odometry", "problem", str(error), "or fill this folder" + steps(ways))
    folders = [path for name, path in available().items() if name.startswith(KITTI) and path]
    origin = "KITTI_ROOT" if os.environ.get("KITTI_ROOT") else "KITTI_ROOT is not set"
    places = f"{', '.join(map(str, roots or [kitti_root()]))} ({origin})"
    if not folders:
        return Finding(
            "KITTI odometry",
            "note",
            f"no sequences in {places}",
            "optional; commands that add data" + steps(ways),
        )
    facts = f"{len(folders)} sequences in {places}"
    incomplete = [path.name for path in folders if count_pairs(path) < len(wanted_frames(path) or ())]
    if not incomplete:
        return Finding("KITTI odometry", "ok", facts)
    remedy = "incomplete" + steps({"vo data check_kitti": "lists the missing parts"})
    return Finding("KITTI odometry", "note", f"{facts}; incomplete: {', '.join(incomplete)}", remedy)


def _detectors() -> Finding:
    """The downloaded models; the kit has one of its own, so it is no problem if there are none."""
    names = list_detectors()
    if names:
        return Finding("downloaded detectors", "ok", ", ".join(names))
    download = steps({"vo data get_detector yolox-tiny": "for real images, 20 MB"})
    remedy = "optional" + download
    return Finding("downloaded detectors", "ok", f"none in {detector_folder()}", remedy)


def _cache() -> Finding:
    """The size of the cache by kind, and how to free space."""
    sizes = [f"{name}: {size / 1e6:.1f} MB" for name, size in cache_sizes().items()]
    to_free = steps({"vo data clean_cache": "deletes all of it but registered detectors"})
    return Finding("cache", "ok", "\n".join([str(cache_folder()), *sizes]), f"to free space{to_free}")
