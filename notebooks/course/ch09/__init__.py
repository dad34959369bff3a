"""Chapter 9: coming back.

`block_drive` has the drive round a block and its true and false loops; `second_visit` finds two real visits of one
road. `figures` has the pictures, `exercises` what is handed in, and `panel` closes a path with a made-up drift. The
methods themselves, places, loops and the pose graph, are in `vo_lib.loops`.
"""

from .panel import LoopPanel as LoopPanel
