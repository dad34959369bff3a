"""Exercises of chapter 7: the allowed difference, the average, the paper's unit, a sweep."""

from __future__ import annotations

import functools
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib.config import change, preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.geometry.matches import empty_matches
from vo_lib.geometry.types import Array
from vo_lib.report.paper_unit import PAPERS_FACTOR, RIGHT_FACTOR
from vo_lib.report.table1 import te_and_re
from vo_lib.runs.drive import run_methods
from vo_lib.runs.front_end import TimedMatches

from ..checker import Case, Condition, Exercise
from ..simulation.drives import CAMERA, drive
from ..simulation.tracks import TrackConfig, simulate_tracks

# The sweep: simulated frames, lengths of the sub-sequences in metres, and numbers of five-point sets.
FRAMES = 30
LENGTHS = (20.0,)
VALUES = (8, 16, 100)

NO_DIGIT = "the paper rounds, too: half a unit of the last printed digit is missing"


def rows(te: dict[str, Any], without: str = "01", none: Any = None) -> list[float]:
    """The numbers of a column without the row `without`.

    te : numbers by the name of their row. none : what replaces None, which is left out by default.
    """
    values = []
    for name, value in te.items():
        number = none if value is None else value
        if name != without and number is not None:
            values.append(number)
    return values


def allowed_difference(
    values: Array, digits: int, t: float, over: int = 1, further: int = 1, digit: float = 0.5
) -> float:
    """How far one more run may be from the mean of runs (n,), with a part of the last printed digit.

    values : errors of the runs.
    digits : printed decimals.
    t : Student's factor.
    over : the deviation is over n - `over`.
    further : the number of further runs that scatter by themselves, 1 or 0.
    digit : the part of the last digit, ½ for rounding.
    """
    deviation = float(np.std(values, ddof=over))
    scatter = t * deviation * float(np.sqrt(further + 1.0 / len(values)))
    return scatter + digit * 10.0**-digits


def without_term(values: Array, digits: int, t: float, over: int = 1, digit: float = 0.5) -> float:
    """Wrong answer: the difference that only the new run's scatter allows, without that of the mean."""
    return t * float(np.std(values, ddof=over)) + digit * 10.0**-digits


def errors_of_seeds() -> list[Case]:
    """Errors of five and of three seeds, printed decimals, and Student's factor."""
    five = np.array([0.81, 0.83, 0.80, 0.84, 0.82])
    three = np.array([0.251, 0.262, 0.244])
    return [(five, 2, 2.776), (three, 3, 4.303), (10.0 * three, 1, 4.303)]


@functools.cache
def simulated() -> tuple[Sequence, list[TimedMatches]]:
    """A sequence of FRAMES simulated frames, and its matches, of which 30 % are wrong."""
    truth = drive(FRAMES - 1)
    tracks = TrackConfig(points=200, noise=0.3, wrong=0.3)
    matches: list[TimedMatches] = [(empty_matches(), {})]
    matches += [(frame.matches, {}) for frame in simulate_tracks(truth, CAMERA, tracks, 0)]
    sequence = Sequence(
        name="simulated",
        folder=Path("simulated"),
        frames=tuple(f"{number:06d}" for number in range(FRAMES)),
        camera=CAMERA,
        times=np.zeros(FRAMES),
        truth=truth,
        labels=None,
    )
    return sequence, matches


@functools.cache
def errors_of_sets(variant: str = "published") -> tuple[Array, Array]:
    """TE and RE, (len(VALUES),) each, of `solution_selection` on the simulated frames, by number of sets."""
    sequence, matches = simulated()
    method = preset("solution_selection", variant=variant)
    configs = {str(value): change(method, "selection.sets", value) for value in VALUES}
    runs = run_methods(sequence, configs, matches=matches).values()
    errors = [kitti_errors(sequence.true_poses, run.poses, LENGTHS, 1) for run in runs]
    te, re = te_and_re(errors)
    return te, re


paper_average = Exercise(
    lambda te: np.mean(rows(te)),
    lambda: [
        ({"00": 1.0, "01": 9.0, "02": 2.0, "04": None, "10": 6.0},),
        ({"00": None, "01": None, "03": 4.0, "05": 0.5},),
        ({"01": 3.0, "06": 2.5, "07": 1.5, "08": 8.0, "09": 2.0},),
    ],
    praise="this is the plain mean of the rows with a number, without 01.",
    hint="in the first case three rows remain, with TE 1, 2 and 6.",
    line="np.mean([v for name, v in te.items() if name != '01' and v is not None])",
    mistakes={
        "the sum is divided by too many rows. In the first case three rows remain, with TE 1, 2 and 6.": (
            lambda te: sum(rows(te)) / 10,
            lambda te: sum(rows(te)) / 11,
            lambda te: sum(rows(te)) / len(te),
        ),
        "this is the median; `Avg` is a mean.": lambda te: np.median(rows(te)),
        "the mean includes row 01, which has dashes in the paper's table.": lambda te: np.mean(
            rows(te, without="")
        ),
        "None became NaN: leave None out of the mean.": Condition(lambda got, te: np.isnan(got)),
        "None was counted as 0.": lambda te: np.mean(rows(te, none=0.0)),
        "this is the sum: divide the sum by the number of rows.": lambda te: sum(rows(te)),
        "None cannot be added: leave None out of the mean.": (
            lambda te: sum(te.values()),
            lambda te: sum(value for name, value in te.items() if name != "01") / 10,
        ),
    },
)

true_rotation_error = Exercise(
    RIGHT_FACTOR / PAPERS_FACTOR,
    atol=2e-3,
    praise="{right:.4f}: the printed number is 3 % too low.",
    hint="dividing by 5555.6 gives rad/m. Then multiply by 100 · 180/π.",
    line="1.000 / 5555.6 * 100 * 180 / np.pi",
    slips={"inverse": "the factors are exchanged: printed / 5555.6 is in rad/m."},
    mistakes={
        "this is the difference, not the RE.": Condition(
            lambda got: abs(got - 0.0313) < 1e-3 or abs(got - 3.1) < 0.1
        ),
        "{got:.3g} is in rad/m: multiply by 100 · 180/π.": Condition(
            lambda got: abs(got * PAPERS_FACTOR - 1.0) < 0.02
        ),
        "{got:.3g} is in degrees per metre: multiply by 100.": Condition(
            lambda got: abs(got - 0.0103) < 2e-4
        ),
    },
)

allowed = Exercise(
    allowed_difference,
    errors_of_seeds,
    praise="{got:.3f} %: a printed number may be that far from our mean of five seeds.",
    hint="t times the deviation over n - 1, times the root of 1 + 1/n, plus half a unit of the last digit.",
    line="t * np.std(values, ddof=1) * np.sqrt(1 + 1 / len(values)) + 0.5 * 10**-digits",
    library=("prediction_half_width", "prediction_interval"),
    mistakes={
        "this is the interval of the mean, t s/√n: one more run scatters by s itself, and our mean by s/√n.": (
            partial(allowed_difference, further=0),
        ),
        "the new run scatters, but so does our mean: the variances s² and s²/n add up.": without_term,
        "the standard deviation is over n; a sample has n - 1 (`ddof=1`).": partial(
            allowed_difference, over=0
        ),
        "the paper rounds, too: add half a unit of the last printed digit.": partial(
            allowed_difference, digit=0.0
        ),
        "two things: this is the interval of the mean, t s/√n, while one more run scatters by s itself; and "
        f"{NO_DIGIT}.": partial(allowed_difference, further=0, digit=0.0),
        "two things: the standard deviation is over n, but a sample has n - 1 (`ddof=1`); and "
        f"{NO_DIGIT}.": partial(allowed_difference, over=0, digit=0.0),
        "two things: not only the new run scatters, but our mean as well, with the variance s²/n; and "
        f"{NO_DIGIT}.": partial(without_term, digit=0.0),
        "two things: this is the interval of the mean, t s/√n, while one more run scatters by s itself; and the "
        "standard deviation is over n, but a sample has n - 1 (`ddof=1`).": partial(
            allowed_difference, further=0, over=0
        ),
        "two things: not only the new run scatters, but our mean as well, with the variance s²/n; and the "
        "standard deviation is over n, but a sample has n - 1 (`ddof=1`).": partial(without_term, over=0),
        "three things: a further run scatters by s itself, beside the s/√n of our mean; the standard deviation is "
        "over n, but a sample has n - 1 (`ddof=1`); and "
        f"{NO_DIGIT}.": (
            partial(allowed_difference, further=0, over=0, digit=0.0),
            partial(without_term, over=0, digit=0.0),
        ),
        "a rounded number is off by at most half a unit of the last digit, not by a whole one.": partial(
            allowed_difference, digit=1.0
        ),
        "Student's factor `t` is missing.": lambda values, digits, t: allowed_difference(values, digits, 1.0),
        "two standard deviations are right for many seeds only; with few seeds use `t`.": (
            lambda values, digits, t: allowed_difference(values, digits, 2.0),
            lambda values, digits, t: allowed_difference(values, digits, 1.96),
            lambda values, digits, t: 2.0 * float(np.std(values, ddof=1)),
            lambda values, digits, t: 2.0 * float(np.std(values)),
        ),
    },
)

sweep = Exercise(
    lambda sequence, matches, values: errors_of_sets()[0],
    lambda: [(*simulated(), VALUES)],
    also=(lambda *case: errors_of_sets("kit")[0],),
    praise="TE is {right[0]:.2f} % with 8 sets, {right[1]:.2f} % with 16 and {right[2]:.2f} % with 100. Only the "
    "back end ran again, on the same matches.",
    hint="for each value make a new configuration of `solution_selection`, run it, and take TE of its poses over 20 m.",
    line='config = change(preset("solution_selection"), "selection.sets", value)',
    mistakes={
        "this is RE: take `.te` of the result of `kitti_errors`.": lambda *case: errors_of_sets()[1],
        "the frames of this exercise have no images, so nothing can be matched here: hand in the given matches, "
        "`run_methods(sequence, configs, matches=matches)`.": lambda sequence, matches, values: [
            run_methods(sequence, {"name": preset("solution_selection")}) for _ in values
        ],
        "a TE is None: the path has 29 m, so take lengths=(20,) and step=1.": (
            lambda sequence, matches, values: [None for _ in values]
        ),
        "all values give the same TE: the setting has not changed. `change` returns a new configuration.": Condition(
            lambda got, *case: np.ptp(got) < 1e-12
        ),
    },
)

fewer_sets = Exercise(
    {"five-point sets": 20.0, "settings changed": 2.0}
    | {"TE": 0.18, "TE of the preset": 0.19, "RE": 0.4, "RE of the preset": 0.5},
    praise="{five-point sets:.0f} sets: TE {TE:.3f} % against {TE of the preset:.3f} %, RE {RE:.3f} against "
    "{RE of the preset:.3f} deg/100 m. This is one seed on thirty frames: move `seed`, and look again.",
    mistakes={
        "the panel shows no TE. Wait until its bar is gone, then run this cell again.": lambda now: (
            not np.isfinite(now["TE"])
        ),
        "{five-point sets:.0f} sets are more than 20.": lambda now: not now["five-point sets"] <= 20,
        "one setting is changed. The kit refines the winner, so few sets suffice in variant `kit`: select "
        "`published` as `method`, and change a second setting.": lambda now: not now["settings changed"] >= 2,
        "RE is {RE:.3f} deg/100 m, above the preset's {RE of the preset:.3f}: with few sets, which setting "
        "improves the choice of the winner?": lambda now: now["RE"] > now["RE of the preset"],
        "TE is {TE:.3f} %, above the preset's {TE of the preset:.3f} %: try another second setting.": (
            lambda now: now["TE"] > now["TE of the preset"]
        ),
    },
)
