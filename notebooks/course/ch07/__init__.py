"""Chapter 7."""

from .explore import ExplorePanel
from .reproduce import ReproducePanel

__all__ = ["ExplorePanel", "ReproducePanel"]
