"""Chapters 2 and 3: from many candidate essential matrices to one rotation.

Consensus takes the candidate with the smallest error over all features. Solution selection (paper,
section 2.2) first keeps, of the candidates of each five-point set, the k nearest to the essential
vector of the previous frame. The image error always has the last word.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config import SelectionConfig
from .five_point import five_point
from .geometry import (
    decompose_essential,
    essential_angle,
    essential_from_motion,
    essential_vector,
    rotation_from_vector,
    sampson_distance,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EssentialEstimate:
    """The motion that the essential matrix of a frame gives.

    Attributes
    ----------
    R_cp : (3, 3) rotation, previous to current.
    direction : (3,) unit translation.
    e : (9,) essential vector, the next frame's prior (the paper's basis vector).
    inliers : (N,) bool, matches whose Sampson distance is below the threshold.
    prior_angle : angle of e to the previous essential vector, radians; NaN without one.
    prior_dropped : the prior's best candidate was clearly worse than the best of all, so it was not used.
    """

    R_cp: Array
    direction: Array
    e: Array
    inliers: NDArray[np.bool_]
    prior_angle: float
    prior_dropped: bool


def sample_sets(rng: np.random.Generator, number: int, sets: int) -> NDArray[np.intp]:
    """Five different indices below `number` for each set, (sets, 5).

    Cut from random permutations, so that every feature is used equally often.
    """
    per_round = number // 5
    rounds = -(-sets // per_round)
    order = rng.permuted(np.tile(np.arange(number), (rounds, 1)), axis=1)
    return order[:, : 5 * per_round].reshape(-1, 5)[:sets]


def truncated_errors(E: Array, x_p: Array, x_c: Array, threshold: float) -> Array:
    """Mean squared Sampson distance of each candidate over all matches, truncated, (M,).

    Parameters
    ----------
    E : (M, 3, 3) candidates; x_p, x_c : (N, 2) normalised points.
    threshold : in the unit of the points; a match never costs more than threshold².

    Returns
    -------
    mean(min(d² / threshold², 1)), in [0, 1]. Numerator and denominator of d² are matrix products over
    all candidates and matches at once, in single precision: enough to rank, twice as fast.
    """
    p = np.concatenate([x_p, np.ones((len(x_p), 1))], axis=1)
    c = np.concatenate([x_c, np.ones((len(x_c), 1))], axis=1)
    outer = (c[:, :, None] * p[:, None, :]).reshape(-1, 9).astype(np.float32)
    numerator = E.reshape(-1, 9).astype(np.float32) @ outer.T
    # |(E p)_{1,2}|² = pᵀ A p with A = E_{1,2}ᵀ E_{1,2}; likewise for Eᵀ c.
    A = np.swapaxes(E[:, :2], 1, 2) @ E[:, :2]
    B = E[:, :, :2] @ np.swapaxes(E[:, :, :2], 1, 2)
    forms = np.concatenate([A.reshape(-1, 9), B.reshape(-1, 9)], axis=1).astype(np.float32)
    squares = np.concatenate([(h[:, :, None] * h[:, None, :]).reshape(-1, 9) for h in (p, c)], axis=1)
    denominator = forms @ squares.astype(np.float32).T
    np.multiply(numerator, numerator, out=numerator)
    np.maximum(denominator, np.float32(1e-20), out=denominator)
    np.divide(numerator, denominator, out=numerator)
    np.minimum(numerator, np.float32(threshold**2), out=numerator)
    return np.asarray(numerator.mean(axis=1, dtype=np.float64) / threshold**2)


def nearest_to_prior(E: Array, set_index: NDArray[np.intp], e_prev: Array, keep: int) -> NDArray[np.bool_]:
    """Solution selection: of each set's candidates, the `keep` nearest to the previous essential vector.

    Parameters
    ----------
    E : (M, 3, 3) candidates; set_index : (M,) the set each one comes from.
    e_prev : (9,) essential vector of the previous frame.

    Returns
    -------
    (M,) bool; nearness is the angle acos|eᵀ e_prev|.
    """
    angle = essential_angle(essential_vector(E), e_prev)
    order = np.lexsort((angle, set_index))
    ordered_sets = set_index[order]
    rank = np.arange(len(order)) - np.searchsorted(ordered_sets, ordered_sets)
    kept = np.zeros(len(order), np.bool_)
    kept[order[rank < keep]] = True
    return kept


def motion_by_depth(E: Array, x_p: Array, x_c: Array, X_p: Array) -> tuple[Array, Array]:
    """Of the four (R, ±t) of E the one that agrees with the stereo depth of the matches.

    Parameters
    ----------
    E : (3, 3); x_p, x_c : (N, 2) normalised points; X_p : (N, 3) points of the previous left frame, metres.

    Returns
    -------
    R_cp (3, 3) and the unit direction of t_cp (3,).

    Each pair is given its best common length s, by least squares on x_c × (R X_p + s t) = 0; its sign
    chooses between t and -t, and the median residual angle between the two rotations.
    """
    rotations, t = decompose_essential(E)
    ray = np.concatenate([x_c, np.ones((len(x_c), 1))], axis=1)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    across_t = np.cross(ray, t)
    best = (np.inf, rotations[0], t)
    for R in rotations:
        rotated = X_p @ R.T
        across = np.cross(ray, rotated)
        # Nearer points know the length better: residuals in angle, not in metres.
        weight = 1.0 / np.maximum(np.sum(rotated**2, axis=1), 1e-12)
        s = -np.sum(weight * np.sum(across * across_t, axis=1)) / max(
            float(np.sum(weight * np.sum(across_t**2, axis=1))), 1e-12
        )
        moved = rotated + s * t
        cosine = np.sum(ray * moved, axis=1) / np.maximum(np.linalg.norm(moved, axis=1), 1e-12)
        error = float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
        if error < best[0]:
            best = (error, R, t if s >= 0 else -t)
    return best[1], best[2]


def refine(
    R_cp: Array, direction: Array, x_p: Array, x_c: Array, scale: float, iterations: int = 10
) -> tuple[Array, Array]:
    """R and the direction of t refined together by robust Gauss-Newton on the Sampson distance.

    Parameters
    ----------
    R_cp, direction : start; x_p, x_c : (N, 2) normalised points.
    scale : Sampson distance, in the unit of the points, at which a match's weight is halved.

    Returns
    -------
    R_cp (3, 3) and unit direction (3,).
    """
    R, t = R_cp, direction
    p = np.concatenate([x_p, np.ones((len(x_p), 1))], axis=1)
    c = np.concatenate([x_c, np.ones((len(x_c), 1))], axis=1)
    for _ in range(iterations):
        E = essential_from_motion(R, t)
        q = p @ R.T
        line_c, line_p = p @ E.T, c @ E
        norm2 = np.sum(line_c[:, :2] ** 2, axis=1) + np.sum(line_p[:, :2] ** 2, axis=1)
        norm = np.sqrt(np.maximum(norm2, 1e-20))
        r = np.sum(c * line_c, axis=1) / norm
        weight = 1.0 / (1.0 + (r / scale) ** 2)
        # cᵀ [t]× δω × q = δω · (q × (c × t)) and cᵀ (δt × q) = δt · (q × c), δt in the plane across t.
        basis = np.linalg.svd(t[None])[2][1:].T
        jac = np.concatenate([np.cross(q, np.cross(c, t)), np.cross(q, c) @ basis], axis=1) / norm[:, None]
        H = (jac * weight[:, None]).T @ jac
        delta = -np.linalg.solve(H + 1e-12 * np.trace(H) * np.eye(5), jac.T @ (weight * r))
        R = rotation_from_vector(delta[:3]) @ R
        t = t + basis @ delta[3:]
        t = t / np.linalg.norm(t)
        if float(delta @ delta) < 1e-18:
            break
    return R, t


def estimate_essential(
    x_p: Array,
    x_c: Array,
    X_p: Array,
    e_prev: Array | None,
    rng: np.random.Generator,
    config: SelectionConfig,
    focal: float,
) -> EssentialEstimate | None:
    """Rotation of a frame by consensus or by solution selection, as the configuration says.

    Parameters
    ----------
    x_p, x_c : (N, 2) normalised points; X_p : (N, 3) their points in the previous left frame, metres.
    e_prev : (9,) previous essential vector, or None (first frame).
    focal : pixels; thresholds are in pixels.

    Returns
    -------
    None when no set gave a candidate (fewer than five matches, or degenerate ones).
    """
    if len(x_p) < 5:
        return None
    sets = sample_sets(rng, len(x_p), config.sets)
    E, set_index = five_point(x_p[sets], x_c[sets])
    if len(E) == 0:
        return None
    threshold = config.threshold / focal
    errors = truncated_errors(E, x_p, x_c, threshold)
    winner = int(np.argmin(errors))
    dropped = False
    if config.prior and e_prev is not None:
        kept = np.flatnonzero(nearest_to_prior(E, set_index, e_prev, config.keep))
        choice = int(kept[np.argmin(errors[kept])])
        dropped = bool(errors[choice] > config.turn_ratio * errors[winner])
        winner = winner if dropped else choice
    best = E[winner]
    inliers = np.abs(sampson_distance(best, x_p, x_c)) < threshold
    trusted = inliers if np.count_nonzero(inliers) >= 5 else np.ones_like(inliers)
    R, t = motion_by_depth(best, x_p[trusted], x_c[trusted], X_p[trusted])
    if config.mode == "refined":
        R, t = refine(R, t, x_p[trusted], x_c[trusted], threshold / 2)
        best = essential_from_motion(R, t)
        inliers = np.abs(sampson_distance(best, x_p, x_c)) < threshold
    e = essential_vector(best)
    angle = float("nan") if e_prev is None else float(essential_angle(e, e_prev))
    return EssentialEstimate(R, t, e, inliers, angle, dropped)
