"""Chapter 1."""

from .panel import MatchingPanel as MatchingPanel
