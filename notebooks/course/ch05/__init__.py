"""Chapter 5."""

from .panel import FilteringPanel as FilteringPanel
from .panel import LorryPanel as LorryPanel
