"""`vo list` and `vo check`: sequences found; what is installed, and what is missing."""

from __future__ import annotations

import argparse
import platform
from dataclasses import dataclass

import cv2

from ..core.errors import DataError
from ..data.kitti import EXPECTED_FRAMES, count_pairs
from ..data.sequence import available, kitti_root, kitti_roots
from ..detection.detectors import detector_folder, known
from .console import say, show_table
from .script import install, installed_version, steps

PACKAGES = ("numpy", "opencv-python-headless", "onnxruntime", "matplotlib", "jupyterlab", "ipywidgets")
OPENCV_NAMES = [f"opencv-{kind}{head}" for kind in ("python", "contrib-python") for head in ("", "-headless")]


@dataclass(frozen=True)
class Finding:
    """One line of the check: what was looked at, what was found, and what to do where it is not well.

    `state` is "ok", "note" (optional thing missing) or "problem".
    """

    what: str
    state: str
    found: str
    remedy: str = ""


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo list` or `vo check`."""
    parser.set_defaults(command=_check if parser.prog.endswith("check") else _list)


def _list(options: argparse.Namespace) -> int:
    found = {name: str(path or "drawn on first use") for name, path in available().items()}
    show_table("", ["name", "folder"], [list(row) for row in found.items()], numbers=False)
    if not any(name.startswith("kitti/") for name in found):
        say("no KITTI sequences found; `vo check` says how to get them")
    return 0


def _check(options: argparse.Namespace) -> int:
    findings = check()
    rows = [[f.what, f.state, f.found] for f in findings]
    show_table("", ["what", "state", "found"], rows, numbers=False)
    say(*(f"{f.what}: {f.remedy}" for f in findings if f.remedy))
    return 1 if any(finding.state == "problem" for finding in findings) else 0


def check() -> list[Finding]:
    """All findings, problems and notes included, in a fixed order."""
    python = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    versions = {name: installed_version(name) for name in PACKAGES}
    packages = [
        Finding(name, "ok", found) if found else Finding(name, "problem", "not installed", install())
        for name, found in versions.items()
    ]
    return [Finding("Python", "ok", python), *packages, _opencv(), _kitti(), _detectors()]


def _opencv() -> Finding:
    present = [name for name in OPENCV_NAMES if installed_version(name)]
    if len(present) < 2:
        return Finding("one OpenCV only", "ok", f"cv2 {cv2.__version__}")
    remedy = f"pip uninstall -y {' '.join(present)}, then {install()}"
    return Finding("one OpenCV only", "problem", " and ".join(present) + " share one folder", remedy)


def data_steps() -> dict[str, str]:
    """How one comes to data, step by step: commands, and what each does."""
    return {
        "vo data get_kitti --sequences 07,04": "two short sequences with true poses, 0.7 GB, into "
        f"{kitti_root()}",
        "vo data get_kitti --from-zip FILE": "the same out of KITTI's archives, where you have them",
        "vo data get_kitti --sequences 00-10 --link DIR": "or out of a KITTI tree that you have (or set "
        "KITTI_ROOT)",
        "vo data check_kitti": "what is complete, what is missing, and the command that gets it",
        "vo data get_detector yolox-tiny": "a vehicle detector for real images, 20 MB",
        "vo data from_folder --help": "stereo images or a video of your own",
    }


def _steps(*scripts: str) -> str:
    """The steps of some scripts."""
    return steps({name: text for name, text in data_steps().items() if name.split()[2] in scripts})


def _kitti() -> Finding:
    found = {name: path for name, path in available().items() if name.startswith("kitti/") and path}
    if not found:
        remedy = "optional; the steps, in their order" + _steps("get_kitti", "check_kitti", "from_folder")
        return Finding("KITTI odometry", "note", "no sequences", remedy)
    words = f"{len(found)} sequences in {', '.join(map(str, kitti_roots()))}"
    short = [p.name for p in found.values() if count_pairs(p) < EXPECTED_FRAMES.get(p.name, 0)]
    if short:
        words = f"{words}; incomplete: {', '.join(short)}"
        return Finding("KITTI odometry", "note", words, _steps("check_kitti"))
    return Finding("KITTI odometry", "ok", words)


def _detectors() -> Finding:
    remedy = _steps("get_detector")
    try:
        here = [name for name, (_, path) in known().items() if path is not None]
    except DataError as error:
        return Finding("fetched detectors", "problem", str(error), remedy)
    if here:
        return Finding("fetched detectors", "ok", ", ".join(here))
    none = f"none in {detector_folder()}"
    return Finding("fetched detectors", "note", none, "optional, for real images" + remedy)
