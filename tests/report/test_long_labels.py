"""Pictures with long names: nothing runs off the page, and names beside each other stay apart."""

from __future__ import annotations

import itertools
import warnings

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from vo_lib.geometry.types import Array
from vo_lib.report.plots import error_curves_figure, errors_figure, figure_page, png, trajectories_figure
from vo_lib.report.sweep_table import Sweep, heat_map

LENGTHS = (10, 40, 80)


def label(length: int, number: int) -> str:
    """A name as an import may give it."""
    words = f"m{number}_imported_from_the_north_road_in_winter_with_snow_and_still_longer_names_"
    return (2 * words)[:length]


def path(seed: int, straight: bool) -> Array:
    """A path (60, 4, 4), bent or straight, with some noise."""
    poses = np.tile(np.eye(4), (60, 1, 1))
    along = np.linspace(0.0, 1.5, 60)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, 60)
    poses[:, 0, 3] = (0.01 if straight else 30.0) * (1 - np.cos(along)) + noise
    poses[:, 2, 3] = 60.0 * along
    return poses


def is_on_the_page(data: bytes) -> bool:
    """Whether the edge of a picture is white: a text that runs off leaves ink there."""
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), 1)
    assert picture is not None
    assert picture.std() > 5
    edges = picture[:2], picture[-2:], picture[:, :2], picture[:, -2:]
    return all((edge == 255).all() for edge in edges)


def drawn(figure: Figure) -> bytes:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # Matplotlib warns if there is no room for the axes
        return png(figure)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize("with_truth", [True, False])
def test_names_of_paths(length: int, straight: bool, with_truth: bool) -> None:
    paths = {label(length, number): path(number, straight) for number in range(4)}
    truth = path(9, straight) if with_truth else None
    assert is_on_the_page(drawn(trajectories_figure({label(length, 5): (truth, paths)})))


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("sequences", [1, 3, 11])
def test_long_names_below_bars_do_not_overlap(length: int, sequences: int) -> None:
    errors = {
        (label(length, sequence), label(length, 20 + method)): np.array([[1.0, 1.2], [0.3, 0.4]])
        for sequence, method in itertools.product(range(sequences), range(4))
    }
    figure = errors_figure(label(length, 40), errors)
    assert is_on_the_page(drawn(figure))
    places = [text.get_window_extent() for text in figure.axes[1].get_xticklabels()]
    assert len(places) == sequences
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(places))


@pytest.mark.parametrize("length", LENGTHS)
def test_names_of_curves(length: int) -> None:
    curves = {label(length, number): [(100.0, 1.0, 0.3), (200.0, 1.1, 0.2)] for number in range(5)}
    assert is_on_the_page(drawn(error_curves_figure(label(length, 9), "length", curves)))


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("several", [True, False])
def test_values_beside_a_heat_map(length: int, several: bool) -> None:
    kinds = ("te_percent", "re_deg_per_100m")
    axes = {"filter.classes": tuple((label(length, number),) for number in range(5))}
    if several:
        axes = {"method": tuple((label(length, 10 + number),) for number in range(3))} | axes
    count = 15 if several else 5
    records = [dict.fromkeys(kinds, 1.0) | {f"{kind}_std": 0.1 for kind in kinds} for _ in range(count)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert is_on_the_page(heat_map(Sweep(f"{label(length, 7)}, 100 frames", axes, records)))


def test_a_title_keeps_its_numbers_with_their_units() -> None:
    figure = figure_page("a path of which the sub-sequences of all lengths are 100 m long, 12 of them")
    assert all("100 m" in line or "100" not in line for line in str(figure.get_suptitle()).split("\n"))
