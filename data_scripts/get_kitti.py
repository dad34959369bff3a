"""Fetch single sequences of the KITTI odometry benchmark.

Images, calibration and true poses of the sequences named come straight out of the official archives of 22 GB.
What is complete on disk is not fetched again: after an interruption, call again.

examples:
  vo data get_kitti --sequences 07,04
  vo data get_kitti --sequences 00-10 --root /data/kitti --yes
  vo data get_kitti --from-zip data_odometry_gray.zip data_odometry_calib.zip data_odometry_poses.zip
  vo data get_kitti --sequences 07 --link /mnt/kitti
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fetch.download import MAX_CONNECTIONS, confirm, in_words, require_space
from fetch.kitti_archive import CALIB, HOST, LICENCE, POSES, absent, archives_at, fetch, link_tree, plan
from fetch.kitti_check import parse_numbers
from fetch.zip_archives import Archives
from vo_lib.commands.console import reporting, say
from vo_lib.commands.script import typed
from vo_lib.commands.scripts import run_script
from vo_lib.data.catalogue import kitti_root
from vo_lib.data.kitti import EXPECTED_FRAMES
from vo_lib.errors import DataError


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script."""
    parser.add_argument("--sequences", metavar="S,S-S,…", help="00 … 21; those of 00-10 have true poses")
    parser.add_argument(
        "--color",
        action="store_true",
        help="also image_2 and image_3: detectors do better in colour",
    )
    parser.add_argument("--root", type=Path, metavar="DIR", help=f"where to; default {kitti_root()}")
    parser.add_argument("--from-zip", type=Path, nargs="+", metavar="FILE", help="archives already on disk")
    parser.add_argument("--link", type=Path, metavar="DIR", help="link a KITTI tree that exists instead")
    parser.add_argument("--yes", action="store_true", help="start without asking")
    parser.add_argument("--jobs", type=int, default=4, metavar="N", help="files fetched at once (default 4)")
    parser.add_argument("--host", default=HOST, metavar="URL", help=f"a mirror; default {HOST}")


def run(options: argparse.Namespace) -> int:
    """Link, unpack or fetch what the options name."""
    root: Path = options.root or kitti_root()
    if options.sequences is None and options.from_zip is None:
        raise DataError("say which: --sequences 07,04 (or 00-21 for all)")
    names = list(EXPECTED_FRAMES) if options.sequences is None else parse_numbers(options.sequences)
    if not 1 <= options.jobs <= MAX_CONNECTIONS:
        raise DataError(f"--jobs {options.jobs}: expected 1 … {MAX_CONNECTIONS}")
    if not options.host.startswith(("http://", "https://")):
        raise DataError(f"--host {options.host!r}: expected an address that begins with http:// or https://")
    linked = [name for name in names if (root / "sequences" / name).is_symlink()]
    if options.link is not None:
        say(f"linked into {root}: {', '.join(link_tree(options.link, root, names))}")
        return 0
    if linked and options.sequences is not None:
        raise DataError(
            "is a link into another tree; nothing is written there", root / "sequences" / linked[0]
        )
    return take(root, set(names) - set(linked), options)


def take(root: Path, wanted: set[str], options: argparse.Namespace) -> int:
    """Find out what is not there yet, say how much it is, ask, and write it."""
    places = archives_at(options.host, options.color)
    if options.from_zip is not None:
        # Calibration and poses last: they win over older copies beside the images.
        last = sorted(options.from_zip, key=lambda path: path.name in (CALIB, POSES))
        places = [str(path) for path in last]
    with Archives() as archives:
        with reporting("reading the archives' directories") as report:
            members = plan(archives, places, wanted, report)
        if not members:
            raise DataError(f"nothing of the sequences {', '.join(sorted(wanted))} is in {', '.join(places)}")
        with reporting("looking at what is there") as report:
            todo = absent(members, root, report)
        packed, size = sum(m.packed for m in todo), sum(m.size for m in todo)
        say(f"{len(members) - len(todo)} of {len(members)} files are already whole in {root}")
        if todo:
            require_space(root, size)
            say(*LICENCE)
            verb = "unpacks" if options.from_zip else "fetches"
            say(f"{verb} {len(todo)} files, {in_words(packed)}; takes {in_words(size)} of disk")
            if not confirm("Go on?", options.yes):
                say("nothing was written")
                return 1
            with reporting("unpacking" if options.from_zip else "fetching", in_bytes=True) as report:
                fetch(archives, todo, root, options.jobs, report)
        say("done. Check it: " + typed(f"vo data check_kitti --root {root}"))
        return 0


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
