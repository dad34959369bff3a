"""What `vo reproduce` leaves in its folder: tables, numbers, figures and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ..core.files import write_bytes_atomic, write_text_atomic
from ..core.poses import write_kitti_poses
from ..core.types import Array
from ..data.sequence import KITTI
from .demo import methods_in_words
from .entries import Group, group_entries
from .paper import PaperTable
from .plots import error_curves_figure, pdf, png, trajectories_figure
from .report import Picture, ReportTable, provenance, render_report
from .reproduce import Reproduction, slug
from .table1 import layout_table, length_table, markdown, paper_table, trajectory_table
from .table1_data import groups_json, table_csv

FIGURE_4 = (f"{KITTI}02", f"{KITTI}07")
COLOURS = {
    "viso2": "green",
    "mesvo_f": "black",
    "solution_selection": "blue",
    "feature_selection": "sky blue",
    "moving_selection": "orange",
}


def write_table_files(
    folder: Path, result: Reproduction, paper: PaperTable, command: str
) -> tuple[list[ReportTable], dict[str, Any]]:
    """Write table1.md, table1.csv, metrics.json, figures, results/ and report.html.

    Returns
    -------
    The tables, and what metrics.json holds.
    """
    groups = group_entries(result.entries)
    tables = make_tables(groups, paper)
    metrics = {
        "groups": groups_json(groups, paper),
        "missing": result.missing,
        "failed": [{"job": job, "cause": cause} for job, cause in result.failed],
        "without_truth": sorted(result.poses),
        "made_with": provenance(),
    }
    text = "".join(f"{line}\n\n" for line in result.problems) + "\n".join(map(markdown, tables))
    write_text_atomic(folder / "table1.md", text)
    write_text_atomic(folder / "table1.csv", table_csv(groups, paper))
    write_text_atomic(folder / "metrics.json", json.dumps(metrics, indent=2, allow_nan=False) + "\n")
    write_results(folder, result)
    pictures = [*_trajectories(folder, result), *_curves(folder, groups)]
    page = render_report(
        "Table 1 and Figure 4, reproduced",
        _introduction(result),
        tables,
        pictures,
        [command],
        tuple(result.problems),
    )
    write_text_atomic(folder / "report.html", page)
    return tables, metrics


def make_tables(groups: list[Group], paper: PaperTable) -> list[ReportTable]:
    """Table 1 of each group, KITTI's also beside the paper's; then by length; ATE and RPE."""
    tables = []
    for group in groups:
        tables.append(layout_table(group))
        if group.kitti:
            tables.append(paper_table(group, paper))
    tables += [length_table(group) for group in groups]
    everything = [entry for group in groups for entry in group.entries.values()]
    return [*tables, trajectory_table(everything)] if everything else tables


def write_results(folder: Path, result: Reproduction) -> None:
    """Poses of sequences without truth as KITTI's server takes them: results/<method>/11.txt, and so on."""
    for sequence, by_method in result.poses.items():
        for method, poses in by_method.items():
            place = folder / "results" / method
            place.mkdir(parents=True, exist_ok=True)
            write_kitti_poses(place / f"{slug(sequence.removeprefix(KITTI))}.txt", poses)


def _introduction(result: Reproduction) -> list[str]:
    seeds = "one seed" if result.seeds == 1 else f"{result.seeds} seeds"
    methods = {entry.method for entry in result.entries}.union(*result.poses.values())
    lines = [
        "The systems of Table 1 of “Enhance stereo visual odometry performance by removing unstable "
        f"features”, run on the same matches with {seeds}. {methods_in_words(methods)}",
        "All methods learn on the way what is wrong with the calibration of the stereo pair: its rows, its "
        "disparities, its principal point. The paper does not, and it helps most where the pair is badly "
        "calibrated.",
    ]
    if result.poses:
        names = ", ".join(sorted(result.poses))
        lines.append(f"No ground truth, so no errors: {names}. Their poses are in the folder results.")
    return lines


def _trajectories(folder: Path, result: Reproduction) -> list[Picture]:
    """A figure for each sequence, and Figure 4 with two of them side by side."""
    panels: dict[str, tuple[Array | None, dict[str, Array]]] = {}
    for entry in result.entries:
        panels.setdefault(entry.sequence, (entry.truth, {}))[1][entry.method] = entry.poses
    for sequence, estimates in result.poses.items():
        panels[sequence] = (None, estimates)
    if not panels:
        return []
    chosen = [name for name in FIGURE_4 if name in panels] or list(panels)[:2]
    write_figure(folder, "figure4", trajectories_figure({name: panels[name] for name in chosen}))
    pictures = []
    for name in [*chosen, *(name for name in panels if name not in chosen)]:
        data = write_figure(folder, f"trajectory_{slug(name)}", trajectories_figure({name: panels[name]}))
        label = "Figure 4. " if name in chosen else ""
        truth, estimates = panels[name]
        lines = [] if truth is None else ["ground truth red"]
        lines += [f"{method} {COLOURS[method]}" for method in estimates]
        caption = f"{label}{name} from above, first seed: {', '.join(lines)}."
        pictures.append(
            Picture(data, caption, f"Paths over {name} from above of {_listed(list(estimates))}.")
        )
    return pictures


def _curves(folder: Path, groups: list[Group]) -> list[Picture]:
    """The devkit's curves of each group, by length and by speed."""
    pictures = []
    for number, group in enumerate(groups):
        errors = {method: group.sub_sequences(method) for method in group.methods}
        lengths = group.measure.lengths
        kind = "kitti" if group.kitti else "others"
        for by in ("length", "speed"):
            curves = {method: part.curve(by, lengths) for method, part in errors.items()}
            figure = error_curves_figure(_title(group), by, curves)
            data = write_figure(folder, f"errors_{kind}_{number}_by_{by}", figure)
            caption = (
                f"TE and RE by {by} over {', '.join(group.sequences)}; {group.measure.words}; all seeds."
            )
            alt = f"TE and RE by {by} of {_listed(group.methods)}; the numbers are in metrics.json."
            pictures.append(Picture(data, caption, alt))
    return pictures


def _title(group: Group) -> str:
    return f"{'KITTI' if group.kitti else 'other sequences'}\n{group.measure.words}"


def write_figure(folder: Path, name: str, figure: Figure) -> bytes:
    """Write a figure as PNG and as PDF; returns the PNG."""
    data = png(figure)
    write_bytes_atomic(folder / f"{name}.png", data)
    write_bytes_atomic(folder / f"{name}.pdf", pdf(figure))
    return data


def _listed(words: list[str]) -> str:
    return ", ".join(words[:-1]) + f" and {words[-1]}" if len(words) > 1 else "".join(words)
