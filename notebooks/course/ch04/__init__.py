"""Chapter 4, translation: `weightings` combines the rows of all features, and simulates matches for its measurements.

`panel` and `figures` draw rows, residuals and translations, and `exercises` has the checks of the answers.
"""

from .panel import TranslationPanel as TranslationPanel
