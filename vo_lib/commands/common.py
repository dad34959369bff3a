"""What several commands share.

These are options and the parsing of their values; opening a sequence, doing runs and drawing a film, each
with a progress bar; notes and warnings.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import re
from collections.abc import Iterable
from contextlib import suppress
from itertools import islice
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

import numpy as np

from ..config import METHODS, VARIANTS, preset
from ..data.catalogue import SYNTHETIC, known_folder, open_sequence
from ..data.drawn import KIT, cache_folder
from ..data.poses import MAX_COORDINATE_M
from ..data.sequence import Sequence
from ..errors import DataError
from ..evaluation.ate_rpe import Delta
from ..evaluation.kitti_errors import SubsequenceProtocol, suitable_protocol
from ..geometry.types import Progress
from ..paper.settings import MethodConfig
from ..report.blocks import Changes, differences
from ..report.plots import require_matplotlib
from ..report.table1 import too_short_words
from ..runs.durations import Durations, duration_words
from ..runs.folder import is_as_written, read_config, settings_in
from ..runs.jobs import Job, Outcome, run_jobs
from .console import print_above_bar, print_wrapped, reporting

if TYPE_CHECKING:
    from ..report.film import Film, FilmFrame

BOTH = "both"
DEFAULT_METHOD = "feature_selection"
DEFAULT_VARIANT = "published"
# The masked share is measured in so many masks: reading one takes 2.5 ms, and a sequence may have thousands.
MASKS_MEASURED = 20


def add_cache(parser: argparse.ArgumentParser) -> None:
    """Add the option for the cache folder."""
    text = f"keep drawn scenes, matches and detected boxes in DIR/{KIT}; default {cache_folder()}"
    parser.add_argument("--cache", type=Path, metavar="DIR", help=text.replace("%", "%%"))


def add_method(parser: argparse.ArgumentParser) -> None:
    """Add the options for a method, its variant and its settings."""
    parser.add_argument("--method", help=f"one of {', '.join(METHODS)}; default {DEFAULT_METHOD}")
    add_variant(parser)
    add_config(parser)


def add_variant(parser: argparse.ArgumentParser, both: bool = False) -> None:
    """Add the option for the variant; `both` allows both variants."""
    default = BOTH if both else DEFAULT_VARIANT
    text = f"published is the method of the paper, and kit extends it; default {default}"
    choices = [*VARIANTS, BOTH] if both else [*VARIANTS]
    parser.add_argument("--variant", choices=choices, help=text)


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the options for frames, labels and masks of the sequence."""
    parser.add_argument(
        "--frames", metavar="A:B", help="use only the frames A to B-1, which are counted from 0"
    )
    text = (
        "folder of YOLO label files; by default labels/ in the sequence's folder. The names of the classes "
        "come from classes.txt, obj.names or data.yaml, in that folder or above it. If there are none, the "
        "numbers are taken as COCO's: 2 is a car, 5 a bus and 7 a truck"
    )
    parser.add_argument("--labels", metavar="DIR", help=text)
    text = (
        "PNG image that is 0 where features are allowed, or a folder with such an image for each frame, "
        "each named as the left image"
    )
    parser.add_argument("--masks", type=Path, metavar="PATH", help=text)


def add_set(parser: argparse.ArgumentParser, purpose: str, required: bool = False) -> None:
    """Add the option that changes settings; `purpose` : what several values of a setting give."""
    text = (
        f"values of a setting, which `vo run --help-settings` lists: {purpose}. Repeat the option for more "
        "settings. Values that are lists are separated by semicolons: filter.classes='car;car,truck'"
    )
    parser.add_argument(
        "--set",
        dest="axes",
        action="append",
        required=required,
        default=None if required else [],
        metavar="SETTING=V,V,…",
        help=text,
    )


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add the option for a run's settings."""
    text = "take method, variant and thresholds from the config.json of a run"
    parser.add_argument("--config", type=Path, metavar="FILE", help=text)


def add_many(parser: argparse.ArgumentParser) -> None:
    """Add the options of commands with many runs."""
    text = "run each method N times, with the seeds 0 to N-1; default %(default)s"
    parser.add_argument("--seeds", metavar="N", default="5", help=text)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs", metavar="N", default="1", help="number of processes at the same time; default %(default)s"
    )
    text = (
        "run on the Dask cluster whose scheduler has this address, such as tcp://host:port. Its workers need "
        "the same file paths (extra [cluster])"
    )
    where.add_argument("--dask", metavar="ADDRESS", help=text)
    parser.add_argument(
        "--fresh", action="store_true", help="compute finished runs again instead of reading them"
    )
    add_cache(parser)


def distinct_sequences(names: list[str], cache: Path | None) -> list[str]:
    """The sequences of names and paths, each once; a note says which of them were named again.

    Of a name and a path of the same sequence, the name stays: only under its name, such as kitti/07, does a
    sequence stand beside the paper's numbers.
    """
    name_of: dict[Path | str, str] = {}  # by folder or, before a scene is drawn, by name
    for name in names:
        folder = known_folder(name, cache)
        place = name if folder is None else folder.resolve()
        first = name_of.setdefault(place, name)
        if first == name:
            continue
        if Path(first).is_dir() and not Path(name).is_dir():
            name_of[place] = name
        print_wrapped(
            f"note: {first} and {name} are the same sequence, so it is used once, as {name_of[place]}"
        )
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            print_wrapped(f"note: {name} is named {names.count(name)} times, but used once")
    return list(name_of.values())


def open_with_bar(name: str, cache: Path | None, part: argparse.Namespace | None = None) -> Sequence:
    """A sequence by name, with a progress bar while a scene is drawn, and the notes on the sequence.

    part : the options of `add_part`.

    Raises `DataError` for an unknown name, an invalid file, frames that it does not have, or a gap in them.
    """
    if part and part.frames:
        parse_frames(part.frames, 0)  # a wrong form is refused before a scene is drawn
    verb = "drawing" if name.startswith(SYNTHETIC) else "opening"
    with reporting(f"{verb} {name}") as report:
        sequence = open_sequence(name, part.labels if part else None, cache, report)
    print_wrapped(*(f"note: {sentence}" for sentence in sequence.notes()))
    if part is None:
        sequence.require_unbroken()
        return sequence
    sequence = dataclasses.replace(sequence, masks=part.masks)
    first = 0
    if part.frames:
        first, stop = parse_frames(part.frames, len(sequence))
        sequence = sequence.part(first, stop)
    sequence.require_unbroken(first)
    if part.masks is not None:
        _note_masked_share(sequence, part.masks)
    return sequence


def _note_masked_share(sequence: Sequence, path: Path) -> None:
    """Print the share of the image that is masked, from some masks; a warning if it is 0 or 100 % in all."""
    # One mask for all frames is repeated endlessly by `mask_images`, but has one file.
    count = len(sequence.mask_files())
    masks = islice(sequence.mask_images(), count)
    share = fmean(np.count_nonzero(mask) / mask.size for mask in islice(masks, MASKS_MEASURED))
    # `masks` goes on where the first ones end: the others are read only to be sure of the warning.
    if share == 0.0 and not any(mask.any() for mask in masks):
        print_wrapped(f"warning: --masks: no pixel is masked: every pixel of {path} is 0")
        return
    if share == 1.0 and all(mask.all() for mask in masks):
        print_wrapped(
            f"warning: --masks: all pixels are masked, so there are no features: no pixel of {path} is 0"
        )
        return
    words = f"--masks: {100 * share:.0f} % of the image is masked"
    if share > 0.5:
        words += "; features on pixels that are not 0 are dropped, so the mask may be inverted"
    print_wrapped(words)


def draw_with_bar(film: Film, frames: Iterable[FilmFrame], which: str = "film") -> None:
    """Write a film, with a progress bar that counts its frames; `which` : text such as "film 2 of 3"."""
    with reporting(f"{which}: {film.label}") as report, film:
        for frame in frames:
            film.add(frame)
            report(frame.index + 1, len(film.run.sequence))


def read_method(options: argparse.Namespace) -> tuple[str, MethodConfig]:
    """Name and settings of the method of --method and --variant, or of the run of --config.

    Raises `DataError` if the method or variant in --config is unknown or differs from the options.
    """
    if options.config is None:
        method = options.method or DEFAULT_METHOD
        variant = options.variant or DEFAULT_VARIANT
        return method, preset(method, variant=variant)
    method, config = _method_of_file(options.config)
    _refuse_contradiction(options.config, "method", method, options.method)
    _refuse_contradiction(options.config, "variant", config.variant, options.variant)
    return method, config


def _refuse_contradiction(path: Path, name: str, in_file: str, typed: str | None) -> None:
    """Raise `DataError` if --method or --variant (`name`) is not that of --config."""
    if typed not in (None, in_file):
        raise DataError(f"is a run of {name} {in_file}, not {typed}: omit --{name} or --config", path)


@dataclasses.dataclass(frozen=True)
class TableMethods:
    """What --variant, --methods and --config say on the methods of a table; None is left to the command.

    changes : settings of --config that differ from the preset of its method; all methods get them.
    must_be_used : names of those changes that are refused, like a value of --set, if no method uses them. If
        the file is as a run wrote it, and the method of that run is in the table, there are none: what a run
        has written down can always be repeated.
    """

    variant: str | None
    methods: str | None
    changes: Changes = ()
    must_be_used: tuple[str, ...] = ()


def read_table_methods(options: argparse.Namespace) -> TableMethods:
    """The methods of a table with many runs; --config decides on what is not typed.

    Raises `DataError` if the method in --config is unknown, or if its variant differs from the option. It
    always differs from --variant both, since the settings of a run are those of one variant.
    """
    if options.config is None:
        return TableMethods(options.variant, options.methods)
    method, config = _method_of_file(options.config)
    _refuse_contradiction(options.config, "variant", config.variant, options.variant)
    methods = method if options.methods is None else options.methods
    changes = differences(config, preset(method, variant=config.variant))
    is_repeated = method in methods.split(",") and is_as_written(read_config(options.config))
    must_be_used = () if is_repeated else tuple(name for name, _ in changes)
    return TableMethods(config.variant, methods, changes, must_be_used)


def _method_of_file(path: Path) -> tuple[str, MethodConfig]:
    """Name and settings of the method in a config.json; `DataError` if its variant does not have it."""
    data = read_config(path)
    config = settings_in(data, path)
    method = str(data.get("method", ""))
    try:
        preset(method, variant=config.variant)
    except DataError as error:
        raise DataError(str(error), path) from None
    return method, config


def warn_missing(missing: list[str], total: int, accepted: bool) -> None:
    """Before the runs, say which sequences are not on this machine."""
    if not missing:
        return
    words = (
        f"warning: {len(missing)} of {total} sequences are not on this machine, so they are not run: "
        f"{', '.join(missing)}; `vo check` says how to get them."
    )
    if not accepted:
        words += " The exit code will be 1; --missing ok accepts this."
    print_wrapped(words)


def print_rest(seconds: float, durations: Durations, again: bool) -> None:
    """Print how long the rest of the runs will take; `again` : this corrects what was printed before."""
    if again:
        print_above_bar(f"The rest will take about {duration_words(seconds)}, other than first estimated.")
        return
    processes = "process" if durations.workers == 1 else "processes"
    print_above_bar(
        f"The other runs will take about {duration_words(seconds)} ({durations.workers} {processes}; "
        "estimated from the first runs)."
    )


def note_too_short(sequence: Sequence, protocol: SubsequenceProtocol | None, remedy: str) -> None:
    """Before the runs, say that a true path is shorter than every sub-sequence, and the remedy, if any.

    protocol : the sub-sequences, or None for those that suit the path.
    """
    if sequence.truth is None:
        return
    chosen = suitable_protocol(sequence.truth) if protocol is None else protocol
    why = too_short_words(sequence.truth, chosen)
    if why:
        end = f"; {remedy}" if remedy else ""
        print_wrapped(f"note: {sequence.name} will have no errors, since {why}{end}")


def run_with_options(
    jobs: list[Job], workers: int, progress: Progress, durations: Durations, options: argparse.Namespace
) -> list[Outcome]:
    """Do the jobs of a command with many runs, as its options say; print how long the rest will take."""
    return run_jobs(
        jobs,
        workers,
        progress,
        cache=options.cache,
        scheduler=options.dask,
        fresh=options.fresh,
        durations=durations,
        estimated=lambda seconds, again: print_rest(seconds, durations, again),
    )


def parse_methods(text: str | None, variant: str | None) -> dict[str, list[str]]:
    """For each variant, the methods in a comma-separated list, each once; without a list, all methods.

    Raises `DataError` for a name that none of the chosen variants has.
    """
    variants = list(VARIANTS) if variant in (None, BOTH) else [str(variant)]
    if text is None:
        return {name: list(VARIANTS[name]) for name in variants}
    methods = list(dict.fromkeys(text.split(",")))
    for method in methods:
        preset(method, variant=variants[-1])  # of two variants, the last one has all methods
    return {name: [method for method in methods if method in VARIANTS[name]] for name in variants}


def require_drawing() -> None:
    """Raise `DataError` before the work if Matplotlib could not draw its figures afterwards."""
    if os.environ.get("MPLBACKEND"):  # without it, the import of half a second can wait
        require_matplotlib()


def parse_whole(name: str, text: str, least: int = 1, most: int = 1_000_000) -> int:
    """A whole number from `least` to `most`; `DataError` with the option's name for other text."""
    number = int(text) if re.fullmatch(r"\d{1,9}", text, re.ASCII) else None
    if number is None or not least <= number <= most:
        raise DataError(f"{name} {text!r}: expected a whole number from {least} to {most}")
    return number


def parse_jobs(text: str, runs: int | None = None) -> int:
    """The number of processes in --jobs, at most one for each run; a note if the machine has fewer cores."""
    workers = parse_whole("--jobs", text)
    if runs is not None:
        workers = min(workers, max(runs, 1))
    cores = os.cpu_count() or 1
    if workers > cores:
        words = "processor core" if cores == 1 else "processor cores"
        print_wrapped(f"note: {workers} processes, but this machine has {cores} {words}")
    return workers


def parse_frames(text: str, number: int) -> tuple[int, int]:
    """Start and stop in a text "A:B"; without A, the start is 0, and without B, the stop is `number`."""
    found = re.fullmatch(r"(-?\d{1,9}|):(-?\d{1,9}|)", text, re.ASCII)
    if found is None:
        raise DataError(f"--frames {text!r}: expected A:B, two whole numbers")
    return int(found[1] or 0), int(found[2] or number)


def parse_lengths(text: str) -> tuple[float, ...]:
    """Sub-sequence lengths, metres, from a comma-separated list; `DataError` for other text."""
    try:
        lengths = tuple(float(word) for word in text.split(","))
    except ValueError:
        lengths = ()  # refused below
    if not lengths or not all(0 < length <= MAX_COORDINATE_M for length in lengths):
        raise DataError(f"--lengths {text!r}: expected metres such as 20,50,100")
    if len(set(lengths)) < len(lengths):
        raise DataError(f"--lengths {text!r}: a value is repeated")
    return lengths


def parse_delta(text: str) -> Delta:
    """The interval of a text such as "10f" (frames) or "5m" (metres); `DataError` for other text."""
    frames = re.fullmatch(r"(\d{1,9})f", text, re.ASCII)
    metres = re.fullmatch(r"(\d{1,9}\.?\d*|\.\d+)m", text, re.ASCII)
    with suppress(DataError):  # for an interval of 0, which is refused below
        if frames is not None:
            return Delta(int(frames[1]))
        if metres is not None:
            return Delta(float(metres[1]), "m")
    raise DataError(f"--delta {text!r}: expected frames such as 10f, or metres such as 5m")


def changed_words(names: Iterable[str]) -> str:
    """The beginning of a sentence on files of a run that are not as the run wrote them."""
    files = list(names)
    verb = "was" if len(files) == 1 else "were"
    return f"{', '.join(files)} {verb} missing or changed"


def note_repeated_runs(outcomes: Iterable[Outcome]) -> None:
    """Print a note on finished runs that were computed again, since their files had changed."""
    for outcome in outcomes:
        if outcome.changed:
            words = changed_words(outcome.changed)
            print_wrapped(f"note: {words} in {outcome.job.folder}, so the run was computed again")
