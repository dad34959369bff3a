"""Chapter 7."""

from .panel import ExplorePanel as ExplorePanel
from .panel import ReproducePanel as ReproducePanel
