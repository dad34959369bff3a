"""Files that belong together are all replaced, or none of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib import DataError
from vo_lib.files import (
    DRAFT,
    LOCK,
    delete_abandoned_drafts,
    locked_draft,
    only_process,
    write_atomic,
    written_together,
)

BEFORE = {"b.txt": "old b", "d.txt": "old d", "end.json": "old end", "stale.png": "old picture"}


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


def replace_files(folder: Path, *names: str, last: str = "", subfolder: str = "", stop: bool = False) -> None:
    """Replace files of a folder by new ones with these names, and delete stale.png.

    last : as in `written_together`; subfolder : one among the new files, which cannot replace a file.
    stop : press Ctrl-C before the files are complete.
    """
    with written_together(folder, last, stale=["stale.png", "never.png"]) as draft:
        for name in names:
            write_atomic(draft / name, f"new {name}")
        if subfolder:
            (draft / subfolder).mkdir()
        if stop:
            raise KeyboardInterrupt


def test_all_files_are_replaced_and_stale_ones_deleted(folder: Path) -> None:
    replace_files(folder, "a.txt", "b.txt", "end.json" + DRAFT, last="end.json")
    assert texts(folder) == {
        "a.txt": "new a.txt",
        "b.txt": "new b.txt",
        "d.txt": "old d",
        "end.json": "new end.json" + DRAFT,
    }


def test_a_file_that_cannot_be_replaced_leaves_the_earlier_files(folder: Path) -> None:
    with pytest.raises(DataError, match="results: cannot be written: "):
        replace_files(folder, "a.txt", "b.txt", subfolder="d.txt")
    assert texts(folder) == BEFORE


def test_a_folder_in_the_place_of_a_file_leaves_the_earlier_files(folder: Path) -> None:
    (folder / "c.txt" / "inner").mkdir(parents=True)
    with pytest.raises(DataError, match="results: cannot be written: "):
        replace_files(folder, "a.txt", "b.txt", "c.txt", "end.json" + DRAFT, last="end.json")
    assert texts(folder) == BEFORE


def test_a_missing_last_file_leaves_the_earlier_files(folder: Path) -> None:
    with pytest.raises(DataError, match="results: cannot be written: "):
        replace_files(folder, "a.txt", "b.txt", last="end.json")
    assert texts(folder) == BEFORE


def test_a_link_is_restored_as_a_link(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere.txt").write_text("elsewhere", encoding="utf-8")
    (folder / "c.txt").symlink_to("../elsewhere.txt")
    with pytest.raises(DataError, match="results: cannot be written: "):
        replace_files(folder, "b.txt", "c.txt", subfolder="d.txt")
    assert (folder / "c.txt").is_symlink()
    assert texts(folder) == BEFORE | {"c.txt": "elsewhere"}


def test_an_interruption_leaves_the_earlier_files(folder: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        replace_files(folder, "a.txt", "b.txt", "end.json" + DRAFT, last="end.json", stop=True)
    assert texts(folder) == BEFORE


def test_drafts_of_killed_processes_are_deleted_by_the_next_one(folder: Path) -> None:
    for draft in (f".earlier.1.2{DRAFT}", f".film.webm.1.2{DRAFT}"):
        (folder / draft).mkdir()
        (folder / draft / "part").write_text("half", encoding="utf-8")
    (folder / f".film.webm.1.2{DRAFT}{LOCK}").write_text("", encoding="utf-8")  # its holder is gone
    with only_process(folder):
        pass
    assert texts(folder) == BEFORE


@pytest.mark.parametrize(
    ("name", "remaining"),
    [
        ("film", ["", "film.2", "film2"]),
        ("film.2", ["", "film", "film2"]),
        ("fil", ["", "film", "film.2", "film2"]),
        ("", ["", "film", "film.2", "film2"]),
        (None, [""]),
    ],
)
def test_only_the_drafts_of_the_named_file_are_deleted(
    tmp_path: Path, name: str | None, remaining: list[str]
) -> None:
    for of in ("film", "film.2", "film2", ""):  # the last one is no name of a draft
        draft = f".{of}.1.2{DRAFT}"
        for file in (draft, draft + LOCK):  # a lock that nobody holds
            (tmp_path / file).write_text("half", encoding="utf-8")
    deleted = delete_abandoned_drafts(tmp_path, name)
    drafts = {f".{of}.1.2{DRAFT}": of for of in ("film", "film.2", "film2", "")}
    assert sorted(drafts[path.name] for path in tmp_path.iterdir() if path.name in drafts) == remaining
    assert deleted == len("half") * (len(drafts) - len(remaining))


def test_a_draft_in_use_stays_while_others_work_in_the_folder(folder: Path) -> None:
    with locked_draft(folder / "film.webm") as draft:
        draft.mkdir()
        (draft / "part").write_text("half", encoding="utf-8")
        with only_process(folder):
            pass
        assert (draft / "part").read_text(encoding="utf-8") == "half"
    assert texts(folder) == BEFORE
