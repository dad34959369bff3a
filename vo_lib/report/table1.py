"""The numbers of Table 1: the paper's, and ours from runs over sequences, methods and seeds.

The plan of these runs is in `table1_plan`, the time that all of KITTI would take in `table1_durations`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..data.catalogue import KITTI
from ..data.kitti import EXPECTED_FRAMES
from ..data.tables import read_csv
from ..errors import DataError
from ..evaluation.kitti_errors import (
    KITTI_PROTOCOL,
    KittiErrors,
    SubsequenceProtocol,
    is_as_kitti,
    kitti_errors,
    suitable_protocol,
    trajectory_distances,
)
from ..evaluation.path_errors import PathErrors, evaluate
from ..evaluation.statistics import mean_and_deviation
from ..geometry.rows import joined
from ..geometry.types import Array
from ..runs.drive import Run
from ..runs.earlier_seconds import FRONT_END_STAGES
from ..runs.folder import read_run
from ..runs.jobs import Outcome
from ..runs.run_quality import warnings_of
from .blocks import Block
from .page import finite_or_none
from .paper_unit import PAPERS_OWN, RE_KIND, converted
from .table1_plan import Cell

PAPER_METHODS = ("viso2", *PAPERS_OWN)  # in the order of the paper's columns
PRINTED_NAMES = {
    "viso2": "VISO2",
    "mesvo_f": "MESVO_F",
    "solution_selection": "Solution selection",
    "feature_selection": "Feature selection",
}
PROPOSAL = "feature_selection"
AVERAGE = "Avg"  # the paper's row of means, and ours with the same sequences
POOLED = "pooled"  # our row with all sub-sequences together
LEFT_OUT = "01"  # the highway, which has dashes in the paper's table
# The sequences in the paper's Avg, with their numbers of sub-sequences in the benchmark: their weights, where
# all sub-sequences are pooled.
SUB_SEQUENCES = {
    "00": 3283,
    "02": 3453,
    "03": 184,
    "04": 43,
    "05": 1806,
    "06": 570,
    "07": 317,
    "08": 2813,
    "09": 958,
    "10": 464,
}
SUB_SEQUENCES_OF_01 = 676
PAPER_ROWS = (AVERAGE, *SUB_SEQUENCES)
# Section 4 of the paper: gains of Feature selection over each of these methods, (TE, RE) in %.
CLAIMS = {"solution_selection": (8.0, 7.0), "mesvo_f": (6.0, 15.0)}

# Below a table of a path that is too short for TE and RE.
POSITION_NOTE = (
    "error: distance of the positions from the true ones, from the same start, at the end and as rmse."
)
_DECIMAL = re.compile(r"\d+(\.\d+)?")  # a number in a sentence
STILL_M = 0.05  # a shorter path is printed as 0.0 m
BENCHMARK_FRAMES = {f"{KITTI}{number}": frames for number, frames in EXPECTED_FRAMES.items()}
# Numbers of sub-sequences of whole sequences, with the benchmark's poses and measure.
BENCHMARK_COUNTS = {f"{KITTI}{row}": count for row, count in SUB_SEQUENCES.items()} | {
    f"{KITTI}{LEFT_OUT}": SUB_SEQUENCES_OF_01
}
# Names of TE and RE in records and in tables, and the number of decimals in the paper.
ERROR_KINDS = {"te_percent": ("TE %", 2), RE_KIND: ("RE deg/100 m", 3)}


PrintedErrors = tuple[float | None, float | None]  # the paper's TE in % and RE in deg/100 m; None for a dash
NOT_PRINTED: PrintedErrors = (None, None)


@dataclass(frozen=True, eq=False)
class PaperTable:
    """The paper's numbers by (row, method)."""

    numbers: dict[tuple[str, str], PrintedErrors]

    def value(self, row: str, method: str) -> PrintedErrors:
        """TE and RE of a row ("00" … "10" or "Avg") and a method."""
        return self.numbers.get((row, method), NOT_PRINTED)


def gain(before: ArrayLike, after: ArrayLike) -> Array:
    """Relative improvement in %; not finite if the old error is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(100.0 * (1.0 - np.asarray(after, float) / np.asarray(before, float)))


def read_paper_table() -> PaperTable:
    """The paper's table, read from paper_table1.csv."""
    table: dict[tuple[str, str], PrintedErrors] = {}
    for row, *cells in printed_cells():
        numbers = [None if cell == "-" else float(cell) for cell in cells]
        for place, method in enumerate(PAPER_METHODS):
            te = numbers[2 * place]
            re_degrees = numbers[2 * place + 1]
            table[row, method] = (te, re_degrees)
    return PaperTable(table)


def printed_cells() -> list[list[str]]:
    """The rows of paper_table1.csv, without the heading."""
    rows = [cells for _, cells in read_csv(Path(__file__).with_name("paper_table1.csv"))]
    return rows[1:]


@dataclass(frozen=True, eq=False)
class Entry:
    """Errors of one method on one sequence with truth, over S seeds.

    Attributes
    ----------
    sequence, method : names.
    variant : `published` or `kit`.
    seeds : (S) seeds of the runs.
    settings : the settings of the block that differ from the presets, as typed; empty for the presets.
    unused : names of those settings that have no effect on the method.
    protocol : the sub-sequences of TE and RE.
    results : (S) KITTI errors, ATE (SE3 alignment) and RPE of each seed.
    poses : (N, 4, 4) T_w_c of the first of these seeds, metres.
    truth : (N, 4, 4) T_w_c, metres.
    has_boxes : whether the sequence has vehicle boxes.
    removed_share : share of matches removed in boxes for the first of these seeds, in [0, 1].
    back_end_ms : mean time per frame of the back end (everything after the matches), milliseconds.
    is_part : whether the sequence is only a part, such as a clip.
    """

    sequence: str
    method: str
    variant: str
    seeds: tuple[int, ...]
    protocol: SubsequenceProtocol
    results: tuple[PathErrors, ...]
    poses: Array
    truth: Array
    has_boxes: bool
    removed_share: float
    back_end_ms: float
    is_part: bool
    settings: str = ""
    unused: tuple[str, ...] = ()

    @property
    def block_key(self) -> tuple[str, str]:
        """The `key` of its block."""
        return self.variant, self.settings

    @property
    def subsequences(self) -> int:
        """Number of sub-sequences from which TE and RE of a seed come."""
        return len(self.results[0].kitti)

    @property
    def as_kitti(self) -> bool:
        """Whether TE and RE are computed as in KITTI's benchmark, on a whole sequence of any data set.

        It must be long enough for `FEW_SUBSEQUENCES` sub-sequences.
        """
        return is_as_kitti(self.protocol, self.subsequences, not self.is_part)

    @property
    def errors(self) -> Array:
        """TE and RE of each seed, (2, S), % and deg/100 m; NaN without a sub-sequence."""
        return te_and_re(result.kitti for result in self.results)

    @property
    def is_whole(self) -> bool:
        """Whether the sequence is one of the benchmark's with all its frames, measured as in the benchmark.

        Only then may the paper's numbers stand beside it.
        """
        return len(self.truth) == BENCHMARK_FRAMES.get(self.sequence) and self.protocol == KITTI_PROTOCOL


def printed_of(paper: PaperTable, entry: Entry) -> PrintedErrors:
    """The paper's TE and RE beside which an entry may stand: none beside a part of a sequence."""
    if not entry.is_whole:
        return NOT_PRINTED
    return paper.value(entry.sequence.removeprefix(KITTI), entry.method)


@dataclass(frozen=True)
class Group:
    """Entries that may be averaged: equal variant, settings and protocol; either all from KITTI or none.

    settings : what differs from the presets, as typed.
    is_kitti : whether the sequences are from the benchmark.
    protocol : the sub-sequences of TE and RE.
    entries : entries by (sequence, method).
    """

    variant: str
    settings: str
    is_kitti: bool
    protocol: SubsequenceProtocol
    entries: dict[tuple[str, str], Entry]

    @property
    def block_key(self) -> tuple[str, str]:
        """The `key` of its block."""
        return self.variant, self.settings

    @property
    def sequences(self) -> list[str]:
        """Names of the sequences, in order."""
        return list(dict.fromkeys(sequence for sequence, _ in self.entries))

    @property
    def averaged(self) -> list[str]:
        """Names of the sequences in the mean: all except KITTI's 01, or 01 if it is the only sequence."""
        without_01 = [name for name in self.sequences if name != f"{KITTI}{LEFT_OUT}"]
        return without_01 or self.sequences

    @property
    def methods(self) -> list[str]:
        """Names of the methods, in order."""
        return list(dict.fromkeys(method for _, method in self.entries))

    @property
    def protocol_words(self) -> str:
        """The sub-sequences as text, with "as KITTI" if that is true of every sequence."""
        return self.protocol.words_with(all(entry.as_kitti for entry in self.entries.values()))

    def of_method(self, method: str) -> list[Entry]:
        """Entries of a method, in the order of the sequences."""
        return [entry for (_, name), entry in self.entries.items() if name == method]

    def averaged_entries(self, method: str) -> list[Entry]:
        """Entries in the mean of a method: those on averaged sequences that have a sub-sequence.

        They may be fewer than the averaged sequences, since a run may have failed.
        """
        entries = self.of_method(method)
        return [entry for entry in entries if entry.sequence in self.averaged and entry.subsequences > 0]

    def is_papers(self, method: str) -> bool:
        """Whether the mean of a method is that of the paper's Avg: over ten complete sequences."""
        complete = {entry.sequence for entry in self.averaged_entries(method) if entry.is_whole}
        return complete == {f"{KITTI}{row}" for row in SUB_SEQUENCES}

    def mean(self, method: str) -> Array:
        """Unweighted mean of TE and RE over the `averaged_entries`, for each seed that all have, (2, S)."""
        means = [te_and_re(errors).mean(axis=1) for errors in _by_seed(self.averaged_entries(method))]
        return np.reshape(means, (-1, 2)).T

    def pooled(self, method: str) -> Array:
        """TE and RE of each seed, (2, S), over all sub-sequences together, as on KITTI's server."""
        return te_and_re(joined(errors_of_seed) for errors_of_seed in _by_seed(self.of_method(method)))


def _by_seed(entries: list[Entry]) -> list[list[KittiErrors]]:
    """For each seed that all entries have, the errors on every sequence."""
    if not entries:
        return []
    common_seeds = set.intersection(*(set(entry.seeds) for entry in entries))
    by_seed = []
    for seed in sorted(common_seeds):
        by_seed.append([entry.results[entry.seeds.index(seed)].kitti for entry in entries])
    return by_seed


def te_and_re(sets: Iterable[KittiErrors]) -> Array:
    """TE in % and RE in deg/100 m of S sets of sub-sequences, (2, S); NaN for an empty set."""
    pairs = [(errors.te, errors.re) for errors in sets]
    return np.array(pairs, float).reshape(-1, 2).T


def too_short_words(truth: Array, protocol: SubsequenceProtocol) -> str:
    """Why a true path (N, 4, 4) has no sub-sequence, as a part of a sentence; "" if it has one."""
    # The truth as its own estimate: only the number of sub-sequences counts.
    if len(kitti_errors(truth, truth, protocol.lengths, protocol.step)):
        return ""
    if stands_still(truth):
        return "its true path stands still"
    length = trajectory_distances(truth)[-1]
    return f"its path has {length:.1f} m, the shortest sub-sequence {min(protocol.lengths):g} m"


def stands_still(truth: Array) -> bool:
    """Whether a true path (N, 4, 4) is so short that no choice of lengths gives it sub-sequences."""
    return bool(trajectory_distances(truth)[-1] < STILL_M)


def measure_runs(
    method: str,
    runs: list[Run],
    protocol: SubsequenceProtocol | None = None,
    settings: str = "",
    unused: Iterable[str] = (),
) -> Entry:
    """Errors of a method's runs, one per seed; the default protocol is from `suitable_protocol`.

    settings, unused : what differs from the presets, see `Entry`.

    Raises `DataError` for a sequence without ground truth.
    """
    sequence = runs[0].sequence
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth, so there are no errors")
    protocol = suitable_protocol(sequence.truth) if protocol is None else protocol
    estimates = {f"seed {run.config.seed}": run.poses for run in runs}
    errors = evaluate(sequence.truth, estimates, protocol, sequence.times)
    return Entry(
        sequence=sequence.name,
        method=method,
        variant=runs[0].config.variant,
        seeds=tuple(run.config.seed for run in runs),
        protocol=protocol,
        results=tuple(errors),
        poses=runs[0].poses,
        truth=sequence.truth,
        has_boxes=sequence.labels is not None,
        removed_share=runs[0].removed_share,
        back_end_ms=back_end_ms(runs),
        is_part=sequence.is_part,
        settings=settings,
        unused=tuple(unused),
    )


def back_end_ms(runs: Iterable[Run]) -> float:
    """Mean time per frame of everything after the matches, milliseconds."""
    times = []
    for run in runs:
        for motion in run.motions:
            back_end_stages = [ms for stage, ms in motion.ms.items() if stage not in FRONT_END_STAGES]
            times.append(sum(back_end_stages))
    return float(np.mean(times))


def group_entries(entries: list[Entry]) -> list[Group]:
    """Groups of entries that may be averaged, in the order of the entries."""
    groups: dict[tuple[str, str, bool, SubsequenceProtocol], Group] = {}
    for entry in entries:
        is_kitti = entry.sequence in BENCHMARK_FRAMES
        key = (*entry.block_key, is_kitti, entry.protocol)
        if key not in groups:
            groups[key] = Group(entry.variant, entry.settings, is_kitti, entry.protocol, {})
        groups[key].entries[entry.sequence, entry.method] = entry
    return list(groups.values())


class DrawnPaths(NamedTuple):
    """The truth (N, 4, 4) of a sequence or None, and the path (N, 4, 4) of each method."""

    truth: Array | None
    by_method: dict[str, Array]


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Errors and paths of the runs of a table.

    Attributes
    ----------
    missing : KITTI sequences that are not on this machine.
    failed : names of failed runs, by cause.
    entries : errors by sequence and method, for sequences with ground truth.
    paths : for each block and sequence, the truth, and each method's path for the first seed. A method whose
        run with this seed failed has none.
    warned : names of the runs with a warning, by the sentence of the warning.
    """

    missing: list[str]
    failed: dict[str, list[str]]
    entries: list[Entry] = field(default_factory=list)
    paths: dict[tuple[Block, str], DrawnPaths] = field(default_factory=dict)
    warned: dict[str, list[str]] = field(default_factory=dict)

    @property
    def problems(self) -> list[str]:
        """Sentences on missing sequences, sequences without truth, failed runs, and warnings of runs."""
        sentences = []
        if self.missing:
            sentences.append(f"Not found, so not run: {', '.join(self.missing)}.")
        without_truth = sorted({name for (_, name), drawn in self.paths.items() if drawn.truth is None})
        if without_truth:
            names = ", ".join(without_truth)
            sentences.append(f"No ground truth, so no errors: {names}; the poses are in the folder runs.")
        without_errors = [entry for entry in self.entries if not np.isfinite(entry.errors).any()]
        if without_errors:
            sentences.append(_too_short_sentence(without_errors))
        for cause, failed in self.failed.items():
            sentences.append(f"Failed: {_first_of(failed)}: {cause}")
        return [*sentences, *_warning_sentences(self.warned)]


def _too_short_sentence(entries: list[Entry]) -> str:
    """Which sequences have no errors, with the reason, and what helps."""
    why = {entry.sequence: too_short_words(entry.truth, entry.protocol) for entry in entries}
    named = ", ".join(f"{name} ({words})" for name, words in why.items())
    sentence = f"Shorter than every sub-sequence, so no errors: {named}."
    if not all(stands_still(entry.truth) for entry in entries):
        sentence += " The option --lengths chooses shorter ones."
    return sentence


def _warning_sentences(warned: Mapping[str, list[str]]) -> list[str]:
    """Sentences on runs with a warning; those that differ only in numbers are said once.

    warned : names of the runs by the sentence of the warning.
    """
    sentences = []
    for warnings in alike_warnings(warned):
        names = [name for warning in warnings for name in warned[warning]]
        numbers = " with other numbers" if len(warnings) > 1 else ""
        sentences.append(f"Warning: {_first_of(names)}{numbers}: {warnings[0]}")
    return sentences


def alike_warnings(warnings: Iterable[str]) -> list[list[str]]:
    """The warnings, with those together that differ only in numbers."""
    by_words: dict[str, list[str]] = {}  # by their words without numbers
    for warning in warnings:
        by_words.setdefault(_DECIMAL.sub("", warning), []).append(warning)
    return list(by_words.values())


def _first_of(names: list[str]) -> str:
    """The first of some names, and the number of the others."""
    others = len(names) - 1
    return f"{names[0]} and {others} more" if others else names[0]


def is_own_table(path: Path) -> bool:
    """Whether a file is a CSV table of errors that the kit wrote, by its heading."""
    try:
        rows = read_csv(path)
    except DataError:
        return False
    return bool(rows) and set(ERROR_KINDS) <= set(rows[0][1])


def collect(
    cells: list[Cell],
    outcomes: list[Outcome],
    missing: list[str],
    protocol: SubsequenceProtocol | None = None,
) -> Reproduction:
    """Errors and paths of the cells, read from the folders of their finished jobs.

    missing : as in `Reproduction`. protocol : the sub-sequences; None for those that suit each path.
    """
    failed: dict[str, list[str]] = {}
    failed_folders = set[Path]()
    for outcome in outcomes:
        if outcome.error is not None:
            failed.setdefault(outcome.error, []).append(outcome.job.name)
            failed_folders.add(outcome.job.folder.resolve())
    entries = list[Entry]()
    paths: dict[tuple[Block, str], DrawnPaths] = {}
    warned: dict[str, list[str]] = {}
    for cell in cells:
        done = [job for job in cell.jobs if job.folder.resolve() not in failed_folders]
        if not done:
            continue
        runs = [read_run(job.folder, job.sequence) for job in done]
        for job, result in zip(done, runs, strict=True):
            for warning in warnings_of(result):
                names = warned.setdefault(warning, [])
                if job.name not in names:  # cells may share a job
                    names.append(job.name)
        truth = cell.sequence.truth
        if done[0] is cell.jobs[0]:  # paths are compared with each other, so all have the same seed
            drawn = paths.setdefault((cell.block, cell.sequence.name), DrawnPaths(truth, {}))
            drawn.by_method[cell.method] = runs[0].poses
        if truth is not None:
            unused = cell.block.unused(cell.method)
            entries.append(measure_runs(cell.method, runs, protocol, cell.block.words, unused))
    return Reproduction(missing, failed, entries, paths, warned)


def table_records(groups: list[Group], paper: PaperTable) -> list[dict[str, Any]]:
    """Table 1 as a record per row and method, in the order of the rows; None for a missing number.

    Rows of a group: the mean (the paper's Avg, if all ten sequences are complete), each sequence (01 last),
    and the mean over all sub-sequences. Only complete sequences are compared with the paper's numbers. The
    rows of a method whose runs failed on a sequence say of how many sequences they are.
    """
    return [record for group in groups for record in group_records(group, paper)]


def group_records(group: Group, paper: PaperTable) -> list[dict[str, Any]]:
    """The records of one group, as in `table_records`."""
    records = []
    if len(group.averaged) > 1:
        for method in group.methods:
            averaged = group.averaged_entries(method)
            if not averaged:
                continue
            is_papers = group.is_papers(method)
            row = AVERAGE if is_papers else f"mean of {len(averaged)}"
            printed = paper.value(AVERAGE, method) if is_papers else NOT_PRINTED
            records.append(_record(group, row, method, group.mean(method), averaged, printed))
    highway = f"{KITTI}{LEFT_OUT}"
    highway_last = sorted(group.entries.values(), key=lambda entry: entry.sequence == highway)
    for entry in highway_last:
        printed = printed_of(paper, entry)
        record = _record(group, entry.sequence, entry.method, entry.errors, [entry], printed, entry)
        records.append(record)
    if len(group.sequences) > 1:
        for method in group.methods:
            pooled = group.of_method(method)
            row = POOLED if len(pooled) == len(group.sequences) else f"{POOLED} of {len(pooled)}"
            records.append(_record(group, row, method, group.pooled(method), pooled, NOT_PRINTED))
    return records


def _record(
    group: Group,
    row: str,
    method: str,
    errors: Array,
    entries: list[Entry],
    printed: PrintedErrors,
    single: Entry | None = None,
) -> dict[str, Any]:
    """A record of a group, see `table_records`.

    errors : TE and RE of each seed, (2, S).
    entries : those from which the errors come.
    printed : the paper's numbers beside them.
    single : the entry of a row with one sequence, which has costs.
    """
    record: dict[str, Any] = {
        "variant": group.variant,
        "sequence": row,
        "method": method,
        "sub_sequences": group.protocol_words,
        "sub_sequence_count": sum(entry.subsequences for entry in entries),
        "seeds": errors.shape[1],
    }
    record |= paper_fields(printed, method, errors)
    record |= number_fields(errors, single)
    record["settings"] = group.settings
    unused = dict.fromkeys(name for entry in entries for name in entry.unused)
    record["not_used"] = " ".join(unused)
    return record


def paper_fields(printed: PrintedErrors, method: str, errors: Array) -> dict[str, float | None]:
    """Fields of a record that compare our TE and RE (2, S) with the paper's; None where it has no number.

    Of each kind of `ERROR_KINDS`: `paper_KIND` as printed, `paper_KIND_right_unit` the same number in % or
    deg/100 m (`converted`), and `KIND_difference`, the mean over our seeds minus the latter.
    """
    fields: dict[str, float | None] = {}
    for kind, printed_number, errors_of_seeds in zip(ERROR_KINDS, printed, errors, strict=True):
        in_right_unit = None
        difference = None
        if printed_number is not None:
            mean, _ = mean_and_deviation(errors_of_seeds)
            in_right_unit = converted(printed_number, method, kind)
            difference = finite_or_none(mean - in_right_unit)
        fields[f"paper_{kind}"] = printed_number
        fields[f"paper_{kind}_right_unit"] = in_right_unit
        fields[f"{kind}_difference"] = difference
    return fields


def number_fields(errors: Array, entry: Entry | None) -> dict[str, float | None]:
    """Fields of a record: mean and deviation of TE and RE (2, S) over seeds, and the costs of the entry."""
    fields: dict[str, float | None] = {}
    for kind, errors_of_seeds in zip(ERROR_KINDS, errors, strict=True):
        mean, deviation = mean_and_deviation(errors_of_seeds)
        fields[kind] = finite_or_none(mean)
        fields[f"{kind}_std"] = finite_or_none(deviation)
    fields["removed_share"] = None if entry is None else entry.removed_share
    fields["back_end_ms"] = None if entry is None else entry.back_end_ms
    return fields
