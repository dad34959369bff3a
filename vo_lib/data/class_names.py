"""Class names: COCO's numbers, the names of vehicles, the choice of the classes that count (chapter 5)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..errors import DataError, did_you_mean
from ..geometry.boxes import VEHICLES, Boxes
from ..geometry.types import IntArray
from ..settings import WORD_OF_LIST

_COCO = """
    person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant,
    stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe,
    backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball
    bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup, fork, knife,
    spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut, cake, chair,
    couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote, keyboard, cell phone,
    microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear, hair drier,
    toothbrush
"""
COCO = tuple(" ".join(name.split()) for name in _COCO.split(","))
# COCO's numbers of the vehicles that count without names.
CAR = 2
BUS = 5
TRUCK = 7
COCO_VEHICLES = (CAR, BUS, TRUCK)

# The last noun of a vehicle's name, by the COCO number of the vehicle that it resembles most.
_NOUNS = {
    CAR: """auto autos automobile automobiles car cars coupe hatchback jeep limousine minivan pickup policecar
        sedan suv taxi taxis van vans vehicle vehicles""",
    BUS: "autobus bus buses busses minibus schoolbus streetcar tram trams tramway trolleybus",
    TRUCK: """ambulance camper caravan firetruck garbagevan lorries lorry motorhome semitrailer tractor
        trailer trailers truck trucks""",
}
_KIND_OF_NOUN = {noun: kind for kind, nouns in _NOUNS.items() for noun in nouns.split()}
# Words that may follow the noun and do not change it, as in "vehicle.bus.rigid" and "car_parked".
_ADDITIONS = """back big front group large left medium mid moving parked rear right rigid bendy side small
    static stopped""".split()  # noqa: SIM905
# With one of these words, the name is not that of a road vehicle: "non-motorized vehicle", "toy car".
_CONTRARY = "cable fake model no non not rail railway toy train two".split()  # noqa: SIM905
# Words of names that no vehicle has, besides those of COCO; a class with one of them is never proposed.
_NO_VEHICLES = """animal background barrier bike biker bikes building cone cyclist dontcare driver face head
    human ignore lane light man men misc motorbike motorcyclist other pavement pedestrian pedestrians people
    persons plate pole rider road sidewalk sign signs sky tree unknown vegetation woman women""".split()  # noqa: SIM905
SHORT_WORD = 2  # words up to this length are sizes, as in "truck-l-" and "truck-xl-"
SHOWN_NAMES = 6  # number of names in a message


class ClassesError(DataError):
    """No box would count.

    Attributes
    ----------
    problem : the message up to the remedy.
    value : a value of the setting filter.classes that may help, or a word for it, such as NUMBER.
    condition : when the value helps; the end of the message.
    """

    def __init__(self, problem: str, path: str | Path | None, value: str, condition: str):
        super().__init__(f"{problem} set filter.classes to {value}{condition}", path)
        self.problem = str(DataError(problem, path))
        self.value = value
        self.condition = condition


def coco_number(name: str) -> int | None:
    """COCO's number of a class with this name, or None."""
    plain = name.strip().lower()
    return COCO.index(plain) if plain in COCO else None


def vehicle_kind(name: str) -> int | None:
    """COCO's number (car, bus or truck) of the vehicle that a class name means; None for other names.

    The last noun decides: "big truck", "truck-l-" and "vehicle.truck" are trucks, "bus stop" and "license
    plate of a car" are not vehicles.
    """
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    words = re.findall(r"[^\W\d_]+", apart.lower())
    if any(word in _CONTRARY for word in words) or "of" in words:
        return None
    nouns = [word for word in words if len(word) > SHORT_WORD and word not in _ADDITIONS]
    return _KIND_OF_NOUN.get(nouns[-1]) if nouns else None


def label_numbers(names: Sequence[str]) -> IntArray:
    """Numbers (C,) in label files for a model's classes, all different.

    A class has the number of the COCO class with its name, else of the COCO vehicle that it resembles, if the
    number is free; every other class k has the number 80 + k.
    """
    numbers = [coco_number(name) for name in names]
    taken = {number for number in numbers if number is not None}
    for k, name in enumerate(names):
        if numbers[k] is None and (kind := vehicle_kind(name)) is not None and kind not in taken:
            numbers[k] = kind
            taken.add(kind)
    unique = []
    for k, number in enumerate(numbers):
        repeated = number is None or number in unique
        unique.append(len(COCO) + k if number is None or repeated else number)
    return np.array(unique, np.int64)


@dataclass(frozen=True)
class ClassChoice:
    """The classes of a label folder or model that count, and those that do not.

    Attributes
    ----------
    kinds : for the number of each chosen class, the COCO number of its kind; the number itself without names.
    chosen, others : names, or numbers as text without names; absent : words that match no class here.
    """

    kinds: Mapping[int, int]
    chosen: tuple[str, ...]
    others: tuple[str, ...]
    absent: tuple[str, ...]

    def select(self, boxes: Boxes) -> Boxes:
        """The boxes of the chosen classes; their `class_id` is the COCO number of the kind."""
        chosen = boxes[np.isin(boxes.class_id, list(self.kinds))]
        if all(number == kind for number, kind in self.kinds.items()):
            return chosen
        kinds = [self.kinds[number] for number in chosen.class_id.tolist()]
        return replace(chosen, class_id=np.array(kinds, np.int64))

    def sentence(self) -> str:
        """The chosen classes and the others, in one line."""
        text = listed(self.chosen)
        if self.others:
            text += f"; not {listed(self.others)}"
        if self.absent:
            text += f"; there is no class {listed(self.absent)}"
        return text


@dataclass(frozen=True)
class ClassNames:
    """The classes of a label folder or of a model.

    Attributes
    ----------
    names : name by number; empty if there are only numbers.
    source : the file with the names, or the model, for messages.
    written : numbers of the classes whose boxes a detector wrote; None for all.
    of_model : the number here of each class of the model, if a detector wrote the folder; a number that a
        person types is the model's.
    """

    names: Mapping[int, str] = field(default_factory=dict)
    source: str = ""
    written: tuple[int, ...] | None = None
    of_model: tuple[int, ...] = ()

    def choose(self, words: Iterable[str]) -> ClassChoice:
        """The classes with a name or number in `words`; the word `vehicles` means all vehicles by name.

        Without names, the numbers of car, bus and truck are COCO's. Raises `DataError` for a number that no
        class has and a word that is no class name, for a class whose boxes were not written, and
        `ClassesError` if no class is chosen.
        """
        words = tuple(dict.fromkeys(words))
        numbers = list[int]()
        absent = list[str]()
        for word in words:
            found = self._numbers(word)
            numbers += found
            if not found and word != VEHICLES:
                absent.append(word)
        kinds = {number: self._kind(number) for number in sorted(set(numbers))}
        if not kinds:
            raise self._none_chosen(words)
        others = [self._name(number) for number in self.names if number not in kinds]
        chosen = [self._name(number) for number in kinds]
        return ClassChoice(kinds, tuple(chosen), tuple(others), tuple(absent))

    def choose_all(self) -> ClassChoice:
        """All classes with a name."""
        kinds = {number: self._kind(number) for number in sorted(self.names)}
        return ClassChoice(kinds, tuple(map(self._name, kinds)), (), ())

    def _none_chosen(self, words: tuple[str, ...]) -> ClassesError:
        """The error for a choice without a class; it proposes a class only if this may be a vehicle."""
        numbers = list(self.names if self.written is None else self.written)
        found = [self._name(number) for number in numbers]
        what = "a vehicle by its name" if words == (VEHICLES,) else listed(words)
        problem = f"none of the classes is {what}, only {listed(found)}:"
        value = "NAME"
        condition = ", with the name of the vehicles if one of these is theirs"
        vehicles = [number for number in numbers if vehicle_kind(self._name(number)) is not None]
        possible = [number for number in numbers if _may_be_vehicle(self._name(number))]
        if proposed := vehicles or possible:
            name = self._name(proposed[0])
            value = name if re.fullmatch(WORD_OF_LIST, name) else self._number_to_type(proposed[0])
            condition = "" if len(numbers) == 1 or vehicles else ", for example, if these are the vehicles"
        return ClassesError(problem, self.source or None, value, condition)

    def _number_to_type(self, number: int) -> str:
        """The number that a person types for a class."""
        return next(str(typed) for typed, here in self._typed().items() if here == number)

    def _numbers(self, word: str) -> list[int]:
        """The class numbers that a word of the setting means; [] for a class that is known but not here."""
        if word == VEHICLES:
            of_vehicles = [number for number, name in self.names.items() if vehicle_kind(name) is not None]
            numbers = of_vehicles if self.names else list(COCO_VEHICLES)
            return [number for number in numbers if self.written is None or number in self.written]
        plain = word.casefold()
        named = [number for number, name in self.names.items() if name.strip().casefold() == plain]
        if named:  # also a name of digits, since the messages show names
            numbers = named
        elif word.isdecimal():
            typed = self._typed()
            if typed and int(word) not in typed:
                raise DataError(f"filter.classes: there is no class {word[:20]}: {self._overview()}")
            numbers = [typed.get(int(word), int(word))]
        elif self.names:
            numbers = []
        else:
            number = coco_number(word)
            numbers = [] if number is None else [number]
        if not numbers and coco_number(word) is None and vehicle_kind(word) is None:
            near = did_you_mean(word, self.names.values() or COCO)
            raise DataError(f"filter.classes: there is no class {word[:40]!r}: {near}{self._overview()}")
        if not numbers and not self.names:
            raise DataError(f"filter.classes: {word[:40]!r} is not a class of COCO: {self._overview()}")
        if self.written is not None and (lost := [n for n in numbers if n not in self.written]):
            names = listed(map(self._name, self.written))
            raise DataError(
                f"filter.classes: the detector's boxes of class {self._name(lost[0])} were not written, only "
                f"those of {names}; detect again with filter.classes",
                self.source or None,
            )
        return numbers

    def _typed(self) -> dict[int, int]:
        """The number here of each number that a person may type; {} without names."""
        return dict(enumerate(self.of_model)) or {number: number for number in self.names}

    def _overview(self) -> str:
        if not self.names:
            return "there are no class names, so expected a number or a name of COCO"
        named = (f"{typed} {self._name(number)}" for typed, number in self._typed().items())
        return f"expected {listed(named)}"

    def _name(self, number: int) -> str:
        return self.names.get(number, str(number))

    def _kind(self, number: int) -> int:
        """COCO's number of a class, or of the vehicle that it resembles; 80 + number for other names."""
        if number not in self.names:
            return number
        name = self.names[number]
        for kind in (coco_number(name), vehicle_kind(name)):
            if kind is not None:
                return kind
        return len(COCO) + number


def _may_be_vehicle(name: str) -> bool:
    """Whether nothing in a class name says that it is no vehicle, as in a name of another language."""
    words = re.findall(r"[^\W_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
    return coco_number(name) is None and not any(word in _KNOWN_WORDS for word in words)


_KNOWN_WORDS = {word for name in COCO for word in name.split()}.union(_NO_VEHICLES, _CONTRARY)


def no_chosen_box(found: Mapping[int, int], choice: ClassChoice, path: Path) -> ClassesError:
    """The error for a label folder with boxes, by class number, none of which has a chosen class."""
    count = sum(found.values())
    wanted = listed(choice.kinds)
    if tuple(choice.kinds) == COCO_VEHICLES:
        wanted += " (car, bus, truck of COCO)"
    boxes = "1 box" if count == 1 else f"{count} boxes"
    numbers = sorted(found)
    problem = f"{boxes}, none of class {wanted}; found class {listed(numbers)}: add classes.txt or"
    in_coco = listed(f"{number} is {COCO[number]}" for number in numbers if number < len(COCO))
    remark = f" (in COCO, {in_coco})" if in_coco else ""
    vehicles = [number for number in numbers if number in COCO_VEHICLES]
    if len(numbers) == 1 or vehicles:
        value = (vehicles or numbers)[0]
        return ClassesError(problem, path, str(value), f" if class {value} is that of the vehicles{remark}")
    return ClassesError(problem, path, "NUMBER", f" with the number of the vehicles{remark}")


def listed(names: Iterable[object], most: int = SHOWN_NAMES) -> str:
    """Names as text, the first ones of many, each at most 40 characters long."""
    words = [str(name)[:40] for name in names]
    more = f" and {len(words) - most} more" if len(words) > most + 1 else ""
    return ", ".join(words[:most] if more else words) + more
