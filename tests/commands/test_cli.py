"""The `vo` command: files, printed tables, help and exit codes."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import HEIGHT, WIDTH, write_bands
from terminal import shown_in_terminal
from tiny_onnx import write_answering

from vo_lib import settings
from vo_lib.commands.cli import COMMANDS, main
from vo_lib.commands.run import FLAG_MEANINGS
from vo_lib.config import CONFIG_CLASSES
from vo_lib.data.poses import read_kitti_poses, read_poses
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import read_csv
from vo_lib.detection.network_image import yolox_cells
from vo_lib.geometry.result import Flag
from vo_lib.kit.calibration import read_learnt_calibration

ROOT = Path(__file__).resolve().parents[2]
FILES = {"config.json", "frames.csv", "metrics.json", "poses.txt", "poses_tum.txt", "trajectory.png"}
SMALL = {"published": ["--features.blob_cell", "9"], "kit": ["--variant", "kit", "--features.cell", "10"]}
BLACK = np.zeros((HEIGHT, WIDTH), np.uint8)


@pytest.fixture
def done(bands: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """A function that calls `vo run` on the band sequence and returns the printed text."""

    def run(out: str, *words: str, code: int = 0, variant: str = "published") -> str:
        assert main(["run", str(bands), "--out", str(bands.parent / out), *SMALL[variant], *words]) == code
        return "".join(capsys.readouterr())

    return run


def read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def read_log(out: Path) -> list[dict[str, str]]:
    (_, names), *rows = read_csv(out / "frames.csv")
    return [dict(zip(names, cells, strict=True)) for _, cells in rows]


def program(code: str, *words: str, **environ: str) -> subprocess.CompletedProcess[str]:
    """Run code with arguments in a new Python process, with additional environment variables."""
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, **environ}, encoding="utf-8"
    )


@pytest.mark.parametrize("variant", SMALL)
def test_a_run_writes_its_files(bands: Path, done: Callable[..., str], variant: str) -> None:
    printed, out = done("new/out", "--method", "mesvo_f", variant=variant), bands.parent / "new" / "out"
    expected = FILES | ({"calibration.json"} if variant == "kit" else set())
    assert {path.name for path in out.glob("[!.]*")} == expected
    poses = read_kitti_poses(out / "poses.txt")
    assert poses.shape == (6, 4, 4)
    times, tum = read_poses(out / "poses_tum.txt")
    np.testing.assert_allclose(tum, poses, atol=1e-7)
    assert times is not None
    assert times[1] == pytest.approx(0.1)
    rows = read_log(out)
    assert [row["frame"] for row in rows] == [f"{i:06d}" for i in range(1, 6)]
    assert all(float(row["matching_ms"]) > 0 and int(row["inliers"]) > 20 for row in rows)
    config = settings.from_dict(CONFIG_CLASSES[variant], read_json(out / "config.json")["settings"])
    assert not config.selection.prior
    image = cv2.imread(str(out / "trajectory.png"))
    assert image is not None
    assert image.std() > 5
    assert f"bands, mesvo_f, {variant}, 6 frames" in printed
    assert "ATE m" in printed  # the path is too short for TE
    assert str(out) in printed
    if variant == "kit":
        learnt = read_learnt_calibration(out / "calibration.json").describe(config.calibration)
        assert f"corrected calibration errors (± σ) {learnt}" in re.sub(r"[│\s]+", " ", printed)


def test_a_run_takes_a_part_of_the_frames_and_a_label_folder(bands: Path, done: Callable[..., str]) -> None:
    labels = bands.parent / "boxes"
    labels.mkdir()
    (labels / "000002.txt").write_text("2 0.5 0.5 0.4 0.4 0.9\n", encoding="utf-8")
    printed = done("out", "--frames", "1:4", "--labels", str(labels))
    assert "note: 2 of 3 images have no label file" in " ".join(printed.split())
    rows = read_log(bands.parent / "out")
    assert [row["frame"] for row in rows] == ["000002", "000003"]
    assert int(rows[0]["removed_by_boxes"]) > 0


@pytest.mark.usefixtures("pictures_not_drawn")
def test_kept_matches_are_used_again(
    bands: Path, done: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(bands.parent / "user"))
    for name, cache in (("filled", []), ("used", []), ("elsewhere", ["--cache", str(bands.parent / "mine")])):
        done(name, "--keep-matches", *cache)
    done("without", "--cache", str(bands.parent / "empty"))
    kept = {path.relative_to(bands.parent).parts[:3] for path in bands.parent.rglob("*.npz")}
    assert kept == {(folder, "stereo-vo-kit", "matches") for folder in ("user", "mine")}
    row = read_log(bands.parent / "used")[0]
    assert (row["matching_ms"], row["wait_images_ms"]) == ("", "")
    assert float(row["cached_matches_ms"]) >= 0


@pytest.mark.usefixtures("pictures_not_drawn")
def test_missing_boxes_cause_a_warning(
    bands: Path, done: Callable[..., str], capsys: pytest.CaptureFixture[str]
) -> None:
    removed_by_none = "No vehicle boxes for bands: no features are removed, "
    warning = f"{removed_by_none}so feature_selection is equal to solution_selection."
    assert " ".join(done("a").split()).startswith(f"warning: {warning}")
    assert "No vehicle boxes" not in done("b", "--method", "solution_selection")
    with_rule = done("viso2", "--method", "viso2", "--filter.rule", "all")
    assert f"{removed_by_none}as with filter.rule none." in " ".join(with_rule.split())
    moving = done("moving", "--method", "moving_selection", variant="kit")
    assert f"{removed_by_none}so moving_selection is equal to" in " ".join(moving.split())
    words = ["--sequences", str(bands), "--methods", "feature_selection", "--variant", "published"]
    words += ["--seeds", "1", "--films", "--cache", str(bands.parent / "cache")]
    assert main(["reproduce", *words, "--out", str(bands.parent / "c")]) == 0
    page = (bands.parent / "c" / "report.html").read_text(encoding="utf-8")
    assert page.count("feature_selection/seed_0/film.webm") == 1
    for text in (capsys.readouterr().out, page):
        assert " ".join(text.split()).count(warning) == text.count("No vehicle boxes") == 1
    assert page.index(warning) < page.index("<nav") < page.index("Shorter than every sub-sequence")
    (bands / "labels").mkdir()
    assert "No vehicle boxes" in done("d")  # an empty folder has no labels
    (bands / "labels" / "000001.txt").touch()
    assert "No vehicle boxes" not in done("e")


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_detector_without_effect_causes_a_note(bands: Path, done: Callable[..., str]) -> None:
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    model = write_answering(bands / "blind.onnx", answer, names="['car']")
    words = ["--detector", str(model), "--cache", str(bands.parent / "cache")]
    nothing = "warning: the detector found no vehicle in the 6 images of bands: no features are removed"
    unused = "note: solution_selection does not use the boxes of --detector"
    for out, method in (("a", "feature_selection"), ("b", "solution_selection")):
        printed = " ".join(done(out, "--method", method, *words).split())
        assert nothing in printed
        assert (unused in printed) == (method == "solution_selection")


@pytest.mark.usefixtures("pictures_not_drawn")
def test_the_rule_truth_is_not_said_to_use_boxes(
    street: Sequence, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    model = write_answering(tmp_path / "blind.onnx", answer, names="['car']")
    words = ["--frames", "0:4", "--variant", "kit", "--filter.rule", "truth", "--detector", str(model)]
    out = ["--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
    assert main(["run", str(street.folder), *words, *out]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "note: feature_selection does not use the boxes of --detector" in printed
    assert "features removed in boxes" not in printed
    assert re.search(r"features removed as truly moving │ \S+ %", printed)


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize(
    ("rows", "words"), [(60, "25 % of the image is masked wa"), (180, "75 % of the image is masked; f")]
)
def test_masked_share_is_printed(bands: Path, done: Callable[..., str], rows: int, words: str) -> None:
    mask = BLACK.copy()
    mask[:rows] = 255
    cv2.imwrite(str(bands / "mask.png"), mask)
    assert words in " ".join(done("out", "--masks", str(bands / "mask.png")).split())


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("short", ["poses/05.txt", "poses.txt"])
def test_commands_name_the_file_of_the_truth(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], short: str
) -> None:
    root, out = bands.parent / "root", bands.parent / "out"
    folder = Path(shutil.copytree(bands, root / "sequences" / "05"))
    truth = folder / "poses.txt"
    if short != "poses.txt":
        (root / "poses").mkdir()
        truth = Path(shutil.copy(truth, root / "poses" / "05.txt"))
    monkeypatch.setenv("KITTI_ROOT", str(root))
    for command in (["run", "kitti/05", "--out", str(out), *SMALL["published"]], ["evaluate", str(out)]):
        assert main(command) == 0
        assert f"\ntruth: {truth}\n" in capsys.readouterr().out
    assert read_json(out / "metrics.json")["truth"] == short
    assert main(["evaluate", str(out), "--truth", str(folder / "poses.txt")]) == 0
    assert f"\ntruth: {folder / 'poses.txt'}\n" in capsys.readouterr().out
    assert main(["list"]) == 0
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "kitti/05" in line]
    assert row.replace("│", "").split()[3] == short


def test_run_without_truth_has_no_errors(bands: Path, done: Callable[..., str]) -> None:
    (bands / "poses.txt").unlink()
    printed = done("out")
    assert read_json(bands.parent / "out" / "metrics.json").keys() == {"path"}
    assert "no ground truth" in printed
    assert "lost" not in printed
    # In a pipe, a sentence is one line, where grep finds it.
    assert "so feature_selection is equal to solution_selection. For boxes, add `--detector" in printed


@pytest.mark.skipif(os.name != "posix", reason="a terminal of POSIX")
def test_a_run_fits_into_a_terminal(bands: Path) -> None:
    (bands / "poses.txt").unlink()
    lines = shown_in_terminal(["run", str(bands), "--out", str(bands.parent / "out"), *SMALL["published"]])
    # A path stays whole, and that of the temporary folder depends on the machine.
    assert max(len(line.replace(str(bands.parent), "")) for line in lines) <= 80
    assert "so feature_selection is equal to solution_selection." in " ".join(" ".join(lines).split())


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_run_without_motion_is_shorter_than_the_truth(bands: Path, done: Callable[..., str]) -> None:
    cv2.imwrite(str(bands / "mask.png"), np.full_like(BLACK, 255))
    printed = " ".join(done("out", "--masks", str(bands / "mask.png")).split())
    assert "is 0 times as long as the truth" in printed


@pytest.mark.usefixtures("pictures_not_drawn")
def test_lost_tracking_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bands = write_bands(tmp_path / "bands", 14)
    for frame in range(3, 13):  # the next frame has no motion either
        for side in ("image_0", "image_1"):
            cv2.imwrite(str(bands / side / f"{frame:06d}.png"), BLACK)
    assert main(["run", str(bands), "--out", str(tmp_path / "out"), *SMALL["published"]]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Tracking was lost: 11 of 13 frames have no motion" in printed


@pytest.mark.usefixtures("pictures_not_drawn")
def test_config_repeats_a_run_and_options_override_it(
    bands: Path, done: Callable[..., str], tmp_path: Path
) -> None:
    done("a", "--method", "mesvo_f")
    config = ["--config", str(tmp_path / "a" / "config.json")]
    for name, more in (("b", ["--method", "mesvo_f", "--variant", "published"]), ("c", ["--seed", "3"])):
        assert main(["run", str(bands), *config, *more, "--out", str(tmp_path / name)]) == 0
    a = (tmp_path / "a" / "poses.txt").read_bytes()
    assert (tmp_path / "b" / "poses.txt").read_bytes() == a
    stored = read_json(tmp_path / "c" / "config.json")
    assert (stored["method"], stored["variant"], stored["settings"]["seed"]) == ("mesvo_f", "published", 3)
    assert stored["settings"]["features"]["blob_cell"] == 9
    # `vo reproduce` and `vo sweep` accept the file too.
    config += ["--seeds", "1", "--cache", str(tmp_path / "cache")]
    assert main(["reproduce", "--sequences", str(bands), *config, "--out", str(tmp_path / "d")]) == 0
    grid = ["--sequence", str(bands), "--set", "selection.sets=200", "--out", str(tmp_path / "e")]
    assert main(["sweep", *grid, *config]) == 0
    assert [path.read_bytes() for path in tmp_path.glob("[de]/**/poses.txt")] == [a, a]


@pytest.mark.usefixtures("pictures_not_drawn")
def test_run_starts_from_another_calibration(bands: Path, done: Callable[..., str]) -> None:
    done("first", variant="kit")
    calibration = ("--calibration", str(bands.parent / "first" / "calibration.json"))
    done("held", *calibration, "--calibration.estimate", "off", variant="kit")
    done("learning", *calibration, variant="kit")
    first, held, then = (
        read_learnt_calibration(bands.parent / name / "calibration.json")
        for name in ("first", "held", "learning")
    )
    assert np.any(first.estimate)
    np.testing.assert_array_equal(held.estimate, first.estimate)
    assert (np.diag(then.covariance)[9:15] < np.diag(first.covariance)[9:15]).all()
    assert "differs in calibration" in done("first", *calibration, variant="kit", code=2)
    calib = bands / "calib.txt"
    calib.write_text(calib.read_text(encoding="utf-8").replace("-150.0", "-160.0"), encoding="utf-8")
    assert "another camera: baseline 0.5, here 0.53" in done("other", *calibration, variant="kit", code=2)


@pytest.mark.parametrize("variant", SMALL)
def test_settings_page_lists_the_settings_of_a_variant(
    capsys: pytest.CaptureFixture[str], variant: str
) -> None:
    pages = []
    for words in (["--help-settings", "--variant", variant], ["--variant", variant, "--help-settings"]):
        assert main(["run", *words]) == 0
        pages.append(" ".join(capsys.readouterr().out.split()))
    assert pages[0] == pages[1]
    names = re.findall(r"--([a-z_.]+) X", pages[0])
    own = [item.name for item in settings.declared(CONFIG_CLASSES[variant])]
    assert [name for name in names if not name.startswith(("detector.", "loops."))] == own
    agreement = {"published": "default 1.0", "kit": "default 2.0"}[variant]
    assert agreement in pages[0].partition("--translation.agreement X")[2].partition("--")[0]


@pytest.mark.parametrize(
    ("words", "start"),
    [("run --help", "usage: vo run "), ("--version", "vo "), ("", "usage: vo ")],
    ids=["help", "version", "nothing"],
)
def test_short_help_omits_thresholds(capsys: pytest.CaptureFixture[str], words: str, start: str) -> None:
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith(start)
    assert "--selection.sets X" not in text
    assert len(text.splitlines()) < 60


def test_help_does_not_import_matplotlib() -> None:
    code = (
        "import sys; from vo_lib.commands.cli import COMMANDS, make_parser\n"
        "for name in COMMANDS: make_parser([name])\n"
        "print({'matplotlib', 'jinja2', 'rich.progress', 'from_folder'}.intersection(sys.modules))"
    )
    assert program(code).stdout == "set()\n"


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (OSError(28, "No space left on device", "/x/y"), 2, "vo: error: /x/y: No space left on device\n"),
        (KeyboardInterrupt(), 130, "vo: interrupted\n"),
        (None, 0, f"vo: warning: overflow in the field ({__file__}:"),
    ],
)
def test_library_warnings_are_printed_after_success(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException | None,
    code: int,
    line: str,
) -> None:
    def available() -> dict[str, None]:
        warnings.simplefilter("always")
        warnings.warn("overflow in the field", RuntimeWarning, stacklevel=1)
        if error is not None:
            raise error
        return {}

    monkeypatch.setattr("vo_lib.commands.list_sequences.available", available)
    assert main(["list"]) == code
    text = capsys.readouterr().err
    assert text == line if error is not None else text.startswith(line)


@pytest.mark.usefixtures("pictures_not_drawn")
def test_every_flag_of_a_frame_is_explained(bands: Path, done: Callable[..., str]) -> None:
    assert set(FLAG_MEANINGS) == set(Flag)
    printed = " ".join(done("still", "--min_matches", "1000").split())
    assert "frames flagged few_matches │ 5" in printed
    assert "few_matches: too few matches, so an earlier motion is repeated." in printed
    assert "length of the path │ 0.0 m" in printed


@pytest.mark.parametrize("command", COMMANDS)
def test_help_begins_with_what_the_command_does(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    usage, description, *_ = capsys.readouterr().out.split("\n\n")
    assert usage.startswith(f"usage: vo {command} ")
    assert "… ..." not in usage
    assert description[0].isupper()
    assert description.endswith(".")
