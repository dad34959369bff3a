"""Class names of detectors and their COCO numbers: labels are in COCO's numbers whatever the model counts."""

from __future__ import annotations

import ast
import warnings
from collections.abc import Sequence

import numpy as np

from ..core.errors import DataError
from ..core.types import Mask, Whole

_COCO = """
    person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant,
    stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe,
    backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball
    bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup, fork, knife,
    spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake, chair,
    couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote, keyboard, cell phone,
    microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear, hair drier,
    toothbrush
"""
COCO = tuple(name.strip() for name in _COCO.split(","))
# Names of other data sets, KITTI's among them, for what COCO calls otherwise.
OTHER_NAMES = {
    "vehicle": "car",
    "vehicles": "car",
    "cars": "car",
    "van": "car",
    "lorry": "truck",
    "tram": "train",
    "pedestrian": "person",
    "person_sitting": "person",
    "cyclist": "bicycle",
}


def coco_number(name: str) -> int | None:
    """COCO's number of a class name, or None."""
    plain = name.strip().lower()
    plain = OTHER_NAMES.get(plain, plain)
    return COCO.index(plain) if plain in COCO else None


def names_from_metadata(text: str, count: int) -> tuple[str, ...] | None:
    """The `names` of an Ultralytics model, a Python dict or list written as text; None where it is neither.

    `count` is the number of classes that the network has.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of escapes that a text does not have
            found = ast.literal_eval(text)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(found, dict):
        found = [found.get(k) for k in range(count)]
    if not isinstance(found, (list, tuple)) or len(found) != count:
        return None
    return tuple(found) if all(isinstance(name, str) for name in found) else None


def class_numbers(names: Sequence[str]) -> Whole:
    """The number (C,) each class gets in labels: COCO's, or 80 and its own place where COCO lacks it."""
    numbers = [coco_number(name) for name in names]
    return np.array([len(COCO) + k if n is None else n for k, n in enumerate(numbers)], np.int64)


def choose_classes(words: Sequence[str], names: Sequence[str]) -> Mask:
    """Which classes (C,) are meant by `words`: names of the model or of COCO, or numbers; no words: all.

    Raises `DataError` for a name that neither the model nor COCO has.
    """
    numbers = class_numbers(names)
    if not words:
        return np.ones(len(names), np.bool_)
    chosen = np.zeros(len(names), np.bool_)
    for word in words:
        plain = word.strip().lower()
        own = np.array([name.lower() == plain for name in names], np.bool_)
        number = int(plain) if plain.isdecimal() and len(plain) < 10 else coco_number(plain)
        if number is None and not own.any():
            raise DataError(
                f"class {word!r}: expected a COCO name or number, or one of {', '.join(names)[:200]}"
            )
        chosen |= own if number is None else own | (numbers == number)
    return chosen
