"""Download single sequences of KITTI, or a range of their frames.

Images, calibration and ground truth are read from the official archives of the
odometry benchmark (22 GB) or of a drive of the raw data. A raw drive becomes a
sequence with the GPS/IMU path as ground truth. Complete files are not
downloaded again. After an interruption, or for more frames, repeat the
command.

examples:
  vo data get_kitti --raw 2011_09_26_drive_0013 --frames 0:80
  vo data get_kitti --sequences 00 --frames 0:201
  vo data get_kitti --sequences 06 --frames 122:139,953:968
  vo data get_kitti --sequences 07,04
  vo data get_kitti --sequences 00-10 --root /data/kitti --yes
  vo data get_kitti --from-zip data_odometry_gray.zip \\
      data_odometry_calib.zip data_odometry_poses.zip
  vo data get_kitti --sequences 07 --link /mnt/kitti
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from fetch.download import MAX_CONNECTIONS, confirm, format_bytes, require_space, write_file
from fetch.kitti_archive import (
    CALIB,
    HOST,
    LICENCE,
    POSES,
    Targets,
    absent,
    fetch,
    link_tree,
    plan,
    sequence_archives,
)
from fetch.kitti_check import parse_numbers
from fetch.kitti_part import drive_archives, parse_drive, select_frames, write_drive_tables
from fetch.zip_archives import Archives, Member
from vo_lib.commands.common import parse_frames, parse_whole
from vo_lib.commands.console import print_lines, print_wrapped, reporting
from vo_lib.data.catalogue import kitti_root
from vo_lib.data.kitti import EXPECTED_FRAMES, PART
from vo_lib.errors import DataError

ALL = ":"  # of --frames


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--sequences", metavar="S,S-S,…", help="00 … 21; 00-10 have ground truth")
    which.add_argument("--raw", metavar="DRIVE", help="a drive of the raw data")
    text = "only frames A to B-1, counted from 0; several pieces as A:B,C:D"
    parser.add_argument("--frames", metavar="A:B,…", default=ALL, help=text)
    parser.add_argument("--color", action="store_true", help="also download the colour images, for detectors")
    parser.add_argument("--root", type=Path, metavar="DIR", help=f"KITTI folder; default {kitti_root()}")
    parser.add_argument(
        "--from-zip", type=Path, nargs="+", metavar="FILE", help="take the files from these archives on disk"
    )
    parser.add_argument("--link", type=Path, metavar="DIR", help="link to files of this KITTI folder instead")
    parser.add_argument("--yes", action="store_true", help="download without confirmation")
    parser.add_argument("--jobs", default="4", metavar="N", help="parallel downloads; default 4")
    parser.add_argument("--host", default=HOST, metavar="URL", help=f"server or mirror; default {HOST}")


def run(options: argparse.Namespace) -> int:
    """Link, unpack or download the chosen files."""
    root: Path = options.root or kitti_root()
    for piece in options.frames.split(","):
        parse_frames(piece, 0)
    if options.raw is not None:
        names = [parse_drive(options.raw)[1]]
    elif options.sequences is not None:
        names = parse_numbers(options.sequences)
    elif options.from_zip is not None:
        names = list(EXPECTED_FRAMES)
    else:
        raise DataError("choose --sequences, such as 07,04 or 00-21, or --raw 2011_09_26_drive_0013")
    jobs = parse_whole("--jobs", options.jobs, most=MAX_CONNECTIONS)
    if not options.host.startswith(("http://", "https://")):
        raise DataError(f"--host {options.host!r}: expected an address with http:// or https://")
    if options.link is not None:
        if options.frames != ALL:
            raise DataError("--frames with --link: only whole sequences can be linked")
        print_wrapped(f"linked into {root}: {', '.join(link_tree(options.link, root, names))}")
        return 0
    linked = [name for name in names if (root / "sequences" / name).is_symlink()]
    named_by_user = options.sequences is not None or options.raw is not None
    if linked and named_by_user:
        raise DataError("is a link to another folder; nothing is written", root / "sequences" / linked[0])
    return fetch_missing(root, set(names) - set(linked), jobs, options)


def archives_of(sequences: set[str], options: argparse.Namespace) -> tuple[list[str], Targets]:
    """Addresses or paths of the archives, and the patterns of the files in them, as for `plan`."""
    if options.raw is None:
        sources, targets = sequence_archives(options.host, sequences, options.color)
    else:
        sources, targets = drive_archives(options.host, options.raw, options.color)
    if options.from_zip is not None:
        # Calibration and poses last: they replace older copies in the image archives.
        in_order = sorted(options.from_zip, key=lambda path: path.name in (CALIB, POSES))
        sources = [str(path) for path in in_order]
    return sources, targets


def fetch_missing(root: Path, sequences: set[str], jobs: int, options: argparse.Namespace) -> int:
    """Determine the missing files, print their size, ask for confirmation, and write the files.

    jobs : number of parallel downloads.
    """
    sources, targets = archives_of(sequences, options)
    with Archives() as archives:
        with reporting("reading the archives' directories") as report:
            members = plan(archives, sources, targets, report)
        if not members:
            raise DataError(f"{', '.join(sources)}: no files of the sequences {', '.join(sorted(sequences))}")
        pieces = [partial(parse_frames, piece) for piece in options.frames.split(",")]
        members, marks = select_frames(members, root, pieces, options.raw)
        with reporting("checking the files present") as report:
            todo = absent(members, root, report)
        print_wrapped(f"{len(members) - len(todo)} of {len(members)} files are already complete in {root}")
        if todo and not confirm_files(todo, root, options):
            print_wrapped("nothing was written")
            return 1
        for folder, mark in marks.items():
            if mark:
                write_file(folder / PART, mark + "\n")
            else:
                (folder / PART).unlink(missing_ok=True)
        if todo:
            with reporting("unpacking" if options.from_zip else "downloading", in_bytes=True) as report:
                fetch(archives, todo, root, jobs, report)
    if options.raw is not None:
        for folder in marks:
            note = write_drive_tables(folder)
            if note:
                print_wrapped(f"note: {note}")
    print_lines(f"done; to check the files: vo data check_kitti --root {root}")
    return 0


def confirm_files(todo: list[Member], root: Path, options: argparse.Namespace) -> bool:
    """Print the licence and the size of the files to write, and ask for confirmation.

    Raises `DataError` if the disk has too little space.
    """
    packed = sum(member.info.compress_size for member in todo)
    size = sum(member.info.file_size for member in todo)
    require_space(root, size)
    print_wrapped(" ".join(LICENCE))
    verb = "to unpack" if options.from_zip else "to download"
    print_wrapped(f"{verb}: {len(todo)} files, {format_bytes(packed)}, {format_bytes(size)} on disk")
    return confirm("Continue?", options.yes)
