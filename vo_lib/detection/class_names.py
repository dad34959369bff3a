"""Class names of detectors and their COCO numbers; label files contain the numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import DataError
from ..geometry.types import BoolArray, IntArray

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
COCO = tuple(" ".join(name.split()) for name in _COCO.split(","))
# Names of other data sets, KITTI's among them, and the COCO names for them.
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
    """COCO number of a class name, or None."""
    plain = name.strip().lower()
    plain = OTHER_NAMES.get(plain, plain)
    return COCO.index(plain) if plain in COCO else None


def class_numbers(names: Sequence[str]) -> IntArray:
    """Class numbers (C,) in label files: the COCO number, or 80 + index for a class that COCO lacks."""
    numbers = [coco_number(name) for name in names]
    return np.array([len(COCO) + k if n is None else n for k, n in enumerate(numbers)], np.int64)


def choose_classes(words: Sequence[str], names: Sequence[str]) -> BoolArray:
    """Mask (C,) of the classes with a number or name in `words`; all classes if `words` is empty.

    Raises `DataError` for a name that neither the model nor COCO has.
    """
    numbers, mask = class_numbers(names), np.full(len(names), not words)
    for word in (word.strip().lower() for word in words):
        same_name = np.array([name.lower() == word for name in names], np.bool_)
        number = int(word) if word.isdecimal() and len(word) < 10 else coco_number(word)
        if number is None and not same_name.any():
            expected = f"expected a COCO name or number, or one of {', '.join(names)[:200]}"
            raise DataError(f"class {word!r}: {expected}")
        mask |= same_name if number is None else same_name | (numbers == number)
    return mask
