"""A real second visit: two short pieces of a KITTI sequence that show the same road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vo_lib.data.catalogue import available, open_sequence
from vo_lib.data.sequence import Sequence

# Of 00, 05, 06 and 07, these are the shortest pieces that show the same 20 m of road: by the true poses, the
# second drive is less than 0.65 m beside the first.
NAME = "kitti/06"
FIRST = range(122, 139)
SECOND = range(953, 968)
COMMAND = "vo data get_kitti --sequences 06 --frames 122:139,953:968"


def real_visit() -> Sequence | None:
    """The frames FIRST and SECOND of sequence 06, from the two pieces or the whole; None if one is missing."""
    if NAME not in available():
        return None
    return two_pieces(open_sequence(NAME), FIRST, SECOND)


def two_pieces(sequence: Sequence, first: range, second: range) -> Sequence | None:
    """The frames with these numbers in one sequence, usually with a gap; None if a frame is missing."""
    index = {int(frame): k for k, frame in enumerate(sequence.frames)}
    wanted = [*first, *second]
    if any(number not in index for number in wanted):
        return None
    kept = np.array([index[number] for number in wanted])
    return replace(
        sequence,
        frames=tuple(sequence.frames[k] for k in kept),
        times=sequence.times[kept],
        truth=None if sequence.truth is None else sequence.truth[kept],
        is_part=True,
    )
