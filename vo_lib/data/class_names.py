"""Class names: COCO's numbers, the names of vehicles, the choice of the classes that count (chapter 5).

A class has up to three numbers. These are those of a detector with the classes van, car and person:

| number | van | car | person |
|---|---|---|---|
| the model's own | 0 | 1 | 2 |
| in label files, by `label_numbers` | 80 | 2 | 0 |
| of its kind, in `ClassChoice.kinds` | 2 | 2 | 0 |

The kind of a class is COCO's class with its name, or else the vehicle of COCO that it resembles most: here,
van and car are both cars. In label files, a class has the number of its kind if no other class has it, and
otherwise 80, the count of COCO's classes, plus its own. Boxes that count have the number of their kind.
Labels of other programs have one number in place of the first two.

A class without a kind, such as a helmet, gets 80 plus its number in `ClassNames.names`. A helmet with the
number 82 there gets 162, which says no more than that this is no class of COCO.
"""

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

# The nouns of vehicles' names, by the COCO number of the vehicle that they resemble most.
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
# Words of classes that are no vehicles, besides the words of COCO.
_NO_VEHICLES = """animal background barrier bike biker bikes building cone cyclist dontcare driver face head
    human ignore lane light man men misc motorbike motorcyclist other pavement pedestrian pedestrians people
    persons plate pole rider road sidewalk sign signs sky tree unknown vegetation woman women""".split()  # noqa: SIM905
# A class with one of these words is never proposed as that of the vehicles.
_KNOWN_WORDS = {word for name in COCO for word in name.split()}.union(_NO_VEHICLES, _CONTRARY)
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


def _spaced(name: str) -> str:
    """A name in lower case with a blank between the words that capitals begin: "bigTruck" is "big truck"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def vehicle_kind(name: str) -> int | None:
    """COCO's number (car, bus or truck) of the vehicle that a class name means; None for other names.

    The last noun decides: "big truck", "truck-l-" and "vehicle.truck" are trucks, "bus stop" and "license
    plate of a car" are not vehicles.
    """
    words = re.findall(r"[^\W\d_]+", _spaced(name))
    if any(word in _CONTRARY for word in words) or "of" in words:
        return None
    nouns = [word for word in words if len(word) > SHORT_WORD and word not in _ADDITIONS]
    return _KIND_OF_NOUN.get(nouns[-1]) if nouns else None


def _may_be_vehicle(name: str) -> bool:
    """Whether nothing in a class name says that it is no vehicle, as in a name of another language."""
    words = re.findall(r"[^\W_]+", _spaced(name))
    return coco_number(name) is None and not any(word in _KNOWN_WORDS for word in words)


def label_numbers(names: Sequence[str]) -> IntArray:
    """Numbers (C,) in label files for a model's classes, all different.

    A class has the number of the COCO class with its name, else of the COCO vehicle that it resembles, if the
    number is free; every other class k has the number 80 + k.
    """
    proposed = [coco_number(name) for name in names]
    for k, name in enumerate(names):
        kind = vehicle_kind(name)
        if proposed[k] is None and kind is not None and kind not in proposed:
            proposed[k] = kind
    numbers: list[int] = []
    for k, number in enumerate(proposed):
        if number is None or number in numbers:  # two classes may have the same name
            number = len(COCO) + k
        numbers.append(number)
    return np.array(numbers, np.int64)


@dataclass(frozen=True)
class ClassChoice:
    """The classes of a label folder or model that count, and those that do not.

    Attributes
    ----------
    kinds : for the number of each chosen class, the COCO number of its kind; the number itself without names.
    chosen, others : names of the classes that count and of those that do not; numbers as text without names.
    absent : words of the choice that match no class here.
    """

    kinds: Mapping[int, int]
    chosen: tuple[str, ...]
    others: tuple[str, ...]
    absent: tuple[str, ...]

    def select(self, boxes: Boxes) -> Boxes:
        """The boxes of the chosen classes; their `class_id` is the COCO number of the kind."""
        chosen = boxes[np.isin(boxes.class_id, list(self.kinds))]
        if all(number == kind for number, kind in self.kinds.items()):
            return chosen  # as for labels with COCO's numbers
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
    names : name by number, in label files or of a model; empty if there are only numbers.
    source : the file with the names, or the model, for messages.
    written : numbers, as in `names`, of the classes whose boxes a detector wrote; None for all.
    of_model : if a detector wrote the folder, the number in `names` of each class of the model, in the order
        of the model's own numbers; a number that a person types is then the model's own.
    """

    names: Mapping[int, str] = field(default_factory=dict)
    source: str = ""
    written: tuple[int, ...] | None = None
    of_model: tuple[int, ...] = ()

    def choose(self, words: Iterable[str]) -> ClassChoice:
        """The classes with a name or number in `words`; the word `vehicles` means all vehicles by name.

        Without names, the numbers of car, bus and truck are COCO's.

        Raises `DataError` for a number that no class has, a word that is no class name, and a class whose
        boxes were not written; `ClassesError` if no class is chosen.
        """
        words = tuple(dict.fromkeys(words))
        numbers = list[int]()
        absent = list[str]()
        for word in words:
            if word == VEHICLES:
                numbers += self._vehicle_numbers()
                continue
            meant = self._numbers_of(word)
            numbers += meant
            if not meant:
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
        chosen = tuple(self._name(number) for number in kinds)
        return ClassChoice(kinds, chosen, others=(), absent=())

    def _none_chosen(self, words: tuple[str, ...]) -> ClassesError:
        """The error for a choice without a class; it proposes a class only if this may be a vehicle."""
        numbers = list(self.names if self.written is None else self.written)
        what = "a vehicle by its name" if words == (VEHICLES,) else listed(words)
        problem = f"none of the classes is {what}, only {listed(map(self._name, numbers))}:"
        source = self.source or None
        vehicles = [number for number in numbers if vehicle_kind(self._name(number)) is not None]
        possible = [number for number in numbers if _may_be_vehicle(self._name(number))]
        if vehicles:
            return ClassesError(problem, source, self._word_to_type(vehicles[0]), "")
        if possible:
            condition = "" if len(numbers) == 1 else ", for example, if these are the vehicles"
            return ClassesError(problem, source, self._word_to_type(possible[0]), condition)
        condition = ", with the name of the vehicles if one of these is theirs"
        return ClassesError(problem, source, "NAME", condition)

    def _word_to_type(self, number: int) -> str:
        """The word that a person types for a class: its name or, if the setting cannot have it, a number."""
        name = self._name(number)
        if re.fullmatch(WORD_OF_LIST, name):
            return name
        return next(str(typed) for typed, meant in self._number_by_typed().items() if meant == number)

    def _vehicle_numbers(self) -> list[int]:
        """The numbers of the vehicles whose boxes are here, by their names or, without names, by COCO's."""
        if self.names:
            numbers = [number for number, name in self.names.items() if vehicle_kind(name) is not None]
        else:
            numbers = list(COCO_VEHICLES)
        if self.written is None:
            return numbers
        return [number for number in numbers if number in self.written]

    def _numbers_of(self, word: str) -> list[int]:
        """The numbers of the classes that a word means; [] for a class that is known but not here.

        Raises `DataError` as `choose`.
        """
        numbers = self._find(word)
        if not numbers:
            self._require_known(word)
        self._require_written(numbers)
        return numbers

    def _find(self, word: str) -> list[int]:
        """The numbers of the classes with this name or this typed number; COCO's names if there are none."""
        plain = word.casefold()
        named = [number for number, name in self.names.items() if name.strip().casefold() == plain]
        if named:  # also a name of digits, since the messages show names
            return named
        if word.isdecimal():
            number_by_typed = self._number_by_typed()
            if number_by_typed and int(word) not in number_by_typed:
                raise DataError(f"filter.classes: there is no class {word[:20]}: {self._overview()}")
            return [number_by_typed.get(int(word), int(word))]
        number = coco_number(word)
        if self.names or number is None:
            return []
        return [number]

    def _require_known(self, word: str) -> None:
        """Raise `DataError` for a word that means no class here.

        Where there are names, a class of COCO or a vehicle may be one of other labels, and is no error.
        """
        if coco_number(word) is None and vehicle_kind(word) is None:
            near = did_you_mean(word, self.names.values() or COCO)
            raise DataError(f"filter.classes: there is no class {word[:40]!r}: {near}{self._overview()}")
        if not self.names:
            raise DataError(f"filter.classes: {word[:40]!r} is not a class of COCO: {self._overview()}")

    def _require_written(self, numbers: list[int]) -> None:
        """Raise `DataError` for a class whose boxes the detector did not write."""
        if self.written is None:
            return
        for number in numbers:
            if number not in self.written:
                names = listed(map(self._name, self.written))
                raise DataError(
                    f"filter.classes: the detector's boxes of class {self._name(number)} were not written, "
                    f"only those of {names}; detect again with filter.classes",
                    self.source or None,
                )

    def _number_by_typed(self) -> dict[int, int]:
        """The number in `names` for each number that a person may type; {} without names."""
        if self.of_model:
            return dict(enumerate(self.of_model))
        return {number: number for number in self.names}

    def _overview(self) -> str:
        """What a person may type, as words for the end of a message."""
        if not self.names:
            return "there are no class names, so expected a number or a name of COCO"
        named = [f"{typed} {self._name(number)}" for typed, number in self._number_by_typed().items()]
        return f"expected {listed(named)}"

    def _name(self, number: int) -> str:
        """The name of a class, or its number as text."""
        return self.names.get(number, str(number))

    def _kind(self, number: int) -> int:
        """COCO's number of a class, or of the vehicle that it resembles; 80 + number for other names.

        Without a name it is the number itself.
        """
        if number not in self.names:
            return number
        name = self.names[number]
        kind = coco_number(name)
        if kind is None:
            kind = vehicle_kind(name)
        return len(COCO) + number if kind is None else kind


def no_chosen_box(counts: Mapping[int, int], choice: ClassChoice, path: Path) -> ClassesError:
    """The error for a label folder without names and without a box of a chosen class.

    counts : number of boxes of each class, at least one in all.
    """
    count = sum(counts.values())
    wanted = listed(choice.kinds)
    if tuple(choice.kinds) == COCO_VEHICLES:
        wanted += " (car, bus, truck of COCO)"
    boxes = "1 box" if count == 1 else f"{count} boxes"
    numbers = sorted(counts)
    problem = f"{boxes}, none of class {wanted}; found class {listed(numbers)}: add classes.txt or"
    in_coco = listed(f"{number} is {COCO[number]}" for number in numbers if number < len(COCO))
    remark = f" (in COCO, {in_coco})" if in_coco else ""
    vehicles = [number for number in numbers if number in COCO_VEHICLES]
    if vehicles or len(numbers) == 1:
        value = vehicles[0] if vehicles else numbers[0]
        return ClassesError(problem, path, str(value), f" if class {value} is that of the vehicles{remark}")
    return ClassesError(problem, path, "NUMBER", f" with the number of the vehicles{remark}")


def listed(names: Iterable[object], most: int = SHOWN_NAMES) -> str:
    """Names as text, separated by commas: all, or the first `most`; each at most 40 characters long."""
    words = [str(name)[:40] for name in names]
    if len(words) <= most + 1:  # the last name is as short as "and 1 more"
        return ", ".join(words)
    return f"{', '.join(words[:most])} and {len(words) - most} more"
