"""Chapter 7."""

from .explore import ExplorePanel as ExplorePanel
from .reproduce import ReproducePanel as ReproducePanel
