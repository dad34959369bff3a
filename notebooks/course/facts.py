"""What stands below a panel's picture: a sentence, and numbers with their change."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from .colours import DARK
from .drawing import WIDTH
from .results import marked


@dataclass(frozen=True)
class Fact:
    """A number shown below a picture; `digits` after the point."""

    name: str
    value: float
    unit: str = ""
    digits: int = 0

    def text(self, before: float | None) -> str:
        """The number with its unit, and how it changed from `before`, as HTML."""
        space = "" if self.unit in ("", "°") else "&nbsp;"
        value = round(self.value, self.digits) + 0.0  # no minus before a zero
        shown = "–" if np.isnan(value) else f"{value:.{self.digits}f}{space}{html.escape(self.unit)}"
        change = np.nan if before is None else self.value - before
        if np.isnan(change) or abs(change) < 0.5 * 10.0**-self.digits:
            return shown
        return f'{shown} <span style="color:{DARK};opacity:.6">({change:+.{self.digits}f})</span>'


def facts_html(sentence: str, facts: tuple[Fact, ...], before: dict[str, float]) -> str:
    """A sentence, and below it the facts in a row, each with its change since `before`."""
    cells = "".join(
        '<div style="margin-right:26px">'
        f'<div style="font-size:11px;opacity:.7">{html.escape(fact.name)}</div>'
        f'<div style="font-size:15px">{fact.text(before.get(fact.name))}</div></div>'
        for fact in facts
    )
    return (
        f'<div style="max-width:{WIDTH}px;line-height:1.35">'
        f'<div style="margin:4px 0 6px">{marked(sentence)}</div>'
        f'<div style="display:flex;flex-wrap:wrap">{cells}</div></div>'
    )
