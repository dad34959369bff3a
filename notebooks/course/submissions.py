"""What a student hands in: a zip of `vo lab --hand-in`, the folder of the course, or `my_vo.py` alone.

A zip comes from somebody else, so nothing in it is unpacked to the disk under its own name: only files with known
names are read, each up to a size, and everything else is refused with a sentence.
"""

from __future__ import annotations

import stat
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from vo_lib.errors import DataError
from vo_lib.files import read_bytes

from . import records, stored_answers

MARKS = "marks.json"
POSES = "my_poses.txt"
ZIP = "hand_in.zip"
FILES = (stored_answers.NAME, records.NAME, POSES, MARKS)
NOTEBOOK = ".ipynb"
MAX_MEMBERS = 100
MAX_MEMBER_BYTES = 30_000_000  # an answered notebook with its pictures takes a few MB
MAX_BYTES = 200_000_000  # of all members together


@dataclass(frozen=True)
class Submission:
    """The files of a student by name, without folders."""

    student: str
    files: dict[str, bytes]


def find_submissions(paths: list[Path]) -> list[tuple[str, Path]]:
    """Students and their files: each zip, `my_vo.py` or folder of a course, also inside a folder of a class.

    Raises `DataError` for a path without any.
    """
    found = list[tuple[str, Path]]()
    for path in paths:
        if not path.exists():
            raise DataError("is missing: expected a zip, a my_vo.py, or a folder of them", path)
        if not path.is_dir() or _is_course(path):
            found.append((_student(path, path.parent), path))
            continue
        zips = [each for each in sorted(path.rglob("*.zip")) if each.is_file()]
        folders = [each.parent for each in sorted(path.rglob(stored_answers.NAME))]
        inside = [*zips, *(folder for folder in folders if not (folder / ZIP).is_file())]
        if not inside:
            raise DataError("contains neither a zip nor a my_vo.py", path)
        found += [(_student(each, path), each) for each in inside]
    return found


def read_submission(student: str, path: Path) -> Submission:
    """The files of a submission. Raises `DataError` for a zip that is damaged, too large or unsafe."""
    if path.is_dir():
        names = [*FILES, *sorted(each.name for each in path.glob(f"*{NOTEBOOK}"))]
        files = {name: read_bytes(path / name) for name in names if (path / name).is_file()}
    elif zipfile.is_zipfile(path):
        files = _read_zip(path)
    elif path.suffix == ".zip":
        raise DataError("is no zip, or it is damaged", path)
    else:
        files = {stored_answers.NAME: read_bytes(path)}
    return Submission(student, files)


def _is_course(folder: Path) -> bool:
    return (folder / stored_answers.NAME).is_file() or (folder / stored_answers.MARK).is_file()


def _student(path: Path, above: Path) -> str:
    """The name of a student: of the zip, or of the folder if the file has its usual name."""
    if path.name in (ZIP, stored_answers.NAME):
        path = path.resolve().parent
    elif path.suffix in (".zip", ".py"):
        path = path.with_suffix("")
    return path.relative_to(above).as_posix() if path.is_relative_to(above) and path != above else path.name


def _read_zip(path: Path) -> dict[str, bytes]:
    files = dict[str, bytes]()
    total = 0
    try:
        with zipfile.ZipFile(path) as archive:
            members = [member for member in archive.infolist() if not member.is_dir()]
            if len(members) > MAX_MEMBERS:
                raise DataError(f"has {len(members)} files, expected at most {MAX_MEMBERS}", path)
            for member in members:
                name = _safe_name(member, path)
                if name is None:
                    continue
                if name in files:
                    raise DataError(f"contains {name} twice", path)
                with archive.open(member) as file:
                    # The size in the list of members may be wrong, so it is not trusted.
                    content = file.read(MAX_MEMBER_BYTES + 1)
                total += len(content)
                if len(content) > MAX_MEMBER_BYTES or total > MAX_BYTES:
                    limit = f"{MAX_MEMBER_BYTES / 1e6:.0f} MB a file, {MAX_BYTES / 1e6:.0f} MB in all"
                    raise DataError(f"{name} is too large: expected at most {limit}", path)
                files[name] = content
    # Encrypted members and unknown methods of compression raise the last two.
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError) as error:
        raise DataError(f"the zip cannot be read: {error}", path) from None
    if not {*files} & {*FILES}:
        raise DataError(f"contains no {stored_answers.NAME} and no {records.NAME}", path)
    return files


def _safe_name(member: zipfile.ZipInfo, path: Path) -> str | None:
    """The name of a member without its folder; None for a file that no hand-in has.

    Raises `DataError` for a name that leaves its folder, and for a link.
    """
    name = member.filename.replace("\\", "/")
    parts = PurePosixPath(name).parts
    if name.startswith("/") or ".." in parts or ":" in name or not parts:
        raise DataError(f"contains {member.filename[:80]!r}, a name outside its folder", path)
    mode = member.external_attr >> 16
    if mode and stat.S_IFMT(mode) not in (0, stat.S_IFREG):
        raise DataError(f"contains {member.filename[:80]!r}, which is a link or a device", path)
    if len(parts) > 2 or parts[0] == "__MACOSX":  # a zip may contain one folder, but nothing deeper counts
        return None
    return parts[-1] if parts[-1] in FILES or parts[-1].endswith(NOTEBOOK) else None
