"""The ideas of variant `kit`, the settings that turn each idea off, and the tables of the effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from measure.disturbances import DISTURBANCES, DISTURBED_FRAMES
from vo_lib.config import change, preset
from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.evaluation.statistics import SPREADS, standard_deviation
from vo_lib.geometry.types import Array
from vo_lib.kit.settings import KitConfig
from vo_lib.report.page import NO_NUMBER, ReportTable

# The methods in which ideas are turned off: MOVING for those of the rule `moving`, PROPOSAL for all others.
PROPOSAL = "feature_selection"
MOVING = "moving_selection"
KEY = ("idea", "method", "sequence", "seeds")
# Results of a run: TE, %; RE, deg/100 m; distance of the last position from the truth, metres; excess length
# of the path, %; frames without a measured motion.
RESULTS = ("te", "re", "end", "length", "lost")
# Each result is followed by its standard deviation.
COLUMNS = (*KEY, *(f"{name}{end}" for name in RESULTS for end in ("", "_sd")), "ms")
# An idea is needed if, without it, one of these errors grows by this share and by `SPREADS` deviations of the
# change. The rule is not that of `one_run_shows`: both runs have the same seed, and 1 % is enough to stay.
DECISIVE = ("te", "re", "end")
NEEDED_SHARE = 0.01
# A drive is passed narrowly if so many ideas or more, turned off alone, lose one frame with the same TE.
NARROW_IDEAS = 3
# The times are measured in runs of their own, on the first frames of the first drive.
TIMED_FRAMES = 40
TIMED_RUNS = 3  # the shortest time counts: other programs only add time
WORDS = {"te": "TE", "re": "RE", "end": "end"}


@dataclass(frozen=True, eq=False)
class Idea:
    """An idea of variant `kit`.

    Attributes
    ----------
    name : name of the idea in the table.
    off : names of settings (dotted), with values that turn off the idea.
    method : the method in which the idea is turned off.
    taught : the part of the course that needs the idea; such an idea stays even if it reduces no error.
    """

    name: str
    off: dict[str, Any]
    method: str = PROPOSAL
    taught: str = ""

    def config(self, seed: int = 0) -> KitConfig:
        """The settings of the method without the idea."""
        config = preset(self.method, variant="kit", seed=seed)
        for name, value in self.off.items():
            config = change(config, name, value)
        return config


# All ideas turned on.
WHOLE = (Idea("", {}), Idea("", {}, MOVING))


def _front_end(name: str, *without: str, taught: str = "chapter 1", **settings: Any) -> Idea:
    """An idea of the front end: parts to leave out, and other matching settings."""
    off: dict[str, Any] = {f"matching.{key}": value for key, value in settings.items()}
    if without:
        off["matching.without"] = without
    return Idea(name, off, taught=taught)


def _calibration(name: str, *without: str, taught: str = "") -> Idea:
    """An idea of the calibration: parts to leave out."""
    return Idea(name, {"calibration.without": without}, taught=taught)


IDEAS = (
    _front_end("front end (turned off: the paper's)", "tracking"),
    _front_end("prediction of the search", "prediction"),
    _front_end("second search at the old positions", "second-search", taught=""),
    _front_end("equal exposure for the second search", "equal-exposure", taught=""),
    _front_end("windows warped in stereo", "stereo-warp"),
    _front_end("windows warped between frames", "motion-warp"),
    _front_end("features on a smooth surface", surface_share=0.0, surface_tolerance=10.0),
    _front_end("sub-pixel fit between frames", "motion-fit", loop_tolerance=10.0, taught=""),
    _front_end("sub-pixel fit in stereo", "stereo-fit", taught=""),
    _front_end("windows of equal brightness", "brightness", taught=""),
    Idea("fewer five-point sets", {"selection.clean_sets": 1_000_000}, taught="chapter 3"),
    Idea("prior", {"selection.prior": False}, taught="chapter 3"),
    Idea("dropping of the prior", {"selection.prior_rejection_ratio": 1000.0}, taught="chapter 3"),
    Idea("refinement of the winner", {"selection.mode": "literal"}, taught="chapter 3"),
    Idea(
        "translation (turned off: the paper's)",
        {"translation.without": ("robust-solution",), "translation.agreement": 1.0},
        taught="chapter 4",
    ),
    Idea("robust start of the translation", {"translation.without": ("robust-start",)}, taught="chapter 4"),
    Idea("robust steps after the first step", {"translation.iterations": 1}, taught="chapter 4"),
    Idea("calibration", {"calibration.estimate": False}, taught="the appendix"),
    _calibration("field", "field", taught="the appendix"),
    _calibration("field: all terms except the constant", "field-shape", taught="the appendix"),
    _calibration("field: remaining errors of the undistortion", "undistortion"),
    _calibration("focal length", "focal-length"),
    _calibration("lens", "lens", taught="the appendix"),
    _calibration("calibration from row differences", "rows", taught="the appendix"),
    Idea("drift of the calibration", {"calibration.drift": 0.0}),
    Idea("inflated noise", {"calibration.noise_inflation": 1.0}),
    _calibration("shrinking", "shrinking", taught="the appendix"),
    Idea("boxes: rule `all` (turned off: `none`)", {"filter.rule": "none"}, taught="chapter 5"),
    Idea("boxes: rule `moving` (turned off: `all`)", {"filter.rule": "all"}, MOVING, "chapter 5"),
    Idea("boxes: removal of disagreeing features", {"filter.moving.agreement": 1000.0}, MOVING),
    Idea(
        "boxes: mean of the moving features",
        {"filter.moving.without": ("moving-mean",)},
        MOVING,
        "chapter 5, exercise 5.9",
    ),
)


@dataclass(frozen=True)
class Row:
    """A row of the CSV file: results over the seeds with all ideas, or their changes without an idea.

    Attributes
    ----------
    idea : name of the idea that is off, empty for the results with all ideas.
    seeds : number of seeds.
    mean, deviation : mean and standard deviation over the seeds by result; NaN if it was not measured.
    ms : processor time, milliseconds per frame, or its change; NaN if it was not measured.
    """

    idea: str
    method: str
    sequence: str
    seeds: int
    mean: dict[str, float]
    deviation: dict[str, float]
    ms: float

    @property
    def cells(self) -> list[str]:
        """The row as cells of the CSV file."""
        numbers = []
        for name in RESULTS:
            numbers += [self.mean[name], self.deviation[name]]
        numbers.append(self.ms)
        texts = ["" if np.isnan(number) else f"{number:.6f}" for number in numbers]
        return [self.idea, self.method, self.sequence, str(self.seeds), *texts]


def read_row(cells: Sequence[str]) -> Row:
    """A row of the CSV file from its cells."""
    values = dict(zip(COLUMNS, cells, strict=True))
    return Row(
        values["idea"],
        values["method"],
        values["sequence"],
        int(values["seeds"]),
        mean={name: _number(values[name]) for name in RESULTS},
        deviation={name: _number(values[f"{name}_sd"]) for name in RESULTS},
        ms=_number(values["ms"]),
    )


def _number(cell: str) -> float:
    """The number in a cell; NaN for an empty cell."""
    return float(cell) if cell else float("nan")


def row_of(idea: Idea, sequence: str, results: Array, whole: Array | None, ms: float) -> Row:
    """The row of an idea from its results (S, 5) over the seeds.

    whole : (S, 5) results with all ideas and the same seeds; the row then has the changes.
    """
    values = results if whole is None else results - whole
    means = dict(zip(RESULTS, values.mean(axis=0).tolist(), strict=True))
    deviations = dict(zip(RESULTS, standard_deviation(values).tolist(), strict=True))
    return Row(idea.name, idea.method, sequence, len(results), means, deviations, ms)


def harm(row: Row, whole: Row) -> dict[str, float]:
    """The errors that clearly grow without an idea, as shares of the errors with all ideas."""
    grown = {}
    for name in DECISIVE:
        growth = row.mean[name]
        spread = row.deviation[name]
        error = whole.mean[name]
        if growth > NEEDED_SHARE * error and growth > SPREADS * spread:
            grown[name] = growth / error if error > 0.0 else np.inf
    return grown


class Ablation:
    """All rows of the CSV file, and the decision about each idea."""

    def __init__(self, rows: Sequence[Row]):
        self.rows = rows
        self._whole = {(row.method, row.sequence): row for row in rows if not row.idea}
        self._changes = {(row.idea, row.sequence): row for row in rows if row.idea}
        # Real drives first, then drawn scenes, then disturbed drives.
        names = dict.fromkeys(row.sequence for row in rows)
        self.sequences = sorted(names, key=lambda name: (": " in name, name.startswith(SYNTHETIC)))
        measured = dict.fromkeys(row.idea for row in rows if row.idea)
        known = [idea.name for idea in IDEAS if idea.name in measured]
        self.removed = [name for name in measured if name not in {idea.name for idea in IDEAS}]
        self.ideas = [*known, *self.removed]

    @property
    def counted(self) -> list[str]:
        """Names of the drives on which every idea of the kit was measured, so that ideas can be compared."""
        ideas = [idea for idea in self.ideas if idea not in self.removed]
        return [name for name in self.sequences if all((idea, name) in self._changes for idea in ideas)]

    def drives_needing(self, idea: str) -> int | None:
        """On how many of the `counted` drives an error grows without an idea; None if some are missing."""
        if any((idea, sequence) not in self._changes for sequence in self.counted):
            return None
        needing = {sequence for sequence, _, _ in self.harms(idea)}
        return len(needing & set(self.counted))

    @property
    def clean(self) -> list[str]:
        """Names of the drives that are not disturbed."""
        return [name for name in self.sequences if ": " not in name]

    def disturbed(self, sequence: str) -> list[str]:
        """Names of the disturbed drives made from a sequence, in the order of `DISTURBANCES`."""
        names = [f"{sequence}: {kind.name}" for kind in DISTURBANCES]
        return [name for name in names if name in self.sequences]

    def row(self, idea: str, sequence: str) -> Row | None:
        """The changes without an idea on a drive; None if they were not measured."""
        return self._changes.get((idea, sequence))

    def whole(self, row: Row) -> Row:
        """The results with all ideas for a row of changes."""
        return self._whole[row.method, row.sequence]

    def results(self, method: str, sequence: str) -> Row | None:
        """The results of a method with all ideas; None if they were not measured."""
        return self._whole.get((method, sequence))

    def harms(self, idea: str) -> list[tuple[str, str, float]]:
        """Drive, error and share for each error that clearly grows without an idea, sorted by share."""
        grown = []
        for sequence in self.sequences:
            row = self.row(idea, sequence)
            if row is not None:
                shares = harm(row, self.whole(row))
                grown += [(sequence, name, share) for name, share in shares.items()]
        return sorted(grown, key=lambda each: -each[2])

    @property
    def seeds_text(self) -> str:
        """The numbers of seeds as text."""
        counts = sorted({row.seeds for row in self.rows if row.idea not in self.removed})
        text = f"{' or '.join(map(str, counts))} seeds"
        return text if len(counts) == 1 else f"{text} (column `seeds` of ablation.csv)"


def tables(ablation: Ablation) -> list[ReportTable]:
    """Tables of the ideas' worth, of the changes on clean drives, and of the ends of disturbed drives."""
    result = [_worth_table(ablation)]
    titles = {"te": "TE, %,", "re": "RE, %,", "length": "the length, percentage points,"}
    for name, words in titles.items():
        columns = [sequence.rpartition("/")[2] for sequence in ablation.clean]
        rows = [
            [idea, *(_change_text(ablation, idea, sequence, name) for sequence in ablation.clean)]
            for idea in ablation.ideas
        ]
        title = f"Change of {words} without an idea of the kit"
        result.append(ReportTable(title, ["without", *columns], rows, []))
    for sequence in ablation.clean:
        drives = ablation.disturbed(sequence)
        if drives:
            result.append(_end_table(ablation, sequence, drives))
            result.append(_lost_table(ablation, sequence, drives))
    return result


def _worth_table(ablation: Ablation) -> ReportTable:
    """The time of each idea, and the largest growth of an error without it."""
    rows = []
    worst_drives = []
    for idea in ablation.ideas:
        times = [row.ms for row in ablation.rows if row.idea == idea and not np.isnan(row.ms)]
        grown = ablation.harms(idea)
        worst = NO_NUMBER
        if grown:
            sequence, name, share = grown[0]
            worst = f"{sequence}, {WORDS[name]} {_growth(share)}"
            worst_drives.append(sequence)
        taught = next((each.taught for each in IDEAS if each.name == idea), "")
        drives = ablation.drives_needing(idea)
        count = NO_NUMBER if drives is None else str(drives)
        ms = f"{np.mean(times):+.1f}" if times else NO_NUMBER
        rows.append([idea, ms, count, worst, taught or NO_NUMBER])
    head = (
        "In each row of these tables, one idea is turned off in the complete kit; a positive change is an "
        f"increase. The cells are means, or means ± standard deviations, over {ablation.seeds_text}. The "
        "errors are over sub-sequences of 20, 50 and 100 m that start at every frame. Drawn scenes have 100 "
        "frames; TE and the end of drive_0013 are computed with the pitch and yaw that minimise TE. The "
        "method is `moving_selection` for ideas of the rule `moving`, and `feature_selection` for all other "
        f"ideas. {_timed_words(ablation)}The column `drives` counts "
        f"the drives on which TE, RE or the end point gets worse by more than {100 * NEEDED_SHARE:.0f} % and "
        "by more than two standard deviations of the change. By this rule an idea stays in the kit, and it "
        "is another rule than that of the tables of errors: a run with the idea and a run without it have "
        f"the same seed, and {100 * NEEDED_SHARE:.0f} % is enough. The count is out of the same "
        f"{len(ablation.counted)} drives for every idea, {_counted_words(ablation)}; the next column has the "
        "largest growth on any drive on which the idea was measured. A dash is a number that was not "
        "measured, or that does not exist."
    )
    notes = _on_narrow_drives(ablation, worst_drives)
    if ablation.removed:
        notes.append(f"Ideas that were removed from the kit: {', '.join(ablation.removed)}.")
    return ReportTable(
        "What each idea of the kit is worth",
        ["without", "ms", "drives", "largest growth of an error", "taught in"],
        rows,
        notes,
        [head],
    )


def _on_narrow_drives(ablation: Ablation, worst_drives: list[str]) -> list[str]:
    """A sentence for each drive that the complete kit passes narrowly: many ideas lose the same there.

    worst_drives : for each idea without which an error grows, the drive on which it grows most.
    """
    sentences = []
    for sequence in ablation.sequences:
        growths = []
        for idea in ablation.ideas:
            row = ablation.row(idea, sequence)
            if row is not None and row.mean["lost"] == 1.0:
                growths.append(_growth(harm(row, ablation.whole(row)).get("te", 0.0)))
        if len(growths) < NARROW_IDEAS or len(set(growths)) > 1:
            continue
        sentences.append(
            f"On {sequence}, {len(growths)} ideas have the same change: without any one of them, one frame "
            f"more is lost, and TE grows {growths[0]}. So the {worst_drives.count(sequence)} rows that name "
            "this drive say that the complete kit passes it narrowly, and not what each idea is worth."
        )
    return sentences


def _timed_words(ablation: Ablation) -> str:
    """What the column of times has, and how far times differ that should be equal; "" without times."""
    timed = [row for row in ablation.rows if row.idea and not np.isnan(row.ms)]
    if not timed:
        return ""
    drives = " and ".join(dict.fromkeys(row.sequence for row in timed))
    words = (
        "The column `ms` has the change of the processor time per frame, in runs of their own on the first "
        f"{TIMED_FRAMES} frames of {drives} with seed 0 (the shortest of {TIMED_RUNS} each); it has no "
        "spread. "
    )
    without_effect = [abs(row.ms) for row in timed if not any(row.mean.values())]
    if without_effect:
        words += (
            "Without an idea that changes no result on this drive, the time still differs by up to "
            f"{max(without_effect):.1f} ms, so a smaller difference tells nothing. "
        )
    return words


def _counted_words(ablation: Ablation) -> str:
    """Which drives are counted: all, or all without the drives on which some ideas were not measured."""
    left_out = [name for name in ablation.sequences if name not in ablation.counted]
    if not left_out:
        return "clean and disturbed ones"
    return f"without {len(left_out)} on which some ideas were not measured ({', '.join(left_out)})"


def _growth(share: float) -> str:
    """The growth of an error as text: in per cent, or as a factor if the error is a multiple."""
    return f"+{100 * share:.0f} %" if share < 2.0 else f"× {1.0 + share:.0f}"


def _change_text(ablation: Ablation, idea: str, sequence: str, name: str) -> str:
    """A change ± standard deviation, in % of the error with all ideas (length: percentage points)."""
    row = ablation.row(idea, sequence)
    if row is None or np.isnan(row.mean[name]):
        return NO_NUMBER
    scale = 1.0
    digits = 2
    if name != "length":
        error = ablation.whole(row).mean[name]
        if error == 0.0:
            return NO_NUMBER
        scale = 100.0 / error
        digits = 1
    text = f"{scale * row.mean[name]:+.{digits}f}"
    spread = f"{scale * row.deviation[name]:.{digits}f}"
    if np.isnan(row.deviation[name]) or float(spread) == 0.0:
        return text
    return f"{text} ± {spread}"


def _end_table(ablation: Ablation, sequence: str, drives: list[str]) -> ReportTable:
    """The end of each disturbed drive, and its change without each idea."""
    columns = [sequence, *drives]
    whole = [ablation.results(PROPOSAL, drive) for drive in columns]
    rows = [["all ideas", *(NO_NUMBER if row is None else f"{row.mean['end']:.2f}" for row in whole)]]
    for idea in ablation.ideas:
        found = [ablation.row(idea, drive) for drive in columns]
        if any(row is not None and not np.isnan(row.mean["end"]) for row in found):
            rows.append([idea, *(_signed_cell(row, "end", 2) for row in found)])
    names = [drive.partition(": ")[2] for drive in drives]
    kinds = "; ".join(f"`{kind.name}`: {kind.text}" for kind in DISTURBANCES if kind.name in names)
    head = (
        f"The disturbed drives are made from the first {DISTURBED_FRAMES} frames of {sequence}, or from all "
        f"of a shorter clip. {kinds}. The vehicle boxes are those of the clean images. The first row has the "
        "distance of the last position from the truth with all ideas; the other rows have its change."
    )
    title = f"End of the disturbed drives of {sequence}, m, without an idea of the kit"
    return ReportTable(title, ["without", "clean, whole clip", *names], rows, [], [head])


def _lost_table(ablation: Ablation, sequence: str, drives: list[str]) -> ReportTable:
    """The frames without a measured motion, for ideas that change their number."""
    columns = [sequence, *drives]
    whole = [ablation.results(PROPOSAL, drive) for drive in columns]
    rows = [["all ideas", *(NO_NUMBER if row is None else f"{row.mean['lost']:g}" for row in whole)]]
    for idea in ablation.ideas:
        found = [ablation.row(idea, drive) for drive in columns]
        if any(row is not None and np.nan_to_num(row.mean["lost"]) != 0.0 for row in found):
            rows.append([idea, *(_signed_cell(row, "lost", 1) for row in found)])
    short = ["clean, whole clip", *(drive.partition(": ")[2] for drive in drives)]
    title = f"Frames without a motion in the disturbed drives of {sequence}"
    notes = ["Ideas without a row do not change these numbers."]
    return ReportTable(title, ["without", *short], rows, notes)


def _signed_cell(row: Row | None, name: str, digits: int) -> str:
    """A change with its sign, or a dash if it was not measured."""
    if row is None or np.isnan(row.mean[name]):
        return NO_NUMBER
    return f"{row.mean[name]:+.{digits}f}"
