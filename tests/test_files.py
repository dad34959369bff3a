"""Reading of text in UTF-8 alone, and writing that leaves each file as it was or as it is now."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from vo_lib import DataError
from vo_lib.data.label_names import read_yaml
from vo_lib.data.tables import read_csv
from vo_lib.files import (
    DRAFT,
    LOCK,
    locked_draft,
    only_process,
    read_mapping,
    read_text,
    write_atomic,
)
from vo_lib.runs.folder import refuse_foreign, written_together

BEFORE = {"b.txt": "old b", "d.txt": "old d", "end.json": "old end"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files of an earlier result."""
    folder = tmp_path / "results"
    folder.mkdir()
    for name, text in BEFORE.items():
        write_atomic(folder / name, text)
    return folder


def texts(folder: Path) -> dict[str, str]:
    """The text of each file of a folder, by its path there."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8") for path in files}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_text_is_utf_8_with_or_without_a_mark(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a").write_bytes("1 zwölf\r\n2\r3\n".encode(encoding))
    assert read_text(tmp_path / "a") == "1 zwölf\n2\n3\n"


@pytest.mark.parametrize(
    "content",
    [*('{"a": 1}'.encode(name) for name in ("utf-16", "utf-16-le", "utf-16-be", "utf-32")), b'{"a": "\xf6"}'],
    ids=["UTF-16", "little end first", "big end first", "UTF-32", "Latin 1"],
)
@pytest.mark.parametrize("read", [lambda path: read_mapping(path, "numbers"), read_csv, read_yaml])
def test_text_in_another_encoding_is_refused(
    tmp_path: Path, content: bytes, read: Callable[[Path], object]
) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(DataError, match="a: is not a text file in UTF-8"):
        read(tmp_path / "a")


@pytest.mark.parametrize(
    ("content", "read", "message"),
    [
        ("{\n1", lambda path: read_mapping(path, "numbers"), "a, line 2: is not JSON: expected numbers"),
        ("[" * 10**5, lambda path: read_mapping(path, "numbers"), "a: is not JSON: expected numbers"),
        ("[1]", lambda path: read_mapping(path, "numbers"), "a: expected numbers"),
        ("1\n" + "2" * 200_000, read_csv, "a, line 2: is not CSV"),
        ("a: 1\nb: [", read_yaml, "a, line 2: is not YAML"),
        ("a: 2020-99-99", read_yaml, "a: is not YAML"),
        (None, read_text, "a: is a folder or a device, expected a file"),
        (os.devnull, lambda path: read_text(os.devnull), "is a folder or a device, expected a file"),
        ("", lambda path: read_text(f"{path}/b"), "a/b: the file is missing"),
        ("", lambda path: read_text(f"{path}\0"), "the file is missing"),
    ],
)
def test_files_that_cannot_be_read_are_named_with_the_fault(
    tmp_path: Path, content: str | None, read: Callable[[Path], object], message: str
) -> None:
    path = tmp_path / "a"
    if content is None:
        path.mkdir()
    else:
        path.write_text(content, encoding="utf-8")
    with pytest.raises(DataError, match=message):
        read(path)


def write_results(folder: Path, *names: str, stop: bool = False) -> None:
    """Replace files of a folder; of them, end.json is the mark of a complete result. stop : press Ctrl-C."""
    with written_together(folder) as draft:
        for name in names:
            write_atomic(draft / name, 100 * "new ")
        if stop:
            raise KeyboardInterrupt


def test_files_are_replaced_and_others_stay(folder: Path) -> None:
    write_results(folder, "a.txt", "b.txt", "end.json" + DRAFT)
    assert texts(folder) == BEFORE | dict.fromkeys(["a.txt", "b.txt", "end.json"], 100 * "new ")


def test_a_file_that_cannot_be_replaced_leaves_each_old_or_new_and_the_mark_old(folder: Path) -> None:
    (folder / "c.txt" / "inner").mkdir(parents=True)  # a folder in the place of a file
    with pytest.raises(DataError, match="results: cannot be written: "):
        write_results(folder, "b.txt", "c.txt", "end.json" + DRAFT)
    assert texts(folder) == BEFORE | {"b.txt": 100 * "new "}


def test_an_interruption_leaves_the_earlier_files(folder: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        write_results(folder, "a.txt", "b.txt", "end.json" + DRAFT, stop=True)
    assert texts(folder) == BEFORE


def write_long(path: Path) -> None:
    """Write a file as one that takes long."""
    with locked_draft(path) as draft:
        draft.write_bytes(bytes(100))


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: write_results(folder, "b.txt", "end.json" + DRAFT),
        lambda folder: write_atomic(folder / "b.txt", bytes(100)),
        lambda folder: write_long(folder / "b.txt"),
    ],
)
def test_on_a_full_disk_the_files_from_before_remain(folder: Path, write: Callable[[Path], None]) -> None:
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50, limits[1]))  # no file may be larger
    try:
        with pytest.raises(DataError, match=r"b\.txt: cannot be written: File too large"):
            write(folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert texts(folder) == BEFORE


def test_drafts_of_killed_processes_are_deleted_and_those_in_use_stay(folder: Path) -> None:
    small, large = folder / f".a.txt.1{DRAFT}", folder / f".film.webm.1{DRAFT}"
    small.write_text("half", encoding="utf-8")
    large.mkdir()
    (large / "part").write_text("half", encoding="utf-8")
    Path(f"{large}{LOCK}").touch()  # its holder is gone
    (folder / ".letter.tmp").write_text("mine", encoding="utf-8")
    with locked_draft(folder / "other.webm") as used:
        used.write_text("half", encoding="utf-8")
        assert small.exists()  # of a process that may have the folder's lock
        assert not large.exists()
        with only_process(folder), locked_draft(folder / "film.webm"):
            assert used.exists()
        assert not small.exists()
    assert texts(folder) == BEFORE | {".letter.tmp": "mine"}


def test_a_file_that_is_not_the_kits_is_not_replaced(folder: Path) -> None:
    refuse_foreign(folder, ["b.txt"], own=True)
    refuse_foreign(folder, ["a.txt"], own=False)
    with pytest.raises(DataError, match=r"b\.txt: is not the kit's file"):
        refuse_foreign(folder, ["a.txt", "b.txt"], own=False)
    with only_process(folder):
        refuse_foreign(folder, ["b.txt"], own=False)
