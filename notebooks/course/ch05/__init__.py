"""Chapter 5."""

from .lorry import LorryPanel as LorryPanel
from .panel import FilteringPanel as FilteringPanel
