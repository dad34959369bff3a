"""Chapter 2."""

from .panel import FivePointPanel

__all__ = ["FivePointPanel"]
