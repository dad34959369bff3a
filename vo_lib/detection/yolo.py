"""Vehicle boxes from a YOLO network, run by ONNX Runtime (chapter 5).

detector = YoloDetector("street", DetectorConfig())
boxes = detector.detect(image)          # (H, W) grey or (H, W, 3) BGR
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from ..errors import DataError
from ..geometry.boxes import Boxes
from ..geometry.types import Array, Image
from . import layout
from .class_names import COCO, choose_classes, class_numbers, names_from_metadata
from .models import find_model
from .settings import DetectorConfig

PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
USUAL_INPUT_PX = 640  # longer side of the training images of most models
INPUT_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
LOG_FATAL = 4  # log level that hides ONNX Runtime's messages on errors, which the kit reports itself


@dataclass(frozen=True, eq=False)
class NetworkOutput:
    """Boxes and scores of all cells of a network, before the selection of boxes.

    Attributes
    ----------
    letterbox : position of the image in the network's image. width, height : size of the image, pixels.
    corners : (N, 4) x0, y0, x1, y1 in the network's image, pixels; scores : (N, C) of the classes.
    """

    letterbox: layout.Letterbox
    corners: Array
    scores: Array
    width: int
    height: int


class YoloDetector:
    """A YOLOv8 or YOLOX network in an ONNX file.

    Attributes
    ----------
    path : the file. config : the settings.
    names : class names from the model's metadata; COCO's names for 80 classes without names.
    layout : "yolov8", output [1, 4 + C, N], or "yolox", output [1, N, 5 + C] before decoding.
    """

    def __init__(
        self, model: str | Path, config: DetectorConfig | None = None, *, provider: str = "cpu"
    ) -> None:
        """Load a model (name, or path of an ONNX file) on provider "cpu" or "cuda"; run the model once.

        Raises `DataError` for a file that is not a usable model, or a provider that is not installed.
        """
        self.path, self.config = find_model(model), config or DetectorConfig()
        self._session = _open_session(self.path, self.config.threads, provider)
        self._input, self._width, self._height = self._check_input()
        self._type = INPUT_TYPES[self._input.type]
        width, height = self._width or 128, self._height or 64
        output = self._run(np.zeros((1, 3, height, width), self._type))
        self.layout, count = self._check_output(output, width, height)
        metadata = self._session.get_modelmeta().custom_metadata_map
        default_names = COCO if count == len(COCO) else tuple(f"class {k}" for k in range(count))
        self.names = names_from_metadata(metadata.get("names", ""), count) or default_names
        self._default_size = layout.size_from_metadata(metadata.get("imgsz", "")) or USUAL_INPUT_PX
        self._numbers = class_numbers(self.names)
        self._class_mask = choose_classes(self.config.classes, self.names)
        if not self._class_mask.any():
            classes, names = ", ".join(self.config.classes), ", ".join(self.names)
            raise DataError(f"the model has none of the classes {classes}, only {names[:200]}", self.path)

    def detect(self, image: Image) -> Boxes:
        """Boxes in a uint8 image, grey (H, W) or BGR (H, W, 3); best first, with COCO class numbers.

        For a grey image, the network's input has three equal channels.
        """
        return self.select_boxes(self.candidates(image), self.config.score, self.config.nms)

    def candidates(self, image: Image) -> NetworkOutput:
        """The network's output for an image, as in `detect`, before the selection of boxes."""
        height, width = image.shape[:2]
        size, centred = self.input_size(width, height), self.layout == "yolov8"
        letterbox = layout.fit_letterbox(width, height, *size, centred)
        output = self._run(self._to_input(layout.letterboxed(image, letterbox)))
        corners, scores = layout.read_yolov8(output) if centred else layout.read_yolox(output, *size)
        return NetworkOutput(letterbox, corners, scores, width, height)

    def select_boxes(self, output: NetworkOutput, score: float, nms: float) -> Boxes:
        """The boxes, in pixels of the image, from a network's output with these thresholds."""
        boxes = layout.best_boxes(output.corners, output.scores, score, nms, self._class_mask)
        xyxy = output.letterbox.to_image(boxes.xyxy, output.width, output.height)
        return dataclasses.replace(boxes, xyxy=xyxy, class_id=self._numbers[boxes.class_id])

    def input_size(self, width: int, height: int) -> tuple[int, int]:
        """Width and height of the network's image for an image of this size.

        A size fixed by the model is used. Otherwise the input has the aspect ratio of the image. The longer
        side is `config.size`, or, if that is 0, the size in the model's metadata, or else 640.
        """
        free_width, free_height = layout.fit_size(width, height, self.config.size or self._default_size)
        return self._width or free_width, self._height or free_height

    def _to_input(self, image: Image) -> NDArray[Any]:
        """The network's input (1, 3, H, W): RGB in 0..1 for YOLOv8, BGR in 0..255 for YOLOX."""
        if image.ndim == 2:
            planes = np.broadcast_to(image, (3, *image.shape))
        else:
            ordered = image[:, :, ::-1] if self.layout == "yolov8" else image
            planes = ordered.transpose(2, 0, 1)
        scale = 1.0 / 255.0 if self.layout == "yolov8" else 1.0
        return np.multiply(planes[None], scale, dtype=np.float32).astype(self._type, copy=False)

    def _run(self, images: NDArray[Any]) -> NDArray[np.float32]:
        try:
            return np.asarray(self._session.run(None, {self._input.name: images})[0][0], np.float32)
        except Exception as error:  # ONNX Runtime's exception types have no common base class
            raise DataError(f"ONNX Runtime cannot run this model: {_first_line(error)}", self.path) from None

    def _check_input(self) -> tuple[Any, int, int]:
        """The model's input with its width and height in pixels, 0 if the model does not fix the size."""
        inputs = self._session.get_inputs()
        shape = inputs[0].shape
        if len(inputs) != 1 or len(shape) != 4 or shape[1] != 3 or shape[0] not in (1, None, str(shape[0])):
            raise DataError(f"expected one input [1, 3, height, width], found {shape}", self.path)
        if inputs[0].type not in INPUT_TYPES:
            raise DataError(f"expected an input of floating-point numbers, found {inputs[0].type}", self.path)
        height, width = (side if isinstance(side, int) else 0 for side in shape[2:])
        return inputs[0], width, height

    def _check_output(self, output: NDArray[np.float32], width: int, height: int) -> tuple[str, int]:
        """Layout and number of classes, from the output for an image of this size."""
        rows, columns = output.shape if output.ndim == 2 else (0, 0)
        cells = layout.yolox_cells(width, height)
        if rows == cells and columns > 5:
            return "yolox", columns - 5
        if columns == cells and rows > 4:
            return "yolov8", rows - 4
        raise DataError(
            f"unknown layout: expected the output [1, 4 + classes, N] of YOLOv8 or [1, N, 5 + classes] of "
            f"YOLOX, N = {cells} for {width}×{height} px, found {[1, *output.shape]}",
            self.path,
        )


def _open_session(path: Path, threads: int, provider: str) -> Any:
    provider_class = PROVIDERS[provider]
    if provider_class not in onnxruntime.get_available_providers():
        raise DataError(f"provider {provider} is not in this ONNX Runtime: install onnxruntime-gpu instead")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = LOG_FATAL
    onnxruntime.set_default_logger_severity(LOG_FATAL)  # the providers' logger
    # Threads that wait in a busy loop would slow down the odometry.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[provider_class])
    except Exception as error:  # ONNX Runtime's exception types have no common base class
        raise DataError(f"is not a model that ONNX Runtime can load: {_first_line(error)}", path) from None
    if session.get_providers()[0] != provider_class:
        raise DataError(f"provider {provider} did not start: expected an NVIDIA GPU with CUDA and cuDNN")
    return session


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0][:200]
