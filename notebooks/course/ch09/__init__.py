"""Chapter 9."""

from .panel import LoopPanel as LoopPanel
