"""Chapter 6."""

from .panel import EvaluationPanel as EvaluationPanel
