"""Chapter 6, evaluation: the errors of a path by KITTI's protocol.

`panel` and `figures` draw paths, sub-sequences and their errors, and `exercises` has the checks of the answers.
"""

from .panel import EvaluationPanel as EvaluationPanel
