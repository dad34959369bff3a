"""What several commands need: opening sequences, options that are read alike."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..config import METHODS, VARIANTS, PublishedConfig, preset
from ..core import settings
from ..core.errors import DataError
from ..core.files import read_json, require_own
from ..core.poses import FARTHEST
from ..data.drawn import cache_folder
from ..data.sequence import SYNTHETIC, Sequence, available, open_sequence
from .console import reporting, tell

BOTH = "both"


def add_cache(parser: argparse.ArgumentParser) -> None:
    """The option that chooses the cache folder."""
    text = f"folder that keeps synthetic scenes; default {cache_folder()}"
    parser.add_argument("--cache", type=Path, metavar="DIR", help=text.replace("%", "%%"))


def add_sequence(parser: argparse.ArgumentParser, name: str, text: str, **more: Any) -> None:
    """The argument or option that names a sequence; a shell may complete those found."""
    action: Any = parser.add_argument(name, help=text, **more)
    action.completer = lambda **_: list(available())


def add_method(parser: argparse.ArgumentParser) -> None:
    """The option that names a method."""
    names = list(METHODS)
    action: Any = parser.add_argument(
        "--method", default="feature_selection", help=f"one of {', '.join(names)}"
    )
    action.completer = lambda **_: names


def open_with_bar(name: str, cache: Path | None, labels: str | None = None) -> Sequence:
    """A sequence; a bar is shown while a synthetic scene is drawn."""
    with reporting(f"drawing {name}") as report:
        return open_sequence(name, labels, cache, report)


def add_part(parser: argparse.ArgumentParser) -> None:
    """The options that choose frames and labels of the sequence."""
    parser.add_argument("--frames", metavar="A:B", help="only the frames A … B-1, counted from 0")
    parser.add_argument("--labels", metavar="DIR", help="YOLO label files; default: labels/ in the sequence")


def open_part(options: argparse.Namespace, cache: Path | None) -> Sequence:
    """The sequence that is named with the options of `add_part`."""
    sequence = open_with_bar(options.sequence, cache, options.labels)
    if options.frames is None:
        return sequence
    return sequence.part(*parse_frames(options.frames, len(sequence)))


def parse_whole(name: str, text: str, least: int = 1, most: int = 1_000_000) -> int:
    """A whole number from `least` to `most`; `DataError` names the option."""
    digits = text.lstrip("0") or "0"
    if not text.isdecimal() or len(digits) > len(str(most)) or not least <= int(digits) <= most:
        raise DataError(f"{name} {text[:40]!r}: expected a whole number of {least} or more, {most} at most")
    return int(digits)


def parse_frames(text: str, number: int) -> tuple[int, int]:
    """Start and stop of "A:B"; either may be left out."""
    start, colon, stop = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return int(start or 0), int(stop or number)
    except ValueError:
        raise DataError(f"--frames {text!r}: expected A:B, two whole numbers") from None


def add_config(parser: argparse.ArgumentParser, more: str) -> None:
    """The option that takes a run's settings."""
    text = f"config.json of a run: its method, variant and thresholds; {more}"
    parser.add_argument("--config", type=Path, metavar="FILE", help=text)


def read_settings(options: argparse.Namespace) -> PublishedConfig | None:
    """The settings of --config, None without; its method and variant become those of the options."""
    if options.config is None:
        return None
    expected = "the settings of a run, as `vo run` writes them"
    data = read_json(options.config, {"method": str, "settings": {}}, expected)
    options.method, options.variant = data["method"], data.get("variant", "kit")
    usual = preset(options.method, variant=options.variant)
    try:
        config: PublishedConfig = settings.from_dict(type(usual), data["settings"])
    except (DataError, TypeError) as error:
        raise DataError(str(error), options.config) from None
    return config


def add_detector(parser: argparse.ArgumentParser, text: str) -> None:
    """The options that choose a detector and what computes it."""
    parser.add_argument("--detector", metavar="MODEL", help=f"{text}; the boxes are kept in the cache folder")
    parser.add_argument("--provider", default="cpu", metavar="P", help="cpu or cuda; default cpu")


def add_many(parser: argparse.ArgumentParser, jobs: Any) -> None:
    """The options of commands that do many runs: `jobs` is the group that --jobs goes to."""
    parser.add_argument("--seeds", metavar="N", default="5", help="seeds 0 … N-1; default 5")
    jobs.add_argument("--jobs", metavar="N", default="1", help="processes; default 1")
    parser.add_argument("--fresh", action="store_true", help="do runs again that are finished")
    add_cache(parser)


def require_place(path: Path | None, *endings: str) -> None:
    """`DataError` unless a file can be written there: its ending, its folder, nobody else's file."""
    if path is None:
        return
    if path.suffix.lower() not in endings or path.is_dir():
        raise DataError(f"expected a file's name, ending in {' or '.join(endings)}", path)
    if not path.absolute().parent.is_dir():
        raise DataError(f"the folder of {path.name} is missing", path.parent)
    require_own(path)


def warn_of_street(detector: str | None, *sequences: Sequence) -> None:
    """Say that the shipped model knows drawn streets only, where it is to look at other images."""
    real = [each.name for each in sequences if not each.name.startswith(SYNTHETIC)]
    if detector == "street" and real:
        names = ", ".join(real)
        tell(f"warning: `street` was trained on drawn streets; on {names} most of its boxes may be wrong")


def add_variant(parser: argparse.ArgumentParser, default: str) -> None:
    """The option that chooses between the paper as published and the kit's way, or takes both."""
    choices = [*VARIANTS, *([BOTH] if default == BOTH else [])]
    text = "the paper as published, or the kit's way with what it adds"
    parser.add_argument("--variant", choices=choices, default=default, help=f"{text}; default {default}")


def parse_methods(text: str | None, variant: str) -> dict[str, list[str]]:
    """Method names of a comma-separated list by variant, each once; none given: all that a variant has.

    Raises `DataError` for a name that no variant asked for has.
    """
    variants = list(VARIANTS) if variant == BOTH else [variant]
    if text is None:
        return {name: list(VARIANTS[name]) for name in variants}
    methods = list(dict.fromkeys(text.split(",")))
    for method in methods:
        preset(method, variant=variants[-1])
    return {name: [m for m in methods if m in VARIANTS[name]] for name in variants}


def parse_lengths(text: str) -> tuple[float, ...]:
    """Sub-sequence lengths of a comma-separated list, metres."""
    try:
        lengths = tuple(float(word) for word in text.split(","))
    except ValueError:
        lengths = ()
    if not lengths or not all(0 < length <= FARTHEST for length in lengths):
        raise DataError(f"--lengths {text!r}: expected metres such as 20,50,100")
    return lengths
