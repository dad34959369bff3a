"""Chapter 0."""

from .panel import StartPanel as StartPanel
