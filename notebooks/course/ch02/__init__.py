"""Chapter 2, five points: from five matches to all essential matrices that fit them.

`library` has the right answers, `puzzle` five matches with several solutions, and `hard_scenes` scenes where five
points determine the motion badly or not at all. `panel` and `figures` draw, and `exercises` has the checks of the
answers.
"""

from .panel import FivePointPanel as FivePointPanel
