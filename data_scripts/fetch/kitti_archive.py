"""Single sequences out of KITTI's odometry archives: over HTTP ranges, from zip files, from another tree."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path, PurePosixPath

from fetch.zip_archives import Archives, Member
from vo_lib.errors import DataError
from vo_lib.files import read_bytes, write_atomic
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

# Only this end of a member's name becomes a path below the root.
INSIDE = re.compile(
    r"(?:.*/)?(sequences/(\d\d)/(?:image_[0-3]/\d+\.png|calib\.txt|times\.txt)|poses/(\d\d)\.txt)"
)


def archives_at(host: str, color: bool = False) -> list[str]:
    """Addresses of the archives that a server has."""
    kinds = [GRAY, *([COLOR] if color else []), CALIB, POSES]
    return [f"{host.rstrip('/')}/{kind}" for kind in kinds]


def plan(
    archives: Archives, places: list[str], sequences: Iterable[str], progress: Progress | None = None
) -> list[Member]:
    """The members wanted of some archives, each target once, in the order of their targets.

    Parameters
    ----------
    places : paths or URLs. What several archives have is taken from the last: KITTI's calibration archive
        replaces the older calib.txt in the image archives.
    sequences : "00" … "21".
    progress : called with (archives looked into, archives in all).
    """
    wanted = set(sequences)
    found: dict[PurePosixPath, Member] = {}
    for number, place in enumerate(places, start=1):
        for info in archives.directory(place):
            inside = INSIDE.fullmatch(info.filename)
            if inside is None or (inside[2] or inside[3]) not in wanted:
                continue
            target = PurePosixPath(inside[1])
            size, packed = info.file_size, info.compress_size
            found[target] = Member(place, info.filename, target, size, packed, info.CRC)
        if progress is not None:
            progress(number, len(places))
    return [found[target] for target in sorted(found)]


def absent(members: list[Member], root: Path, progress: Progress | None = None) -> list[Member]:
    """The members that are not below `root` yet with the right size and checksum."""
    todo = []
    for number, member in enumerate(members, start=1):
        path = root / member.target
        whole = path.is_file() and path.stat().st_size == member.size
        if not (whole and zlib.crc32(read_bytes(path)) == member.crc):
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
    for folder in sorted({root / member.target.parent for member in members}):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"the folder cannot be made: {error.strerror}", folder) from None
    total, done = sum(member.packed for member in members), 0

    def take(member: Member) -> None:
        write_atomic(root / member.target, archives.read(member))

    pool = ThreadPoolExecutor(max_workers=jobs)
    try:
        # In the order of the archive the server reads ahead.
        waiting: dict[Future[None], Member] = {pool.submit(take, member): member for member in members}
        for future in as_completed(waiting):
            future.result()
            done += waiting[future].packed
            if progress is not None:
                progress(done, total)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def link_tree(tree: Path, root: Path, sequences: Iterable[str]) -> list[str]:
    """Links below `root` to the sequences and poses of a KITTI tree elsewhere; returns those linked."""
    tree = tree / "dataset" if (tree / "dataset" / "sequences").is_dir() else tree
    linked = []
    for name in sequences:
        if not (tree / "sequences" / name).is_dir():
            continue
        _link(tree / "sequences" / name, root / "sequences" / name)
        if (tree / "poses" / f"{name}.txt").is_file():
            _link(tree / "poses" / f"{name}.txt", root / "poses" / f"{name}.txt")
        linked.append(name)
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
        raise DataError(
            f"cannot be linked: {error.strerror}; set KITTI_ROOT to the tree instead", link
        ) from None
