"""The cache: drafts of killed processes, files without use, and files of somebody else."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from data_command import load
from tiny_onnx import write_answering

from vo_lib import open_sequence, preset
from vo_lib.commands.cache_contents import cache_items, clean_cache
from vo_lib.commands.cli import main
from vo_lib.data.drawn import ensure_scene
from vo_lib.data.imports import remember_import
from vo_lib.data.label_names import DETECTOR_RECORD
from vo_lib.data.scenes import scene_config
from vo_lib.detection.label_folders import labelled_sequence
from vo_lib.detection.network_image import yolox_cells
from vo_lib.runs.earlier_seconds import write_seconds
from vo_lib.runs.match_cache import CachedMatches, code_folder

TINY = {"width": 160, "height": 64, "length": 2.0, "speed": 8.0}
DRAWING = "data render_synthetic empty --jobs 1 --width 160 --height 64 --length 2 --speed 8"
MATCHING = "run {bands} --keep-matches --out {out}"


def drafts(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob(".*")]


def has_draft(folder: Path) -> bool:
    """Whether there is a draft; those that are renamed meanwhile do not disturb `os.walk`."""
    for _, folders, files in os.walk(folder):
        if any(name.startswith(".") and name.endswith(".tmp") for name in folders + files):
            return True
    return False


def kill_with_draft(words: list[str], folder: Path) -> None:
    """Start `vo`, and kill it and its processes when a draft appears in a folder."""
    command = [sys.executable, "-m", "vo_lib", *words]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)
    while not has_draft(folder) and process.poll() is None:
        time.sleep(0.001)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "the work was done before it could be killed"
    assert drafts(folder)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("words", [DRAWING, MATCHING], ids=["drawing", "matching"])
def test_draft_of_a_killed_command_is_deleted(bands: Path, tmp_path: Path, words: str) -> None:
    cache = tmp_path / "cache"
    kill_with_draft([*words.format(bands=bands, out=tmp_path / "out").split(), "--cache", str(cache)], cache)
    assert load("clean_cache")(["--cache", str(cache)]) == 0
    assert not any(path.is_file() for path in cache.rglob("*"))


def test_draft_in_use_is_kept(bands: Path, tmp_path: Path) -> None:
    matches = iter(CachedMatches(open_sequence(bands), preset("feature_selection"), tmp_path))
    next(matches)
    written = drafts(tmp_path)
    assert len(written) == 2  # the draft and its lock
    assert load("clean_cache")(["--cache", str(tmp_path)]) == 0
    assert drafts(tmp_path) == written
    assert sum(1 for _ in matches) == 5
    assert drafts(tmp_path) == []


@pytest.fixture
def user_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache folder, empty; the kit's results are written there."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    folder = tmp_path / "user" / "stereo-vo-kit"
    for module in ("image_hashes", "imports"):
        monkeypatch.setattr(f"vo_lib.data.{module}.user_cache", lambda: folder)
    return folder


def fill(bands: Path, cache: Path | None) -> None:
    """Draw a scene, store matches and hashes, detect vehicles; remember an import in the user's cache."""
    ensure_scene(scene_config("empty", **TINY), cache, jobs=1)
    sequence = open_sequence(bands)
    matches = CachedMatches(sequence, preset("feature_selection"), cache)
    matches.fill()
    write_seconds(matches, 1.0)
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    model = write_answering(bands.parent / "blind.onnx", answer, names="['car']")
    labelled_sequence(sequence, model, cache=cache)
    if cache is None:
        remember_import(bands)


def test_files_without_use_are_deleted_and_their_size_is_printed(
    bands: Path, user_cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    fill(bands, None)
    kinds = {item.kind: item for item in cache_items()}
    assert kinds.keys() == {"scenes", "matches", "labels", "hashes", "imports"}
    assert {kind for kind, item in kinds.items() if item.useful} == {"scenes", "matches", "labels", "imports"}
    # The same of another version of the kit.
    scene = kinds["scenes"].path
    old = scene.with_name("empty-0123456789ab")
    shutil.copytree(scene, old)
    odd = scene.with_name("empty-0123456789cd-0-5")
    shutil.copytree(scene, odd)
    (odd / "truth" / "scene.json").write_text('{"config": {"colour": 3}}', encoding="utf-8")
    matches = user_cache / "matches" / "kit-0123456789abcdef"
    matches.mkdir()
    remember_import(bands.parent / "deleted since")
    forgotten = [item.path for item in cache_items() if item.kind == "imports" and not item.useful]
    labels = shutil.copytree(kinds["labels"].path, user_cache / "labels" / "older")
    record = json.loads((labels / DETECTOR_RECORD).read_text(encoding="utf-8"))
    del record["settings"]["nms"]
    (labels / DETECTOR_RECORD).write_text(json.dumps(record), encoding="utf-8")
    draft = scene.with_name(f".{scene.name}.abcdefgh")  # as older versions named it
    (draft / "image_0").mkdir(parents=True)
    os.utime(draft, (time.time() - 7200,) * 2)
    assert main(["check"]) == 0
    printed = capsys.readouterr().out
    for kind in ("scenes", "matches", "labels", "hashes", "imports", "drafts"):
        assert f"{kind}: " in printed
    assert load("clean_cache")([]) == 0
    for path in (old, odd, matches, labels, draft, kinds["hashes"].path, *forgotten):
        assert not path.exists(), path
    assert len(forgotten) == 1
    for kind in ("scenes", "matches", "labels", "imports"):
        assert kinds[kind].path.exists(), kind
    assert load("clean_cache")(["--all"]) == 0
    assert cache_items() == []
    assert [path for path in user_cache.rglob("*") if path.is_file()] == []


def bytes_on_disk(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


@pytest.mark.parametrize("age_s", [0.0, 7200.0], ids=["written", "left behind"])
def test_draft_among_matches_counts_once(bands: Path, user_cache: Path, age_s: float) -> None:
    CachedMatches(open_sequence(bands), preset("feature_selection")).fill()
    draft = code_folder("published") / ".other.npz.1.2.tmp"  # without a lock, as older versions wrote them
    draft.write_bytes(bytes(3_000_000))
    os.utime(draft, (time.time() - age_s,) * 2)
    sizes = {item.path: item.size for item in cache_items()}
    assert sizes[draft] == 3_000_000
    assert sum(sizes.values()) == bytes_on_disk(user_cache)
    for everything in (False, True):
        size_before = bytes_on_disk(user_cache)
        assert clean_cache(everything=everything).deleted == size_before - bytes_on_disk(user_cache)
        assert draft.exists() == (age_s == 0 and not everything)
    assert bytes_on_disk(user_cache) == 0


@pytest.mark.skipif(os.name != "posix", reason="links without special rights")
def test_link_in_the_cache_has_no_size(user_cache: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "other disk"
    elsewhere.mkdir()
    (elsewhere / "a.npz").write_bytes(bytes(1000))
    matches = user_cache / "matches"
    old = matches / "kit-0123456789abcdef"
    old.mkdir(parents=True)
    (old / "b-0123456789abcdef.npz").symlink_to(elsewhere / "a.npz")
    (matches / "kit-0123456789abcdee").symlink_to(elsewhere, target_is_directory=True)
    assert [item.size for item in cache_items()] == [0, 0]
    cleaned = clean_cache()
    assert cleaned.deleted == 0
    # The kit makes no links, so these are the reader's.
    assert sorted(cleaned.kept) == [matches / "kit-0123456789abcdee", old / "b-0123456789abcdef.npz"]
    assert (matches / "kit-0123456789abcdee" / "a.npz").stat().st_size == 1000
    assert (old / "b-0123456789abcdef.npz").stat().st_size == 1000


def test_matches_of_another_library_have_no_use(
    bands: Path, user_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    CachedMatches(open_sequence(bands), preset("feature_selection")).fill()
    assert [item.useful for item in cache_items() if item.kind == "matches"] == [True]
    monkeypatch.setattr("cv2.__version__", "4.0.0")
    assert [item.useful for item in cache_items() if item.kind == "matches"] == [False]
    assert load("clean_cache")([]) == 0
    assert not list(user_cache.rglob("*.npz"))


def test_files_of_somebody_else_in_the_cache_are_kept(bands: Path, user_cache: Path, tmp_path: Path) -> None:
    cache = tmp_path / "mine"
    names = (
        "matches/chess.txt",
        "matches/published/a.npz",
        "labels/set/000000.txt",
        "labels/other/detector.json",
        "hashes/0123456789abcdef.json",
        "empty-0123456789ab/notes.txt",
        ".thesis-0123456789ab.draft/a.tex",
        ".a.1.2.tmp",
        "synthetic/a.png",
    )
    for name in names:
        path = cache / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{}", encoding="utf-8")
        os.utime(path.parent, (0, 0))
    fill(bands, cache)
    assert load("clean_cache")(["--cache", str(cache), "--all"]) == 0
    left = {path.relative_to(cache).as_posix() for path in cache.rglob("*") if path.is_file()}
    assert left == set(names)


def test_cache_takes_a_folder_and_never_the_sequence(
    bands: Path, tmp_path: Path, user_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["--cache", str(bands)], ["--cache", "kitti/98"]):
        assert main(["run", *words, "--out", str(tmp_path / "out")]) == 2
        assert f"missing: a sequence (`vo list`); --cache takes a folder, here {words[1]}" in " ".join(
            capsys.readouterr().err.split()
        )
    assert not (tmp_path / "out").exists()
    # The flag for the matches has no value, so the next word is the sequence.
    assert main(["run", "--keep-matches", str(bands), "--out", str(tmp_path / "out")]) == 0
    assert len(list(user_cache.rglob("*.npz"))) == 1
    assert not list(bands.rglob("*.npz"))


def write(path: Path, text: str = "mine\n") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def files_in(folder: Path) -> set[str]:
    """Files, links, and folders without content."""
    found = set()
    for place, folders, files in os.walk(folder):
        links = [name for name in folders if Path(place, name).is_symlink()]
        found |= {Path(place, name).relative_to(folder).as_posix() for name in [*files, *links]}
        if not folders and not files:
            found.add(Path(place).relative_to(folder).as_posix() + "/")
    return found


def words(text: str) -> str:
    return " ".join(text.split())


OWN = (
    "my_labels/000000.txt",
    "labels_yolo/000000.txt",
    "labels_yolo/detector.json",
    "notes.txt",
    ".hidden",
    "image_0/000000.png.bak",
    "image_0/mine/000000.png",
    "image_2/000000.png",
    "truth/my_truth.csv",
    "truth/instance/000000.txt",
    "labels/sub/000000.txt",
)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ensure_scene(scene_config("empty", **TINY), tmp_path_factory.mktemp("drawn"), jobs=1)


@pytest.mark.parametrize("name", OWN)
@pytest.mark.parametrize("part", ["", "-0-2"])
def test_files_of_the_reader_in_a_scene_are_kept_and_named(
    name: str, part: str, drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = shutil.copytree(drawn, tmp_path / f"jam-000000000000{part}")
    own = write(old / name)
    assert load("clean_cache")(["--cache", str(tmp_path)]) == 0
    assert own.read_text(encoding="utf-8") == "mine\n"
    left = files_in(old)
    if name.startswith("labels/"):  # then they are all somebody else's
        assert {file for file in left if not file.startswith("labels/")} == set()
    else:
        assert left == {name}
    printed = words(capsys.readouterr().out)
    assert printed.count("kept, as files or links of your own:") == 1
    uppermost = name if name.startswith(("image_0", "truth")) else name.split("/")[0]
    assert f"{old.name}/{'image_0/mine' if 'mine' in name else uppermost}" in printed
    # A second time, there is nothing to delete, so nothing to keep.
    assert load("clean_cache")(["--cache", str(tmp_path), "--all"]) == 0
    assert files_in(old) == left


def test_labels_of_a_detector_in_the_place_of_the_drawn_ones_are_kept(
    drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = shutil.copytree(drawn, tmp_path / "empty-000000000000")
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    model = write_answering(tmp_path / "blind.onnx", answer, names="['car']")
    for words_of_out in (["--replace"], ["--out", str(old / "labels_blind")]):
        assert load("write_labels")([str(old), "--model", str(model), *words_of_out]) == 0
    capsys.readouterr()
    frames = ["000000.txt", "000001.txt", "000002.txt"]
    names = [*frames, "detector.json", "images.sha256"]
    expected = {f"{folder}/{name}" for folder in ("labels", "labels_blind") for name in names}
    assert load("clean_cache")(["--cache", str(tmp_path)]) == 0
    assert files_in(old) == expected
    assert "own: empty-000000000000/labels, empty-000000000000/labels_blind" in words(capsys.readouterr().out)


@pytest.mark.parametrize("name", ["labels/000001.txt", "image_0/000001.png", "calib.txt"])
def test_drawn_file_that_the_reader_changed_is_kept(name: str, drawn: Path, tmp_path: Path) -> None:
    old = shutil.copytree(drawn, tmp_path / "empty-000000000000")
    later = (old / "image_1" / "000002.png").stat().st_mtime + 60.0
    os.utime(write(old / name), (later, later))
    assert clean_cache(tmp_path).kept == [old / name]
    assert files_in(old) == {name}


@pytest.mark.parametrize("name", [*OWN, "labels/000001.txt"])
def test_scene_is_drawn_again_around_the_files_of_the_reader(name: str, tmp_path: Path, drawn: Path) -> None:
    scene = shutil.copytree(drawn, tmp_path / drawn.name)
    own = write(scene / name)
    later = time.time() + 60.0
    os.utime(own, (later, later))
    before = files_in(scene)
    assert clean_cache(tmp_path, everything=True).kept
    assert not (scene / "calib.txt").exists()
    assert ensure_scene(scene_config("empty", **TINY), tmp_path, jobs=1) == scene
    assert files_in(scene) == before
    assert own.read_text(encoding="utf-8") == "mine\n"
    for file in files_in(drawn) - {name}:
        assert (scene / file).read_bytes() == (drawn / file).read_bytes()
    assert len(open_sequence(scene)) == 3
    assert list(tmp_path.iterdir()) == [scene]


@pytest.mark.skipif(os.name != "posix", reason="links without special rights")
def test_no_link_is_followed_out_of_the_cache(drawn: Path, tmp_path: Path, user_cache: Path) -> None:
    disk = tmp_path / "other disk"
    scene = shutil.copytree(drawn, disk / "synthetic" / "jam-000000000000")
    write(disk / "matches" / "kit-0123456789abcdef" / "a-0123456789abcdef.npz")
    write(disk / "hashes" / "0123456789abcdef.json")
    write(disk / "imported" / "0123456789abcdef.txt")
    record = {"model": "a", "sha256": "b", "settings": {}}
    write(disk / "labels" / "older" / DETECTOR_RECORD, json.dumps(record))
    old_draft = disk / "synthetic" / ".jam-000000000000.1.2.tmp"
    write(old_draft / "calib.txt")
    write(old_draft.with_name(old_draft.name + ".lock"), "")
    before = files_in(disk)
    user_cache.mkdir(parents=True)
    for folder in disk.iterdir():
        (user_cache / folder.name).symlink_to(folder)
    for everything in (False, True):
        cleaned = clean_cache(everything=everything)
        assert cleaned.deleted == 0
        assert sorted(path.name for path in cleaned.kept) == sorted(path.name for path in disk.iterdir())
    other = tmp_path / "other cache"
    inside = shutil.copytree(drawn, other / "jam-000000000001")
    shutil.rmtree(inside / "image_0")
    (inside / "image_0").symlink_to(scene / "image_0")
    (inside / "my_data").symlink_to(disk)
    (other / "jam-000000000002").symlink_to(scene)
    (other / "labels").symlink_to(disk / "labels")
    clean_cache(other, everything=True)
    left = {"jam-000000000001/image_0", "jam-000000000001/my_data", "jam-000000000002", "labels"}
    assert files_in(other) == left
    assert files_in(disk) == before


def test_files_of_the_reader_beside_other_kinds_are_kept(
    bands: Path, user_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill(bands, None)
    (labels,) = (item.path for item in cache_items() if item.kind == "labels")
    corrected = shutil.copytree(labels, labels.with_name("corrected"))
    later = (corrected / "images.sha256").stat().st_mtime + 60.0
    os.utime(corrected / "000000.txt", (later, later))
    draft = user_cache / "synthetic" / ".jam-000000000000.1.2.tmp"
    locked = user_cache / "synthetic" / ".jam-000000000001.1.2.tmp"
    own = {
        write(labels / "classes.txt"),
        write(labels / "mine" / "000000.txt"),
        write(code_folder("published") / "notes.md"),
        write(code_folder("published") / "result.npz"),
        write(user_cache / "matches" / "kit-0123456789abcdef" / "plots" / "a-0123456789abcdef.npz"),
        write(user_cache / "hashes" / "mine.json"),
        write(user_cache / "hashes" / "0123456789abcdef.json" / "a"),
        write(user_cache / "imported" / "notes.txt"),
        write(user_cache / "matches" / "notes.txt"),
        write(user_cache / "matches" / "mine" / "a.npz"),
        write(user_cache / "synthetic" / ".jam-000000000000.txt"),
        write(draft / "my_labels" / "000000.txt"),
        write(locked / "my_labels" / "000000.txt"),
        *corrected.iterdir(),
    }
    for folder in (draft, locked):
        write(folder / "calib.txt")
    write(locked.with_name(locked.name + ".lock"), "")
    os.utime(draft, (0, 0))
    assert load("clean_cache")(["--all"]) == 0
    assert {user_cache / name for name in files_in(user_cache) if not name.endswith("/")} == own
    printed = words(capsys.readouterr().out)
    for path in (
        labels / "classes.txt",
        labels / "mine",
        corrected,
        draft / "my_labels",
        locked / "my_labels",
    ):
        assert path.relative_to(user_cache).as_posix() in printed
