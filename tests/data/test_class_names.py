"""Class names: the names of vehicles, the choice of classes, and the files of names beside labels."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from vo_lib.data.class_names import (
    BUS,
    CAR,
    COCO,
    TRUCK,
    ClassesError,
    ClassNames,
    label_numbers,
    vehicle_kind,
)
from vo_lib.data.label_names import read_class_names
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes

KITTI = "Car Van Truck Pedestrian Person_sitting Cyclist Tram Misc DontCare".split()  # noqa: SIM905
VEHICLES = ("vehicles",)


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        ("car Car cars Van minivan SUV taxi vehicle REGULAR_VEHICLE vehicle.car police-car policecar", CAR),
        ("car_parked parkedCar object--vehicle--car sedan TYPE_VEHICLE auto", CAR),
        ("bus SCHOOL_BUS bus-s- bus-l- vehicle.bus.rigid Tram minibus", BUS),
        ("truck big-truck truck-l- truck-xl- Lorry BOX_TRUCK trailer ambulance", TRUCK),
        (
            "person Cyclist train bicycle motorcycle Misc DontCare bus-stop car-wheel toy-car driver's_cab",
            None,
        ),
        (
            "vehicle.bicycle vehicle-registration-plate non-motorized-vehicle auto-rickshaw trafficlight 7",
            None,
        ),
        ("carrot oscar wheelbarrow busy truckload", None),
    ],
)
def test_vehicles_are_known_by_their_last_noun(names: str, kind: int | None) -> None:
    for name in names.split():
        assert vehicle_kind(name) == kind, name


def test_numbers_in_label_files_are_cocos_and_all_different() -> None:
    assert label_numbers(COCO).tolist() == list(range(80))
    assert label_numbers(("vehicle",)).tolist() == [2]
    assert label_numbers(("van", "Car", "lorry", "sign", "car")).tolist() == [80, 2, 7, 83, 84]


def boxes(*numbers: int) -> Boxes:
    count = len(numbers)
    return Boxes(np.zeros((count, 4)), np.array(numbers, np.int64), np.ones(count))


def test_vehicles_of_kitti_are_chosen_by_name() -> None:
    choice = ClassNames(dict(enumerate(KITTI))).choose(VEHICLES)
    assert choice.chosen == ("Car", "Van", "Truck", "Tram")
    # A cyclist (5) is no bus, and a truck (2) no car.
    assert choice.select(boxes(0, 1, 2, 3, 4, 5, 6, 7, 8)).class_id.tolist() == [CAR, CAR, TRUCK, BUS]
    assert choice.sentence() == (
        "Car, Van, Truck, Tram; not Pedestrian, Person_sitting, Cyclist, Misc, DontCare"
    )


def test_classes_are_chosen_by_name_or_number() -> None:
    names = ClassNames(dict(enumerate(KITTI)))
    assert names.choose(("car",)).chosen == ("Car",)
    assert names.choose(("5", "van")).chosen == ("Van", "Cyclist")
    partly = names.choose(("car", "bus"))
    assert partly.sentence().endswith("; there is no class bus")
    numbers = ClassNames()
    assert list(numbers.choose(VEHICLES).kinds) == [2, 5, 7]
    assert list(numbers.choose(("truck", "0")).kinds) == [0, 7]


@pytest.mark.parametrize(
    ("names", "word", "message"),
    [
        (KITTI, "9", "there is no class 9: expected 0 Car, 1 Van"),
        (KITTI, "cra", "there is no class 'cra': did you mean Car"),
        ([], "big truck", "'big truck' is not a class of COCO: there are no class names"),
        ([], "cra", "there is no class 'cra': did you mean cat"),
    ],
)
def test_unknown_classes_are_refused(names: list[str], word: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        ClassNames(dict(enumerate(names))).choose(("car", word))


def test_choice_without_a_class_names_one() -> None:
    with pytest.raises(
        ClassesError, match="none of the classes is a vehicle by its name, only pkw, baum"
    ) as e:
        ClassNames({0: "pkw", 1: "baum"}).choose(VEHICLES)
    assert e.value.value == "pkw"
    with pytest.raises(ClassesError) as e:
        ClassNames({3: "-odd-"}).choose(VEHICLES)
    assert e.value.value == "3"  # the name would look like an option


@pytest.mark.parametrize(
    ("names", "words", "value"),
    [
        (["person", "pkw"], VEHICLES, "pkw"),  # not the first class, whatever it is
        (["Pedestrian", "Cyclist", "Fahrzeug"], VEHICLES, "Fahrzeug"),
        (["person", "dog"], VEHICLES, "NAME"),
        (["traffic-light", "stop_sign", "Tree"], VEHICLES, "NAME"),
        (["person", "van"], ("bus",), "van"),
        (["person", "12"], VEHICLES, "12"),
    ],
)
def test_only_a_class_that_may_be_a_vehicle_is_proposed(
    names: list[str], words: tuple[str, ...], value: str
) -> None:
    with pytest.raises(ClassesError, match=f"only {', '.join(names)}: set filter.classes to {value}") as e:
        ClassNames(dict(enumerate(names))).choose(words)
    assert e.value.value == value


def test_the_number_that_the_model_has_is_proposed() -> None:
    names = ClassNames({80: "-pkw-", 0: "person"}, of_model=(0, 80))
    with pytest.raises(ClassesError) as e:
        names.choose(VEHICLES)
    assert e.value.value == "1"
    assert names.choose(("1",)).chosen == ("-pkw-",)


def test_a_class_with_a_name_of_digits_can_be_chosen() -> None:
    names = ClassNames({0: "30", 1: "0", 2: "car"})
    assert names.choose(("30",)).chosen == ("30",)
    assert names.choose(("0",)).chosen == ("0",)
    assert names.choose(("2",)).chosen == ("car",)
    assert len(names.choose_all().kinds) == 3


ROAD = "names:\n  1: car\n  0: person\n"
YAML = "train: ../train/images\nnc: 2\nnames: ['person', 'car']\n"
NOTES = json.dumps({"categories": [{"id": 1, "name": "car"}, {"id": 0, "name": "person"}], "info": {}})
# Label folder, and files of names, relative to the top folder.
LAYOUTS = {
    "labelImg": ("seq", {"seq/classes.txt": "person\ncar\n"}),
    "label studio": ("x/labels", {"x/classes.txt": "person\ncar\n", "x/notes.json": NOTES}),
    "notes alone": ("x/labels", {"x/notes.json": NOTES}),
    "cvat": ("x/obj_train_data", {"x/obj.names": "person\ncar\n", "x/obj.data": "classes = 2\n"}),
    "roboflow": ("x/train/labels", {"x/data.yaml": YAML}),
    "roboflow darknet": ("train", {"train/_darknet.labels": "person\ncar"}),
    "darknet": ("labels", {"road.names": "person\r\ncar\r\n"}),
    "ultralytics": ("x/labels/train", {"x/road.yaml": f"train: images/train\n{ROAD}"}),
    "ultralytics, moved": ("x/labels/val", {"x/road.yaml": f"path: /elsewhere\nval: [images/val]\n{ROAD}"}),
    "ultralytics, above": ("x/labels", {"road.yml": f"path: x\ntrain: images\n{ROAD}"}),
    "ultralytics, list": (
        "x/labels/a",
        {"x/road.yaml": f"train: train.txt\n{ROAD}", "x/train.txt": "./images/a/000000.png\n"},
    ),
    "numbered": ("seq", {"seq/classes.txt": "0: person\n1: car\n"}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_names_are_found_beside_the_labels(tmp_path: Path, layout: str) -> None:
    labels, files = LAYOUTS[layout]
    top = tmp_path / "a" / "b" / "c"
    (top / labels).mkdir(parents=True)
    for name, text in files.items():
        (top / name).write_text(text, encoding="utf-8")
    found = read_class_names(top / labels)
    assert dict(sorted(found.names.items())) == {0: "person", 1: "car"}
    assert Path(found.source) in {top / name for name in files}


UNRELATED = (
    "names: [light, sign]\n",
    "train: ../other/images\nnames: [light, sign]\n",
    "path: signs\ntrain: images/train\nval: images/val\nnames: [light, sign]\n",
    "train: [1, {a: b}]\nval: missing.txt\nnames: {0: light}\n",
    "names: [",
)


@pytest.mark.parametrize("text", UNRELATED)
@pytest.mark.parametrize("name", ["traffic.yaml", "x/config.yml"])
def test_files_that_describe_other_labels_do_not_count(tmp_path: Path, text: str, name: str) -> None:
    labels = tmp_path / "x" / "labels"
    labels.mkdir(parents=True)
    (tmp_path / name).write_text(text, encoding="utf-8")
    assert read_class_names(labels) == ClassNames()


def test_names_two_levels_above_have_a_usual_file(tmp_path: Path) -> None:
    (tmp_path / "x" / "labels").mkdir(parents=True)
    (tmp_path / "coco.names").write_text("light\nsign\n", encoding="utf-8")
    assert read_class_names(tmp_path / "x" / "labels") == ClassNames()


def test_nearest_names_count_and_contradictions_are_refused(tmp_path: Path) -> None:
    labels = tmp_path / "x" / "labels"
    labels.mkdir(parents=True)
    (tmp_path / "data.yaml").write_text(YAML, encoding="utf-8")
    (tmp_path / "x" / "classes.txt").write_text("truck\n", encoding="utf-8")
    assert read_class_names(labels).names == {0: "truck"}
    (tmp_path / "x" / "data.yaml").write_text("names: [car]\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"x/data\.yaml: has other class names than classes\.txt beside it"):
        read_class_names(labels)
    (tmp_path / "x" / "data.yaml").write_text("names: [", encoding="utf-8")
    with pytest.raises(DataError, match="is not YAML"):
        read_class_names(labels)


def test_a_record_without_the_written_classes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "classes.txt").write_text("car\n", encoding="utf-8")
    (tmp_path / "detector.json").write_text('{"model": "a", "sha256": "b", "settings": {}}', encoding="utf-8")
    with pytest.raises(DataError, match=r"detector\.json: expected the record of the detector"):
        read_class_names(tmp_path)
