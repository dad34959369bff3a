"""Whatever the bytes of a file and the words of an option: a result, or one line that says what is wrong."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from readers import Reader, expanded, readers

from fetch.kitti_check import parse_numbers
from kitti_to_yolo import parse_drives
from vo_lib.commands.common import parse_frames, parse_lengths, parse_methods, parse_whole
from vo_lib.config import Config, DetectorConfig
from vo_lib.core.errors import DataError
from vo_lib.core.settings import declared
from vo_lib.data.drawn import is_complete
from vo_lib.data.sequence import parse_sequences
from vo_lib.detection.class_names import choose_classes, names_from_metadata
from vo_lib.detection.yolo_layout import size_from_metadata
from vo_lib.runs.identity import _remembered
from vo_lib.runs.match_cache import unpack
from vo_lib.tables.sweep import parse_axis

# Words parted by blanks, and what holds blanks or is long.
ODD = """0 -1 1e308 -1e308 1e400 nan inf 1e-320 1_0 ٣ null true [] {} [ { ] " ' : , # x é ../.. =
    - ; % 2001-99-99 !!python/name:os.system &a""".split()  # noqa: SIM905
ODD += ["", "\n", "\t", "\0", "*a", "9" * 20, "9" * 5000, "[" * 3000, '{"a":' * 3000]
PIECE = re.compile(rb"[^\s,:\[\]{}\"]+")


@st.composite
def damaged(draw: st.DrawFn, valid: bytes) -> bytes:
    """Any bytes, or a valid file of which some words are odd ones, or a part is gone, doubled or other."""
    how = draw(st.sampled_from(["bytes", "words", "words", "words", "part"]))
    if how == "bytes":
        return draw(st.binary(max_size=200))
    data = valid
    if how == "words":
        for _ in range(draw(st.integers(1, 3))):
            pieces = list(PIECE.finditer(data))
            if not pieces:
                break
            start, end = draw(st.sampled_from(pieces)).span()
            data = data[:start] + draw(st.sampled_from(ODD)).encode() + data[end:]
        return data
    start, end = sorted(draw(st.tuples(*[st.integers(0, len(data))] * 2)))
    middle = draw(st.sampled_from([b"", 2 * data[start:end]]) | st.binary(max_size=20))
    return data[:start] + middle + data[end:]


def outcome(work: Callable[[], Any]) -> tuple[Any, str]:
    """What some work gives, and what it says where it refuses its input."""
    try:
        return work(), ""
    except DataError as error:
        return None, str(error)


def arrays(value: Any) -> Iterator[Any]:
    """All arrays of floats in a result."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        yield value
    elif dataclasses.is_dataclass(value):
        yield from arrays(list(vars(value).values()))
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from arrays(item)


@pytest.fixture(scope="module", params=readers())
def place(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Reader, Path]:
    """A reader and a folder of valid files."""
    reader, folder = readers()[request.param], tmp_path_factory.mktemp("reader")
    reader.write(folder)
    return reader, folder


def test_the_valid_files_are_read(place: tuple[Reader, Path]) -> None:
    reader, folder = place
    reader.read(folder)


def spoilt(how: str | list[str], valid: bytes) -> bytes:
    """A file's bytes: as `how` says, or with the first of its two texts replaced by the second.

    What is no UTF-8 is written as Python's surrogates.
    """
    if isinstance(how, str):
        return expanded(how).encode("utf-8", "surrogateescape")
    old, new = how
    assert old.encode() in valid
    return valid.replace(old.encode(), spoilt(new, valid), 1)


BAD_FILES = json.loads((Path(__file__).parent / "bad_files.json").read_text(encoding="utf-8"))
CASES = [(name, how, expected) for name, cases in BAD_FILES.items() for how, expected in cases]


@pytest.mark.parametrize(
    ("name", "how", "expected"), CASES, ids=[f"{name} {str(how)[:40]!a}" for name, how, _ in CASES]
)
def test_a_bad_file_is_one_line_that_says_what_is_wrong(
    tmp_path: Path, name: str, how: str | list[str], expected: str
) -> None:
    reader = readers()[name]
    path = reader.write(tmp_path)
    path.write_bytes(spoilt(how, reader.valid))
    there = sorted(tmp_path.rglob("*"))
    _, said = outcome(lambda: reader.read(tmp_path))
    assert said.startswith(str(tmp_path))
    assert expected in said.replace(f"{tmp_path}/", "")
    assert len(said.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == there


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


NO_FILES: dict[str, Callable[[Path], Any]] = {"folder": Path.mkdir, "pipe": pipe, "device": endless}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("kind", NO_FILES)
@pytest.mark.parametrize("name", readers())
def test_what_is_no_file_is_refused_before_it_is_read(tmp_path: Path, name: str, kind: str) -> None:
    path = readers()[name].write(tmp_path)
    path.unlink()
    NO_FILES[kind](path)
    _, said = outcome(lambda: readers()[name].read(tmp_path))
    assert "expected a file" in said
    assert len(said.splitlines()) == 1


@given(data=st.data())
def test_any_file_gives_finite_numbers_or_one_line(place: tuple[Reader, Path], data: st.DataObject) -> None:
    reader, folder = place
    path = folder / reader.file
    path.write_bytes(data.draw(damaged(reader.valid)))
    result, said = outcome(lambda: reader.read(folder))
    path.write_bytes(reader.valid)
    assert len(said.splitlines()) <= 1
    assert said == "" or said.startswith(str(folder))
    assert all(np.isfinite(array).all() for array in arrays(result))


CACHES: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "hashes": ('{"a.png": [12, 34, "abc"]}', lambda path: list(_remembered(path))),
    "manifest": ('{"a.png": [12, 34]}', lambda path: is_complete(path.parent)),
}


@pytest.mark.parametrize("name", CACHES)
@given(data=st.data())
def test_any_damage_of_what_is_kept_is_as_if_it_were_not_there(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    valid, read = CACHES[name]
    path = tmp_path_factory.getbasetemp() / "manifest.json"
    path.write_bytes(data.draw(damaged(valid.encode())))
    read(path)


@given(st.binary(max_size=300))
def test_any_bytes_are_matches_or_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="checksum"):
        unpack(data)


WORDS: dict[str, Callable[[str], Any]] = {
    "axis": parse_axis,
    "axis of a setting": lambda text: parse_axis(f"selection.sets={text}"),
    "axis of a list": lambda text: parse_axis(f"filter.classes={text}"),
    "frames": lambda text: parse_frames(text, 10),
    "sequences": parse_sequences,
    "numbers": parse_numbers,
    "lengths": parse_lengths,
    "methods": lambda text: parse_methods(text, "both"),
    "whole": lambda text: parse_whole("--step", text),
    "drives": lambda text: parse_drives([text]),
    "classes": lambda text: choose_classes(text.split(","), ("car",)),
    "names of a model": lambda text: names_from_metadata(text, 1),
    "size of a model": size_from_metadata,
}
SETTINGS = [*declared(Config), *declared(DetectorConfig)]
LIKE_WORDS = st.lists(st.sampled_from([*ODD, "00", "07", "1", "kit", "car", "5:7", "viso2", "20", ","])).map(
    "".join
)


@pytest.mark.parametrize("name", WORDS)
@given(text=st.text(max_size=60) | LIKE_WORDS)
def test_any_words_of_an_option_are_understood_or_refused(name: str, text: str) -> None:
    assert len(outcome(lambda: WORDS[name](text))[1].splitlines()) <= 1


@given(st.sampled_from(SETTINGS), st.text(max_size=60) | LIKE_WORDS)
def test_any_word_is_a_value_of_a_setting_or_refused(item: Any, text: str) -> None:
    _, said = outcome(lambda: item.check(item.parse(text)))
    assert said == "" or said.startswith(f"{item.name}: ")
    assert len(said.splitlines()) <= 1
