"""Train YOLOv8, the paper's detector, and export it as ONNX.

examples:
  vo data train_detector data/cars --out runs/cars --epochs 400
  vo data train_detector roboflow/data.yaml --out runs/cars \\
      --weights yolov8n.pt --register cars
  vo data train_detector data/street --out runs/street \\
      --one-class vehicle --size 800

The training uses Ultralytics (extra `[train]`) and a data set in YOLO format.
Ultralytics and the trained models are under AGPL-3.0: see
https://www.ultralytics.com/license. An interrupted training continues after
its last complete epoch. The output folder contains data.yaml, train/ (weights,
curves) and detector.onnx, the model for `vo run --detector` and `vo data
write_labels`.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import yaml

from fetch.detectors import register_detector
from training.dataset import SPLITS, DetectionSet, open_set
from training.evaluated import refuse_evaluated
from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import install, print_lines, print_wrapped
from vo_lib.detection.model_files import copy_model
from vo_lib.detection.models import detector_folder, list_detectors
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.files import read_text, write_atomic
from vo_lib.runs.folder import refuse_foreign

MODEL = "detector.onnx"
OWN = "# written by `vo data train_detector`\n"  # first line of data.yaml, by which the folder is recognised
FAILURES = (RuntimeError, AssertionError, ValueError, TypeError, OSError)  # of Ultralytics for damaged files
LICENCE = "AGPL-3.0"
FROM_SCRATCH = "yolov8n.yaml"  # the smallest YOLOv8, with random weights
FINISHED = "finished"  # file beside the weights of a complete training


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the training."""
    parser.add_argument("data", type=Path, help="data.yaml, or its folder")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the training")
    parser.add_argument("--one-class", metavar="NAME", help="merge all classes into one class NAME")
    parser.add_argument(
        "--weights", type=Path, metavar="FILE", help="initial weights, a .pt file; default: random"
    )
    parser.add_argument("--epochs", default="400", metavar="N", help="epochs; default 400, as in the paper")
    parser.add_argument("--size", default="640", metavar="PX", help="longer image side, pixels; default 640")
    parser.add_argument("--batch", default="16", metavar="N", help="images per step; default 16")
    parser.add_argument("--seed", default="0", metavar="N", help="random seed; default 0")
    parser.add_argument("--device", default="cpu", help="cpu, or the number of a GPU; default cpu")
    parser.add_argument("--register", metavar="NAME", help="register the model under this name")
    parser.add_argument("--allow-evaluated", action="store_true", help="also train on KITTI odometry images")


def run(options: argparse.Namespace) -> int:
    """Train and export a model, and print its quality."""
    training = read_numbers(options)
    data = open_set(options.data)
    for folder in data.outside():
        print_wrapped(f"note: images outside the folder of data.yaml: {folder}")
    if not options.allow_evaluated:
        refuse_evaluated(path for part in data.images.values() for path in part)
    if options.weights is not None and not options.weights.is_file():
        raise DataError("the file is missing", options.weights)
    if options.register in list_detectors():
        raise DataError(f"--register {options.register}: a detector has this name; choose another name")
    model = options.out / MODEL
    described = options.out / "data.yaml"
    own = described.is_file() and read_text(described).startswith(OWN)
    lists = [f"{split}.txt" for split in SPLITS]
    refuse_foreign(options.out, ("data.yaml", *lists, "train", MODEL), own)
    YOLO = _ultralytics()
    options.out.mkdir(parents=True, exist_ok=True)
    _describe(data, options.one_class, described)
    split = "test" if data.images["test"] else "val"
    print_wrapped(f"Ultralytics and the trained models are under {LICENCE}.")
    try:
        weights = _train(YOLO, described, training, options)
        quality, exported = _test_and_export(YOLO, weights, described, split, training, options)
    except FAILURES as error:
        words = (str(error).splitlines() or [type(error).__name__])[0]
        raise DataError(f"Ultralytics: {words[:160]}") from None
    copy_model(exported, model)
    YoloDetector(model)  # raises `DataError` if the copy does not work
    (weights / FINISHED).touch()
    print_wrapped(f"{model}: mAP50 {quality.map50:.3f}, mAP50-95 {quality.map:.3f} on {split}")
    if options.register is not None:
        register(options.register, model, quality.map50)
    return 0


def read_numbers(options: argparse.Namespace) -> dict[str, int]:
    """The numbers of a training, by the names of Ultralytics' parameters; `DataError` for impossible ones."""
    return {
        "epochs": parse_whole("--epochs", options.epochs),
        "imgsz": parse_whole("--size", options.size),
        "batch": parse_whole("--batch", options.batch),
        "seed": parse_whole("--seed", options.seed, least=0),
    }


def _train(YOLO: Any, described: Path, training: dict[str, int], options: argparse.Namespace) -> Path:
    """Begin a training, or go on with an interrupted one; return the folder of its weights.

    YOLO : the model class of Ultralytics; described : data.yaml.
    """
    weights = Path(options.out / "train" / "weights")
    last = weights / "last.pt"
    is_interrupted = last.is_file() and not (weights / FINISHED).is_file()
    if is_interrupted:
        YOLO(str(last)).train(resume=True)
        return weights
    YOLO(str(options.weights or FROM_SCRATCH)).train(
        data=str(described),
        project=str(options.out.resolve()),
        name="train",
        **training,
        device=options.device,
        single_cls=options.one_class is not None,
        exist_ok=True,
        amp=False,
        workers=2,
    )
    return weights


def _test_and_export(
    YOLO: Any,
    weights: Path,
    described: Path,
    split: str,
    training: dict[str, int],
    options: argparse.Namespace,
) -> tuple[Any, Path]:
    """The quality of the best weights on a split, with `map50` and `map`, and their ONNX file."""
    best = YOLO(str(weights / "best.pt"))
    if options.one_class is not None:
        best.model.names = {0: options.one_class}  # Ultralytics names a single class "item"
    size = training["imgsz"]
    result = best.val(data=str(described), split=split, imgsz=size, device=options.device, plots=False)
    exported = best.export(format="onnx", dynamic=True, simplify=False, imgsz=size)
    return result.box, Path(exported)


def register(name: str, model: Path, map50: float) -> None:
    """Register a model under a name; `DataError` if the model detected nothing on the test images."""
    if map50 == 0:
        command = f"vo data get_detector {name} --from {model}"
        raise DataError(f"not registered: detects nothing on the test images; add it with: {command}", model)
    register_detector(name, model, detector_folder())
    print_lines(f"registered: vo run … --detector {name}")


def _ultralytics() -> Any:
    """The model class of Ultralytics, with usage reports and the installation of packages turned off."""
    os.environ.setdefault("YOLO_AUTOINSTALL", "false")
    try:
        import onnx  # noqa: F401  (needed for the export)
        from ultralytics import YOLO, settings
    except ImportError as error:
        raise DataError(f"{error.name} is missing: {install('train')}") from None
    settings.update({"sync": False})
    return YOLO


def _describe(data: DetectionSet, one_class: str | None, described: Path) -> None:
    """Write data.yaml with a list of images for each split, so that Ultralytics runs from any folder."""
    lists: dict[str, str] = {}
    for split, key in SPLITS.items():
        if data.images[split]:
            file = described.absolute().with_name(f"{split}.txt")
            write_atomic(file, "".join(f"{image}\n" for image in data.images[split]))
            lists[key] = str(file)
    names = [one_class] if one_class is not None else list(data.names)
    content = {**lists, "names": dict(enumerate(names))}
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    write_atomic(described, f"{OWN}{text}")
