"""Chapter 7: an honest reproduction.

`our_errors` reads a folder of `vo reproduce`; `verdict` judges each printed number by it, and `claimed_gain` the
gain that the paper claims. `plan` has the runs that are started here, and `figures` the pictures and tables.
"""

from .panel import ExplorePanel as ExplorePanel
from .panel import ReproducePanel as ReproducePanel
