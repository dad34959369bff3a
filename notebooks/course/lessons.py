"""Chapters 3 and 4: what solution selection is worth, and which translation is best, on simulated matches."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from vo_lib.beyond.selection import choose, motion_of_winner, sample_sets
from vo_lib.beyond.translation import solve_translation
from vo_lib.config import SelectionConfig, TranslationConfig
from vo_lib.core.camera import StereoCamera
from vo_lib.core.geometry import essential_vector, rigid, rotation_angle, rotation_from_vector
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array, Progress
from vo_lib.data.problems import random_problems
from vo_lib.data.tracks import TrackConfig, simulate_tracks
from vo_lib.method.five_point import five_point
from vo_lib.method.selection import truncated_errors
from vo_lib.runs.runner import single_threaded

from .three_frames import solve_three_frames

CAMERA = StereoCamera(f=718.856, cx=607.19, cy=185.22, baseline=0.537, width=1241, height=376)
FRAMES = 40
BAD = 0.5  # degrees; a frame with a larger rotation error went wrong
BAD_STEP = 50.0  # millimetres
NEVER = 1000.0  # a turn ratio that never drops the prior


@dataclass(frozen=True)
class Pair:
    """Matches of one frame with its known rotation: x_p, x_c (N, 2) normalised, X_p (N, 3) metres, R_cp."""

    x_p: Array
    x_c: Array
    X_p: Array
    R_cp: Array


@dataclass(frozen=True)
class Cell:
    """Errors over seeds: the median of each seed's frames, (S,), and the share of bad frames of all."""

    medians: Array
    bad: float

    @property
    def text(self) -> str:
        """Mean ± standard deviation over seeds, and the share of bad frames."""
        return f"{self.medians.mean():.3f} ± {self.medians.std():.3f} ({100 * self.bad:.0f} %)"

    def to_dict(self) -> dict[str, float]:
        """Plain values for JSON."""
        return {"mean": float(self.medians.mean()), "std": float(self.medians.std()), "bad_share": self.bad}

    @classmethod
    def of(cls, runs: list[Array], bad: float) -> Cell:
        """From the errors of each seed's frames; those larger than `bad` went wrong."""
        return cls(np.array([np.median(run) for run in runs]), float(np.mean(np.concatenate(runs) > bad)))


Table = dict[str, dict[str, Cell]]


@dataclass(frozen=True)
class Scene:
    """Simulated matches along `drive`, with sharp turns or not; or, `plane`, of a plane that fills the view.

    A wall, or the rear of a lorry: two essential matrices then fit all matches.
    """

    tracks: TrackConfig
    sharp: bool = False
    plane: bool = False


def selections(mode: str = "literal") -> dict[str, SelectionConfig]:
    """The ways to choose a winner that are compared."""
    rows = {"consensus": SelectionConfig(mode=mode, prior=False)}
    for keep in (1, 2, 3):
        rows[f"k = {keep}"] = SelectionConfig(mode=mode, keep=keep)
    rows["k = 1, never dropped"] = SelectionConfig(mode=mode, keep=1, prior_rejection_ratio=NEVER)
    rows["k = 2, never dropped"] = SelectionConfig(mode=mode, prior_rejection_ratio=NEVER)
    return rows


def drive(frames: int, sharp: bool = False) -> Array:
    """Poses (N, 4, 4) of steps of one metre on gentle bends or, `sharp`, with turns of 4° a frame."""
    number = np.arange(frames)
    yaw = np.where(number % 20 >= 10, 4.0, 0.0) if sharp else 0.4 * np.sin(number / 5.0)
    poses = np.tile(np.eye(4), (frames + 1, 1, 1))
    for i, angle in enumerate(np.radians(yaw)):
        step = rigid(rotation_from_vector(np.array([0.0, angle, 0.0])), np.array([0.0, 0.0, 1.0]))
        poses[i + 1] = poses[i] @ step
    return poses


def scenes() -> dict[str, Scene]:
    """The scenes of the table of selections."""
    clean = TrackConfig(points=300, noise=0.3)
    rows = {"clean": Scene(clean)}
    for share in (0.3, 0.5, 0.7):
        rows[f"{share:.0%} wrong"] = Scene(dataclasses.replace(clean, wrong=share))
    for share in (0.3, 0.5, 0.7):
        crossing = dataclasses.replace(clean, moving=share, objects=1, object_heading=90.0)
        rows[f"{share:.0%} on a car that crosses"] = Scene(crossing)
    for share in (0.3, 0.5, 0.7):
        ahead = dataclasses.replace(clean, moving=share, objects=2, object_speed=0.6)
        rows[f"{share:.0%} on cars ahead"] = Scene(ahead)
    rows["turns of 4°, 30% wrong"] = Scene(dataclasses.replace(clean, wrong=0.3), sharp=True)
    rows["all on one plane"] = Scene(clean, plane=True)
    return rows


def frames_of(scene: Scene, frames: int, seed: int) -> Iterator[Pair]:
    """Matches of a scene, frame by frame."""
    if scene.plane:
        count = scene.tracks.points
        given = random_problems(
            np.random.default_rng(seed), frames, count, "planar_forward", noise_px=scene.tracks.noise
        )
        yield from map(Pair, given.x_p, given.x_c, given.X_p, given.R_cp)
        return
    for frame in simulate_tracks(drive(frames, scene.sharp), CAMERA, scene.tracks, seed):
        yield _pair(frame.matches, frame.T_cp[:3, :3])


def _pair(matches: StereoMatches, R_cp: Array) -> Pair:
    X_p = CAMERA.triangulate(matches.prev_left, matches.prev_right)
    near = np.isfinite(X_p[:, 2])
    x_p, x_c = CAMERA.normalise(matches.prev_left[near]), CAMERA.normalise(matches.cur_left[near])
    return Pair(x_p, x_c, X_p[near], R_cp)


def selection_errors(
    scene: Scene, configs: dict[str, SelectionConfig], frames: int, seed: int
) -> dict[str, Array]:
    """Rotation error of each frame, (frames,) degrees, by selection; all choose from the same candidates."""
    e_prev: dict[str, Array | None] = dict.fromkeys(configs)
    errors: dict[str, list[float]] = {name: [] for name in configs}
    for number, pair in enumerate(frames_of(scene, frames, seed)):
        sets = sample_sets(np.random.default_rng([seed, number]), len(pair.x_p), 200)
        E, set_index = five_point(pair.x_p[sets], pair.x_c[sets])
        known: dict[tuple[int, str], tuple[float, Array]] = {}
        for name, config in configs.items():
            winner, _ = choose(E, set_index, pair.x_p, pair.x_c, e_prev[name], config, CAMERA.f)
            if (winner, config.mode) not in known:
                R, _, best, _ = motion_of_winner(E[winner], pair.x_p, pair.x_c, pair.X_p, config, CAMERA.f)
                error = float(np.degrees(rotation_angle(R.T @ pair.R_cp)))
                known[winner, config.mode] = error, essential_vector(best)
            error, e_prev[name] = known[winner, config.mode]
            errors[name].append(error)
    return {name: np.array(values) for name, values in errors.items()}


def consensus_rotation(
    x_p: Array, x_c: Array, X_p: Array, rng: np.random.Generator, focal: float
) -> Array | None:
    """R_cp (3, 3) of the candidate with the smallest error, refined; None where there is no candidate."""
    if len(x_p) < 5:
        return None
    sets = sample_sets(rng, len(x_p), 200, np.arctan2(x_c[:, 1], x_c[:, 0]))
    E, _ = five_point(x_p[sets], x_c[sets])
    if len(E) == 0:
        return None
    winner = E[np.argmin(truncated_errors(E, x_p, x_c, SelectionConfig().threshold / focal))]
    return motion_of_winner(winner, x_p, x_c, X_p, SelectionConfig(), focal)[0]


def selection_table(
    seeds: int = 5, frames: int = FRAMES, mode: str = "literal", progress: Progress | None = None
) -> Table:
    """Rotation errors, degrees, of every scene by every selection."""
    rows, configs = scenes(), selections(mode)
    table: Table = {}
    with single_threaded():
        for done, (name, scene) in enumerate(rows.items()):
            runs = [selection_errors(scene, configs, frames, seed) for seed in range(seeds)]
            table[name] = {c: Cell.of([run[c] for run in runs], BAD) for c in configs}
            if progress is not None:
                progress(done + 1, len(rows))
    return table


VARIANTS = ("stacked", "unweighted", "feature_median", "feature_mean")


def translation_errors(tracks: TrackConfig, frames: int, seed: int) -> dict[str, Array]:
    """Translation error of each frame, millimetres, by variant; rotations estimated, the same for all.

    The three-frame experiment starts a frame later.
    """
    errors: dict[str, list[float]] = {name: [] for name in (*VARIANTS, "three frames")}
    last: tuple[StereoMatches, Array] | None = None
    for frame in simulate_tracks(drive(frames), CAMERA, tracks, seed):
        pair = _pair(frame.matches, frame.T_cp[:3, :3])
        rng = np.random.default_rng([seed, frame.frame])
        R_cp = consensus_rotation(pair.x_p, pair.x_c, pair.X_p, rng, CAMERA.f)
        assert R_cp is not None
        for name in VARIANTS:
            solved = solve_translation(CAMERA, frame.matches, R_cp, TranslationConfig(variant=name))
            assert solved is not None
            errors[name].append(1e3 * float(np.linalg.norm(solved[0] - frame.T_cp[:3, 3])))
        if last is not None:
            three = solve_three_frames(CAMERA, last[0], frame.matches, last[1], R_cp, TranslationConfig())
            assert three is not None
            errors["three frames"].append(1e3 * float(np.linalg.norm(three[1] - frame.T_cp[:3, 3])))
        last = frame.matches, R_cp
    return {name: np.array(values) for name, values in errors.items()}


def translation_table(seeds: int = 5, frames: int = FRAMES, progress: Progress | None = None) -> Table:
    """Translation errors, millimetres for steps of one metre, on clean and on partly wrong matches."""
    clean = TrackConfig(points=300, noise=0.3)
    rows = {"clean": clean, "30% wrong": dataclasses.replace(clean, wrong=0.3)}
    table: Table = {}
    with single_threaded():
        for done, (name, tracks) in enumerate(rows.items()):
            runs = [translation_errors(tracks, frames, seed) for seed in range(seeds)]
            table[name] = {v: Cell.of([run[v] for run in runs], BAD_STEP) for v in runs[0]}
            if progress is not None:
                progress(done + 1, len(rows))
    return table


def to_dict(table: Table) -> dict[str, Any]:
    """A table as plain values for JSON."""
    return {row: {column: cell.to_dict() for column, cell in cells.items()} for row, cells in table.items()}
