"""Chapter 5."""

from .panel import FilteringPanel

__all__ = ["FilteringPanel"]
