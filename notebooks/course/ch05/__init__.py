"""Chapter 5."""

from .panel import FilteringPanel as FilteringPanel
