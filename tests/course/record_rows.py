"""Rows of the record of a reproduction, for the tests of chapter 7's verdicts and cells."""

from __future__ import annotations

from typing import Any

from vo_lib.evaluation.kitti_errors import KITTI_PROTOCOL
from vo_lib.report.table1 import BENCHMARK_COUNTS, BENCHMARK_FRAMES


def record_row(row: str, method: str, seeds: int = 5, **changes: Any) -> dict[str, Any]:
    """A row of a record as `vo reproduce` writes it, with equal errors of all seeds."""
    usual = {
        "variant": "published",
        "settings": "",
        "sequence": f"kitti/{row}",
        "method": method,
        "whole": True,
        "frames": BENCHMARK_FRAMES[f"kitti/{row}"],
        "sub_sequences": KITTI_PROTOCOL.words,
        "sub_sequence_count": BENCHMARK_COUNTS[f"kitti/{row}"],
        "removed_share": 0.1 if method == "feature_selection" else 0.0,
        "seeds": [*range(seeds)],
        "te_percent": [1.0] * seeds,
        "re_deg_per_100m": [0.3] * seeds,
    }
    return usual | changes
