"""Chapter 3."""

from .panel import SelectionPanel as SelectionPanel
