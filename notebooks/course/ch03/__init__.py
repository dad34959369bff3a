"""Chapter 3."""

from .panel import SelectionPanel

__all__ = ["SelectionPanel"]
