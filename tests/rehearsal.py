"""All of KITTI at full length, played from a few clips: does `vo reproduce` come through, killed on the way?

    python tests/rehearsal.py FOLDER --clips CLIPS
    python tests/rehearsal.py FOLDER --clips CLIPS --sequences 03,04 --kill 20,40 --seeds 2

Not part of the test suite: half an hour on two cores. CLIPS has KITTI's layout. Each of the sequences gets
as many frames as KITTI's: links to the images of a clip, played to its end and back, with the truth to
match. Every turn is a jump in speed; errors are those of the played path, not the paper's. The command runs
in a process group of its own, is killed after so many seconds, and started again until it ends.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
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
        (own / side).mkdir(parents=True, exist_ok=True)
        for frame, source in enumerate(order):
            link = own / side / f"{frame:06d}.png"
            if not link.is_symlink():
                link.symlink_to((clip.folder / side / f"{source:06d}.png").resolve())
    (own / "calib.txt").write_text((clip.folder / "calib.txt").read_text("utf-8"), "utf-8")
    (own / "times.txt").write_text("".join(f"{STEP * i:.6e}\n" for i in range(len(order))), "utf-8")
    (folder / "poses").mkdir(exist_ok=True)
    write_kitti_poses(folder / "poses" / f"{name}.txt", clip.truth[order])


def reproduce(words: list[str], environment: dict[str, str], limit: float | None) -> int | None:
    """The command's exit code; None where it was killed after `limit` seconds."""
    command = [sys.executable, "-m", "vo_lib", "reproduce", *words]
    started = time.monotonic()
    process = subprocess.Popen(command, env=environment, start_new_session=True)
    try:
        code: int | None = process.wait(limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        code = None
    words_for = "killed" if code is None else f"exit code {code}"
    print(f"\n{words_for} after {time.monotonic() - started:.0f} s", flush=True)
    return code


def main() -> int:
    """Lay the sequences out, run, kill, run again."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=Path, required=True, help="a folder with sequences/ and poses/")
    parser.add_argument("--names", default="00,01", help="its sequences, in turn")
    parser.add_argument("--sequences", default=",".join(f"{number:02d}" for number in range(11)))
    parser.add_argument("--kill", default="300,900", help="seconds after which it is killed, one by one")
    parser.add_argument("--seeds", default="1")
    options = parser.parse_args()
    clips = [open_sequence(str(options.clips / "sequences" / name)) for name in options.names.split(",")]
    names = options.sequences.split(",")
    for number, name in enumerate(names):
        lay_out(clips[number % len(clips)], options.folder / "kitti", name)
    print(f"{sum(EXPECTED_FRAMES[name] for name in names)} frames in {len(names)} sequences")
    words = ["--sequences", ",".join(names), "--detector", "street", "--jobs", "2", "--seeds", options.seeds]
    words += ["--out", str(options.folder / "table")]
    cache = str(options.folder / "cache")
    environment = os.environ | {"KITTI_ROOT": str(options.folder / "kitti"), "XDG_CACHE_HOME": cache}
    for seconds in options.kill.split(","):
        if reproduce(words, environment, float(seconds)) is not None:
            return 1  # it ended before it was killed
    return reproduce(words, environment, None) or 0


if __name__ == "__main__":
    sys.exit(main())
