"""Convert your own stereo images to KITTI's layout, for `vo run FOLDER`.

The images come from two folders or patterns, or from a video with both images
side by side. A drive of KITTI's raw data already has calibration, times and
truth. Left and right images are paired by the number in
their names (leading zeros and other text do not matter), or by equal names, or
by time if the names are times: since 1970 in s, ms, µs or ns, or seconds with
decimals. The calibration is given by --focal, --centre and --baseline for
rectified images, or by the files of OpenCV (YAML, XML, JSON, .npz), Kalibr
(camchain.yaml), ROS (left.yaml, right.yaml), RealSense (JSON), ZED (.conf) or
KITTI (calib.txt). If it is that of the raw cameras, the script rectifies the
images; with P1 P2 alone, they must be rectified already. A sample of pairs is
checked for exchanged images, unequal rows, a baseline with the wrong sign, and
a median depth that is not plausible outdoors (5 m to 100 m).

examples:
  vo data from_folder --left L --right R --out data/mine \\
      --focal 718.9 --centre 607.2,185.2 --baseline 0.537
  vo data from_folder --left L --right R --out data/mine \\
      --calibration intrinsics.yml extrinsics.yml
  vo data from_folder --left 'S/I1_*.png' --right 'S/I2_*.png' \\
      --calibration stereo.yml --out data/mine
  vo data from_folder --video drive.mp4 --calibration stereo.yml \\
      --unit mm --out data/mine
  vo data from_folder --raw 2011_09_26/2011_09_26_drive_0005_sync \\
      --out data/drive_0005
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fetch.calibrations.user_files import read_user_calibration
from fetch.kitti_raw import read_raw_drive
from fetch.rectification import Size
from fetch.stereo_calibration import UNITS, RectifiedRig, centre_warning, rig_from_numbers
from fetch.stereo_import import check_source, require_new, write_sequence
from fetch.stereo_sources import MAX_DELAY_S, Drive, FolderSource, Source, VideoSource, pair_images
from vo_lib.commands.console import print_lines, print_wrapped, reporting
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.kitti import read_times
from vo_lib.data.poses import read_kitti_poses
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array

MIN_FPS = 0.1
MAX_FPS = 1000.0
DEFAULT_FPS = 10.0
# Options that do not go with --raw.
EXCLUDED_BY_DRIVES = (
    "right",
    "swap",
    "focal",
    "centre",
    "baseline",
    "calibration",
    "rectified",
    "fps",
    "unit",
    "fisheye",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script."""
    images = parser.add_argument_group("images")
    text = "left images: a folder, or a quoted pattern 'FOLDER/NAME*.png'"
    images.add_argument("--left", type=Path, nargs="+", metavar="DIR", help=text)
    images.add_argument(
        "--right", type=Path, nargs="+", metavar="DIR", help="right images, in the form of --left"
    )
    images.add_argument("--video", type=Path, metavar="FILE", help="video, both images side by side")
    images.add_argument("--raw", type=Path, metavar="DIR", help="synced drive of KITTI's raw data")
    images.add_argument("--swap", action="store_true", help="exchange left and right")
    text = "skip images without a partner; gaps in the numbers remain in the times"
    images.add_argument("--skip-unpaired", action="store_true", help=text)
    text = f"largest time difference between left and right image, seconds; default {MAX_DELAY_S}"
    images.add_argument("--max-delay", type=float, default=MAX_DELAY_S, metavar="S", help=text)
    camera = parser.add_argument_group("calibration")
    text = "focal length, pixels; from mm: times the image width, divided by the sensor width in mm"
    camera.add_argument("--focal", type=float, metavar="F", help=text)
    camera.add_argument("--centre", metavar="CX,CY", help="principal point, pixels")
    camera.add_argument("--baseline", type=float, metavar="B", help="distance between the cameras")
    text = "calibration files of OpenCV, Kalibr, ROS, RealSense, ZED or KITTI, or their folder"
    camera.add_argument("--calibration", type=Path, nargs="+", metavar="FILE", help=text)
    text = "unit of the baseline and of T; default: the tool's unit, or m"
    camera.add_argument("--unit", choices=UNITS, help=text)
    text = "OpenCV's files have four distortion numbers of cv2.fisheye"
    camera.add_argument("--fisheye", action="store_true", help=text)
    camera.add_argument(
        "--rectified", action="store_true", help="the images are rectified; use P1, P2 of the files"
    )
    more = parser.add_argument_group("times, truth, output")
    text = f"stereo pairs per second; default: from the file names or the video, or else {DEFAULT_FPS:g}"
    more.add_argument("--fps", type=float, metavar="N", help=text)
    text = "one line per pair or per left image"
    more.add_argument("--times", type=Path, metavar="FILE", help=f"times, seconds; {text}")
    text = f"ground-truth poses in KITTI's format; {text}"
    more.add_argument("--poses", type=Path, metavar="FILE", help=text)
    more.add_argument("--copy", action="store_true", help="copy PNG images instead of linking them")
    more.add_argument("--anyway", action="store_true", help="write the sequence even if a check fails")
    more.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the new sequence")


def run(options: argparse.Namespace) -> int:
    """Find images and calibration, check a sample of pairs, and write the sequence."""
    check_options(options)
    source = find_source(options)
    notes = []
    if isinstance(source, FolderSource) and source.note:
        notes.append(f"note: {source.note}")
    if isinstance(source, Drive):
        rig = source.rig
    else:
        rig, lines = rig_of(source, options)
        notes += lines
    if notes:
        print_wrapped(*notes)
    print_wrapped(*check_source(source, rig, options.anyway, outdoors=not isinstance(source, Drive)))
    times = times_of(source, options)
    poses = poses_of(source, options)
    with reporting("writing pairs") as report:
        count = write_sequence(source, rig, options.out, times, poses, options.copy, report)
    camera = open_sequence(options.out).camera
    truth = "no truth" if poses is None else "with truth"
    print_lines(
        f"{count} pairs of {camera.width}×{camera.height}, f {camera.f:.1f} px, centre {camera.cx:.1f},"
        f"{camera.cy:.1f}, baseline {camera.baseline:.3f} m, {truth}",
        f"next: vo run {options.out} --out runs/{options.out.name}",
    )
    return 0


def check_options(options: argparse.Namespace) -> None:
    """Raise `DataError` for options that contradict each other, or whose values are impossible."""
    for name in ("left", "right"):
        paths = getattr(options, name) or ()
        if len(paths) > 1:
            raise DataError(
                f"--{name}: {len(paths)} paths; quote the pattern, so that the shell does not expand it"
            )
    require_new(options.out)
    places = (options.video, options.raw, options.left)
    if sum(place is not None for place in places) != 1:
        raise DataError("give the images by --left and --right, or by one of --video and --raw")
    if options.fps is not None and not MIN_FPS <= options.fps <= MAX_FPS:
        raise DataError(f"--fps {options.fps:g}: expected {MIN_FPS:g} to {MAX_FPS:g} pairs per second")
    if not options.max_delay >= 0:
        raise DataError(f"--max-delay {options.max_delay:g}: expected 0 s or more")


def times_of(source: Source, options: argparse.Namespace) -> Array | float:
    """Times (N,) of the pairs, seconds, or their rate, Hz.

    A file of --times comes first, then --fps, then the times or the rate of the source. Numbers in the names
    of the images are frames at the rate, with their gaps.
    """
    times = source.times if isinstance(source, FolderSource) else None
    rate = source.fps() if isinstance(source, VideoSource) else 0.0
    if options.times is not None:
        times = read_times(options.times)
    elif options.fps is not None:
        times = None
        rate = options.fps
    elif times is None and not rate:
        rate = DEFAULT_FPS
        print_wrapped(f"note: {rate:g} pairs per second are assumed; give the times by --fps or --times")
    if isinstance(source, FolderSource):
        if times is not None:
            return source.of_pairs(times)
        if source.frames is not None:
            return np.asarray(source.frames / rate)
    return rate if times is None else times


def poses_of(source: Source, options: argparse.Namespace) -> Array | None:
    """True poses (N, 4, 4) of the pairs: those of the file of --poses, or else of a drive; or None."""
    poses = source.poses if isinstance(source, Drive) else None
    if options.poses is not None:
        poses = read_kitti_poses(options.poses)
    if poses is None or not isinstance(source, FolderSource):
        return poses
    return source.of_pairs(poses)


def find_source(options: argparse.Namespace) -> Source:
    """The drive, the video, or the two folders or patterns of images."""
    if options.raw is not None:
        refuse_calibration_options(options, "raw")
        return read_raw_drive(options.raw, options.skip_unpaired)
    if options.video is not None:
        return VideoSource(options.video, options.swap)
    if options.right is None:
        raise DataError("--right is missing: give the folder of the right images")
    left = options.left[0]
    right = options.right[0]
    if options.swap:
        return pair_images(right, left, options.max_delay, options.skip_unpaired)
    return pair_images(left, right, options.max_delay, options.skip_unpaired)


def refuse_calibration_options(options: argparse.Namespace, kind: str) -> None:
    """Raise `DataError` for an option that a data set with a calibration of its own, --`kind`, excludes."""
    for name in EXCLUDED_BY_DRIVES:
        if getattr(options, name) not in (None, False):
            raise DataError(f"--{name} with --{kind}: the folder has its own calibration")


def rig_of(source: Source, options: argparse.Namespace) -> tuple[RectifiedRig, list[str]]:
    """The rig given by either numbers or calibration files, and lines to print; otherwise `DataError`."""
    read_first_pair = next(iter(source.pairs()))
    height, width = read_first_pair()[0].shape
    size = width, height
    if options.calibration is not None:
        return rig_of_files(size, options)
    if options.fisheye:
        raise DataError("--fisheye belongs to --calibration: --focal, --centre are for rectified images")
    if None in (options.focal, options.centre, options.baseline):
        raise DataError(
            "the calibration is missing: add --focal, --centre and --baseline, or --calibration FILE"
        )
    try:
        u, v = options.centre.split(",")
        cx = float(u)
        cy = float(v)
    except ValueError:
        raise DataError(f"--centre {options.centre!r}: expected two numbers such as 607.2,185.2") from None
    metres_per_unit = UNITS.get(options.unit, 1.0)
    rig = rig_from_numbers(options.focal, cx, cy, metres_per_unit * options.baseline)
    warning = centre_warning(cx, cy, size)
    return rig, [f"warning: {warning}"] if warning else []


def rig_of_files(size: Size, options: argparse.Namespace) -> tuple[RectifiedRig, list[str]]:
    """The rig given by calibration files, for images of this size, and lines to print."""
    if any(number is not None for number in (options.focal, options.centre, options.baseline)):
        raise DataError("use either --calibration, or --focal, --centre and --baseline")
    places = [*(options.left or []), *(options.right or [])]
    folders = tuple(str(place) for place in places)
    calibration = read_user_calibration(options.calibration, size, folders, options.fisheye)
    rig = calibration.rig(size, options.rectified, UNITS.get(options.unit))
    lines = [f"note: {note}" for note in calibration.notes]
    # Only a file without a size can belong to another resolution: any other size was refused.
    if calibration.size is None:
        warning = centre_warning(*calibration.centre(), size)
        if warning:
            lines.append(f"warning: {warning}")
    return rig, lines
