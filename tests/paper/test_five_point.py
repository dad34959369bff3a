"""The five-point solver on simulated problems."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from course.simulation.problems import MOTIONS, Motion, PoseProblems, random_problems
from vo_lib.geometry.types import Array
from vo_lib.paper.five_point import (
    Candidates,
    cubic_constraints,
    determinant,
    eliminate,
    epipolar_rows,
    five_point,
    null_space,
)
from vo_lib.paper.real_roots import real_roots

WITH_PARALLAX: list[Motion] = [motion for motion in MOTIONS if motion != "pure_rotation"]


def distance(E: Array, F: Array) -> Array:
    """‖E - F‖ of unit matrices (..., 3, 3) up to sign."""
    return np.asarray(np.minimum(*(np.linalg.norm(E + sign * F, axis=(-2, -1)) for sign in (-1.0, 1.0))))


def off_essential(E: Array) -> Array:
    """Differences (M, 3) between the singular values of unit matrices and of a unit essential matrix."""
    return np.asarray(np.abs(np.linalg.svd(E, compute_uv=False) - [0.5**0.5, 0.5**0.5, 0.0]))


def error_of_best(result: Candidates, truth: Array) -> Array:
    """Distance (S,) of the truth (S, 3, 3) to each set's nearest candidate; infinite without candidates."""
    error = np.full(len(truth), np.inf)
    np.minimum.at(error, result.set_index, distance(result.E, truth[result.set_index]))
    return error


def problems(motion: Motion, count: int, noise_px: float = 0.0, points: int = 5) -> PoseProblems:
    return random_problems(np.random.default_rng(7), count, points, motion, noise_px=noise_px)


@pytest.mark.parametrize("motion", ["general", "forward", "sideways", "planar", "planar_forward"])
def test_candidates_contain_the_true_essential_matrix(motion: Motion) -> None:
    errors = []
    for seed in range(2):
        truth = random_problems(np.random.default_rng([7, seed]), 5000, 5, motion)
        errors.append(error_of_best(five_point(truth.x_p, truth.x_c), truth.E))
    error = np.concatenate(errors)
    assert np.median(error) <= 1e-12
    assert np.percentile(error, 95) <= 1e-10
    assert np.mean(error > 1e-6) <= 1e-3
    assert np.max(error) < 1e-2  # no solution is lost


@pytest.mark.parametrize(
    ("motion", "seed", "rotation", "most"),
    [
        *((motion, 3, 0.0, 1e-6) for motion in ("forward", "planar_forward")),
        # Each of these batches has sets that are solved only with the axes in a different order.
        *(("small_baseline", seed, None, 1e-5) for seed in (1, 2, 3, 5)),
    ],
)
def test_special_motions_lose_no_solution(
    motion: Motion, seed: int, rotation: float | None, most: float
) -> None:
    truth = random_problems(np.random.default_rng(seed), 3000, 5, motion, rotation=rotation)
    error = error_of_best(five_point(truth.x_p, truth.x_c), truth.E)
    assert np.percentile(error, 95) <= 1e-9
    assert np.max(error) <= most


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
@pytest.mark.parametrize("motion", WITH_PARALLAX)
def test_candidates_are_essential_and_fit_their_points(motion: Motion, noise_px: float) -> None:
    simulated = problems(motion, 1000, noise_px)
    E, index = five_point(simulated.x_p, simulated.x_c)
    off = off_essential(E)
    assert np.max(off) <= 2e-8
    assert np.quantile(off, 0.99) <= 1e-13
    h_p, h_c = (
        np.concatenate([x, np.ones((*x.shape[:2], 1))], axis=2) for x in (simulated.x_p, simulated.x_c)
    )
    residual = np.einsum("mni,mij,mnj->mn", h_c[index], E, h_p[index])
    assert np.max(np.abs(residual)) <= 1e-12
    np.testing.assert_allclose(np.linalg.norm(E, axis=(1, 2)), 1.0, atol=1e-14)


def test_number_of_candidates_is_even_and_at_most_ten() -> None:
    """Complex roots of a real polynomial are in pairs, so the number of real roots among ten is even."""
    simulated = problems("general", 5000, noise_px=0.3)
    count = np.bincount(five_point(simulated.x_p, simulated.x_c).set_index, minlength=5000)
    assert count.max() <= 10
    assert np.mean(count % 2) <= 1e-3
    assert 4.0 < count.mean() < 5.0


@pytest.mark.parametrize("motion", ["general", "sideways", "forward"])
def test_opencv_finds_the_same_candidates(motion: Motion) -> None:
    simulated = problems(motion, 400, noise_px=0.3)
    E, index = five_point(simulated.x_p, simulated.x_c)
    ours, theirs, precise = [], [], []
    for s in range(400):
        stacked, _ = cv2.findEssentialMat(simulated.x_p[s], simulated.x_c[s], np.eye(3))
        F = np.empty((0, 3, 3)) if stacked is None else stacked.reshape(-1, 3, 3)
        F = F / np.linalg.norm(F, axis=(1, 2), keepdims=True)
        gaps = distance(E[index == s][:, None], F[None])
        ours += [*np.min(gaps, axis=1, initial=np.inf)]
        theirs += [*np.min(gaps, axis=0, initial=np.inf)]
        # OpenCV does not polish: some of its matrices are essential only to fewer than nine digits.
        precise += [*(np.ptp(np.linalg.svd(F, compute_uv=False)[:, :2], axis=1) < 1e-9)]
    gap = np.array(theirs)
    assert gap.size > 1500
    assert np.mean(precise) > 0.9
    assert np.max(gap[precise]) < 1e-5
    assert np.mean(gap < 1e-5) > 0.99
    assert np.mean(np.array(ours) < 1e-5) > 0.99


@pytest.mark.parametrize("motion", ["general", "planar_forward"])
def test_batch_equals_single_sets(motion: Motion) -> None:
    simulated = problems(motion, 100)
    batch = five_point(simulated.x_p, simulated.x_c)
    for s in range(100):
        alone = five_point(simulated.x_p[s : s + 1], simulated.x_c[s : s + 1])
        together = batch.E[batch.set_index == s]
        assert alone.E.shape == together.shape
        np.testing.assert_allclose(distance(alone.E, together), 0.0, atol=1e-8)


@pytest.mark.parametrize("copies", [2, 3, 5])
def test_sets_with_repeated_matches_have_no_candidates(copies: int) -> None:
    simulated = problems("general", 60)
    x_p, x_c = simulated.x_p.copy(), simulated.x_c.copy()
    x_p[::2, :copies], x_c[::2, :copies] = x_p[::2, :1], x_c[::2, :1]
    result = five_point(x_p, x_c)
    assert set(result.set_index) == set(range(1, 60, 2))
    assert np.max(error_of_best(result, simulated.E)[1::2]) <= 1e-9


def test_degenerate_sets_give_finite_candidates() -> None:
    rng = np.random.default_rng(11)
    line = np.stack([np.linspace(-0.5, 0.5, 5), np.linspace(-0.1, 0.2, 5)], axis=1)
    x = rng.uniform(-0.8, 0.8, (20, 5, 2))
    sets = [
        (np.zeros((3, 5, 2)), np.zeros((3, 5, 2))),
        (x, x),  # nothing moves
        (x, 1.1 * x),  # looks like a zoom
        (np.tile(line, (4, 1, 1)), np.tile(line + np.array([0.1, 0.0]), (4, 1, 1))),  # collinear points
        (x, rng.uniform(-0.8, 0.8, x.shape)),  # wrong matches
        (1e8 * x, 1e8 * x + 1.0),
        (x[:0], x[:0]),
    ]
    for x_p, x_c in sets:
        E, index = five_point(x_p, x_c)
        assert np.isfinite(E).all()
        assert np.all(np.bincount(index, minlength=1) <= 12)
        assert np.max(off_essential(E), initial=0.0) <= 1e-6


@pytest.mark.parametrize("parallax", [1e-4, 1e-5, 1e-6, 1e-7, 0.0])
def test_exact_points_with_little_parallax_have_at_most_ten_candidates(parallax: float) -> None:
    """The less parallax there is, the more matrices fit to within rounding; without any, a whole family."""
    simulated = problems("general", 1000)
    X_c = simulated.X_p @ np.swapaxes(simulated.R_cp, 1, 2) + parallax * simulated.t_cp[:, None]
    E, index = five_point(simulated.x_p, X_c[..., :2] / X_c[..., 2:])
    assert np.bincount(index, minlength=1000).max() <= (10 if parallax else 0)
    assert np.isfinite(E).all()


@pytest.mark.parametrize(
    ("shape_p", "shape_c", "message"),
    [
        ((5, 2), (5, 2), r"x_p has the shape \(5, 2\), expected \(S, 5, 2\)"),
        ((2, 8, 2), (2, 8, 2), r"\(2, 8, 2\)"),
        ((2, 5, 3), (2, 5, 3), r"\(2, 5, 3\)"),
        ((2, 5, 2), (2, 5, 3), r"x_c has the shape \(2, 5, 3\)"),
        ((2, 5, 2), (3, 5, 2), r"\(2, 5, 2\) and \(3, 5, 2\)"),
    ],
)
def test_other_shapes_are_refused(shape_p: tuple[int, ...], shape_c: tuple[int, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        five_point(np.ones(shape_p), np.ones(shape_c))


@pytest.mark.parametrize("dtype", [complex, str, bytes, object, bool])
def test_other_types_than_real_numbers_are_refused(dtype: type) -> None:
    simulated = problems("general", 4)
    with pytest.raises(ValueError, match=r"x_c of shape \(4, 5, 2\) has the type .*, expected real numbers"):
        five_point(simulated.x_p, simulated.x_c.astype(dtype))


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(number: float) -> None:
    simulated = problems("general", 4)
    simulated.x_c[2, 3, 1] = number
    with pytest.raises(
        ValueError, match=r"x_c of shape \(4, 5, 2\) has a number in set 2 that is not finite"
    ):
        five_point(simulated.x_p, simulated.x_c)


def test_lists_and_single_precision_are_accepted() -> None:
    simulated = problems("general", 3)
    assert len(five_point(simulated.x_p.astype(np.float32), simulated.x_c.astype(np.float32)).E)
    assert len(five_point(simulated.x_p.tolist(), simulated.x_c.tolist()).E)


@pytest.mark.parametrize("motion", ["general", "forward", "sideways"])
def test_the_first_matrix_of_the_null_space_has_neither_z_nor_w(motion: Motion) -> None:
    """In the place of z or w, it gives several times as many sets with roots too near each other to count."""
    drawn = problems(motion, 10_000)
    basis, _ = null_space(epipolar_rows(drawn.x_p, drawn.x_c))

    def doubtful_sets(order: list[int]) -> int:
        reordered = np.ascontiguousarray(basis[order])
        _, _, _, doubtful = real_roots(determinant(eliminate(cubic_constraints(reordered))))
        return int(np.count_nonzero(doubtful))

    as_used = doubtful_sets([0, 1, 2, 3])
    assert doubtful_sets([1, 2, 3, 0]) > 2 * as_used
    assert doubtful_sets([3, 2, 1, 0]) > 2 * as_used


def test_real_roots_are_all_found() -> None:
    """Polynomials with given roots; the solver computes roots outside [-1, 1] as w/z."""
    rng = np.random.default_rng(2)
    for expected in ([0.3], [-0.9, 0.91, 5.0], [0.1, 0.101, -7.0, 100.0], list(np.linspace(-3.1, 2.7, 10))):
        complex_pairs = (10 - len(expected)) // 2
        polynomial = np.poly(expected)
        for _ in range(complex_pairs):
            polynomial = np.polymul(polynomial, [1.0, rng.uniform(-1, 1), 2.0 + rng.uniform(0, 1)])
        polynomial = np.pad(polynomial, (11 - len(polynomial), 0))
        z, w, index, doubtful = real_roots(polynomial[:, None] / np.max(np.abs(polynomial)))
        finite = np.abs(w) > 1e-9  # a polynomial of odd degree has its last root at infinity
        np.testing.assert_allclose(np.sort(z[finite] / w[finite]), np.sort(expected), rtol=1e-9)
        assert (~finite).sum() == len(expected) % 2
        assert not doubtful.any()
        assert np.all(index == 0)
