"""Estimate the constant angles between the axes of a camera and of its ground
truth.

examples:
  vo data measure_axes truth.txt runs/00/poses.txt
  vo data measure_axes truth.txt runs/00/poses.txt --lengths 20,50,100 --step 1

KITTI's ground truth is measured by an inertial unit and transformed to the
camera with a calibration. An error of this calibration rotates every motion.
The printed pitch and yaw minimise the translation error TE. KITTI's benchmark
has no such correction. Both files are in KITTI's format, one row per frame.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from measure.axes import fit_axes, fit_of_halves
from vo_lib.commands.common import parse_lengths, parse_whole
from vo_lib.commands.console import print_wrapped, show_table
from vo_lib.data.poses import read_kitti_poses
from vo_lib.errors import DataError
from vo_lib.evaluation.kitti_errors import KITTI_LENGTHS, KITTI_STEP, kitti_errors, subsequences_text
from vo_lib.report.page import format_number


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    parser.add_argument("truth", type=Path, help="ground-truth poses")
    parser.add_argument("estimate", type=Path, help="estimated poses of the same frames")
    lengths = ",".join(f"{length:g}" for length in KITTI_LENGTHS)
    parser.add_argument(
        "--lengths", default=lengths, metavar="L,L", help="sub-sequence lengths in metres; default KITTI's"
    )
    step = f"frames between the starts of sub-sequences; default {KITTI_STEP}"
    parser.add_argument("--step", default=str(KITTI_STEP), metavar="N", help=step)


def run(options: argparse.Namespace) -> int:
    """Print the errors without a correction, and after a rotation by the angles that minimise TE."""
    lengths = parse_lengths(options.lengths)
    step = parse_whole("--step", options.step)
    truth = read_kitti_poses(options.truth)
    estimate = read_kitti_poses(options.estimate)
    if len(truth) != len(estimate):
        counts = f"has {len(estimate)} rows, {options.truth} has {len(truth)}"
        raise DataError(f"{counts}: both need a pose for the same frames", options.estimate)
    measured = kitti_errors(truth, estimate, lengths, step)
    turned = fit_axes(truth, estimate, lengths, step)
    if not len(measured):
        raise DataError(f"is shorter than {min(lengths):g} m: choose smaller --lengths", options.truth)
    rows = [
        ["as measured", "0", "0", format_number(measured.te), format_number(measured.re)],
        [
            "axes turned",
            f"{turned.pitch:+.3f}",
            f"{turned.yaw:+.3f}",
            format_number(turned.kitti.te),
            format_number(turned.kitti.re),
        ],
    ]
    print_wrapped(f"{subsequences_text(len(measured))}; angles up to {turned.limit:g} deg")
    show_table(["", "pitch deg", "yaw deg", "TE %", "RE deg/100 m"], rows)
    if turned.at_limit:
        print_wrapped(f"note: {turned.limit_words}")
    halves = fit_of_halves(truth, estimate, lengths, step)
    if halves:
        first, last = halves
        print_wrapped(
            f"The sub-sequences that start first give {_angles_text(first)}; those that start last "
            f"{_angles_text(last)}. The more these differ, the more of the fit is drift, which it removes "
            "from TE as well."
        )
    return 0


def _angles_text(angles: tuple[float, float]) -> str:
    """Pitch and yaw, degrees, in words."""
    pitch, yaw = angles
    return f"pitch {pitch:+.3f}, yaw {yaw:+.3f} deg"
