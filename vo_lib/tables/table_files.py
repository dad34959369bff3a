"""What `vo reproduce` leaves in its folder: tables, numbers, figures and the report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..config import CalibrationConfig
from ..core.files import write_result
from ..core.poses import format_kitti_poses
from ..core.rows import joined
from ..data.sequence import KITTI
from ..evaluation.kitti import KITTI_MEASURE
from .entries import Group, group_entries
from .error_plots import Curve, error_curves_figure
from .field_figure import field_figure
from .paper import PAPER_METHODS, REMARKS, PaperTable
from .plots import pdf, png, trajectories_figure
from .report import Picture, ReportTable, markdown, provenance, render_report
from .reproduce import Reproduction, slug
from .table1 import NAMED, VARIANT_WORDS, layout_tables, length_table, trajectory_table
from .table1_data import records_csv, table_records

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_4 = (f"{KITTI}02", f"{KITTI}07")
TABLE_FILES = ("table1.md", "table1.csv", "metrics.json", "report.html")
# Of the devkit's curves, with the fewest points that make one: its bins of speed overlap, and a drive at one
# speed lies in two or three of them.
AXES = {"length": 2, "speed": 4}
IN_WORDS = {
    "viso2": "viso2 fits rotation and translation together",
    "mesvo_f": "mesvo_f chooses the rotation by consensus",
    "solution_selection": "solution_selection prefers solutions near the previous frame's",
    "feature_selection": "feature_selection also removes the features in vehicle boxes, which is the paper's "
    "proposal",
    "moving_selection": "moving_selection, not in the paper, removes only those of boxes that are judged to "
    "move",
}


def write_table_files(
    folder: Path, result: Reproduction, paper: PaperTable, command: str, more: tuple[Picture, ...] = ()
) -> None:
    """Write `TABLE_FILES`, figures and results/; `more` pictures go into the report."""
    groups = group_entries(result.entries)
    tables, records = make_tables(groups, paper), table_records(groups, paper)
    without_truth = sorted({name for (_, name), (truth, _) in result.paths.items() if truth is None})
    metrics = {
        "rows": records,
        "missing": result.missing,
        "failed": [{"job": job, "cause": cause} for job, cause in result.failed],
        "without_truth": without_truth,
        "made_with": provenance(),
    }
    write_results(folder, result)
    pictures = [*more, *_trajectories(folder, result), *_curves(folder, groups), *_fields(folder, result)]
    introduction = _introduction(result, without_truth)
    contents = (
        "".join(f"{line}\n\n" for line in result.problems) + "\n".join(map(markdown, tables)),
        records_csv(records),
        json.dumps(metrics, indent=2, allow_nan=False) + "\n",
        render_report(_report_title(groups), introduction, tables, pictures, [command], result.problems),
    )
    for name, content in zip(TABLE_FILES, contents, strict=True):
        write_result(folder / name, content)


def make_tables(groups: list[Group], paper: PaperTable) -> list[ReportTable]:
    """Table 1 of each group, KITTI's with the paper's numbers; then all by length; ATE and RPE.

    What is to be said of the paper's numbers stands once, below the last table that has them.
    """
    tables = [table for group in groups for table in layout_tables(group, paper)]
    if any(group.kitti for group in groups):
        tables[-1].notes.extend(REMARKS)
    tables += [length_table(group) for group in groups]
    return tables + [trajectory_table(group) for group in groups]


def write_results(folder: Path, result: Reproduction) -> None:
    """Poses of sequences without truth as KITTI's server takes them: results/<variant>/<method>/11.txt."""
    for (variant, sequence), (truth, paths) in result.paths.items():
        for method, poses in paths.items() if truth is None else ():
            place = folder / "results" / variant / method
            place.mkdir(parents=True, exist_ok=True)
            write_result(place / f"{slug(sequence.removeprefix(KITTI))}.txt", format_kitti_poses(poses))


def _report_title(groups: list[Group]) -> str:
    if any(group.kitti and group.measure == KITTI_MEASURE for group in groups):
        return "Table 1 and Figure 4, reproduced"
    names = list(dict.fromkeys(name for group in groups for name in group.sequences))
    return "The paper's methods" + (f" on {_listed(names)}" if 0 < len(names) <= NAMED else "")


def _introduction(result: Reproduction, without_truth: list[str]) -> list[str]:
    seeds = "one seed" if result.seeds == 1 else f"{result.seeds} seeds"
    methods = {method for _, paths in result.paths.values() for method in paths}
    in_words = "; ".join(words for name, words in IN_WORDS.items() if name in methods)
    lines = [
        "The systems of Table 1 of “Enhance stereo visual odometry performance by removing unstable "
        f"features”, run on the same matches with {seeds}. {in_words}.",
        "As published: the paper and no more; paper_and_code.md lists what it leaves open and what was "
        "chosen. The kit's way: its own front end, a winner that is refined on its inliers, and what is "
        "wrong with the stereo calibration is learnt on the way, which helps most where the pair is badly "
        "calibrated.",
    ]
    if without_truth:
        names = ", ".join(without_truth)
        lines.append(f"No ground truth, so no errors: {names}. Their poses are in the folder results.")
    return lines


def _trajectories(folder: Path, result: Reproduction) -> list[Picture]:
    """Of each variant Figure 4, where its two sequences are, and a figure of each sequence."""
    pictures = []
    for variant in dict.fromkeys(variant for variant, _ in result.paths):
        found = {name: panel for (each, name), panel in result.paths.items() if each == variant}
        figure_4 = {
            name: (found[name][0], {m: poses for m, poses in found[name][1].items() if m in PAPER_METHODS})
            for name in FIGURE_4
            if name in found
        }
        figures = {f"figure4_{variant}": figure_4} if any(paths for _, paths in figure_4.values()) else {}
        figures |= {f"trajectory_{variant}_{slug(name)}": {name: panel} for name, panel in found.items()}
        for file, shown in figures.items():
            known = any(truth is not None for truth, _ in shown.values())
            beside = "; beside it the distance from the truth along the path" if known else ""
            label = "Figure 4: " if file.startswith("figure4") else ""
            caption = (
                f"{label}{_listed(list(shown))} from above, {VARIANT_WORDS[variant]}, first seed{beside}."
            )
            pictures.append(Picture(write_figure(folder, file, trajectories_figure(shown)), caption))
    return pictures


def _curves(folder: Path, groups: list[Group]) -> list[Picture]:
    """The devkit's curves of each group, by length and by speed."""
    pictures = []
    for number, group in enumerate(groups):
        errors = {m: joined(e.sub_sequences for e in group.of_method(m)) for m in group.methods}
        curves = {by: {m: each.curve(by, group.measure.lengths) for m, each in errors.items()} for by in AXES}
        name = f"{group.variant}_{'kitti' if group.kitti else 'others'}_{number}"
        title = f"{VARIANT_WORDS[group.variant]}\n{group.words}"
        for by, data in write_curves(folder, name, title, curves).items():
            where = f"{', '.join(group.sequences)}, {VARIANT_WORDS[group.variant]}; {group.measure.words}"
            pictures.append(Picture(data, f"TE and RE by {by} over {where}; all seeds."))
    return pictures


def _fields(folder: Path, result: Reproduction) -> list[Picture]:
    """What the kit's way learnt of each sequence's stereo calibration."""
    pictures = []
    for name, calibration in result.calibrations.items():
        errors = calibration.in_use(CalibrationConfig())
        data = write_figure(folder, f"field_{slug(name)}", field_figure(errors, calibration.camera))
        said = calibration.in_words(CalibrationConfig())
        pictures.append(
            Picture(data, f"{name}, what the kit's way learnt of the stereo calibration: {said}.")
        )
    return pictures


def write_figure(folder: Path, name: str, figure: Figure) -> bytes:
    """Write a figure as PNG and as PDF; returns the PNG."""
    data = png(figure)
    write_result(folder / f"{name}.png", data)
    write_result(folder / f"{name}.pdf", pdf(figure))
    return data


def write_curves(
    folder: Path, name: str, title: str, curves: Mapping[str, Mapping[str, Curve]]
) -> dict[str, bytes]:
    """Write errors_<name>_by_length and _by_speed as far as they are curves and not single points.

    `curves` : of "length" and of "speed" the points by name. Returns the PNG of each figure written.
    """
    return {
        by: write_figure(folder, f"errors_{name}_by_{by}", error_curves_figure(title, by, points))
        for by, points in curves.items()
        if max(map(len, points.values()), default=0) >= AXES[by]
    }


def _listed(words: list[str]) -> str:
    return ", ".join(words[:-1]) + f" and {words[-1]}" if len(words) > 1 else "".join(words)
