"""What a student hands in: a zip of `vo lab --hand-in`, the folder of the course, or `my_vo.py` alone.

A zip comes from somebody else, so nothing in it is unpacked to the disk under its own name: only files with known
names are read, each up to a size, and everything else is refused with a sentence. A zip that a desktop made of the
folder of the course will do, too.
"""

from __future__ import annotations

import json
import re
import stat
import time
import zipfile
import zlib
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from vo_lib.errors import DataError
from vo_lib.files import read_bytes

from . import answer_log, stored_answers

MARKS = "marks.json"
POSES = "my_poses.txt"
ZIP = "hand_in.zip"
ANSWERS = (stored_answers.NAME, answer_log.NAME)
FILES = (*ANSWERS, POSES, MARKS)
NOTEBOOK = ".ipynb"
CHANGED = "last change"  # in marks.json: seconds since 1970
MAX_MEMBERS = 5000  # of a zip of the whole folder, with the kit's modules and what the system adds
MAX_MEMBER_BYTES = 30_000_000  # an answered notebook with its pictures takes a few MB
MAX_BYTES = 200_000_000  # of all members together
NAMED = 5  # files that a sentence names
EXPECTED = "expected a zip, a folder of the course, or a my_vo.py"
# Kinds of files that somebody may have handed in, although they cannot be read.
HANDED_IN = (".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".bz2", ".xz", ".zst", ".zipx", ".py", NOTEBOOK)
OF_THE_SYSTEM = ("__MACOSX", "Thumbs.db", "desktop.ini")
# What systems and browsers add to the name of a second copy.
COPY = re.compile(r"( ?\(\d+\)| - (copy|kopie)( \(\d+\))?| copy( \d+)?)$", re.IGNORECASE)


@dataclass(frozen=True)
class Submission:
    """The files of a student by name, without folders.

    changed : when the last of them was written, in seconds since 1970; None if unknown.
    """

    student: str
    files: dict[str, bytes]
    remarks: tuple[str, ...] = ()
    changed: float | None = None


@dataclass(frozen=True)
class Found:
    """What lies in the folders of a class: students with their files, and the files that are nobody's."""

    students: list[tuple[str, Path]] = field(default_factory=list)
    others: list[Path] = field(default_factory=list)


def find_submissions(paths: list[Path]) -> Found:
    """Students and their files: each zip, `my_vo.py` or folder of a course, also inside a folder of a class.

    A file that somebody may have handed in counts as a student's, also if `read_submission` will refuse it, and so
    does a folder without any submission. Raises `DataError` for a path that is missing or has nothing in it.
    """
    found = Found()
    for path in paths:
        if not path.exists():
            raise DataError("is missing: expected a zip, a my_vo.py, or a folder of them", path)
        if not path.is_dir() or (path / stored_answers.COURSE_FILE).is_file() or _is_alone(path):
            found.students.append((_student(path, path.parent), path))
            continue
        inside = Found()
        _look_into(path, inside)
        if not inside.students:
            raise DataError("contains neither a zip nor a my_vo.py", path)
        found.students.extend((_student(each, path), each) for _, each in inside.students)
        found.others.extend(inside.others)
    # A file that is named twice counts once, under its first name.
    first_names = dict[Path, tuple[str, Path]]()
    for student, path in found.students:
        first_names.setdefault(path.resolve(), (student, path))
    return Found(list(first_names.values()), found.others)


def _look_into(folder: Path, found: Found) -> None:
    """Add what lies in a folder of a class, or in a folder of a student in it.

    The students have no names here: `find_submissions` makes them of the paths.
    """
    for path in sorted(folder.iterdir()):
        if _is_of_the_system(path.name):
            found.others.append(path)
        elif path.is_dir() and not path.is_symlink():
            try:
                _look_into_student(path, found)
            except OSError:  # a folder without permission to read it: `read_submission` says so
                found.students.append(("", path))
        elif path.suffix.lower() in HANDED_IN or path.is_symlink() or zipfile.is_zipfile(path):
            found.students.append(("", path))
        else:
            found.others.append(path)


def _look_into_student(folder: Path, found: Found) -> None:
    """Add a folder of the course, the submissions in a folder, or the folder itself if it has none.

    Without names, as in `_look_into`.
    """
    if (folder / stored_answers.COURSE_FILE).is_file() or _is_alone(folder):
        own_zip = folder / ZIP
        if own_zip.is_file():
            found.students.append(("", own_zip))
        if not own_zip.is_file() or _differ(folder, own_zip):
            found.students.append(("", folder))
        return
    inside = Found()
    _look_into(folder, inside)
    if inside.students:
        found.students.extend(inside.students)
        found.others.extend(inside.others)
    else:
        found.students.append(("", folder))


def _is_alone(folder: Path) -> bool:
    """Whether a folder has the files of one student, and no submission but the zip of the same course."""
    names = {each.name for each in folder.iterdir() if each.is_file()}
    has_answers = any(name in ANSWERS or name.endswith(NOTEBOOK) for name in names)
    if not has_answers:
        return False
    inside = Found()
    for each in folder.iterdir():
        if each.is_dir() and not each.is_symlink() and not _is_of_the_system(each.name):
            _look_into_student(each, inside)
    has_submissions_below = any(_is_answered(path) for _, path in inside.students)
    has_other_zips = any(Path(name).suffix.lower() == ".zip" and name != ZIP for name in names)
    return not has_submissions_below and not has_other_zips


def _is_answered(path: Path) -> bool:
    """Whether a submission is a file, or a folder with answers."""
    return not path.is_dir() or any((path / name).is_file() for name in ANSWERS)


def _differ(folder: Path, path: Path) -> bool:
    """Whether a folder has other answers than the zip that was made of it."""
    with suppress(DataError):
        of_folder = read_submission("", folder).files
        of_zip = read_submission("", path).files
        return any(of_folder.get(name) != of_zip.get(name) for name in ANSWERS)
    return True


def _is_of_the_system(name: str) -> bool:
    """Whether a file or folder was made by the system of a computer, not by a student."""
    return name.startswith(".") or name in OF_THE_SYSTEM


def read_submission(student: str, path: Path) -> Submission:
    """The files of a submission. Raises `DataError` for a zip that is damaged, too large or unsafe."""
    if path.is_dir():
        try:
            return _read_folder(student, path)
        except OSError as error:
            raise DataError(f"was not read: {error.strerror}", path) from None
    if zipfile.is_zipfile(path):
        return _read_zip(student, path)
    if path.suffix.lower() == ".zip":
        raise DataError("is no zip, or it is damaged", path)
    content = read_bytes(path)
    is_answers = path.name == stored_answers.NAME or stored_answers.SECTION.search(content.decode("latin-1"))
    if path.suffix.lower() != ".py" or not is_answers:
        raise DataError(f"was not read: {EXPECTED}", path)
    return Submission(student, {stored_answers.NAME: content}, (), path.stat().st_mtime)


def _read_folder(student: str, folder: Path) -> Submission:
    """The submission in a folder of the course."""
    names = [*FILES, *sorted(each.name for each in folder.glob(f"*{NOTEBOOK}"))]
    present = [name for name in names if (folder / name).is_file()]
    if not present:
        inside = sorted(each.name for each in folder.iterdir())
        raise DataError(f"was not read: {EXPECTED}; found {_listed(inside)}", folder)
    files = {name: read_bytes(folder / name) for name in present}
    times = [(folder / name).stat().st_mtime for name in present if name in ANSWERS]
    remarks: tuple[str, ...] = ()
    if not times:
        remarks = (f"there is no {' and no '.join(ANSWERS)}",)
    return Submission(student, files, remarks, max(times, default=None))


def _listed(names: list[str]) -> str:
    """Some of the names, for a sentence."""
    if not names:
        return "nothing"
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(name[:80] for name in names[:NAMED]) + more


def namesakes(found: list[tuple[str, Path]]) -> list[list[tuple[str, Path]]]:
    """The submissions of each student who has more than one, by the names without marks of copies."""
    groups = dict[str, list[tuple[str, Path]]]()
    for student, path in found:
        groups.setdefault(COPY.sub("", student).casefold(), []).append((student, path))
    return [group for group in groups.values() if len(group) > 1]


def _student(path: Path, above: Path) -> str:
    """The name of a student: of the zip, or of the folder if the file has its usual name.

    above : folder of the class; the name has the folders below it.
    """
    if COPY.sub("", path.stem) + path.suffix.lower() in (ZIP, stored_answers.NAME):
        path = path.resolve().parent
        above = above.resolve()
    elif path.suffix.lower() in HANDED_IN:
        path = path.with_suffix("")
    if path.is_relative_to(above) and path != above:
        return path.relative_to(above).as_posix()
    return path.name


def _read_zip(student: str, path: Path) -> Submission:
    """The submission in a zip of `vo lab --hand-in`, or in a zip of the folder of the course."""
    files = dict[str, bytes]()
    total = 0
    try:
        with zipfile.ZipFile(path) as archive:
            members = [member for member in archive.infolist() if not member.is_dir()]
            if len(members) > MAX_MEMBERS:
                raise DataError(f"has {len(members)} files, expected at most {MAX_MEMBERS}", path)
            places = [(_safe_place(member, path), member) for member in members]
            folder = _folder_of_answers([place for place, _ in places], path)
            chosen = []
            for place, member in places:
                if place.parent == folder and (place.name in FILES or place.name.endswith(NOTEBOOK)):
                    chosen.append((place.name, member))
            for name, member in chosen:
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
    times = [_time_of(member) for name, member in chosen if name in ANSWERS]
    return Submission(student, files, (), _noted_time(files) or max(times, default=None))


def _time_of(member: zipfile.ZipInfo) -> float:
    """When a member was written, in seconds since 1970; 0 if its date is none."""
    with suppress(ValueError, OverflowError):
        return time.mktime((*member.date_time, 0, 0, -1))
    return 0.0


def _noted_time(files: dict[str, bytes]) -> float | None:
    """When the answers of a hand-in were last changed, as marks.json says."""
    with suppress(ValueError, AttributeError):
        noted = json.loads(files.get(MARKS, b"{}")).get(CHANGED)
        return float(noted) if isinstance(noted, (int, float)) else None
    return None


def _folder_of_answers(places: list[PurePosixPath], path: Path) -> PurePosixPath:
    """The folder in a zip that has the answers. Raises `DataError` if there is none, or more than one."""
    places = [place for place in places if not any(map(_is_of_the_system, place.parts))]
    for wanted in (ANSWERS, FILES):
        found = [place for place in places if place.name in wanted]
        for name in wanted:
            same = [str(place) for place in found if place.name == name]
            if len(same) > 1:
                where = _listed(same) if len({*same}) > 1 else same[0]
                raise DataError(f"contains {name} twice, {where}: expected one", path)
        folders = {place.parent for place in found}
        if len(folders) > 1:
            raise DataError(f"contains answers in several folders, {_listed(sorted(map(str, found)))}", path)
        if folders:
            return folders.pop()
    inside = _listed(sorted(map(str, places)))
    raise DataError(f"contains no {' and no '.join(ANSWERS)}; found {inside}", path)


def _safe_place(member: zipfile.ZipInfo, path: Path) -> PurePosixPath:
    """The place of a member inside the zip.

    Raises `DataError` for a name that leaves its folder, and for a link.
    """
    name = member.filename.replace("\\", "/")
    place = PurePosixPath(name)
    if name.startswith("/") or ".." in place.parts or ":" in name or not place.parts:
        raise DataError(f"contains {member.filename[:80]!r}, a name outside its folder", path)
    mode = member.external_attr >> 16
    if mode and stat.S_IFMT(mode) not in (0, stat.S_IFREG):
        raise DataError(f"contains {member.filename[:80]!r}, which is a link or a device", path)
    return place
