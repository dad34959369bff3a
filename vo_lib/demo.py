"""The main job with nothing downloaded: a synthetic street, every method on it, table, pictures, report."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .config import METHODS, preset
from .evaluation import suitable_errors, trajectory_distances
from .files import write_bytes_atomic, write_text_atomic
from .filtering import static_matches
from .front_end import make_front_end
from .plots import jpeg, match_image, png, trajectory_figure
from .report import Picture, ReportTable, render_report
from .reproduce import COLUMNS
from .results import write_run
from .runner import Run, run_methods
from .sequence import Progress, Sequence

SCENE = "synthetic/traffic"


def run_demo(sequence: Sequence, folder: Path, progress: Progress | None = None) -> ReportTable:
    """All methods over a sequence with truth; writes a folder for each, a picture and report.html.

    Returns
    -------
    The table of the report: TE and RE over the sub-sequence lengths that the path allows, the share of the
    features that boxes removed, and the mean time of a frame.
    """
    assert sequence.truth is not None
    runs = run_methods(sequence, {name: preset(name) for name in METHODS}, progress)
    for name, result in runs.items():
        (folder / name).mkdir(exist_ok=True)
        write_run(folder / name, result, name)
    table = _table(sequence, runs)
    estimates = {name: result.poses for name, result in runs.items()}
    picture = png(trajectory_figure(sequence.name, sequence.truth, estimates))
    write_bytes_atomic(folder / "trajectory.png", picture)
    pictures = [
        Picture(picture, "The path from above: ground truth and the estimate of each method."),
        Picture(
            _example_frame(sequence),
            "Matches of one frame, from the previous place of a feature to its present one: "
            "orange lies in a vehicle's box (white) and is removed, blue stays.",
        ),
    ]
    introduction = [
        f"{len(sequence)} stereo pairs of {sequence.name}, {trajectory_distances(sequence.truth)[-1]:.0f} m. "
        "The street is drawn by the kit, so its ground truth is exact.",
        "mesvo_f chooses the rotation by consensus; solution_selection prefers solutions near the previous "
        "frame's; feature_selection also removes features in vehicle boxes (the paper's proposal).",
    ]
    page = render_report("Stereo visual odometry: demo", introduction, [table], pictures, ["vo demo"])
    write_text_atomic(folder / "report.html", page)
    return table


def _table(sequence: Sequence, runs: dict[str, Run]) -> ReportTable:
    assert sequence.truth is not None
    rows, lengths = [], ""
    for name, result in runs.items():
        errors, lengths = suitable_errors(sequence.truth, result.poses)
        numbers = ["–", "–"] if errors.te is None else [f"{errors.te:.3f}", f"{errors.re:.3f}"]
        rows.append([name, *numbers, f"{100 * result.removed_share:.1f} %", f"{result.ms_per_frame:.0f}"])
    notes = [f"TE and RE over sub-sequences of {lengths}; one seed."]
    return ReportTable(f"Errors on {sequence.name}", COLUMNS, rows, notes)


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
