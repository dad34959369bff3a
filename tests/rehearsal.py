"""All of KITTI at full length, played from a few clips: does `vo reproduce` come through, killed on the way?

    python tests/rehearsal.py FOLDER --clips CLIPS [--sequences 03,04]
    export KITTI_ROOT=FOLDER
    again="vo reproduce --sequences 00-10 --detector street --jobs 2 --seeds 1 --out table --cache cache"
    timeout -s KILL 300 $again; timeout -s KILL 900 $again; $again

Not part of the test suite: half an hour on two cores. CLIPS has KITTI's layout. Each of the sequences gets
as many frames as KITTI's: links to the images of a clip, played to its end and back, with the truth to
match. Every turn is a jump in speed; errors are those of the played path, not the paper's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vo_lib.core.poses import write_kitti_poses
from vo_lib.core.types import Array
from vo_lib.data.kitti import EXPECTED_FRAMES
from vo_lib.data.sequence import Sequence, open_sequence

STEP = 0.1037  # seconds from frame to frame, about KITTI's


def there_and_back(length: int, frames: int) -> Array:
    """Frame numbers 0, 1, … length - 1, length - 2, … 0, 1, …, (frames,)."""
    return (length - 1) - np.abs((np.arange(frames) + length - 1) % (2 * length - 2) - (length - 1))


def lay_out(clip: Sequence, folder: Path, name: str) -> None:
    """A sequence of the benchmark's length out of a clip with truth, by links."""
    assert clip.truth is not None
    order = there_and_back(len(clip), EXPECTED_FRAMES[name])
    own = folder / "sequences" / name
    for side in ("image_0", "image_1"):
        (own / side).mkdir(parents=True)
        for frame, source in enumerate(order):
            image = clip.folder / side / f"{source:06d}.png"
            (own / side / f"{frame:06d}.png").symlink_to(image.resolve())
    (own / "calib.txt").write_text((clip.folder / "calib.txt").read_text("utf-8"), "utf-8")
    (own / "times.txt").write_text("".join(f"{STEP * i:.6e}\n" for i in range(len(order))), "utf-8")
    (folder / "poses").mkdir(exist_ok=True)
    write_kitti_poses(folder / "poses" / f"{name}.txt", clip.truth[order])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=Path, required=True, help="a folder with sequences/ and poses/")
    parser.add_argument("--names", default="00,01", help="its sequences, in turn")
    parser.add_argument("--sequences", default=",".join(f"{number:02d}" for number in range(11)))
    options = parser.parse_args()
    clips = [open_sequence(str(options.clips / "sequences" / name)) for name in options.names.split(",")]
    names = options.sequences.split(",")
    for number, name in enumerate(names):
        lay_out(clips[number % len(clips)], options.folder, name)
    print(f"{sum(EXPECTED_FRAMES[name] for name in names)} frames in {len(names)} sequences")
