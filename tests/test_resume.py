"""A run stopped at any moment and started again gives the same bytes; a folder belongs to one run."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands

from vo_lib import DataError, Sequence, open_sequence, preset, run
from vo_lib.beyond.odometry import Odometry
from vo_lib.commands.cli import main
from vo_lib.config import Config
from vo_lib.core import settings
from vo_lib.runs.results import write_run
from vo_lib.runs.resume import only_process, resumable_run
from vo_lib.runs.run_log import CHECKPOINT, LOG, RunLog
from vo_lib.runs.runner import FoundMatches, Run

FRAMES = 14
COMMAND = "import sys; from vo_lib.cli import main; sys.exit(main())"


class Stopped(Exception):
    """Raised by a test in the middle of a run."""


@pytest.fixture
def sequence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sequence:
    """Fourteen frames with boxes, a checkpoint every five."""
    monkeypatch.setattr("vo_lib.runs.resume.EVERY", 5)
    folder = write_bands(tmp_path / "bands", frames=FRAMES)
    (folder / "labels").mkdir()
    for frame in range(FRAMES):
        (folder / "labels" / f"{frame:06d}.txt").write_text("2 0.25 0.5 0.3 0.8\n", encoding="utf-8")
    return open_sequence(folder)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty run folder."""
    (tmp_path / "run").mkdir()
    return tmp_path / "run"


def small(**changes: object) -> Config:
    config: Config = settings.replace(preset("feature_selection"), "features.cell", 14)
    for name, value in {"filter.min_matches": 10, "selection.sets": 20, **changes}.items():
        config = settings.replace(config, name.replace("__", "."), value)
    return config


def stop_at(frame: int) -> Callable[[int, int], None]:
    def progress(done: int, total: int) -> None:
        if done == frame:
            raise Stopped

    return progress


def log_of(folder: Path) -> list[dict[str, str]]:
    """The per-frame log without its times."""
    with open(folder / "frames.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if not name.endswith("_ms")} for row in rows]


def whole_run(sequence: Sequence, folder: Path, config: Config) -> Path:
    """A folder with the run done in one go, without any log."""
    folder.mkdir()
    write_run(folder, run(sequence, config), "m")
    return folder


@pytest.mark.parametrize("cached", [False, True])
@pytest.mark.parametrize("stops", [[1], [5], [6], [9, 12], [5, 6, 7, 8, 14]])
def test_a_stopped_run_goes_on_to_the_same_bytes(
    sequence: Sequence, folder: Path, tmp_path: Path, cached: bool, stops: list[int]
) -> None:
    whole = whole_run(sequence, tmp_path / "whole", small())
    start = partial(resumable_run, folder, sequence, small(), "m", cached=cached, cache=tmp_path / "cache")
    for stop in stops:
        with pytest.raises(Stopped):
            start(progress=stop_at(stop))
        assert (folder / LOG).exists() == (stop >= 5)
    seen: list[int] = []
    result, before = start(progress=lambda done, total: seen.append(done))
    assert not before
    assert len(result.motions) == FRAMES - 1
    assert seen[-1] == FRAMES
    # What the last checkpoint holds is not done again.
    assert seen[0] == {1: 1, 5: 5, 6: 5, 12: 10, 14: 14}[stops[-1]]
    assert (folder / "poses.txt").read_bytes() == (whole / "poses.txt").read_bytes()
    assert log_of(folder) == log_of(whole)
    assert not {LOG, CHECKPOINT, ".lock"} & {path.name for path in folder.iterdir()}


def test_a_run_begun_with_the_cache_goes_on_without_it_and_the_other_way(
    sequence: Sequence, folder: Path, tmp_path: Path
) -> None:
    poses = run(sequence, small()).poses
    for first in (True, False):
        with pytest.raises(Stopped):
            resumable_run(
                folder, sequence, small(), "m", cached=first, cache=tmp_path, fresh=True, progress=stop_at(8)
            )
        result, _ = resumable_run(folder, sequence, small(), "m", cached=not first, cache=tmp_path)
        assert result.poses.tobytes() == poses.tobytes()


@pytest.mark.parametrize("method", ["feature_selection", "viso2", "moving_selection", "blob_corner"])
def test_front_end_and_odometry_go_on_from_their_states(sequence: Sequence, method: str) -> None:
    front_end = "blob_corner" if method == "blob_corner" else "klt"
    config = preset("feature_selection" if method == "blob_corner" else method)
    config = dataclasses.replace(config, features=small().features)
    config = settings.replace(settings.replace(config, "selection.sets", 20), "reprojection.trials", 20)
    config = settings.replace(config, "matching.front_end", front_end)
    front = config.features, config.matching
    source, odometry = FoundMatches(sequence, *front), Odometry(sequence.camera, config)
    states, wanted = {}, []
    for index, (matches, _) in enumerate(source):
        boxes = sequence.boxes(index)
        if index:
            wanted.append(odometry.step(matches, boxes).T_cp.tobytes())
        else:
            odometry.start(boxes)
        states[index] = source.state(), odometry.state()
    for index in (0, 7, FRAMES - 2):
        again = Odometry(sequence.camera, config)
        again.restore(states[index][1])
        rest = FoundMatches(sequence, *front, start=index + 1, state=states[index][0])
        found = [again.step(m, sequence.boxes(index + 1 + i)).T_cp.tobytes() for i, (m, _) in enumerate(rest)]
        assert found == wanted[index:]


def test_a_finished_run_is_only_read(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _ = resumable_run(folder, sequence, small(), "m")
    written = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr("vo_lib.data.sequence.read_image", None)
    second, before = resumable_run(folder, sequence, small(), "m")
    assert before
    assert second.config == first.config
    np.testing.assert_allclose(second.poses, first.poses, atol=1e-8)
    for one, other in zip(first.motions, second.motions, strict=True):
        np.testing.assert_allclose(other.T_cp, one.T_cp, atol=1e-8)
        assert (other.matches, other.removed, other.flags) == (one.matches, one.removed, one.flags)
        assert other.ms == pytest.approx(one.ms, abs=0.01)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == written


@pytest.mark.parametrize("damage", [None, "{", "[]", '{"kitti": 3}'])
def test_missing_or_damaged_errors_of_a_finished_run_are_written_again(
    sequence: Sequence, folder: Path, damage: str | None
) -> None:
    resumable_run(folder, sequence, small(), "m")
    path = folder / "metrics.json"
    wanted = json.loads(path.read_text(encoding="utf-8"))
    if damage is None:
        path.unlink()
    else:
        path.write_text(damage, encoding="utf-8")
    resumable_run(folder, sequence, small(), "m")
    again = json.loads(path.read_text(encoding="utf-8"))
    assert again.keys() == wanted.keys()
    for kind, part in wanted.items():
        ate = part["sequences"][0]["ate"]
        assert again[kind]["sequences"][0]["ate"] == pytest.approx(ate, abs=1e-6)


def test_fresh_starts_anew_and_leaves_the_old_result_until_it_is_done(
    sequence: Sequence, folder: Path
) -> None:
    resumable_run(folder, sequence, small(), "m")
    written = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(Stopped):
        resumable_run(folder, sequence, small(seed=1), "m", fresh=True, progress=stop_at(2))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == written
    result, before = resumable_run(folder, sequence, small(seed=1), "m", fresh=True)
    assert not before
    assert result.config.seed == 1
    assert (folder / "poses.txt").read_bytes() != written["poses.txt"]


CHANGES: dict[str, tuple[dict[str, object], str]] = {
    "threshold": ({"selection__sets": 50}, "selection.sets is 20 there and 50 here"),
    "seed": ({"seed": 4}, "seed is 0 there and 4 here"),
    "several": (
        {"seed": 4, "filter__classes": (2,), "min_matches": 13, "buckets__size": 40},
        "and 1 more",
    ),
}


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("case", CHANGES)
def test_other_settings_in_the_same_folder_are_refused_by_name(
    sequence: Sequence, folder: Path, finished: bool, case: str
) -> None:
    begin(sequence, folder, finished)
    changes, words = CHANGES[case]
    with pytest.raises(DataError, match=words):
        resumable_run(folder, sequence, small(**changes), "m")
    assert resumable_run(folder, sequence, small(), "m")[1] == finished


def begin(sequence: Sequence, folder: Path, finished: bool) -> None:
    try:
        resumable_run(folder, sequence, small(), "m", progress=None if finished else stop_at(8))
    except Stopped:
        assert not finished


def test_another_method_sequence_label_or_code_is_refused_by_name(
    sequence: Sequence, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(sequence, folder, finished=False)

    def refused(other: Sequence, method: str = "m") -> str:
        with pytest.raises(DataError) as error:
            resumable_run(folder, other, small(), method)
        return str(error.value)

    assert "method is m there and n here" in refused(sequence, "n")
    assert "it has bands 000000-000013 and this is bands 000000-000006" in refused(sequence.part(0, 7))
    camera = dataclasses.replace(sequence.camera, f=301.0)
    assert "another calibration" in refused(dataclasses.replace(sequence, camera=camera))
    label = sequence.folder / "labels" / "000012.txt"
    text = label.read_text(encoding="utf-8")
    label.write_text(text.replace("0.25", "0.26"), encoding="utf-8")
    assert "other labels" in refused(sequence)
    label.write_text(text, encoding="utf-8")
    image = sequence.folder / "image_0" / "000012.png"
    data = image.read_bytes()
    image.write_bytes((sequence.folder / "image_0" / "000011.png").read_bytes())
    assert "other images" in refused(sequence)
    image.write_bytes(data)
    with monkeypatch.context() as patch:
        patch.setattr("vo_lib.runs.identity.code_digest", lambda *modules: "changed")
        assert "the kit's code has changed" in refused(sequence)
        patch.setattr("vo_lib.runs.identity.np.__version__", "1.0")
        assert "numpy is" in refused(sequence)
    assert not resumable_run(folder, sequence, small(), "m")[1]


def test_a_name_of_the_same_data_is_no_other_run(sequence: Sequence, folder: Path) -> None:
    begin(sequence, folder, finished=True)
    assert resumable_run(folder, dataclasses.replace(sequence, name="x"), small(), "m")[1]


def test_a_folder_of_something_else_is_refused(sequence: Sequence, folder: Path) -> None:
    damaged = '{"settings": {}, "frames": 5, "labels": [1], "made_with": 3}'
    for text in ("{}", "no JSON", "[1]", '{"settings": {}}', damaged):
        (folder / "config.json").write_text(text, encoding="utf-8")
        with pytest.raises(DataError):
            resumable_run(folder, sequence, small(), "m")


@pytest.mark.parametrize(
    "damage", ["checkpoint cut", "checkpoint lost", "log cut", "log garbled", "log of numbers"]
)
def test_a_damaged_log_means_doing_frames_again_never_a_wrong_result(
    sequence: Sequence, folder: Path, damage: str
) -> None:
    begin(sequence, folder, finished=False)
    log, checkpoint = folder / LOG, folder / CHECKPOINT
    lines = log.read_bytes().splitlines(keepends=True)
    if damage == "checkpoint cut":
        checkpoint.write_bytes(checkpoint.read_bytes()[:-20])
    elif damage == "checkpoint lost":
        checkpoint.unlink()
    elif damage == "log cut":
        log.write_bytes(b"".join(lines[:3]) + lines[3][:40])
    elif damage == "log of numbers":
        log.write_bytes(b"5\n" + b"".join(lines[1:]))
    else:
        log.write_bytes(b"".join(lines[:2]) + b"\0" * 300 + b"\n" + b"".join(lines[3:]))
    result, _ = resumable_run(folder, sequence, small(), "m")
    assert result.poses.tobytes() == run(sequence, small()).poses.tobytes()


def test_a_log_keeps_motions_to_the_last_bit(sequence: Sequence, folder: Path) -> None:
    motions = run(sequence, small()).motions
    log = RunLog.start(folder, {"who": "me"})
    for motion in motions:
        log.append(motion)
    log.checkpoint({"x": np.arange(3)})
    log.append(motions[0])
    log.close()
    found = RunLog.find(folder)
    assert found is not None
    found.close()
    assert found.identity == {"who": "me"}
    assert found.state["x"].tolist() == [0, 1, 2]
    assert repr(found.motions) == repr(motions)


def test_one_process_at_a_time_and_the_lock_of_a_killed_one_is_gone(sequence: Sequence, folder: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from vo_lib.resume import only_process\n"
        "with only_process(Path(sys.argv[1])):\n    print('in', flush=True); time.sleep(600)"
    )
    other = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    try:
        assert other.stdout.readline() == "in\n"
        with pytest.raises(DataError, match="another process is working in this folder"):
            resumable_run(folder, sequence, small(), "m")
    finally:
        other.kill()
        other.wait()
        other.stdout.close()
    assert (folder / ".lock").exists()
    resumable_run(folder, sequence, small(), "m")
    with only_process(folder), pytest.raises(DataError, match="another process"), only_process(folder):
        pass


def logged(folder: Path) -> int:
    try:
        return (folder / LOG).read_bytes().count(b"\n")
    except OSError:
        return 0


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(("cached", "kills"), [(False, [30, 77, 112]), (True, [66])])
def test_kill_9_at_any_moment_costs_fifty_frames_and_no_byte(
    tmp_path: Path, cached: bool, kills: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    bands = write_bands(tmp_path / "bands", frames=130)
    out = tmp_path / "out"
    words = ["run", str(bands), "--method", "solution_selection", "--out", str(out), "--features.cell", "20"]
    words += ["--selection.sets", "20", *(["--cache", str(tmp_path / "cache")] if cached else [])]
    for frames in kills:
        command = [sys.executable, "-c", COMMAND, *words]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while logged(out) < frames and process.poll() is None:
            time.sleep(0.002)
        assert process.poll() is None, "the run ended before it could be killed"
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert logged(out) >= frames
    assert main(words) == 0
    config = settings.replace(preset("solution_selection"), "features.cell", 20)
    config = settings.replace(config, "selection.sets", 20)
    whole = whole_run(open_sequence(bands), tmp_path / "whole", config)
    assert (out / "poses.txt").read_bytes() == (whole / "poses.txt").read_bytes()
    assert log_of(out) == log_of(whole)
    assert "finished before" not in capsys.readouterr().out
    assert main(words) == 0
    assert "finished before" in capsys.readouterr().out


@pytest.mark.skipif(os.name != "posix", reason="file size limits of POSIX")
def test_a_full_disk_is_one_line_and_what_was_written_stays_readable(tmp_path: Path) -> None:
    bands = write_bands(tmp_path / "bands", frames=80)
    out = tmp_path / "out"
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (45000, 45000)); "
    options = ["run", str(bands), "--method", "mesvo_f", "--features.cell", "24", "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", limit + COMMAND, *options], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith(f"vo: error: {out / LOG}: cannot be written: ")
    lines = (out / LOG).read_text(encoding="utf-8").splitlines()
    assert len(lines) > 50
    for line in lines[:-1]:
        json.loads(line)
    assert main(options) == 0
    config = settings.replace(preset("mesvo_f"), "features.cell", 24)
    whole = whole_run(open_sequence(bands), tmp_path / "whole", config)
    assert (out / "poses.txt").read_bytes() == (whole / "poses.txt").read_bytes()


def test_a_real_clip_stopped_and_continued_is_the_same(
    clips: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vo_lib.runs.resume.EVERY", 10)
    sequence = open_sequence(clips / "sequences" / "01").part(0, 30)
    config = preset("feature_selection")
    with pytest.raises(Stopped):
        resumable_run(folder, sequence, config, "m", progress=stop_at(17))
    result, _ = resumable_run(folder, sequence, config, "m")
    whole: Run = run(sequence, config)
    assert result.poses.tobytes() == whole.poses.tobytes()
