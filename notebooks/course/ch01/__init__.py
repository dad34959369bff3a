"""Chapter 1."""

from .panel import MatchingPanel

__all__ = ["MatchingPanel"]
