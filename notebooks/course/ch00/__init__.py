"""Chapter 0."""

from .panel import StartPanel

__all__ = ["StartPanel"]
