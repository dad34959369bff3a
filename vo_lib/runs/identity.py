"""The identity of a result: short digests of images, labels and code, settings, and library versions."""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import platform
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ..data.image_hashes import image_hashes
from ..data.label_names import read_class_names
from ..data.sequence import Sequence
from ..files import read_bytes
from ..paper.settings import MethodConfig
from ..settings import to_dict

if TYPE_CHECKING:
    from ..kit.calibration import Calibration

PACKAGE = Path(__file__).resolve().parents[1]
DIGEST_DIGITS = 16
NOT_USED = "not used"
# Entry modules of the code of matches and of poses; the modules that they import at top level belong to the
# code.
FRONT_END_CODE = {"published": ("runs.front_end",), "kit": ("runs.front_end", "kit.klt")}
POSE_CODE = {
    "published": ("runs.drive",),
    "kit": ("runs.drive", "kit.kit_odometry", "kit.klt", "data.truth"),
}


@functools.cache
def code_digest(modules: tuple[str, ...]) -> str:
    """Digest of modules (such as "runs.drive") and of the modules of vo_lib that they import at top level."""
    paths = import_closure(modules)
    names = [path.relative_to(PACKAGE).as_posix().encode() for path in paths]
    return _digest(
        b"".join(name + b"\n" + path.read_bytes() for name, path in zip(names, paths, strict=True))
    )


def import_closure(modules: Iterable[str]) -> tuple[Path, ...]:
    """Sorted files of `modules` and of all modules of vo_lib that these files import at top level."""
    waiting = [PACKAGE.joinpath(*name.split(".")).with_suffix(".py") for name in modules]
    files = set[Path]()
    while waiting:
        path = waiting.pop()
        if path in files or not path.exists():
            continue
        files.add(path)
        for node in ast.parse(path.read_bytes()).body:
            if isinstance(node, ast.ImportFrom) and node.level:
                folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
                waiting += [folder.with_suffix(".py"), *(folder / f"{name.name}.py" for name in node.names)]
    return tuple(sorted(files))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:DIGEST_DIGITS]


def images_digest(sequence: Sequence) -> str:
    """Digest of the names and contents of all images.

    Each image is hashed once, see `image_hashes`.
    """
    names = [f"{side}/{frame}.png" for side in sequence.sides for frame in sequence.frames]
    lines = [f"{name} {digest}\n" for name, digest in image_hashes(sequence.folder, names).items()]
    return _digest("".join(lines).encode())


def labels_digest(sequence: Sequence, classes: tuple[str, ...]) -> str:
    """Digest of the label files of the sequence's frames and, if classes have names, of the chosen classes.

    Without label files, the digest of an empty text. Raises as `ClassNames.choose`.
    """
    if sequence.labels is None:
        return _digest(b"")
    files = [sequence.labels / f"{frame}.txt" for frame in sequence.frames]
    names = read_class_names(sequence.labels)
    choice = names.choose(classes)
    text = json.dumps(sorted(choice.kinds.items())) if names.names else ""
    return _digest_of_data(files, text.encode())


def _digest_of_data(files: list[Path], more: bytes = b"") -> str:
    """Digest of the stems and contents of the existing files, and of more data."""
    contents = [f"{path.stem} ".encode() + read_bytes(path) for path in files if path.exists()]
    return _digest(b"".join([*contents, more]))


def truth_digest(sequence: Sequence) -> str:
    """Digest of the sequence's truth about moving vehicles, which the box rule `truth` reads."""
    folder = sequence.folder / "truth"
    files = [folder / "objects.npz", *(folder / "instance" / f"{frame}.png" for frame in sequence.frames)]
    return _digest_of_data(files)


def library_versions() -> dict[str, str]:
    """Versions of the kit and of the libraries that can change a result."""
    return {"kit": metadata.version("stereo-vo-kit"), "numpy": np.__version__, "opencv": cv2.__version__}


def matches_identity(sequence: Sequence, config: MethodConfig) -> dict[str, Any]:
    """All inputs of the matches of a sequence; the sequence is identified by its images, not by its name."""
    return {
        "variant": config.variant,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "camera": to_dict(sequence.camera),
        "images": images_digest(sequence),
        "settings": {"features": to_dict(config.features), "matching": to_dict(config.matching)},
        "made_with": library_versions() | {"code": code_digest(FRONT_END_CODE[config.variant])},
    }


def run_identity(
    sequence: Sequence, config: MethodConfig, method: str, calibration: Calibration | None = None
) -> dict[str, Any]:
    """All inputs that determine the poses of a run, and names of method and sequence, in types of JSON.

    Runs with equal identities have byte-identical poses.
    """
    identity = {"method": method, "variant": config.variant, "sequence": sequence.name}
    identity |= matches_identity(sequence, config) | {
        "settings": to_dict(config),
        "times": _digest(sequence.times.tobytes()),
        "labels": labels_digest(sequence, config.filter.classes) if config.filter.uses_boxes else NOT_USED,
        "masks": _digest(b"".join(map(read_bytes, sequence.mask_files()))),
        "moving": truth_digest(sequence) if config.filter.rule == "truth" else NOT_USED,
        "calibration": calibration and _digest(calibration.to_json().encode()),
        "made_with": library_versions() | {"code": code_digest(POSE_CODE[config.variant])},
    }
    return dict(json.loads(json.dumps(identity)))


def machine_info() -> dict[str, str | None]:
    """Facts for the reader that do not change a result: commit, Python version, machine, processor."""
    return {
        "commit": git_commit(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": processor_name(),
    }


def processor_name() -> str:
    """The processor as Linux names it, elsewhere as Python does."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def git_commit() -> str | None:
    """Commit of the kit's work tree, with "-dirty" after local changes; None outside git."""
    if not (PACKAGE.parent / ".git").exists():
        return None
    describe = "describe --always --dirty --abbrev=40 --exclude=*"
    words = ["git", "-C", str(PACKAGE.parent), *describe.split()]
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.check_output(words, text=True, stderr=subprocess.DEVNULL).strip()
    return None
