"""Every file content and every option value gives a result or a one-line error."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from file_readers import FileReader, expanded, readers
from hypothesis import given
from hypothesis import strategies as st

from vo_lib.commands.common import parse_frames, parse_lengths, parse_methods, parse_whole
from vo_lib.config import preset
from vo_lib.data.catalogue import parse_sequences
from vo_lib.detection.settings import DetectorConfig
from vo_lib.errors import DataError
from vo_lib.kit.settings import KitConfig
from vo_lib.report.blocks import parse_axis
from vo_lib.settings import declared

# Unusual words: first those without blanks, then those with blanks and long ones.
ODD = """0 -1 1e308 -1e308 1e400 nan inf 1e-320 1_0 ٣ null true [] {} [ { ] " ' : , # x é ../.. =
    - ; % 2001-99-99 !!python/name:os.system &a""".split()  # noqa: SIM905
ODD += ["", "\n", "\t", "\0", "*a", "9" * 20, "9" * 5000, "[" * 1000, '{"a":' * 1000]
PIECE = re.compile(rb"[^\s,:\[\]{}\"]+")


@st.composite
def damaged(draw: st.DrawFn, valid: bytes) -> bytes:
    """Random bytes, or a valid file with unusual words or with a part removed, doubled or replaced."""
    how = draw(st.sampled_from(["bytes", "words", "words", "words", "part"]))
    if how == "bytes":
        return draw(st.binary(max_size=200))
    data = valid
    if how == "words":
        for _ in range(draw(st.integers(1, 3))):
            start, end = draw(st.sampled_from([result.span() for result in PIECE.finditer(data)] or [(0, 0)]))
            data = data[:start] + draw(st.sampled_from(ODD)).encode() + data[end:]
        return data
    start, end = sorted(draw(st.tuples(*[st.integers(0, len(data))] * 2)))
    middle = draw(st.sampled_from([b"", 2 * data[start:end]]) | st.binary(max_size=20))
    return data[:start] + middle + data[end:]


def outcome(work: Callable[[], Any]) -> tuple[Any, str]:
    """The result of a function, and the text of its `DataError` or ""."""
    try:
        return work(), ""
    except DataError as error:
        return None, str(error)


def arrays(value: Any) -> Iterator[Any]:
    """All floating-point arrays in a result."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        yield value
    elif dataclasses.is_dataclass(value):
        yield from arrays(list(vars(value).values()))
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from arrays(item)


def spoilt(how: str | list[str], valid: bytes) -> bytes:
    """Invalid content of a file: `how` as text, or the valid content with how[1] in place of how[0].

    Bytes that are not UTF-8 are encoded as Python's surrogates.
    """
    if isinstance(how, str):
        return expanded(how).encode("utf-8", "surrogateescape")
    old, new = how
    assert old.encode() in valid
    return valid.replace(old.encode(), spoilt(new, valid), 1)


# Reader, damage, and a part of the error.
CASES = json.loads((Path(__file__).parent / "bad_files.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("name", "how", "expected"), CASES, ids=[f"{name} {str(how)[:40]!a}" for name, how, _ in CASES]
)
def test_bad_files_give_one_line(tmp_path: Path, name: str, how: str | list[str], expected: str) -> None:
    reader = readers()[name]
    path = reader.write(tmp_path)
    path.write_bytes(spoilt(how, reader.valid))
    _, message = outcome(lambda: reader.read(tmp_path))
    assert message.startswith(str(tmp_path))
    assert expected in message.replace(f"{tmp_path}/", "")
    assert len(message.splitlines()) == 1


@pytest.fixture(scope="module", params=readers())
def place(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[FileReader, Path]:
    """A reader and a folder of valid files."""
    reader, folder = readers()[request.param], tmp_path_factory.mktemp("reader")
    reader.write(folder)
    reader.read(folder)
    return reader, folder


@given(data=st.data())
def test_random_files_give_finite_numbers_or_one_line(
    place: tuple[FileReader, Path], data: st.DataObject
) -> None:
    reader, folder = place
    path = folder / reader.file
    path.write_bytes(data.draw(damaged(reader.valid)))
    result, message = outcome(lambda: reader.read(folder))
    path.write_bytes(reader.valid)
    assert len(message.splitlines()) <= 1
    assert message == "" or message.startswith(str(folder))
    assert all(np.isfinite(array).all() for array in arrays(result))


CONFIG = preset("feature_selection")
WORDS: dict[str, Callable[[str], Any]] = {
    "axis": lambda text: parse_axis(text, CONFIG),
    "axis of a setting": lambda text: parse_axis(f"selection.sets={text}", CONFIG),
    "axis of a list": lambda text: parse_axis(f"filter.classes={text}", CONFIG),
    "frames": lambda text: parse_frames(text, 10),
    "sequences": parse_sequences,
    "lengths": parse_lengths,
    "methods": lambda text: parse_methods(text, "both"),
    "whole": lambda text: parse_whole("--step", text),
}
WORDS |= {
    item.name: lambda text, item=item: item.parse(text)  # type: ignore[misc]
    for cls in (KitConfig, DetectorConfig)
    for item in declared(cls)
}
LIKE_WORDS = st.lists(st.sampled_from([*ODD, "00", "07", "1", "kit", "car", "5:7", "viso2", "20", ","])).map(
    "".join
)


@given(st.sampled_from(sorted(WORDS)), st.text(max_size=60) | LIKE_WORDS)
def test_random_option_values_are_parsed_or_refused(name: str, text: str) -> None:
    assert len(outcome(lambda: WORDS[name](text))[1].splitlines()) <= 1
