"""What an ONNX file says about its network: class names, task, image size, kind of head (its last layers).

Ultralytics writes these entries as Python text; other programs write JSON, or nothing at all.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SMALLEST_INPUT_PX = 32  # a smaller size in a model's metadata is ignored
MAX_INPUT_PX = 4096  # and a larger one
MAX_CLASSES = 10_000  # no detector has more; a larger number is not a class
TRANSFORMER_HEAD = "RTDETRDecoder"  # Ultralytics' name for the head of RT-DETR
NO_NAMES = ("", "None", "null")
EXPECTED_NAMES = "expected names such as {0: 'car', 1: 'truck'}, numbered from 0"

# What literal_eval and json raise for text that is not theirs, deep nesting included.
UNREADABLE = (ValueError, SyntaxError, TypeError, MemoryError, RecursionError)


@dataclass(frozen=True)
class Metadata:
    """Entries of a model that tell how to read its output.

    Attributes
    ----------
    names : class names in the order of the model's class numbers, None if the file has none.
    task : what the network was made for, such as "detect" or "segment"; "" if the file does not say.
    one_to_one : the network gives each object one box, so that nothing is left to suppress.
    transformer : the boxes are those of RT-DETR: centre and size, as shares of the image.
    size : longer side of the training images, pixels; None if the file does not say.
    """

    names: tuple[str, ...] | None = None
    task: str = ""
    one_to_one: bool = False
    transformer: bool = False
    size: int | None = None


def read_metadata(entries: Mapping[str, str]) -> Metadata:
    """The metadata of a model from its entries (text by key).

    Raises ValueError for class names that cannot be read.
    """
    arguments = _evaluated(entries.get("args", ""))
    suppresses = isinstance(arguments, dict) and arguments.get("nms") is True
    is_end_to_end = entries.get("end2end", "").strip().lower() == "true"
    has_transformer_head = entries.get("head") == TRANSFORMER_HEAD
    is_described_so = "rtdetr" in entries.get("description", "").lower()
    return Metadata(
        names=read_names(entries.get("names", "")),
        task=entries.get("task", "").strip().lower(),
        one_to_one=is_end_to_end or suppresses,
        transformer=has_transformer_head or is_described_so,
        size=read_size(entries.get("imgsz", "")),
    )


def read_names(text: str) -> tuple[str, ...] | None:
    """Class names from text: a list, or a mapping from 0, 1, 2 … in any order, as Python or JSON write it.

    None for an empty text, "None" or no names. Raises ValueError for other text.
    """
    if text.strip() in NO_NAMES:
        return None
    names = _evaluated(text)
    if isinstance(names, dict):
        names = _in_order(names)
    if not isinstance(names, (list, tuple)) or len(names) > MAX_CLASSES:
        raise ValueError(f"its class names cannot be read: {EXPECTED_NAMES}, found {text.strip()[:60]!r}")
    if not all(isinstance(name, (str, int)) for name in names):
        raise ValueError(f"its class names are not all text: {EXPECTED_NAMES}")
    in_one_line = tuple(" ".join(str(name).split()) for name in names)
    return in_one_line or None


def read_size(text: str) -> int | None:
    """Longer side, in pixels, from a model's metadata such as "[640, 640]" or "640"; None for other text."""
    sides = [int(side) for side in re.findall(r"[0-9]{1,9}", text)]
    if not sides or min(sides) < SMALLEST_INPUT_PX or max(sides) > MAX_INPUT_PX:
        return None
    return max(sides)


def _evaluated(text: str) -> Any:
    """The value of JSON, else of a Python literal; None for other text.

    JSON is first: it writes a character beyond 16 bits as two escapes, which Python reads as two characters.
    """
    for read in (json.loads, ast.literal_eval):
        try:
            return read(text.strip())
        except UNREADABLE:
            continue
    return None


def _in_order(names: dict[Any, Any]) -> list[Any]:
    """The names of a mapping, sorted by number; ValueError unless the numbers are 0, 1, 2 … without a gap."""
    try:
        by_number = {int(key): name for key, name in names.items()}
    except (ValueError, TypeError):
        raise ValueError(f"its class names have no numbers: {EXPECTED_NAMES}") from None
    if sorted(by_number) != list(range(len(names))):
        numbers = ", ".join(str(number) for number in sorted(by_number)[:8])
        raise ValueError(f"its class names have the numbers {numbers}: {EXPECTED_NAMES}")
    return [by_number[number] for number in range(len(names))]
