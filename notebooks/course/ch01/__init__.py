"""Chapter 1, matching: `trace` says what becomes of each feature, `wrong_matches` how wrong a match is.

`panel` and `figures` draw both; `front_end_table` has measured results, `exercises` the checks of the answers.
"""

from .panel import MatchingPanel as MatchingPanel
