"""The runs of `measure_results` for each sequence, and the tables of their results."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from measure.axes import MAX_ANGLE_DEG, NARROW_DEG, fit_axes, fit_of_halves, is_raw_drive, te_and_re
from measure.error_tables import MEAN, Cell, Cells, compared, plain, tables, with_numbers
from vo_lib.config import VARIANTS, change, preset
from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import (
    KITTI_PROTOCOL,
    SHORT_LENGTHS,
    SubsequenceProtocol,
    kitti_errors,
    suitable_protocol,
    trajectory_distances,
)
from vo_lib.evaluation.statistics import standard_deviation
from vo_lib.report.page import ReportTable
from vo_lib.report.table1_page import VARIANT_WORDS
from vo_lib.report.table1_plan import slug
from vo_lib.runs.drive import Run
from vo_lib.runs.jobs import Job

SEEDS = range(5)
# The box rules, and the methods that are run with each of them.
RULES = ("none", "all", "moving", "truth")
METHODS_WITH_RULES = ("viso2", "solution_selection")
# Some of these runs are those of a method in Table 1, and are not made twice.
METHOD_OF_RULE = {
    ("viso2", "none"): "viso2",
    ("solution_selection", "none"): "solution_selection",
    ("solution_selection", "all"): "feature_selection",
    ("solution_selection", "moving"): "moving_selection",
}
# TE % and RE deg/100 m of libviso2 and of ORB-SLAM2's published trajectory, from every frame.
OTHERS: dict[str, dict[str, tuple[float, float]]] = {
    "kitti/00, 50 m": {"libviso2": (1.61, 1.88), "ORB-SLAM2": (1.51, 2.13)},
    "kitti/00, 100 m": {"libviso2": (1.44, 1.17), "ORB-SLAM2": (1.41, 1.64)},
    "kitti/01, 20 m": {"libviso2": (7.84, 2.70), "ORB-SLAM2": (5.47, 2.54)},
}
OUR_METHODS = "viso2", "feature_selection"  # in the same table
Key = tuple[str, str, str]  # sequence, variant, and method, "method rule" or "method off"
Numbers = Mapping[str, Mapping[str, float | None]]  # by row and column


def jobs_of(sequence: Sequence, folder: Path) -> Iterable[tuple[tuple[Key, int], Job]]:
    """Jobs for every method of both variants, for the other box rules, and without learnt calibration.

    Each with its key and its seed.
    """
    configs = {}
    for variant, methods in VARIANTS.items():
        for name, config in methods.items():
            configs[variant, name] = config
    has_truth_on_vehicles = (sequence.folder / "truth").is_dir()  # as drawn scenes have
    for method in METHODS_WITH_RULES:
        for rule in RULES:
            is_new = (method, rule) not in METHOD_OF_RULE
            if is_new and (rule != "truth" or has_truth_on_vehicles):
                config = change(preset(method, variant="kit"), "filter.rule", rule)
                configs["kit", f"{method} {rule}"] = config
    method = _method_with_calibration(sequence)
    configs["kit", f"{method} off"] = change(preset(method, variant="kit"), "calibration.estimate", False)
    for (variant, name), config in configs.items():
        for seed in SEEDS:
            path = folder / variant / slug(sequence.name) / slug(name) / f"seed_{seed}"
            key = (sequence.name, variant, name)
            yield (key, seed), Job(sequence, name, change(config, "seed", seed), path)


def _protocols(sequence: Sequence) -> list[tuple[str, SubsequenceProtocol]]:
    """Label and protocol of each table row of a sequence: KITTI's, or one for each short length."""
    truth = sequence.true_poses
    if sequence.name.startswith(SYNTHETIC) and suitable_protocol(truth) == KITTI_PROTOCOL:
        return [(sequence.name, KITTI_PROTOCOL)]
    axes = ", axes removed" if is_raw_drive(sequence) else ""
    protocols = []
    for length in SHORT_LENGTHS:
        fits_into_path = len(kitti_errors(truth, truth, [length], 1)) > 0
        if fits_into_path:
            label = f"{sequence.name}, {length:g} m{axes}"
            protocols.append((label, SubsequenceProtocol((length,), 1)))
    return protocols


def _cell(runs: list[Run] | None, protocol: SubsequenceProtocol) -> Cell:
    """Mean and standard deviation (columns) of TE and RE (rows) over the seeds, (2, 2), or None."""
    if runs is None:
        return None
    turned = is_raw_drive(runs[0].sequence)
    errors = np.array([te_and_re(run.sequence, run.poses, protocol, turned) for run in runs])
    if not np.isfinite(errors).all():
        return None
    return np.stack([errors.mean(axis=0), standard_deviation(errors)], axis=1)


def cells_of_systems(sequences: list[Sequence], runs: dict[Key, list[Run]]) -> dict[str, Cells]:
    """The errors of the methods of each variant, by row and method."""
    systems: dict[str, Cells] = {}
    for variant, methods in VARIANTS.items():
        cells = {}
        for sequence in sequences:
            for label, protocol in _protocols(sequence):
                cells[label] = {
                    method: _cell(runs[sequence.name, variant, method], protocol) for method in methods
                }
        systems[variant] = cells
    return systems


def claim_table(cells: Cells) -> ReportTable:
    """The paper's claim, as in the README: errors with and without removal, for the longest sub-sequences.

    `cells` : errors of variant `published`. Two decimals do not depend on the processor's rounding.
    """
    methods = ("solution_selection", "feature_selection")
    # The rows of a sequence are in the order of their lengths, so the last one counts.
    last_label_of = {label.partition(",")[0]: label for label in cells}
    rows = []
    for label in last_label_of.values():
        row = [label]
        for method in methods:
            cell = cells[label][method]
            row.append("" if cell is None else f"{cell[0, MEAN]:.2f} / {cell[1, MEAN]:.2f}")
        rows.append(row)
    title = "The paper's claim, variant published: TE % / RE deg/100 m, means over the seeds"
    return ReportTable(title, ["sequence", *methods], rows, [])


def result_tables(
    sequences: list[Sequence], runs: dict[Key, list[Run]], systems: Mapping[str, Cells]
) -> list[ReportTable]:
    """All tables of the page: methods of both variants, other systems, box rules, self-calibration."""
    rules, removed = _cells_of_rules(sequences, runs)
    learning, axes, doubts = _cells_of_calibration(sequences, runs)
    return page_tables(systems, rules, removed, learning, axes, doubts)


def _shown_protocols(sequence: Sequence) -> list[tuple[str, SubsequenceProtocol]]:
    """The protocols in the tables of box rules and of the calibration: of a drawn scene, the last alone."""
    protocols = _protocols(sequence)
    return protocols[-1:] if sequence.name.startswith(SYNTHETIC) else protocols


def _cells_of_rules(
    sequences: list[Sequence], runs: dict[Key, list[Run]]
) -> tuple[dict[str, dict[str, Cell]], dict[str, dict[str, float | None]]]:
    """The errors with each box rule, and the share of features that the rule removes, %, by row and rule."""
    rules: dict[str, dict[str, Cell]] = {}
    removed: dict[str, dict[str, float | None]] = {}
    for sequence in sequences:
        first_label, first_protocol = _shown_protocols(sequence)[0]
        for method in METHODS_WITH_RULES:
            row = f"{first_label}, {method}"
            runs_of_rules = _runs_of_rules(sequence, method, runs)
            rules[row] = {rule: _cell(each, first_protocol) for rule, each in runs_of_rules.items()}
            removed[row] = {
                rule: None if each is None else 100 * each[0].removed_share
                for rule, each in runs_of_rules.items()
            }
    return rules, removed


def _cells_of_calibration(
    sequences: list[Sequence], runs: dict[Key, list[Run]]
) -> tuple[dict[str, dict[str, Cell]], dict[str, dict[str, float | None]], list[str]]:
    """The errors without and with the learnt calibration, and the fitted axes, by row and column.

    The third result is sentences on doubts about the fitted axes.
    """
    learning: dict[str, dict[str, Cell]] = {}
    axes: dict[str, dict[str, float | None]] = {}
    doubts: list[str] = []
    for sequence in sequences:
        drawn = sequence.name.startswith(SYNTHETIC)
        method = _method_with_calibration(sequence)
        learnt = runs[sequence.name, "kit", method]
        off = runs[sequence.name, "kit", f"{method} off"]
        for label, protocol in _shown_protocols(sequence):
            row = f"{label}, {method}"
            learning[row] = {"off": _cell(off, protocol), "learnt": _cell(learnt, protocol)}
            axes[row] = {"length %, learnt": _length(sequence, learnt)}
            for name, each in (("off", off), ("learnt", learnt)):
                values: list[float | None] = [None] * 3
                if not drawn:
                    values, new_doubts = _fitted_axes(f"In {row}, {name}", each[0], protocol)
                    doubts += new_doubts
                columns = [f"TE %, {name}", f"pitch °, {name}", f"yaw °, {name}"]
                axes[row] |= dict(zip(columns, values, strict=True))
    return learning, axes, doubts


def _runs_of_rules(
    sequence: Sequence, method: str, runs: dict[Key, list[Run]]
) -> dict[str, list[Run] | None]:
    """The runs of a method of variant `kit` with each box rule; None for a rule that was not run."""
    found = {}
    for rule in RULES:
        name = METHOD_OF_RULE.get((method, rule), f"{method} {rule}")
        found[rule] = runs.get((sequence.name, "kit", name))
    return found


def _fitted_axes(start: str, run: Run, protocol: SubsequenceProtocol) -> tuple[list[float | None], list[str]]:
    """TE, %, pitch and yaw, degrees, of a run with fitted axes, and sentences on doubts about the fit.

    start : the words with which a sentence begins: row and column.
    """
    sequence = run.sequence
    truth = sequence.true_poses
    turned = fit_axes(truth, run.poses, protocol.lengths, protocol.step)
    doubts = []
    if turned.at_limit:
        doubts.append(f"{start}, {turned.limit_words}")
    if is_raw_drive(sequence):
        halves = fit_of_halves(truth, run.poses, protocol.lengths, protocol.step)
        yaws = " and ".join(f"{yaw:.2f}°" for _, yaw in halves)
        doubts.append(
            f"{start}, the sub-sequences that start first and those that start last give a yaw of {yaws}: "
            "what differs is drift, which the fit removes from TE as well."
        )
    return [turned.kitti.te, turned.pitch, turned.yaw], doubts


def page_tables(
    systems: Mapping[str, Cells],
    rules: Cells,
    removed: Numbers,
    learning: Cells,
    axes: Numbers,
    doubts: list[str],
) -> list[ReportTable]:
    """The tables of the page, with sentences computed from their numbers."""
    result = []
    for variant, cells in systems.items():
        cells = with_numbers(cells)
        sentences = compared(
            cells, "solution_selection", "feature_selection", "Removal of the features in boxes"
        )
        result += tables(VARIANT_WORDS[variant].capitalize(), cells, sentences)
    result += other_systems(systems)
    method = "solution_selection"
    of_method = {label: row for label, row in rules.items() if label.endswith(method)}
    sentences = compared(of_method, "none", "moving", f"For `{method}`, the rule `moving` in place of `none`")
    result += tables("Box rules, variant kit", rules, sentences, "sequence, method")
    removed_table = plain("Box rules, variant kit: features removed, %", "sequence, method", removed, 0)
    removed_table.notes.append("Of the runs with seed 0.")
    result.append(removed_table)
    learning = with_numbers(learning)
    sentences = compared(learning, "off", "learnt", "Learning the calibration")
    result += tables("Effect of the estimated calibration", learning, sentences, "sequence, method")
    axes_table = plain("Axes of the truth, and the length of the path", "sequence, method", axes, 3)
    result.append(axes_table)
    axes_table.notes.append(
        "The column TE has the smallest TE over the constant rotations between the axes of the camera and of "
        f"the truth, up to {MAX_ANGLE_DEG:g}° where the angles are well determined and up to {NARROW_DEG:g}° "
        "elsewhere; pitch and yaw are the angles of this rotation (`vo data measure_axes`, seed 0). The "
        "column length has the length of the path minus the true length. The settings of the calibration "
        "were chosen on 00, 01, KITTI's raw drive 0005 and the drawn scenes, so these rows do "
        "not test the settings; see the appendix."
    )
    axes_table.notes.extend(doubts)
    return result


def other_systems(systems: Mapping[str, Cells]) -> list[ReportTable]:
    """Table of libviso2, ORB-SLAM2 and the kit's methods, on the clips with results of both systems."""
    rows: dict[str, dict[str, float | None]] = {}
    for label, others in OTHERS.items():
        if any(label not in cells for cells in systems.values()):
            continue
        errors = dict(others)
        for variant, method in itertools.product(systems, OUR_METHODS):
            cell = systems[variant][label][method]
            if cell is not None:
                errors[f"{method}, {variant}"] = (float(cell[0, MEAN]), float(cell[1, MEAN]))
        for name, (te, re) in errors.items():
            rows[f"{label}, {name}"] = {"TE %": te, "RE deg/100 m": re}
    if not rows:
        return []
    table = plain("Other systems on the same frames", "sequence, system", rows, 2)
    table.notes.append(
        "Published trajectories of libviso2 and ORB-SLAM2, and methods of the kit (means over the seeds), on "
        "frames 0 to 200 of KITTI's 00 and frames 0 to 50 of 01. A sub-sequence starts at every frame."
    )
    return [table]


def _method_with_calibration(sequence: Sequence) -> str:
    """The method that is compared with and without estimation of the calibration errors."""
    return "feature_selection" if sequence.name.startswith(SYNTHETIC) else "solution_selection"


def _length(sequence: Sequence, runs: list[Run]) -> float:
    """Excess length of the path in % of the true length, mean over the seeds."""
    true = float(trajectory_distances(sequence.true_poses)[-1])
    lengths = [float(trajectory_distances(run.poses)[-1]) for run in runs]
    return 100 * (float(np.mean(lengths)) / true - 1)
