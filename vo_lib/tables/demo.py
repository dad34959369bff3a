"""The main job with nothing downloaded: a synthetic street, every method on it, table, pictures, report."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..beyond.box_filter import static_matches
from ..config import METHODS, VARIANTS, preset
from ..core.files import write_bytes_atomic, write_text_atomic
from ..core.types import Progress
from ..data.sequence import Sequence
from ..evaluation.kitti import trajectory_distances
from ..front_end.front_end import make_front_end
from ..runs.results import write_run
from ..runs.runner import run_methods
from .entries import measure_runs
from .plots import jpeg, match_image, png, trajectory_figure
from .report import Picture, ReportTable, render_report
from .table1 import VARIANT_WORDS, method_table

SCENE = "synthetic/traffic"
IN_WORDS = {
    "viso2": "viso2 fits rotation and translation together",
    "mesvo_f": "mesvo_f chooses the rotation by consensus",
    "solution_selection": "solution_selection prefers solutions near the previous frame's",
    "feature_selection": "feature_selection also removes the features in vehicle boxes, which is the paper's "
    "proposal",
    "moving_selection": "moving_selection, not in the paper, removes only those of boxes that are judged to "
    "move",
}


def methods_in_words(names: Iterable[str] = METHODS) -> str:
    """What the methods do, a sentence."""
    return "; ".join(words for name, words in IN_WORDS.items() if name in set(names)) + "."


def run_demo(
    sequence: Sequence, folder: Path, variants: list[str], progress: Progress | None = None
) -> list[ReportTable]:
    """All methods of some variants over a sequence with truth; writes a folder for each run and report.html.

    Returns
    -------
    The tables of the report, one a variant: TE and RE over the sub-sequence lengths that the path allows, the
    share of the features that boxes removed, and the mean time that a method takes of a frame.
    """
    assert sequence.truth is not None
    tables, pictures = [], []
    for number, variant in enumerate(variants):
        runs = run_methods(sequence, VARIANTS[variant], _part(progress, number, len(variants)))
        for name, result in runs.items():
            place = folder / variant / name
            place.mkdir(parents=True, exist_ok=True)
            write_run(place, result, name)
        entries = [measure_runs(name, [result]) for name, result in runs.items()]
        tables.append(method_table(entries))
        estimates = {name: result.poses for name, result in runs.items()}
        title = f"{sequence.name}, {VARIANT_WORDS[variant]}"
        picture = png(trajectory_figure(title, sequence.truth, estimates))
        write_bytes_atomic(folder / f"trajectory_{variant}.png", picture)
        pictures.append(
            Picture(
                picture,
                f"{VARIANT_WORDS[variant].capitalize()}: the path from above, which all methods share to the "
                "eye, and how far each strays from the truth along it.",
            )
        )
    pictures.append(
        Picture(
            _example_frame(sequence),
            "Matches of one frame, from the previous place of a feature to its present one: "
            "orange lies in a vehicle's box (white) and is removed, blue stays.",
        )
    )
    introduction = [
        f"{len(sequence)} stereo pairs of {sequence.name}, {trajectory_distances(sequence.truth)[-1]:.0f} m. "
        "The street is drawn by the kit, so its ground truth is exact.",
        methods_in_words(),
    ]
    page = render_report("Stereo visual odometry: demo", introduction, tables, pictures, ["vo demo"])
    write_text_atomic(folder / "report.html", page)
    return tables


def _part(progress: Progress | None, number: int, of: int) -> Progress | None:
    """The progress of one of several equal parts."""
    if progress is None:
        return None
    return lambda done, total: progress(number * total + done, of * total)


def _example_frame(sequence: Sequence) -> bytes:
    """JPEG of the matches in the frame with the largest vehicle boxes among a dozen of the sequence."""
    tried = np.linspace(1, len(sequence) - 1, min(12, len(sequence) - 1)).astype(int).tolist()
    frame = max(tried, key=lambda i: _box_area(sequence, i))
    config = preset("feature_selection")
    matcher = make_front_end(sequence.camera, config.features, config.matching)
    pairs = [sequence.stereo(frame - 1), sequence.stereo(frame)]
    matches = [matcher.step(matcher.prepare(pair)) for pair in pairs][-1]
    boxes = sequence.boxes(frame)
    kept, _ = static_matches(matches, sequence.boxes(frame - 1), boxes, config.filter)
    return jpeg(match_image(pairs[1][0], matches, kept, boxes))


def _box_area(sequence: Sequence, frame: int) -> float:
    x0, y0, x1, y1 = sequence.boxes(frame).xyxy.T
    return float(np.sum((x1 - x0) * (y1 - y0)))
