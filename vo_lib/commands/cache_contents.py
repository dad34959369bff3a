"""The contents of the cache that the kit wrote: scenes, matches, labels, hashes, records of imports, drafts.

A cache folder may be any folder of the reader, so everything is recognised by its name and content; other
files are never listed.
"""

from __future__ import annotations

import re
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..data.drawn import scene_key, scenes_folder, user_cache
from ..data.image_hashes import hash_folder
from ..data.imports import import_records
from ..data.label_names import DETECTOR_RECORD
from ..data.scenes import SceneConfig
from ..detection.label_folders import RECORD_KEYS, is_current_record
from ..errors import DataError
from ..files import DRAFT, LOCK, delete_abandoned_drafts, delete_tree, read_mapping
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
    "scenes": re.compile(r"\.[a-z_]+-[0-9a-f]{12}(-\d+-\d+)?\.\w+(\.\d+" + re.escape(DRAFT) + ")?"),
}
UNUSED_DRAFT_S = 3600.0  # age of a draft without a lock that no process writes any more


@dataclass(frozen=True)
class CacheItem:
    """A file or folder of the cache.

    kind : one of `KINDS`.
    size : bytes that its deletion frees, without those of other items in it.
    useful : whether `clean_cache` keeps it: this version has a use for it, and does not make it again in
        seconds. A draft without use was left by a killed process.
    """

    path: Path
    kind: str
    size: int
    useful: bool


def cache_items(cache: Path | None = None) -> list[CacheItem]:
    """Everything in a cache folder, by default the user's, that the kit wrote there."""
    # In the user's cache, drawn scenes have a folder beside those of the others; elsewhere, they lie in the
    # cache folder itself.
    scenes = scenes_folder() if cache is None else cache
    root = user_cache() if cache is None else cache
    items = [*_scenes(scenes), *_matches(cache), *_labels(root / "labels")]
    # Only the user's cache has hashes of images, records of imported sequences, and drafts of scenes by
    # versions that did not lock them.
    if cache is None:
        items += [_item(record, "imports", folder is not None) for record, folder in import_records().items()]
        items += _hashes(hash_folder())
        items += _drafts(scenes, DRAFT_OF["scenes"])
    return items


def clean_cache(cache: Path | None = None, everything: bool = False) -> int:
    """Delete what has no use for this version, or everything that the kit wrote; return the bytes deleted."""
    folders = [scenes_folder() if cache is None else cache]
    folders += [code_folder(variant, cache) for variant in FRONT_END_CODE]
    deleted = sum(delete_abandoned_drafts(folder) for folder in folders)
    for item in cache_items(cache):
        if everything or not item.useful:
            # Measured only now: a draft may just have been deleted with its folder.
            before = _size(item.path)
            delete_tree(item.path)
            deleted += before - _size(item.path)
    return deleted


def _item(path: Path, kind: str, useful: bool, others: Collection[Path] = ()) -> CacheItem:
    """An item; `others` : files in its folder that are items of their own."""
    return CacheItem(path, kind, _size(path, others), useful)


def _size(path: Path, others: Collection[Path] = ()) -> int:
    """Bytes of a file, or of the files in a folder without those of `others`; 0 if it is missing.

    Links have no bytes of their own here: to delete one frees nothing, since its target stays.
    """
    if path.is_symlink():
        return 0
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(
        file.stat().st_size
        for file in files
        if file.is_file() and not file.is_symlink() and file not in others
    )


def _content(folder: Path) -> list[Path]:
    """The files and folders in a folder, sorted; none if it is missing."""
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _scenes(folder: Path) -> Iterator[CacheItem]:
    """Drawn scenes; one has a use if this version would give it the same name."""
    for path in _content(folder):
        found = SCENE.fullmatch(path.name)
        description = path / "truth" / "scene.json"
        if found is None or not description.is_file():
            continue
        try:
            config = from_dict(SceneConfig, read_mapping(description, "a scene's settings")["config"])
            useful = scene_key(config) == found[1]
        except (DataError, KeyError):  # the settings of another version
            useful = False
        yield _item(path, "scenes", useful)


def _matches(cache: Path | None) -> Iterator[CacheItem]:
    """Folders of matches; those by the present code of a front end have a use."""
    current = {code_folder(variant, cache) for variant in FRONT_END_CODE}
    for path in _content(match_folder(cache)):
        # All of the user's cache folder is the kit's own.
        if cache is None or CODE_FOLDER.fullmatch(path.name):
            # In a folder of other code, a draft is as useless as its folder, and no item of its own.
            drafts = list(_drafts(path, DRAFT_OF["matches"])) if path in current else []
            yield _item(path, "matches", path in current, [draft.path for draft in drafts])
            yield from drafts


def _labels(folder: Path) -> Iterator[CacheItem]:
    """Folders of detected labels, which have the record of a detector."""
    for path in _content(folder):
        try:
            record = read_mapping(path / DETECTOR_RECORD, "the record of a detector")
        except DataError:
            continue
        if record.keys() >= RECORD_KEYS:
            yield _item(path, "labels", is_current_record(record))


def _hashes(folder: Path) -> Iterator[CacheItem]:
    """Hashes of images, and their drafts; none counts as useful, since they are computed in seconds."""
    for path in _content(folder):
        if HASHES.fullmatch(path.name):
            yield _item(path, "hashes", False)
    yield from _drafts(folder, DRAFT_OF["hashes"])


def _drafts(folder: Path, pattern: re.Pattern[str]) -> Iterator[CacheItem]:
    """Drafts without a lock; `files.delete_abandoned_drafts` deletes the others."""
    for path in _content(folder):
        if pattern.fullmatch(path.name) and not path.with_name(path.name + LOCK).exists():
            age = time.time() - path.stat().st_mtime
            yield _item(path, "drafts", age < UNUSED_DRAFT_S)
