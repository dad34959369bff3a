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

PACKAGE = Path(__file__).resolve().parents[1]  # the folder of vo_lib
DIGEST_DIGITS = 16
NOT_USED = "not used"  # in place of the digest of an input that a run does not read
# The modules with which the code of matches and of poses begins, by variant. What they import at top level
# belongs to this code as well. A module that only one variant needs is imported inside a function, so the
# variant names it here.
FRONT_END_CODE = {"published": ("runs.front_end",), "kit": ("runs.front_end", "kit.klt")}
POSE_CODE = {
    "published": ("runs.drive",),
    "kit": ("runs.drive", "kit.kit_odometry", "kit.klt", "data.truth"),
}


@functools.cache
def code_digest(modules: tuple[str, ...]) -> str:
    """Digest of modules (such as "runs.drive") and of the modules of vo_lib that they import at top level."""
    content = b""
    for path in import_closure(modules):
        content += path.relative_to(PACKAGE).as_posix().encode() + b"\n" + path.read_bytes()
    return short_digest(content)


def import_closure(modules: Iterable[str]) -> tuple[Path, ...]:
    """Sorted files of `modules` and of all modules of vo_lib that these files import at top level."""
    waiting = [PACKAGE.joinpath(*name.split(".")).with_suffix(".py") for name in modules]
    files = set[Path]()
    while waiting:
        path = waiting.pop()
        if path in files or not path.exists():
            continue
        files.add(path)
        for imported in _relative_imports(path.read_bytes()):
            # In "from .name import other", `name` is a module, or a package with the module `other`.
            target = path.parents[imported.level - 1].joinpath(*(imported.module or "").split("."))
            waiting.append(target.with_suffix(".py"))
            waiting += [target / f"{alias.name}.py" for alias in imported.names]
    return tuple(sorted(files))


@functools.cache  # the code of matches and that of poses have most modules in common
def _relative_imports(source: bytes) -> tuple[ast.ImportFrom, ...]:
    """The statements "from .name import other" at the top level of a module."""
    statements = ast.parse(source).body
    return tuple(each for each in statements if isinstance(each, ast.ImportFrom) and each.level)


def short_digest(data: bytes) -> str:
    """The first digits of the SHA-256 of some bytes."""
    return hashlib.sha256(data).hexdigest()[:DIGEST_DIGITS]


def images_digest(sequence: Sequence) -> str:
    """Digest of the names and contents of all images.

    Each image is hashed once, see `image_hashes`.
    """
    names = [f"{side}/{frame}.png" for side in sequence.sides for frame in sequence.frames]
    lines = [f"{name} {digest}\n" for name, digest in image_hashes(sequence.folder, names).items()]
    return short_digest("".join(lines).encode())


def labels_digest(sequence: Sequence, classes: tuple[str, ...]) -> str:
    """Digest of the label files of the sequence's frames and, if classes have names, of the chosen classes.

    Without label files, it is the digest of an empty text. Raises as `ClassNames.choose`.
    """
    if sequence.labels is None:
        return short_digest(b"")
    files = [sequence.labels / f"{frame}.txt" for frame in sequence.frames]
    class_names = read_class_names(sequence.labels)
    chosen_classes = class_names.choose(classes)
    words = json.dumps(sorted(chosen_classes.kinds.items())) if class_names.names else ""
    return short_digest(_content_of(files) + words.encode())


def _content_of(files: list[Path]) -> bytes:
    """The stems and contents of the files that exist, one after the other."""
    contents = [f"{path.stem} ".encode() + read_bytes(path) for path in files if path.exists()]
    return b"".join(contents)


def truth_digest(sequence: Sequence) -> str:
    """Digest of the sequence's truth about moving vehicles, which the box rule `truth` reads."""
    folder = sequence.folder / "truth"
    instance_images = [folder / "instance" / f"{frame}.png" for frame in sequence.frames]
    return short_digest(_content_of([folder / "objects.npz", *instance_images]))


def library_versions() -> dict[str, str]:
    """Versions of the kit and of the libraries that can change a result."""
    return {"kit": _kit_version(), "numpy": np.__version__, "opencv": cv2.__version__}


@functools.cache  # read from a file, for each identity of a run
def _kit_version() -> str:
    return metadata.version("stereo-vo-kit")


def made_with(modules: tuple[str, ...]) -> dict[str, str]:
    """Versions of the libraries, and the digest of the code that begins with `modules`."""
    return library_versions() | {"code": code_digest(modules)}


def matches_identity(sequence: Sequence, config: MethodConfig) -> dict[str, Any]:
    """All inputs of the matches of a sequence; the sequence is identified by its images, not by its name."""
    return {
        "variant": config.variant,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "camera": to_dict(sequence.camera),
        "images": images_digest(sequence),
        "settings": {"features": to_dict(config.features), "matching": to_dict(config.matching)},
        "made_with": made_with(FRONT_END_CODE[config.variant]),
    }


def run_identity(
    sequence: Sequence, config: MethodConfig, method: str, calibration: Calibration | None = None
) -> dict[str, Any]:
    """All inputs that determine the poses of a run, and names of method and sequence, in types of JSON.

    Runs with equal identities have byte-identical poses.

    Raises `DataError` for an input file that cannot be read, and as `ClassNames.choose`.
    """
    identity: dict[str, Any] = {"method": method, "variant": config.variant, "sequence": sequence.name}
    identity |= matches_identity(sequence, config)
    identity["settings"] = to_dict(config)  # all of them, in place of those of the matches
    identity["made_with"] = made_with(POSE_CODE[config.variant])
    identity["times"] = short_digest(sequence.times.tobytes())
    identity["labels"] = NOT_USED
    if config.filter.uses_boxes:
        identity["labels"] = labels_digest(sequence, config.filter.classes)
    masks = [read_bytes(path) for path in sequence.mask_files()]
    identity["masks"] = short_digest(b"".join(masks))
    identity["moving"] = truth_digest(sequence) if config.filter.rule == "truth" else NOT_USED
    identity["calibration"] = None if calibration is None else short_digest(calibration.to_json().encode())
    types_of_json: dict[str, Any] = json.loads(json.dumps(identity))  # as `read_config` returns them
    return types_of_json


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
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


@functools.cache
def git_commit() -> str | None:
    """Commit of the kit's work tree, with "-dirty" after local changes; None outside git.

    As of the first call, since a process goes on with the code that it has imported.
    """
    if not (PACKAGE.parent / ".git").exists():
        return None
    command = ["git", "-C", str(PACKAGE.parent), "describe"]
    command += ["--always", "--dirty", "--abbrev=40", "--exclude=*"]  # without tags, so it is the commit
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.check_output(command, text=True, stderr=subprocess.DEVNULL).strip()
    return None
