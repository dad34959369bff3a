"""Painted house fronts: walls of several kinds with windows, doors, shops and fixtures."""

from __future__ import annotations

import cv2
import numpy as np

from .textures import Image, Rng, box, fractal, letters, masonry, plain, smeared

ROWS = 512
COLUMNS = 512
STOREYS = (2, 3, 3, 4)


def wall(rng: Rng, kind: str) -> Image:
    """Texture of a bare wall of ROWS × COLUMNS texels, about 12 m wide and 9 m high."""
    if kind == "brick":
        return masonry(rng, ROWS, COLUMNS, 6, 14, rng.uniform(85, 115), 12.0, rng.uniform(120, 150))
    if kind == "blocks":
        return masonry(rng, ROWS, COLUMNS, 24, 48, rng.uniform(120, 160), 9.0, rng.uniform(85, 110))
    if kind == "boards":
        image = plain(rng.uniform(110, 190), ROWS, COLUMNS, rng, 4.0)
        image[::14] -= 38.0
        image[1::14] -= 14.0
        return image
    image = plain(rng.uniform(120, 205), ROWS, COLUMNS, rng, 3.5)
    image += 5.0 * fractal(rng, ROWS, COLUMNS, 0.3, 30.0)
    return np.asarray(image + 14.0 * smeared(fractal(rng, ROWS, COLUMNS, 0.6), 61), np.float32)


def facade(rng: Rng, kind: str, storeys: int, shop: bool) -> Image:
    """Texture of a house front, top row first: cornice, storeys, door or shop, plinth."""
    image = wall(rng, kind)
    mean = float(image.mean())
    is_light_trim = mean < 150 or rng.random() < 0.4
    trim = 225.0 if is_light_trim else 95.0
    columns = int(rng.integers(3, 6))
    height = ROWS / (storeys + 0.25)
    window_w = COLUMNS / columns * rng.uniform(0.36, 0.52)
    window_h = height * rng.uniform(0.48, 0.6)
    shutters = rng.random() < 0.4 and window_w < 0.44 * COLUMNS / columns
    panes = (int(rng.integers(1, 4)), int(rng.integers(1, 4)))
    door_at = int(rng.integers(0, columns))
    for storey in range(storeys):
        base = ROWS - (storey + 0.12) * height
        if storey > 0 and rng.random() < 0.5:
            ledge = base + 0.08 * height
            box(image, 0, ledge, COLUMNS, ledge + 5, trim * 0.85)
        for column in range(columns):
            x = (column + 0.5) * COLUMNS / columns
            if storey == 0 and shop:
                continue
            if storey == 0 and column == door_at:
                _door(image, rng, x, height, trim)
                continue
            top = base - 0.25 * height - window_h * 0.78
            _window(image, rng, x - window_w / 2, top, window_w, window_h, trim, panes)
            if shutters:
                _shutters(image, rng, x, top, window_w, window_h)
        if storey > 0 and rng.random() < 0.3:
            x = (int(rng.integers(0, columns)) + 0.5) * COLUMNS / columns
            _balcony(image, x, base, COLUMNS / columns * 0.42, height)
    if shop:
        _shop(image, rng, height)
    else:
        plinth = int(0.1 * height)
        image[ROWS - plinth :] = image[ROWS - plinth :] * 0.5 + 30.0
    # The cornice and its shadow, and a rain pipe.
    box(image, 0, 0, COLUMNS, 10, trim * 0.9)
    box(image, 0, 10, COLUMNS, 14, 60.0)
    pipe = float(rng.choice([0.02, 0.5, 0.97])) * COLUMNS
    box(image, pipe, 0, pipe + 5, ROWS, 80.0)
    box(image, pipe + 5, 0, pipe + 7, ROWS, 55.0)
    return image


def gable(rng: Rng, kind: str) -> Image:
    """Texture of a side wall with a few small windows."""
    image = wall(rng, kind)
    for _ in range(int(rng.integers(1, 5))):
        x = rng.uniform(0.1, 0.75) * COLUMNS
        y = rng.uniform(0.1, 0.7) * ROWS
        _window(image, rng, x, y, 40.0, 62.0, 190.0, (2, 1))
    box(image, 12, 0, 17, ROWS, 75.0)
    return image


def _window(
    image: Image, rng: Rng, x: float, y: float, w: float, h: float, trim: float, panes: tuple[int, int]
) -> None:
    """A window with its upper left corner at x, y: frame, glass, perhaps a curtain, and sill."""
    box(image, x - 5, y - 5, x + w + 5, y + h + 5, trim)
    box(image, x, y, x + w, y + h, 40.0)
    glass = float(rng.uniform(22, 70))
    for i in range(panes[0]):
        for j in range(panes[1]):
            x0 = x + 3 + i * w / panes[0]
            y0 = y + 3 + j * h / panes[1]
            x1 = x0 + w / panes[0] - 5
            y1 = y0 + h / panes[1] - 5
            box(image, x0, y0, x1, y1, glass + rng.normal(0, 6))
            if rng.random() < 0.6:  # a mirrored patch of sky or of the house opposite
                lower = y0 + 0.4 * (y1 - y0)
                patch = np.array([[x0, y1], [x0, lower], [x1, y0], [x1, lower]]).astype(np.int32)
                cv2.fillPoly(image, [patch], glass + float(rng.uniform(15, 70)), cv2.LINE_AA)
    if rng.random() < 0.35:  # a curtain or a blind
        drop = rng.uniform(0.25, 0.9) * h
        box(image, x + 3, y + 3, x + w - 3, y + drop, rng.uniform(110, 200))
        for k in range(3, int(drop), 7):
            box(image, x + 3, y + k, x + w - 3, y + k + 1, 95.0)
    box(image, x - 9, y + h + 5, x + w + 9, y + h + 12, min(trim * 1.1, 240))
    box(image, x - 9, y + h + 12, x + w + 9, y + h + 15, 50.0)


def _shutters(image: Image, rng: Rng, x: float, y: float, w: float, h: float) -> None:
    """An open shutter with slats on both sides of a window of width w at x."""
    grey = float(rng.choice([60.0, 85.0, 120.0]))
    for side in (x - w / 2 - 7 - 0.45 * w, x + w / 2 + 7):
        box(image, side, y, side + 0.45 * w, y + h, grey)
        for k in range(4, int(h) - 4, 6):
            box(image, side + 3, y + k, side + 0.45 * w - 3, y + k + 2, grey * 0.55)


def _door(image: Image, rng: Rng, x: float, height: float, trim: float) -> None:
    """A panelled door at x in a frame, with a handle, a house number and a step."""
    w = 46.0
    h = 0.74 * height
    box(image, x - w / 2 - 7, ROWS - h - 7, x + w / 2 + 7, ROWS, trim)
    grey = float(rng.choice([45.0, 70.0, 110.0, 150.0]))
    box(image, x - w / 2, ROWS - h, x + w / 2, ROWS, grey)
    for j in range(3):
        for i in range(2):
            x0 = x - w / 2 + 5 + i * 20
            y0 = ROWS - h + 6 + j * h / 3.1
            box(image, x0, y0, x0 + 15, y0 + h / 3.8, grey * 0.7 if j else 35.0)
    cv2.circle(image, (round(x + w / 2 - 5), round(ROWS - h / 2)), 3, 220.0, -1, cv2.LINE_AA)
    number = str(int(rng.integers(1, 99)))
    letters(image, number, (round(x + w / 2 + 12), round(ROWS - 0.6 * h)), 0.5, 30.0, 2)
    box(image, x - w / 2 - 14, ROWS - 8, x + w / 2 + 14, ROWS, 165.0)


def _balcony(image: Image, x: float, base: float, half: float, height: float) -> None:
    """A balcony, 2 · `half` wide: a slab and a railing."""
    top = base - 0.28 * height
    box(image, x - half, base - 3, x + half, base + 8, 150.0)
    box(image, x - half, top, x + half, top + 4, 45.0)
    for k in np.arange(x - half, x + half, 9.0):
        box(image, k, top, k + 3, base, 50.0)


def _shop(image: Image, rng: Rng, height: float) -> None:
    """A ground floor with a board, two shop windows and a door."""
    top = ROWS - 0.98 * height
    box(image, 0, top, COLUMNS, ROWS, rng.uniform(70, 110))
    board = 220.0
    ink = 45.0
    if rng.random() < 0.5:
        board = 45.0
        ink = 225.0
    box(image, 8, top + 4, COLUMNS - 8, top + 0.24 * height, board)
    word = str(rng.choice(["BAKERY", "BOOKS", "CAFE LUNA", "FLOWERS", "OPTIK", "PHARMACY", "RADIO", "BIKES"]))
    at = (int(rng.uniform(20, 120)), round(top + 0.19 * height))
    letters(image, word, at, 1.2, ink, 3)
    # Two windows with a sill, and the door between them, with their goods.
    for x0, x1, is_window in ((16, 190, True), (206, 276, False), (292, 496, True)):
        y0 = top + 0.3 * height
        sill = 26 if is_window else 4
        pane_sill = 32 if is_window else 8
        box(image, x0, y0, x1, ROWS - sill, 190.0)
        box(image, x0 + 5, y0 + 5, x1 - 5, ROWS - pane_sill, 38.0)
        for _ in range(9):
            x = rng.uniform(x0 + 8, x1 - 26)
            y = rng.uniform(y0 + 8, ROWS - 60)
            box(image, x, y, x + rng.uniform(6, 24), y + rng.uniform(6, 30), rng.uniform(60, 230))
