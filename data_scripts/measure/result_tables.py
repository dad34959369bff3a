"""The runs of `measure_results` for each sequence, and the tables of their results."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from measure.axes import fit_axes, is_raw_drive, te_and_re
from vo_lib.config import VARIANTS, change, preset
from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import (
    KITTI_MEASURE,
    SHORT_LENGTHS,
    Measure,
    kitti_errors,
    suitable_measure,
    trajectory_distances,
)
from vo_lib.report.page import ReportTable
from vo_lib.report.reproduce import slug
from vo_lib.report.table1 import VARIANT_WORDS
from vo_lib.runs.drive import Run
from vo_lib.runs.jobs import Job

SEEDS = range(5)
RULES = ("none", "all", "moving", "truth")
RULED = ("viso2", "solution_selection")
# Box rules that are methods of their own, which are not run twice.
PRESET_OF_RULE = {
    ("solution_selection", "all"): "feature_selection",
    ("solution_selection", "moving"): "moving_selection",
}
# TE % / RE deg/100 m of libviso2 and of ORB-SLAM2's published trajectory, from every frame.
OTHERS: dict[tuple[str, tuple[float, ...]], tuple[str, str]] = {
    ("kitti/00", (50.0,)): ("1.61 / 1.88", "1.51 / 2.13"),
    ("kitti/00", (100.0,)): ("1.44 / 1.17", "1.41 / 1.64"),
    ("kitti/01", (20.0,)): ("7.84 / 2.70", "5.47 / 2.54"),
}
Key = tuple[str, str, str]  # sequence, variant, method or "method rule"


def jobs_of(sequence: Sequence, folder: Path) -> Iterable[tuple[tuple[Key, int], Job]]:
    """Jobs for every method of both variants, and for the other box rules."""
    wanted = {
        (variant, name): config for variant, methods in VARIANTS.items() for name, config in methods.items()
    }
    # Only drawn scenes have the truth about moving vehicles.
    rules = RULES if (sequence.folder / "truth").is_dir() else RULES[:-1]
    for method in RULED:
        for rule in rules[1:]:
            if (method, rule) not in PRESET_OF_RULE:
                wanted["kit", f"{method} {rule}"] = change(preset(method, variant="kit"), "filter.rule", rule)
    method = _judged(sequence)
    wanted["kit", f"{method} off"] = change(preset(method, variant="kit"), "calibration.estimate", False)
    for (variant, name), config in wanted.items():
        for seed in SEEDS:
            place = folder / variant / slug(sequence.name) / slug(name) / f"seed_{seed}"
            yield (
                ((sequence.name, variant, name), seed),
                Job(sequence, name, change(config, "seed", seed), place),
            )


def _measures(sequence: Sequence) -> list[tuple[str, Measure]]:
    """Measures of a sequence: KITTI's, or one short length per row."""
    assert sequence.truth is not None
    whole = sequence.name.startswith(SYNTHETIC) and suitable_measure(sequence.truth) == KITTI_MEASURE
    if whole:
        return [(sequence.name, KITTI_MEASURE)]
    lengths = [L for L in SHORT_LENGTHS if len(kitti_errors(sequence.truth, sequence.truth, [L], 1))]
    axes = ", axes removed" if is_raw_drive(sequence) else ""
    return [(f"{sequence.name}, {length:g} m{axes}", Measure((length,), 1)) for length in lengths]


def _cell(runs: list[Run], measure: Measure) -> str:
    """TE / RE, mean ± deviation over the seeds."""
    turned = is_raw_drive(runs[0].sequence)
    errors = np.array([te_and_re(run.sequence, run.poses, measure, turned) for run in runs])
    if not np.isfinite(errors).all():
        return "–"
    return " / ".join(f"{v.mean():.3f} ± {v.std():.3f}" for v in errors.T)


def systems(sequences: list[Sequence], runs: dict[Key, list[Run]], variant: str) -> ReportTable:
    """Table of the methods of a variant on all sequences."""
    methods = list(VARIANTS[variant])
    rows = [
        [label, *(_cell(runs[sequence.name, variant, method], measure) for method in methods)]
        for sequence in sequences
        for label, measure in _measures(sequence)
    ]
    rows = [row for row in rows if set(row[1:]) != {"–"}]
    return ReportTable(VARIANT_WORDS[variant].capitalize(), ["sequence", *methods], rows, [])


def box_rules(sequences: list[Sequence], runs: dict[Key, list[Run]]) -> ReportTable:
    """Table of variant `kit` with each box rule, and the share of removed features."""
    rows = []
    for sequence in sequences:
        label, measure = _measures(sequence)[-1 if sequence.name.startswith(SYNTHETIC) else 0]
        for method in RULED:
            cells = []
            for rule in RULES:
                name = method if rule == "none" else PRESET_OF_RULE.get((method, rule), f"{method} {rule}")
                rule_runs = runs.get((sequence.name, "kit", name))
                removed = "" if rule_runs is None else f" {100 * rule_runs[0].removed_share:.0f} % gone"
                cells.append("–" if rule_runs is None else _cell(rule_runs, measure) + removed)
            rows.append([f"{label}, {method}", *cells])
    return ReportTable("Box rules, the kit's way", ["sequence, method", *RULES], rows, [])


def _judged(sequence: Sequence) -> str:
    """The method for the comparison with and without estimated calibration errors."""
    return "feature_selection" if sequence.name.startswith(SYNTHETIC) else "solution_selection"


def calibrations(sequences: list[Sequence], runs: dict[Key, list[Run]]) -> ReportTable:
    """Table of variant `kit` with and without estimation; real clips: fitted axes, other systems."""
    rows = []
    for sequence in sequences:
        measures = _measures(sequence)
        for label, measure in measures[-1:] if sequence.name.startswith(SYNTHETIC) else measures:
            method = _judged(sequence)
            learnt, off = (runs[sequence.name, "kit", name] for name in (method, f"{method} off"))
            cells = [_cell(part, measure) for part in (learnt, off)]
            if set(cells) == {"–"}:
                continue
            cells += [_turned(sequence, learnt, measure), _turned(sequence, off, measure)]
            others = OTHERS.get((sequence.name, measure.lengths), ("–", "–"))
            rows.append([f"{label}, {method}", *cells, _length(sequence, learnt), *others])
    columns = ["sequence, method", "learnt", "off", "learnt, axes", "off, axes", "length"]
    columns += ["libviso2", "ORB-SLAM2"]
    notes = [
        "Axes: the TE that is left with the pitch and yaw between camera and truth that make it smallest "
        "(`vo data measure_axes`), and these angles; seed 0. Length: of all steps, against the truth. "
        "libviso2 and ORB-SLAM2's published trajectories on the same frames, of clips with KITTI's first "
        "201 frames of 00 and 51 of 01. What learning is set to was chosen on 00, 01, KITTI's raw drive 0005 "
        "and the drawn scenes, so these rows are no check of it; the appendix says how."
    ]
    return ReportTable("What learning the calibration does", columns, rows, notes)


def _turned(sequence: Sequence, runs: list[Run], measure: Measure) -> str:
    """TE of the first seed with fitted axes, and the angles; "" for drawn scenes."""
    if sequence.name.startswith(SYNTHETIC) or sequence.truth is None:
        return "–"
    turned = fit_axes(sequence.truth, runs[0].poses, measure.lengths, measure.step)
    return f"{turned.kitti.te:.3f}\n({turned.pitch:+.2f}°, {turned.yaw:+.2f}°)"


def _length(sequence: Sequence, runs: list[Run]) -> str:
    """Excess length of the path, mean over seeds, percent."""
    assert sequence.truth is not None
    true, *lengths = (trajectory_distances(T)[-1] for T in (sequence.truth, *(run.poses for run in runs)))
    return f"{100 * (np.mean(lengths) / true - 1):+.2f} %"
