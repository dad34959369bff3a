"""Chapter 6."""

from .panel import EvaluationPanel

__all__ = ["EvaluationPanel"]
