"""The contents of the cache that the kit wrote: scenes, matches, labels, hashes, records of imports, drafts.

A cache folder may be any folder of the reader, who may also keep files in a folder of the kit, such as labels
in that of a scene. So everything is recognised by its name and content, file by file; what the kit did not
write is never deleted. No link is followed out of the cache.
"""

from __future__ import annotations

import dataclasses
import os
import re
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ..data.drawn import scene_key, scenes_folder, user_cache
from ..data.image_hashes import hash_folder
from ..data.imports import import_records, record_folder
from ..data.label_names import DETECTOR_RECORD
from ..data.scene_files import SCENE_FILE, SCENE_FILES, SCENE_FOLDERS, has_other_labels
from ..data.scenes import SceneConfig
from ..detection.label_folders import IMAGE_LIST, RECORD_KEYS, is_current_record
from ..errors import DataError
from ..files import DRAFT, DRAFT_NAME, LOCK, delete_abandoned_drafts, read_mapping
from ..runs.earlier_seconds import TIME_ENDING
from ..runs.identity import FRONT_END_CODE
from ..runs.match_cache import code_folder, match_folder
from ..settings import from_dict

KINDS = ("scenes", "matches", "labels", "hashes", "imports", "drafts")
SCENE = re.compile(r"([a-z_]+-[0-9a-f]{12})(-\d+-\d+)?")  # its key and, for a part, the numbers of the frames
CODE_FOLDER = re.compile(r"(published|kit)-[0-9a-f]{16}")
HASHES = re.compile(r"[0-9a-f]{16}\.json")
# The names of drafts (`files.writing`) of each kind. Those of hashes have no lock, and those of
# older versions neither.
DRAFT_OF = {
    "matches": re.compile(r"\..+\.npz\.\d+\.\d+" + re.escape(DRAFT)),
    "hashes": re.compile(r"\.[0-9a-f]{16}\.json\.\d+\.\d+" + re.escape(DRAFT)),
    "scenes": re.compile(
        r"\.[a-z_]+-[0-9a-f]{12}(-\d+-\d+)?\.([a-z0-9_]{8}|\d+\.\d+" + re.escape(DRAFT) + ")"
    ),
}
UNUSED_DRAFT_S = 3600.0  # age of a draft without a lock that no process writes any more
# A file that is so much younger than the last file that the kit wrote beside it was changed by somebody else.
CHANGED_S = 10.0


@dataclass(frozen=True)
class Layout:
    """What the kit writes into a folder of the cache, apart from drafts.

    files : the paths of its files in the folder.
    folders : the paths of the folders in it.
    """

    files: re.Pattern[str]
    folders: tuple[str, ...] = ()


SCENE_LAYOUT = Layout(SCENE_FILES, SCENE_FOLDERS)
# The matches of a sequence, and the time that they took.
MATCHES_LAYOUT = Layout(re.compile(rf"[A-Za-z0-9_-]+-[0-9a-f]{{16}}(\.npz|{re.escape(TIME_ENDING)})"))
LABELS_LAYOUT = Layout(re.compile(rf"[0-9]+\.txt|{re.escape(DETECTOR_RECORD)}|{re.escape(IMAGE_LIST)}"))


@dataclass(frozen=True)
class CacheItem:
    """A file or folder of the cache.

    kind : one of `KINDS`.
    size : bytes that its deletion frees.
    useful : whether `clean_cache` keeps it: this version has a use for it, and does not make it again in
        seconds. A draft without use was left by a killed process.
    files : the files that the kit wrote, without those of other items, in the order of their deletion.
    folders : the folders that the kit made, inner ones first.
    others : files, folders and links in it that the kit did not write, or that somebody has changed since. A
        folder stands for all that lies in it.
    """

    path: Path
    kind: str
    size: int
    useful: bool
    files: tuple[Path, ...]
    folders: tuple[Path, ...]
    others: tuple[Path, ...]


class Cleaned(NamedTuple):
    """What `clean_cache` has done.

    deleted : the number of bytes.
    kept : what it found in folders without use and did not delete (see `CacheItem.others`).
    """

    deleted: int
    kept: list[Path]


def cache_items(cache: Path | None = None) -> list[CacheItem]:
    """Everything in a cache folder, by default the user's, that the kit wrote there."""
    root = user_cache() if cache is None else cache
    kinds: list[tuple[str, Path, Callable[[Path], Iterator[CacheItem]]]] = [
        ("matches", match_folder(cache), _matches),
        ("labels", root / "labels", _labels),
    ]
    items = list[CacheItem]()
    if cache is None:
        # Only the user's cache has hashes of images, records of imported sequences, and drafts of scenes by
        # versions that did not lock them.
        kinds += [
            ("scenes", scenes_folder(), _scenes),
            ("hashes", hash_folder(), _hashes),
            ("imports", record_folder(), _imports),
            ("drafts", scenes_folder(), _scene_drafts),
        ]
    else:
        # Here, the scenes lie in the cache folder itself. It may be a link, since a person has named it.
        items += _scenes(cache)
    for kind, folder, find in kinds:
        if not folder.is_symlink():
            items += find(folder)
        elif kind != "drafts":  # "scenes" has named this link: both are in one folder
            items.append(_link(folder, kind))
    return items


def clean_cache(cache: Path | None = None, everything: bool = False) -> Cleaned:
    """Delete what has no use for this version, or everything that the kit wrote."""
    deleted = 0
    kept = list[Path]()

    def delete_draft(path: Path) -> int:
        draft = _draft(path, useful=False)
        kept.extend(draft.others)
        return _delete(draft)

    if cache is not None or not scenes_folder().is_symlink():
        scenes = scenes_folder() if cache is None else cache
        deleted += delete_abandoned_drafts(scenes, delete=delete_draft)
    if not match_folder(cache).is_symlink():
        for variant in FRONT_END_CODE:
            folder = code_folder(variant, cache)
            if not folder.is_symlink():
                deleted += delete_abandoned_drafts(folder, delete=delete_draft)
    for item in cache_items(cache):
        if everything or not item.useful:
            deleted += _delete(item)
            kept += item.others
    return Cleaned(deleted, list(dict.fromkeys(kept)))


def _delete(item: CacheItem) -> int:
    """Delete the files of an item, and its folders if they are empty then; return the number of bytes."""
    deleted = 0
    for file in item.files:
        with suppress(OSError):  # gone meanwhile, or protected
            size = _size(file)
            file.unlink()
            deleted += size
    for folder in item.folders:
        with suppress(OSError):
            folder.rmdir()
    return deleted


def _size(file: Path) -> int:
    """Bytes of a file; 0 if it is missing."""
    try:
        return file.lstat().st_size
    except OSError:
        return 0


def _content(folder: Path) -> list[Path]:
    """The files and folders in a folder, sorted; none if it is missing."""
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _item(
    path: Path,
    kind: str,
    useful: bool,
    files: Sequence[Path] = (),
    folders: Sequence[Path] = (),
    others: Sequence[Path] = (),
) -> CacheItem:
    """An item, with its size."""
    size = sum(_size(file) for file in files)
    return CacheItem(path, kind, size, useful, tuple(files), tuple(folders), tuple(others))


def _link(path: Path, kind: str) -> CacheItem:
    """A link in the place of a file or folder of the kit, which makes none."""
    return _item(path, kind, useful=False, others=[path])


def _file(path: Path, kind: str, useful: bool) -> Iterator[CacheItem]:
    """The item of a file that has a name of the kit; none for a folder of this name."""
    if path.is_symlink():
        yield _link(path, kind)
    elif path.is_file():
        yield _item(path, kind, useful, files=[path])


def _folder(
    path: Path,
    kind: str,
    useful: bool,
    layout: Layout,
    *,
    apart: Collection[Path] = (),
    changed: Collection[Path] = (),
) -> CacheItem:
    """The item of a folder.

    apart : files in it that are items of their own.
    changed : files and folders in it that have a name of the kit, but are somebody else's.
    """
    files = list[Path]()
    folders = [path]
    others = list[Path]()
    for place, folder_names, file_names in os.walk(path):
        for name in sorted(folder_names):
            folder = Path(place, name)
            is_named_so = folder.relative_to(path).as_posix() in layout.folders
            if is_named_so and not folder.is_symlink() and folder not in changed:
                folders.append(folder)
            else:
                others.append(folder)
                folder_names.remove(name)  # so that `os.walk` does not enter it
        for name in sorted(file_names):
            file = Path(place, name)
            is_named_so = layout.files.fullmatch(file.relative_to(path).as_posix()) is not None
            if file in apart:
                continue
            if (is_named_so or _is_draft_or_lock(name)) and not file.is_symlink() and file not in changed:
                files.append(file)
            else:
                others.append(file)
    folders.reverse()
    return _item(path, kind, useful, files, folders, others)


def _is_draft_or_lock(name: str) -> bool:
    """Whether a file has the name of a draft, of its lock, or of the lock of a folder."""
    return name == LOCK or DRAFT_NAME.fullmatch(name.removesuffix(LOCK)) is not None


def _scenes(folder: Path) -> Iterator[CacheItem]:
    """Drawn scenes; one has a use if this version would give it the same name."""
    for path in _content(folder):
        found = SCENE.fullmatch(path.name)
        description = path / SCENE_FILE
        if found is None:
            continue
        if path.is_symlink():
            yield _link(path, "scenes")
            continue
        if not description.is_file():
            continue
        try:
            config = from_dict(SceneConfig, read_mapping(description, "a scene's settings")["config"])
            useful = scene_key(config) == found[1]
        except (DataError, KeyError):  # the settings of another version
            useful = False
        yield _scene(path, "scenes", useful)


def _scene(path: Path, kind: str, useful: bool) -> CacheItem:
    """The item of a scene or of the draft of one.

    Labels that a person or a detector has put in the place of the drawn ones cost time to make again, so they
    are the reader's.
    """
    drawn = [_time(file) for file in path.glob("truth/instance/*.png")]
    candidates = [*path.glob("*.txt"), *path.glob("image_[01]/*"), *path.glob("labels/*")]
    changed = {file for file in candidates if drawn and _time(file) > max(drawn) + CHANGED_S}
    if has_other_labels(path):
        changed.add(path / "labels")
    item = _folder(path, kind, useful, SCENE_LAYOUT, changed=changed)
    # Without this file, the rest is no scene any more: what is deleted in part is drawn again.
    files = sorted(item.files, key=lambda file: file != path / SCENE_FILE)
    return dataclasses.replace(item, files=tuple(files))


def _time(path: Path) -> float:
    """When a file was last written, in seconds."""
    return path.lstat().st_mtime


def _matches(folder: Path) -> Iterator[CacheItem]:
    """Folders of matches; those by the present code of a front end have a use."""
    current = {code_folder(variant).name for variant in FRONT_END_CODE}
    for path in _content(folder):
        if CODE_FOLDER.fullmatch(path.name) is None:
            continue
        if path.is_symlink():
            yield _link(path, "matches")
        elif path.is_dir():
            # In a folder of other code, a draft is as useless as its folder, and no item of its own.
            is_current = path.name in current
            drafts = list(_drafts(path, DRAFT_OF["matches"])) if is_current else []
            apart = [draft.path for draft in drafts]
            yield _folder(path, "matches", is_current, MATCHES_LAYOUT, apart=apart)
            yield from drafts


def _labels(folder: Path) -> Iterator[CacheItem]:
    """Folders of detected labels, which have the record of a detector."""
    for path in _content(folder):
        if path.is_symlink():
            continue
        try:
            record = read_mapping(path / DETECTOR_RECORD, "the record of a detector")
        except DataError:
            continue
        if not record.keys() >= RECORD_KEYS:
            continue
        useful = is_current_record(record)
        # The list is written after each label. If a label was corrected by hand since, the whole folder is
        # the reader's: without the record, the kit would replace that label.
        image_list = path / IMAGE_LIST
        labels = list(path.glob("*.txt"))
        if image_list.is_file() and any(_time(file) > _time(image_list) + CHANGED_S for file in labels):
            yield _item(path, "labels", useful, others=[path])
        else:
            yield _folder(path, "labels", useful, LABELS_LAYOUT)


def _hashes(folder: Path) -> Iterator[CacheItem]:
    """Hashes of images, and their drafts; none counts as useful, since they are computed in seconds."""
    for path in _content(folder):
        if HASHES.fullmatch(path.name):
            yield from _file(path, "hashes", useful=False)
    yield from _drafts(folder, DRAFT_OF["hashes"])


def _imports(_: Path) -> Iterator[CacheItem]:
    """Records of imported sequences; those of sequences that still exist have a use."""
    for record, sequence in import_records().items():
        yield from _file(record, "imports", sequence is not None)


def _scene_drafts(folder: Path) -> Iterator[CacheItem]:
    """Drafts of scenes by versions that did not lock them."""
    for draft in _drafts(folder, DRAFT_OF["scenes"]):
        if draft.path.is_dir():
            yield draft


def _drafts(folder: Path, pattern: re.Pattern[str]) -> Iterator[CacheItem]:
    """Drafts without a lock; `files.delete_abandoned_drafts` deletes the others."""
    for path in _content(folder):
        if pattern.fullmatch(path.name) and not path.with_name(path.name + LOCK).exists():
            age = time.time() - _time(path)
            yield _draft(path, age < UNUSED_DRAFT_S)


def _draft(path: Path, useful: bool) -> CacheItem:
    """The item of a draft: a file, or the folder of a scene."""
    if path.is_symlink():
        return _link(path, "drafts")
    if path.is_dir():
        return _scene(path, "drafts", useful)
    return _item(path, "drafts", useful, files=[path])
