"""Images used for the evaluation of the odometry, which are forbidden for the training of a detector.

A detector trained on the test images detects the vehicles in these images better than the vehicles in a new
street, so the measured errors would be too small.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from vo_lib.errors import DataError

# Raw drive of each KITTI odometry sequence with ground truth (odometry development kit, readme).
ODOMETRY_DRIVES = {
    "2011_10_03_drive_0027": "00",
    "2011_10_03_drive_0042": "01",
    "2011_10_03_drive_0034": "02",
    "2011_09_26_drive_0067": "03",
    "2011_09_30_drive_0016": "04",
    "2011_09_30_drive_0018": "05",
    "2011_09_30_drive_0020": "06",
    "2011_09_30_drive_0027": "07",
    "2011_09_30_drive_0028": "08",
    "2011_09_30_drive_0033": "09",
    "2011_09_30_drive_0034": "10",
}
DRIVE = re.compile(r"\d{4}_\d{2}_\d{2}_drive_\d{4}")
SEQUENCE = re.compile(r"sequences[/\\](0\d|10)[/\\]")
WHY = "a detector makes fewer errors on its training images, so the measured errors would be too small"


def evaluated_sequence(text: str) -> str | None:
    """The odometry sequence, such as "07", to which a path or a drive's name belongs, or None."""
    for drive in DRIVE.findall(text):
        if drive in ODOMETRY_DRIVES:
            return ODOMETRY_DRIVES[drive]
    match = SEQUENCE.search(text)
    return match[1] if match else None


def refuse_evaluated(images: Iterable[Path]) -> None:
    """Raise `DataError` for the first image with the path or name of a KITTI odometry sequence."""
    for image in images:
        sequence = evaluated_sequence(str(image)) or evaluated_sequence(str(image.resolve()))
        if sequence is not None:
            raise DataError(
                f"comes from KITTI odometry sequence {sequence}, which is evaluated: {WHY}; remove it, or "
                "allow it with --allow-evaluated",
                image,
            )
