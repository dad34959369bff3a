"""Chapter 3, solution selection: `comparisons` measures selections on simulated drives.

`panel` and `figures` draw the candidates of a frame, and `exercises` has the checks of the answers.
"""

from .panel import SelectionPanel as SelectionPanel
