"""Chapter 4."""

from .panel import TranslationPanel as TranslationPanel
