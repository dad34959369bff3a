"""Selection of frames of KITTI's sequences (part.txt), and conversion of raw drives to sequences."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath

from fetch.kitti_archive import Targets
from fetch.kitti_raw import describe_drive
from fetch.stereo_import import write_tables
from fetch.stereo_sources import pair_images
from fetch.zip_archives import Member
from vo_lib.data.kitti import read_part
from vo_lib.data.sequence import open_folder, require_frames
from vo_lib.errors import DataError

RAW = "raw"  # in a drive's sequence: calibration, timestamps and GPS/IMU packets of the drive
DRIVE = re.compile(r"(\d{4}_\d\d_\d\d)_(drive_\d{4})", re.ASCII)


def parse_drive(text: str) -> tuple[str, str]:
    """Day and sequence of a raw drive, such as 2011_09_26 and drive_0013 for 2011_09_26_drive_0013."""
    match = DRIVE.fullmatch(text)
    if match is None:
        raise DataError(f"--raw {text!r}: expected a drive such as 2011_09_26_drive_0013")
    return match[1], match[2]


def drive_archives(host: str, drive: str, color: bool = False) -> tuple[list[str], Targets]:
    """Addresses of the archives of a rectified drive and of its calibration, and path patterns of the files.

    The images have the same numbers as in the drive. Calibration, timestamps and GPS/IMU packets are in RAW.
    """
    day, sequence = parse_drive(drive)
    base = f"{host.rstrip('/')}/raw_data"
    folder = f"sequences/{sequence}"
    cameras = "0-3" if color else "01"
    return [f"{base}/{drive}/{drive}_sync.zip", f"{base}/{day}_calib.zip"], {
        rf"{day}/{drive}_sync/image_0([{cameras}])/data/0000(\d{{6}}\.png)": rf"{folder}/image_\1/\2",
        rf"{day}/{drive}_sync/(oxts/data/\d{{10}}\.txt|image_00/timestamps\.txt)": rf"{folder}/{RAW}/\1",
        rf"{day}/(calib_\w+\.txt)": rf"{folder}/{RAW}/\1",
    }


def select_frames(
    members: list[Member],
    root: Path,
    frames: Sequence[Callable[[int], tuple[int, int]]],
    drive: str | None = None,
) -> tuple[list[Member], dict[Path, str]]:
    """The members for the given frames and for the frames of earlier calls, and the text of each part.txt.

    Parameters
    ----------
    members : members of whole sequences. root : KITTI folder.
    frames : for each piece, a function of the number of frames of a sequence, which returns start and stop.
    drive : the raw drive of the members; None for the odometry benchmark.

    A whole sequence has the text "". Raises `DataError` for frames outside the sequence, for a single piece
    that leaves a gap to the frames of earlier calls, and for a folder with images of another source.
    """
    counts: dict[str, int] = {}  # frames of each sequence
    for member in members:
        if member.target.match("sequences/*/image_?/*.png"):
            name = member.target.parts[1]
            counts[name] = max(counts.get(name, 0), int(member.target.stem) + 1)
    wanted: dict[str, list[range]] = {}
    marks: dict[Path, str] = {}
    for name, count in counts.items():
        folder = root / "sequences" / name
        chosen = [range(*piece(count)) for piece in frames]
        for piece in chosen:
            require_frames(piece.start, piece.stop, count, drive or name)
        wanted[name], marks[folder] = _pieces_and_mark(folder, chosen, count, drive)

    def is_selected(target: PurePosixPath) -> bool:
        name = target.parts[1]
        number = target.stem
        if name not in wanted or not number.isdecimal():
            return True
        return any(int(number) in piece for piece in wanted[name])

    return [member for member in members if is_selected(member.target)], marks


def _pieces_and_mark(
    folder: Path, chosen: list[range], count: int, drive: str | None
) -> tuple[list[range], str]:
    """The frames that a sequence's folder is to have, and the text of its part.txt, "" without such a file.

    Parameters
    ----------
    chosen : the pieces of this call; count : number of frames of the whole sequence.
    drive : as in `select_frames`, which raises the same errors.
    """
    name = folder.name
    source = f"--raw {drive}" if drive else f"--sequences {name}"
    part = read_part(folder)
    has_images = any(folder.glob("image_[01]/*.png"))
    if part is None:
        # A folder with images but without part.txt has a whole sequence of the benchmark, or its start.
        is_foreign = has_images and drive is not None
        present = _pieces_present(folder)
    else:
        is_foreign = not part.text.startswith(f"{source} ")
        present = list(part.pieces)
    if is_foreign:
        raise DataError(
            f"contains images of a source other than {drive or name}; move the folder away first", folder
        )
    pieces = joined_pieces([*present, *chosen])
    if len(chosen) == 1 and present and len(pieces) > len(present):
        last = max(piece.stop for piece in pieces)
        first = min(piece.start for piece in pieces)
        raise DataError(
            f"has the frames {frames_text(present)}; --frames {first}:{last} leaves no gap, "
            f"--frames {frames_text(pieces)} keeps one",
            folder,
        )
    is_whole = drive is None and pieces == [range(count)]
    is_start = has_images and part is None and len(pieces) <= len(present)
    mark = "" if is_whole or is_start else f"{source} --frames {frames_text(pieces)}"
    return (chosen if part is None else pieces), mark


def _pieces_present(folder: Path) -> list[range]:
    """Ranges of the numbers of the images in a folder, left or right."""
    numbers = {int(path.stem) for path in folder.glob("image_[01]/*.png") if path.stem.isdecimal()}
    return joined_pieces([range(number, number + 1) for number in numbers])


def joined_pieces(pieces: Iterable[range]) -> list[range]:
    """Ranges of numbers in order; those that overlap or touch are joined."""
    joined: list[range] = []
    for piece in sorted(pieces, key=lambda each: each.start):
        if joined and piece.start <= joined[-1].stop:
            joined[-1] = range(joined[-1].start, max(joined[-1].stop, piece.stop))
        else:
            joined.append(piece)
    return joined


def frames_text(pieces: Iterable[range]) -> str:
    """Ranges as a text such as 122:139,953:968."""
    return ",".join(f"{piece.start}:{piece.stop}" for piece in pieces)


def write_drive_tables(folder: Path) -> str:
    """Write calib.txt, times.txt and poses.txt of a drive; return a note on missing truth, or "".

    The first frame has time 0 and the identity as its pose.
    """
    drive = describe_drive(folder / RAW, pair_images(folder / "image_0", folder / "image_1"))
    write_tables(folder, drive.rig, drive.times, drive.poses)
    open_folder(folder, folder.name)
    return drive.note
