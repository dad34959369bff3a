"""What chapter 5, part one, says about the jam, held by the cells that print it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from course.ch05 import claim, miniature

CELLS = {
    cell["id"]: "".join(cell["source"])
    for cell in json.loads(miniature.NOTEBOOK.read_text(encoding="utf-8"))["cells"]
}
RUN = ("cell-02", "claim-jam-load", "line-distances", "claim-distance", "claim-runs", "claim-translation")


@pytest.mark.slow
def test_in_the_jam_removal_leaves_less_error_but_more_than_the_pull() -> None:
    names: dict[str, Any] = {"__name__": "__main__"}
    for name in RUN[:-1]:
        exec(CELLS[name], names)
    jam = names["jam"]
    names["in_jam"] = [names["run"](jam)]
    exec(CELLS[RUN[-1]], names)
    errors = {
        name: [float(turn.mean()), float(step.mean())]
        for name, (turn, step) in (
            (name, claim.step_errors(jam, poses)) for name, poses in names["in_jam"][0].items()
        )
    }
    pulled = names["np"].degrees(names["pull"] / jam.camera.f)
    left = errors["boxes removed"][0]
    assert "What remains is still more than *s* δ" in CELLS["claim-kit-words"]
    assert left > pulled
    assert left < 0.5 * errors["boxes kept"][0]
    alone = {name: names["translation_error"](jam, poses) for name, poses in names["in_jam"][0].items()}
    assert "the same features give about a third of the error" in CELLS["claim-price-words"]
    assert alone["boxes removed"] / alone["boxes kept"] == pytest.approx(1 / 3, abs=0.05)
