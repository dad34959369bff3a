"""Single sequences of the KITTI odometry benchmark from a web server, from zip files, or as links."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath

from fetch.download import write_file
from fetch.zip_archives import Archives, Member
from vo_lib.errors import DataError
from vo_lib.files import DRAFT, only_process, read_bytes
from vo_lib.geometry.types import Progress

# The links of PAGE under "odometry data set", with the sizes on that page.
PAGE = "https://www.cvlibs.net/datasets/kitti/eval_odometry.php"
HOST = "https://s3.eu-central-1.amazonaws.com/avg-kitti/"
GRAY = "data_odometry_gray.zip"  # 22 GB: image_0, image_1
COLOR = "data_odometry_color.zip"  # 65 GB: image_2, image_3
CALIB = "data_odometry_calib.zip"  # 1 MB: calib.txt, times.txt
POSES = "data_odometry_poses.zip"  # 4 MB: ground truth of 00-10

LICENCE = (
    "KITTI's licence is CC BY-NC-SA 3.0: non-commercial use, share alike, attribution",
    "(Geiger, Lenz, Urtasun, CVPR 2012). By downloading the data, you accept this licence. The terms, and",
    f"the log-in for the download links, are at {PAGE}",
)

# Pattern for the end of a member's name -> path of the file below the root.
Targets = dict[str, str]


def sequence_archives(host: str, sequences: Iterable[str], color: bool = False) -> tuple[list[str], Targets]:
    """Addresses of the benchmark's archives, and path patterns of the files of sequences "00" … "21"."""
    kinds = [GRAY, COLOR, CALIB, POSES] if color else [GRAY, CALIB, POSES]
    names = f"(?:{'|'.join(sequences)})"
    inside = rf"(sequences/{names}/(?:image_[0-3]/\d+\.png|calib\.txt|times\.txt)|poses/{names}\.txt)"
    return [f"{host.rstrip('/')}/{kind}" for kind in kinds], {inside: r"\1"}


def plan(
    archives: Archives, sources: list[str], targets: Targets, progress: Progress | None = None
) -> list[Member]:
    """The members of the archives that match `targets`, one per path, sorted by path.

    Parameters
    ----------
    sources : paths or URLs. A file in several archives is taken from the last of these archives: KITTI's
        calibration archive replaces the older calib.txt in the image archives.
    progress : called with (archives read, total archives).
    """
    chosen_members: dict[PurePosixPath, Member] = {}
    patterns = [(re.compile(f"(?:.*/)?{inside}", re.ASCII), path) for inside, path in targets.items()]
    for number, source in enumerate(sources, start=1):
        for info, end in archives.directory(source):
            for pattern, path in patterns:
                match = pattern.fullmatch(info.filename)
                if match is not None:
                    below = PurePosixPath(match.expand(path))
                    chosen_members[below] = Member(source, info, end, below)
        if progress is not None:
            progress(number, len(sources))
    return [chosen_members[below] for below in sorted(chosen_members)]


def absent(members: list[Member], root: Path, progress: Progress | None = None) -> list[Member]:
    """The members whose file below `root` is missing or has a wrong size or checksum."""
    todo = []
    for number, member in enumerate(members, start=1):
        path = root / member.target
        complete = path.is_file() and path.stat().st_size == member.info.file_size
        if not (complete and zlib.crc32(read_bytes(path)) == member.info.CRC):
            todo.append(member)
        if progress is not None and (number % 50 == 0 or number == len(members)):
            progress(number, len(members))
    return todo


def fetch(
    archives: Archives, members: list[Member], root: Path, jobs: int = 4, progress: Progress | None = None
) -> None:
    """Write members of archives as files below `root`, several in parallel, each file atomically.

    The first failure ends the download; complete files are kept, so a second call continues, and deletes what
    a killed one has left half-written. Raises `DataError` if another process writes below `root`.

    progress : called with (bytes done, total bytes).
    """
    total = sum(member.info.compress_size for member in members)
    done = 0

    def take(member: Member) -> None:
        write_file(root / member.target, archives.read(member))

    root.mkdir(parents=True, exist_ok=True)
    with only_process(root):
        for folder in {(root / member.target).parent for member in members}:
            for draft in folder.glob(f".*{DRAFT}"):
                draft.unlink()
        pool = ThreadPoolExecutor(max_workers=jobs)
        try:
            for member, _ in zip(members, pool.map(take, members), strict=True):
                done += member.info.compress_size
                if progress is not None:
                    progress(done, total)
        finally:
            pool.shutdown(cancel_futures=True)


def link_tree(tree: Path, root: Path, sequences: Iterable[str]) -> list[str]:
    """Create links below `root` to the sequences and poses of another KITTI folder; return their names."""
    tree = tree / "dataset" if (tree / "dataset" / "sequences").is_dir() else tree
    linked = [name for name in sequences if (tree / "sequences" / name).is_dir()]
    for name in linked:
        _link(tree / "sequences" / name, root / "sequences" / name)
        if (tree / "poses" / f"{name}.txt").is_file():
            _link(tree / "poses" / f"{name}.txt", root / "poses" / f"{name}.txt")
    if not linked:
        raise DataError("contains none of these sequences; expected folders such as sequences/00", tree)
    return linked


def _link(source: Path, link: Path) -> None:
    """Create a link, unless it is there; `DataError` if it cannot be created."""
    if link.is_symlink() and link.resolve() == source.resolve():
        return
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(source.resolve(), target_is_directory=source.is_dir())
    except OSError as error:
        raise DataError(f"cannot be linked: {error.strerror}; set KITTI_ROOT instead", link) from None
