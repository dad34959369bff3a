"""Chapter 7: an honest reproduction.

`our_errors` reads a folder of `vo reproduce`; `verdict` judges each printed number by it, and `claimed_gain` the
gain that the paper claims. `plan` has the runs that are started here, and `figures` the pictures and tables.
`panel` has the panel of Table 1 and the one of changed settings, and `exercises` the checks of the answers.

The RE of the columns that the paper measured itself are printed in a unit that makes them 3 % too small
(`vo_lib.report.paper_unit`); "in the right unit" means converted to deg/100 m.
"""

from .panel import ExplorePanel as ExplorePanel
from .panel import ReproducePanel as ReproducePanel
