"""Chapter 2."""

from .panel import FivePointPanel as FivePointPanel
