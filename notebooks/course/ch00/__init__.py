"""Chapter 0, the task: `panel`, `figures` and `exercises`."""

from .panel import StartPanel as StartPanel
