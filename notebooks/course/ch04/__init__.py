"""Chapter 4."""

from .panel import TranslationPanel

__all__ = ["TranslationPanel"]
