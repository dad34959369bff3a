"""What is installed and what is missing: the facts behind `vo check`."""

from __future__ import annotations

import importlib.metadata as metadata
import platform
import sys
from dataclasses import dataclass

from .sequence import available, kitti_roots

PACKAGES = ("numpy", "opencv-python-headless", "onnxruntime", "matplotlib", "jupyterlab", "ipywidgets")
OPENCV_NAMES = (
    "opencv-python",
    "opencv-python-headless",
    "opencv-contrib-python",
    "opencv-contrib-python-headless",
)
OLDEST_PYTHON = (3, 10)


@dataclass(frozen=True)
class Finding:
    """One line of the check: what was looked at, what was found, and what to do where it is not well.

    `state` is "ok", "note" (optional thing missing) or "problem".
    """

    what: str
    state: str
    found: str
    remedy: str = ""


def check() -> list[Finding]:
    """All findings, problems and notes included, in a fixed order."""
    findings = [_python()]
    findings += [_package(name) for name in PACKAGES]
    findings.append(_opencv())
    findings.append(_kitti())
    return findings


def _python() -> Finding:
    found = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if sys.version_info[:2] < OLDEST_PYTHON:
        return Finding("Python", "problem", found, "install Python 3.10 or newer")
    return Finding("Python", "ok", found)


def installed_version(name: str) -> str | None:
    """Version of an installed package, or None."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _package(name: str) -> Finding:
    version = installed_version(name)
    if version is None:
        return Finding(name, "problem", "not installed", "pip install -r environment.txt")
    return Finding(name, "ok", version)


def _opencv() -> Finding:
    present = [name for name in OPENCV_NAMES if installed_version(name) is not None]
    if len(present) > 1:
        remedy = f"pip uninstall -y {' '.join(present)}, then pip install -r environment.txt"
        return Finding("one OpenCV only", "problem", " and ".join(present) + " share one folder", remedy)
    try:
        import cv2
    except ImportError as error:
        return Finding("one OpenCV only", "problem", str(error), "pip install -r environment.txt")
    return Finding("one OpenCV only", "ok", f"cv2 {cv2.__version__}")


def _kitti() -> Finding:
    roots = kitti_roots()
    names = [name for name in available() if name.startswith("kitti/")]
    if not names:
        found = f"no sequences in {roots[0]}" if roots else "not found"
        remedy = (
            "optional, 22 GB grey images: download 'odometry data set (grayscale)', 'calibration files' and "
            "'ground truth poses' from www.cvlibs.net/datasets/kitti/eval_odometry.php, unpack them into "
            "data/kitti or set KITTI_ROOT to where they are"
        )
        return Finding("KITTI odometry", "note", found, remedy)
    return Finding("KITTI odometry", "ok", f"{len(names)} sequences in {', '.join(map(str, roots))}")
