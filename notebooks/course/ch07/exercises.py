"""Exercises of chapter 7: the average, the paper's unit, a gain and its spread, a sweep."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

from course.simulation.tracks import TrackConfig, simulate_tracks
from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.evaluation.statistics import paired_change
from vo_lib.geometry.matches import empty_matches
from vo_lib.geometry.types import Array
from vo_lib.report.table1 import te_and_re
from vo_lib.runs.drive import run_methods
from vo_lib.runs.front_end import TimedMatches
from vo_lib.settings import replace

from ..checker import Condition, Exercise
from ..frames import true_poses
from ..lessons import CAMERA, drive

USED, TRUE = 5555.6, 100.0 * 180.0 / np.pi  # factors from rad/m to deg/100 m
FRAMES = 30
LENGTHS = (20.0,)
VALUES = (8, 16, 100)


def rows(te: dict[str, Any], without: str = "01", none: Any = None) -> list[float]:
    """The numbers of a column without the row `without`; `none` replaces None."""
    values = [none if value is None else value for name, value in te.items() if name != without]
    return [value for value in values if value is not None]


def change(before: Array, after: Array, spread: float | None = None) -> tuple[float, float]:
    """Mean of the change, and `spread`; by default, `spread` is the standard deviation of the change."""
    paired = paired_change(before, after)
    return paired.mean, paired.deviation if spread is None else float(spread)


@functools.cache
def simulated() -> tuple[Sequence, list[TimedMatches]]:
    """A sequence of FRAMES simulated frames, and its matches, of which a third are wrong."""
    truth = drive(FRAMES - 1)
    tracks = TrackConfig(points=200, noise=0.3, wrong=0.3)
    matches: list[TimedMatches] = [(empty_matches(), {})]
    matches += [(frame.matches, {}) for frame in simulate_tracks(truth, CAMERA, tracks, 0)]
    frames = tuple(f"{number:06d}" for number in range(FRAMES))
    return Sequence("simulated", Path("simulated"), frames, CAMERA, np.zeros(FRAMES), truth, None), matches


@functools.cache
def errors_of_sets(variant: str = "published") -> tuple[Array, Array]:
    """TE and RE, (len(VALUES),) each, of `solution_selection` on the simulated frames, by number of sets."""
    sequence, matches = simulated()
    method = preset("solution_selection", variant=variant)
    configs = {str(value): replace(method, "selection.sets", value) for value in VALUES}
    runs = run_methods(sequence, configs, matches=matches).values()
    te, re = te_and_re(kitti_errors(true_poses(sequence), run.poses, LENGTHS, 1) for run in runs)
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
    TRUE / USED,
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
            lambda got: abs(got * USED - 1.0) < 0.02
        ),
        "{got:.3g} is in degrees per metre: multiply by 100.": Condition(
            lambda got: abs(got - 0.0103) < 2e-4
        ),
    },
)

gain = Exercise(
    change,
    lambda: [
        (np.array([1.0, 1.2, 1.4, 1.6, 1.9]), np.array([0.9, 1.05, 1.3, 1.5, 1.7])),
        (np.array([0.7, 0.4, 0.6]), np.array([0.65, 0.5, 0.45])),
    ],
    # A student who leaves out `ddof=1` has understood the exercise, too.
    also=(lambda before, after: change(before, after, np.std(after - before)),),
    parts=("mean", "spread"),
    praise="{got[0]:+.2f} ± {got[1]:.2f}; each method alone has ± 0.3. Random effects on both methods cancel.",
    hint="compute the change of each seed, then the mean and the standard deviation of these changes.",
    line="np.mean(after - before), np.std(after - before, ddof=1)",
    mistakes={
        "this is the spread of one method; compute the spread of after - before.": (
            lambda before, after: change(before, after, before.std(ddof=1)),
            lambda before, after: change(before, after, after.std(ddof=1)),
            lambda before, after: change(before, after, before.std()),
            lambda before, after: change(before, after, after.std()),
        ),
        "the spread comes from the two methods' own spreads: subtract seed by seed first.": (
            lambda before, after: change(before, after, np.hypot(before.std(ddof=1), after.std(ddof=1))),
            lambda before, after: change(before, after, abs(after.std(ddof=1) - before.std(ddof=1))),
            lambda before, after: change(before, after, np.hypot(before.std(), after.std())),
            lambda before, after: change(before, after, abs(after.std() - before.std())),
        ),
        "this is the standard error of the mean, the deviation divided by √S: return the deviation of the change.": (
            lambda before, after: change(before, after, np.std(after - before, ddof=1) / len(before) ** 0.5),
            lambda before, after: change(before, after, np.std(after - before) / np.sqrt(len(before))),
        ),
        "this change is relative to `before`: return the change in the unit of `before`.": lambda before, after: (
            change(0 * after + 1, after / before)
        ),
    },
    slips={"sign": "the sign is wrong: an error that falls is a negative change."},
)

sweep = Exercise(
    lambda sequence, matches, values: errors_of_sets()[0],
    lambda: [(*simulated(), VALUES)],
    also=(lambda *case: errors_of_sets("kit")[0],),
    praise="TE is {right[0]:.2f} % with 8 sets, {right[1]:.2f} % with 16 and {right[2]:.2f} % with 100. Only the "
    "back end ran again, on the same matches.",
    hint="for each value make a new configuration of `solution_selection`, run it, and take TE of its poses over 20 m.",
    line='config = replace(preset("solution_selection"), "selection.sets", value)',
    mistakes={
        "this is RE: take `.te` of the result of `kitti_errors`.": lambda *case: errors_of_sets()[1],
        "a TE is None: the path has 29 m, so take lengths=(20,) and step=1.": lambda *case: [None] * 3,
        "all values give the same TE: the setting has not changed. `replace` returns a new configuration.": Condition(
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
