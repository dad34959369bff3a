"""Chapter 5: features in boxes (part one), and how a detector learns (part two).

Part one: `box_sources` gives a frame's boxes, and `frame_removal` what a rule removes with them. `claim` compares
whole runs, `real_drives` looks at real traffic, and `figures` has the pictures.

Part two: the network of the miniature detector is in the notebook; `layers` has the arithmetic below it, and
`miniature` its streets, and makes it a model of the panel. `detector_figures` has the pictures.

`exercises` and `panel` are for both parts.
"""

from .panel import FilteringPanel as FilteringPanel
from .panel import LorryPanel as LorryPanel
