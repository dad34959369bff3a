"""The folder of the notebooks, which also has this package; imports only what every Python has."""

from __future__ import annotations

from pathlib import Path

NOTEBOOKS = Path(__file__).resolve().parents[1]
