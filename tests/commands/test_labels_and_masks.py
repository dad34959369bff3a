"""What commands say about labels and masks: classes, missing and surplus files, nothing or all removed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vo_lib.commands.cli import main

Say = Callable[..., tuple[int, str]]
BOX = "0.5 0.5 0.4 0.6\n"


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that the tests share, so that the bands are matched once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def run(bands: Path, tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]) -> Say:
    """A function that calls `vo run` on the bands with further options, and returns exit code and words."""

    def call(*words: str) -> tuple[int, str]:
        usual = ["run", str(bands), "--out", str(tmp_path / "out"), "--fresh", "--features.blob_cell", "9"]
        code = main([*usual, "--cache", str(cache), "--keep-matches", *words])
        captured = capsys.readouterr()
        return code, " ".join((captured.out + captured.err).split())

    return call


@pytest.fixture
def labels(tmp_path: Path) -> Path:
    """Labels of class 0 for the six images."""
    folder = tmp_path / "mine" / "x" / "labels"
    folder.mkdir(parents=True)
    for frame in range(6):
        (folder / f"{frame:06d}.txt").write_text(f"0 {BOX}", encoding="utf-8")
    return folder


def removed(said: str) -> float:
    found = re.search(r"features removed in boxes │ (\S+) %", said)
    assert found is not None, said
    return float(found[1])


@pytest.mark.usefixtures("pictures_not_drawn")
def test_class_numbers_without_names_are_not_taken_for_cocos(run: Say, labels: Path) -> None:
    code, said = run("--labels", str(labels))
    assert code == 2
    assert (
        "6 boxes, none of class 2, 5, 7 (car, bus, truck of COCO); found class 0: "
        "add classes.txt or --filter.classes 0 if class 0 is that of the vehicles (in COCO, 0 is person)"
    ) in said
    code, said = run("--labels", str(labels), "--frames", "0:3")
    assert "6 boxes, none of class" in said  # of the whole folder
    code, said = run("--labels", str(labels), "--filter.classes", "0")
    by_number = removed(said)
    (labels.parent / "classes.txt").write_text("car\nperson\n", encoding="utf-8")
    code, said = run("--labels", str(labels))
    assert "note: boxes of car; not person (names from x/classes.txt)" in said
    assert removed(said) == by_number > 0
    assert "does not use the boxes" not in said
    code, said = run("--labels", str(labels), "--method", "solution_selection")
    assert code == 0
    assert "note: solution_selection does not use the boxes of --labels; only a film shows the boxes" in said


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("option", ["labels", "detector"])
@pytest.mark.parametrize(
    "command",
    [
        ["reproduce", "--variant", "published", "--sequences"],
        ["sweep", "--set", "min_matches=6", "--sequence"],
    ],
    ids=["reproduce", "sweep"],
)
def test_a_table_without_a_method_for_the_boxes_says_so(
    bands: Path,
    labels: Path,
    cache: Path,
    capsys: pytest.CaptureFixture[str],
    command: list[str],
    option: str,
) -> None:
    value = {"labels": str(labels), "detector": "street"}[option]
    places = ["--out", str(bands.parent / "out"), "--cache", str(cache)]
    words = [*command, str(bands), "--seeds", "1", f"--{option}", value, *places]
    note = f"note: no method of the table uses the boxes of --{option}"
    assert main([*words, "--methods", "mesvo_f"]) == 0
    assert note in capsys.readouterr().out
    (labels / "classes.txt").write_text("car\n", encoding="utf-8")
    assert main([*words, "--methods", "mesvo_f,feature_selection"]) == 0
    assert note not in capsys.readouterr().out


def test_the_number_of_the_vehicles_is_not_guessed(run: Say, labels: Path) -> None:
    (labels / "000003.txt").write_text(f"1 {BOX}90 {BOX}", encoding="utf-8")
    code, said = run("--labels", str(labels))
    assert code == 2
    assert "7 boxes, none of class 2, 5, 7 (car, bus, truck of COCO); found class 0, 1, 90" in said
    assert (
        "--filter.classes NUMBER with the number of the vehicles (in COCO, 0 is person, 1 is bicycle)" in said
    )


def test_number_without_a_name_contradicts_the_names(run: Say, labels: Path) -> None:
    (labels / "classes.txt").write_text("person\ncar\n", encoding="utf-8")
    (labels / "000005.txt").write_text(f"1 {BOX}2 {BOX}", encoding="utf-8")  # numbered from 1
    code, said = run("--labels", str(labels))
    assert code == 2
    assert "classes.txt: class 2 of the labels in" in said
    assert "has no name, the last name is that of class 1" in said
    assert f"Write the names of these labels into {labels / 'classes.txt'}, one a line" in said


@pytest.mark.usefixtures("pictures_not_drawn")
def test_names_of_other_labels_above_do_not_count(run: Say, labels: Path) -> None:
    for path in labels.iterdir():
        path.write_text(f"2 {BOX}", encoding="utf-8")
    for name in ("x/traffic.yaml", "traffic.yaml"):
        (labels.parents[1] / name).write_text("names: [light, sign]\n", encoding="utf-8")
    code, said = run("--labels", str(labels))
    assert code == 0
    assert removed(said) > 0


@pytest.mark.usefixtures("pictures_not_drawn")
def test_class_numbers_that_do_not_count_are_listed(run: Say, labels: Path) -> None:
    (labels / "000003.txt").write_text(f"2 {BOX}7 {BOX}", encoding="utf-8")
    code, said = run("--labels", str(labels))
    assert code == 0
    assert "2 boxes of class 2 car, 5 bus, 7 truck (numbers of COCO) count" in said
    assert "the others do not, class 0 (person): 5 boxes" in said


@pytest.mark.usefixtures("pictures_not_drawn")
def test_missing_surplus_and_shifted_label_files_are_listed(run: Say, labels: Path) -> None:
    (labels / "000000.txt").rename(labels / "000006.txt")
    code, said = run("--labels", str(labels), "--filter.classes", "0")
    assert code == 0
    assert "note: 1 of 6 images have no label file, which means no vehicle" in said
    assert "000006.txt: no image of the sequence has this name, and 000000.png has no label file" in said
    assert "are the names shifted?" in said


@pytest.mark.usefixtures("pictures_not_drawn")
def test_removal_of_no_feature_or_of_all_causes_a_warning(run: Say, labels: Path, tmp_path: Path) -> None:
    for path in labels.iterdir():
        path.write_text("2 0.01 0.01 0.01 0.01\n", encoding="utf-8")
    code, said = run("--labels", str(labels))
    assert code == 0
    assert "warning: 0.0 % of the features are removed in boxes" in said
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert any(words.startswith("0.0 % of the features") for words in metrics["path"]["warnings"])
    for path in labels.iterdir():
        path.write_text("2 0.5 0.5 1 1\n", encoding="utf-8")
    assert "warning: 100.0 % of the features are removed in boxes" in run("--labels", str(labels))[1]


@pytest.mark.usefixtures("pictures_not_drawn")
def test_tables_and_sweeps_have_the_warnings(
    bands: Path, labels: Path, tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in labels.iterdir():
        path.write_text("2 0.01 0.01 0.01 0.01\n", encoding="utf-8")
    labels.rename(bands / "labels")
    few = ["--seeds", "1", "--cache", str(cache), "--variant", "published"]
    table = ["--methods", "feature_selection", "--out", str(tmp_path / "t")]
    main(["reproduce", "--sequences", str(bands), *table, *few])
    assert "0.0 % of the features are removed" in (tmp_path / "t" / "report.html").read_text(encoding="utf-8")
    capsys.readouterr()
    axis = ["--set", "filter.classes=car;truck,2", "--out", str(tmp_path / "s")]
    assert main(["sweep", "--sequence", str(bands), *axis, *few]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Warning: filter.classes=car: 0.0 % of the features are removed" in said
    assert main(["sweep", "--sequence", str(bands), "--set", "filter.classes=9", *axis[2:], *few]) == 2
    assert "add classes.txt or --set filter.classes=2" in " ".join(capsys.readouterr().err.split())


UNUSED = "selection.sets: viso2 does not use this setting, since estimator is reprojection"


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize(
    ("method", "sets", "told", "hand_made"),
    [
        ("viso2", 200, "", True),
        ("viso2", 50, UNUSED, False),
        ("viso2", 50, UNUSED, True),
        ("feature_selection", 50, "", False),
    ],
)
def test_settings_without_effect_are_refused_in_a_config_as_with_set(
    run: Say,
    bands: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    method: str,
    sets: int,
    told: str,
    hand_made: bool,
    cache: Path,
) -> None:
    assert run("--method", method)[0] == 0
    data = json.loads((tmp_path / "out" / "config.json").read_text(encoding="utf-8"))
    data["settings"]["selection"]["sets"] = sets
    if hand_made:
        data = {name: data[name] for name in ("method", "variant", "settings")}
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    code, said = run("--config", str(path))
    assert code == (2 if told else 0)
    assert told in said
    assert "does not use" not in said.replace(told, "") if told else "does not use" not in said
    config = ["--config", str(path), "--seeds", "1", "--cache", str(cache)]
    config += ["--out", str(tmp_path / "table")]
    for words in (
        ["reproduce", "--sequences", str(bands)],
        ["sweep", "--sequence", str(bands), "--set", "min_matches=6"],
    ):
        capsys.readouterr()
        assert main([*words, *config]) == (2 if told else 0)
        assert told in capsys.readouterr().err
    # Where another method uses it, it is said that this one does not.
    if told:
        both = ["--methods", "viso2,mesvo_f"]
        assert main(["sweep", "--sequence", str(bands), "--set", "min_matches=6", *config, *both]) == 0
        assert f"note: {told}" in capsys.readouterr().out


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_config_with_unused_settings_is_read_again(
    run: Say, bands: Path, tmp_path: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = ["--method", "mesvo_f", "--loops", "--reprojection.threshold", "1.5"]
    assert run(*changes)[0] == 0  # the loops use it
    path = tmp_path / "out" / "config.json"
    (tmp_path / "kept.json").write_bytes(path.read_bytes())
    code, said = run("--config", str(tmp_path / "kept.json"))
    assert code == 0
    assert "mesvo_f does not use reprojection.threshold 1.5" in said
    config = ["--config", str(tmp_path / "kept.json"), "--seeds", "1", "--cache", str(cache)]
    assert main(["reproduce", "--sequences", str(bands), *config, "--out", str(tmp_path / "a")]) == 0
    sweep = ["sweep", "--sequence", str(bands), "--set", "selection.sets=20", *config]
    assert main([*sweep, "--out", str(tmp_path / "b")]) == 0
    assert "note: reprojection.threshold: mesvo_f does not use" in capsys.readouterr().out
    # A table without its method is another matter.
    assert main([*sweep, "--methods", "solution_selection", "--out", str(tmp_path / "c")]) == 2
    assert "solution_selection does not use this setting" in capsys.readouterr().err


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize(("value", "words"), [(0, "no pixel is masked"), (1, "all pixels are masked")])
def test_masks_that_cover_nothing_or_everything_cause_a_warning(
    run: Say, tmp_path: Path, value: int, words: str
) -> None:
    cv2.imwrite(str(tmp_path / "mask.png"), np.full((240, 480), value, np.uint8))
    code, said = run("--masks", str(tmp_path / "mask.png"), "--method", "solution_selection")
    assert code == 0
    assert f"warning: --masks: {words}" in said
