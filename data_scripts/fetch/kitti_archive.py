"""Single sequences out of KITTI's odometry archives: over HTTP ranges, from zip files, from another tree."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path, PurePosixPath

from fetch.download import write_file
from fetch.zip_archives import Archives, Member
from vo_lib.errors import DataError
from vo_lib.files import read_bytes
from vo_lib.geometry.types import Progress

# The links of PAGE under "odometry data set"; sizes as the page states them.
PAGE = "https://www.cvlibs.net/datasets/kitti/eval_odometry.php"
HOST = "https://s3.eu-central-1.amazonaws.com/avg-kitti/"
GRAY = "data_odometry_gray.zip"  # 22 GB: image_0, image_1
COLOR = "data_odometry_color.zip"  # 65 GB: image_2, image_3
CALIB = "data_odometry_calib.zip"  # 1 MB: calib.txt, times.txt
POSES = "data_odometry_poses.zip"  # 4 MB: ground truth of 00-10

LICENCE = (
    "KITTI is licensed CC BY-NC-SA 3.0: not for commercial use, shared alike, with its authors named",
    "(Geiger, Lenz, Urtasun, CVPR 2012). Taking the data means accepting this. The terms, and the log-in",
    f"that the page asks for before it shows its download links: {PAGE}",
)

# Paths below the root by the names of members: a pattern of a name's end, and what it becomes.
Targets = dict[str, str]


def sequence_archives(host: str, sequences: Iterable[str], color: bool = False) -> tuple[list[str], Targets]:
    """Addresses of the benchmark's archives, and the targets of some sequences, "00" … "21"."""
    kinds, names = [GRAY, *([COLOR] if color else []), CALIB, POSES], f"(?:{'|'.join(sequences)})"
    inside = rf"(sequences/{names}/(?:image_[0-3]/\d+\.png|calib\.txt|times\.txt)|poses/{names}\.txt)"
    return [f"{host.rstrip('/')}/{kind}" for kind in kinds], {inside: r"\1"}


def plan(
    archives: Archives, places: list[str], targets: Targets, progress: Progress | None = None
) -> list[Member]:
    """The members of some archives that have a target, each target once, in the order of the targets.

    Parameters
    ----------
    places : paths or URLs. What several archives have is taken from the last: KITTI's calibration archive
        replaces the older calib.txt in the image archives.
    progress : called with (archives looked into, archives in all).
    """
    found: dict[PurePosixPath, Member] = {}
    patterns = [(re.compile(f"(?:.*/)?{inside}", re.ASCII), path) for inside, path in targets.items()]
    for number, place in enumerate(places, start=1):
        for info, end in archives.directory(place):
            for pattern, path in patterns:
                if match := pattern.fullmatch(info.filename):
                    below = PurePosixPath(match.expand(path))
                    found[below] = Member(place, info, end, below)
        if progress is not None:
            progress(number, len(places))
    return [found[below] for below in sorted(found)]


def absent(members: list[Member], root: Path, progress: Progress | None = None) -> list[Member]:
    """The members that are not below `root` yet with the right size and checksum."""
    todo = []
    for number, member in enumerate(members, start=1):
        path = root / member.target
        whole = path.is_file() and path.stat().st_size == member.info.file_size
        if not (whole and zlib.crc32(read_bytes(path)) == member.info.CRC):
            todo.append(member)
        if progress is not None and (number % 50 == 0 or number == len(members)):
            progress(number, len(members))
    return todo


def fetch(
    archives: Archives, members: list[Member], root: Path, jobs: int = 4, progress: Progress | None = None
) -> None:
    """Write members below `root`, several at once, each file whole or not at all.

    The first failure ends it; what is complete stays, so that another call goes on from there.

    Parameters
    ----------
    progress : called with (bytes of the archive done, bytes in all).
    """
    total, done = sum(member.info.compress_size for member in members), 0

    def take(member: Member) -> None:
        write_file(root / member.target, archives.read(member))

    pool = ThreadPoolExecutor(max_workers=jobs)
    try:
        # In the order of the archive the server reads ahead.
        waiting: dict[Future[None], Member] = {pool.submit(take, member): member for member in members}
        for future in as_completed(waiting):
            future.result()
            done += waiting[future].info.compress_size
            if progress is not None:
                progress(done, total)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def link_tree(tree: Path, root: Path, sequences: Iterable[str]) -> list[str]:
    """Links below `root` to the sequences and poses of a KITTI tree elsewhere; returns those linked."""
    tree = tree / "dataset" if (tree / "dataset" / "sequences").is_dir() else tree
    linked = [name for name in sequences if (tree / "sequences" / name).is_dir()]
    for name in linked:
        _link(tree / "sequences" / name, root / "sequences" / name)
        if (tree / "poses" / f"{name}.txt").is_file():
            _link(tree / "poses" / f"{name}.txt", root / "poses" / f"{name}.txt")
    if not linked:
        raise DataError("has none of these sequences; expected sequences/00 and so on in it", tree)
    return linked


def _link(source: Path, link: Path) -> None:
    if link.is_symlink() and link.resolve() == source.resolve():
        return
    if os.path.lexists(link):
        raise DataError("is there already; move it away first", link)
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(source.resolve(), target_is_directory=source.is_dir())
    except OSError as error:
        raise DataError(f"cannot be linked: {error.strerror}; set KITTI_ROOT instead", link) from None
