"""Boxes from a detection network, run by ONNX Runtime (chapter 5).

detector = YoloDetector("street", DetectorConfig())
boxes = detector.detect(image)          # (H, W) grey or (H, W, 3) BGR
"""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from ..data.class_names import COCO
from ..errors import DataError
from ..geometry.boxes import Boxes
from ..geometry.types import Array, BoolArray, Image
from .metadata import read_metadata
from .model_files import model_files
from .models import find_model
from .network_image import Letterbox, fit_letterbox, fit_size, fit_stretched, letterboxed
from .outputs import Output, OutputLayout, recognise
from .readers import ScoredBoxes, UnusableOutput
from .settings import DetectorConfig
from .suppression import best_boxes

PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
USUAL_INPUT_PX = 640  # longer side of the training images of most models
# Size of the test image of a network that takes every size, pixels: small, but no grid of
# `outputs.STRIDE_SETS` has 300 cells, the usual number of boxes that a network selects itself.
TEST_WIDTH = 320
TEST_HEIGHT = 256
# Sides of an original image, pixels. Given to RT-DETR in both orders, they show which it takes for the width.
LONG_SIDE = 1000
SHORT_SIDE = 100
INPUT_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
}
SIZES_INPUT = "orig_target_sizes"  # of RT-DETR and its relatives: width and height of the original image
LOG_FATAL = 4  # log level that hides ONNX Runtime's messages on errors, which the kit reports itself
# Operators that ONNX Runtime has not; exports for TensorRT contain them.
TENSORRT = re.compile(r"TRT\b|_TRT|EfficientNMS|BatchedNMS")


@dataclass(frozen=True, eq=False)
class NetworkOutput:
    """All boxes that a network gives for an image, and their scores, before the selection of boxes.

    Attributes
    ----------
    letterbox : position of the image in the network's image.
    corners : (N, 4) x0, y0, x1, y1 in the network's image, pixels. scores : (N, C) of the classes.
    width, height : size of the image, pixels.
    """

    letterbox: Letterbox
    corners: Array
    scores: Array
    width: int
    height: int


class YoloDetector:
    """A detection network in an ONNX file; module `outputs` lists the layouts that are read.

    Attributes
    ----------
    path : the file. config : the settings.
    names : class names in the order of the model's class numbers. COCO's for a model of 80 classes without
        names; None for another model without names.
    named : the names are the model's own.
    class_count : number of classes; None if the file does not tell.
    layout_name : name of the layout of the outputs, such as "yolov8".
    """

    def __init__(
        self, model: str | Path, config: DetectorConfig | None = None, *, provider: str = "cpu"
    ) -> None:
        """Load a model (name, or path of an ONNX file) on provider "cpu" or "cuda"; run it on black images.

        Raises `DataError` for a file that is not a usable model, or a provider that is not installed.
        """
        self.path = find_model(model)
        self.config = config or DetectorConfig()
        self._session = _open_session(self.path, self.config.threads, provider)
        # What the network takes; a side of the image that the file leaves open, by a name or None, is 0.
        self._input, self._sizes_input = self._find_inputs()
        self._type = INPUT_TYPES[self._input.type]
        _, _, height, width = self._input.shape
        self._height = height if isinstance(height, int) else 0
        self._width = width if isinstance(width, int) else 0
        try:
            self._metadata = read_metadata(self._session.get_modelmeta().custom_metadata_map)
        except ValueError as error:
            raise DataError(str(error), self.path) from None
        # What the network gives, from its outputs for black images.
        self._output_layout = self._recognise_outputs()
        self.layout_name = self._output_layout.name
        self._height_first = self._sizes_input is not None and self._expects_height_first()
        # The classes, by the file's own names or by COCO's.
        self.class_count = self._output_layout.class_count
        self.named = self._metadata.names is not None
        self.names = self._metadata.names
        if self.names is None and self.class_count == len(COCO):
            self.names = COCO

    def detect(self, image: Image, class_mask: BoolArray | None = None) -> Boxes:
        """Boxes in a uint8 image, grey (H, W) or BGR (H, W, 3), best first; `class_id` is the model's number.

        For a grey image, the network's input has three equal channels.

        class_mask : mask (C,) of the wanted classes by number, all by default; boxes of other classes take no
            part in the suppression.

        Raises `DataError` as `select_boxes`, and if the network cannot be run or its output cannot be read.
        """
        return self.select_boxes(self.candidates(image), self.config.score, self.config.nms, class_mask)

    def candidates(self, image: Image) -> NetworkOutput:
        """The network's output for an image, as in `detect`, before the selection of boxes."""
        height, width = image.shape[:2]
        net_width, net_height = self.input_size(width, height)
        if self._is_stretched:
            letterbox = fit_stretched(width, height, net_width, net_height)
        else:
            centred = self._output_layout.placement == "centred"
            letterbox = fit_letterbox(width, height, net_width, net_height, centred)
        original_size = (height, width) if self._height_first else (width, height)
        outputs = self._run(self._to_input(letterboxed(image, letterbox)), original_size)
        corners, scores = self._read(outputs, letterbox, width, height)
        return NetworkOutput(letterbox, corners, scores, width, height)

    def select_boxes(
        self, output: NetworkOutput, score: float, nms: float, class_mask: BoolArray | None = None
    ) -> Boxes:
        """The boxes, in pixels of the image, from a network's output with these thresholds.

        Raises `DataError` if most boxes are not in the image, as after an export of another kind.
        """
        boxes = best_boxes(
            output.corners, output.scores, score, nms, class_mask, one_to_one=self._output_layout.one_to_one
        )
        self._check_boxes(boxes, output.letterbox)
        return dataclasses.replace(
            boxes, xyxy=output.letterbox.to_image(boxes.xyxy, output.width, output.height)
        )

    def input_size(self, width: int, height: int) -> tuple[int, int]:
        """Width and height of the network's image for an image of this size.

        A size fixed by the model is used. Otherwise the input has the aspect ratio of the image, or is square
        where the network wants the image stretched. The longer side is `config.size`, or, if that is 0, the
        size in the model's metadata, or else 640.
        """
        longer = self.config.size or self._default_size
        if self._is_stretched:
            free_width, free_height = fit_size(longer, longer, longer)
        else:
            free_width, free_height = fit_size(width, height, longer)
        return self._width or free_width, self._height or free_height

    @property
    def _default_size(self) -> int:
        """Longer side of the network's image, pixels, if neither the model nor the settings fix it."""
        return self._metadata.size or USUAL_INPUT_PX

    @property
    def _is_stretched(self) -> bool:
        """Whether the network wants the image stretched over its whole input."""
        return self._output_layout.placement == "stretched" or self._sizes_input is not None

    def _to_input(self, image: Image) -> NDArray[Any]:
        """The network's input (1, 3, H, W): RGB in 0..1, or BGR in 0..255 for YOLOX and inputs of bytes.

        image : the network's image, uint8, grey (H, W) or BGR (H, W, 3).
        """
        in_bytes = self._output_layout.wants_bgr_bytes or self._type == np.uint8
        if image.ndim == 2:
            planes = np.broadcast_to(image, (3, *image.shape))
        else:
            ordered = image if in_bytes else image[:, :, ::-1]
            planes = ordered.transpose(2, 0, 1)
        if self._type == np.uint8:
            return np.ascontiguousarray(planes[None])
        scale = 1.0 if in_bytes else 1.0 / 255.0
        return np.multiply(planes[None], scale, dtype=np.float32).astype(self._type, copy=False)

    def _run(self, images: NDArray[Any], original_size: tuple[int, int]) -> list[NDArray[Any]]:
        """The outputs for a network's input (1, 3, H, W); `DataError` if ONNX Runtime cannot run the model.

        original_size : of the original image, pixels, in the order that the network expects, if it asks.
        """
        feed = {self._input.name: images}
        if self._sizes_input is not None:
            feed[self._sizes_input.name] = np.array([original_size], np.int64)
        try:
            return [np.asarray(output) for output in self._session.run(None, feed)]
        except Exception as error:  # ONNX Runtime's exception types have no common base class
            raise DataError(f"ONNX Runtime cannot run this model: {_first_line(error)}", self.path) from None

    def _read(
        self, outputs: list[NDArray[Any]], letterbox: Letterbox, width: int, height: int
    ) -> ScoredBoxes:
        """The boxes in a network's outputs, in pixels of the network's image.

        width, height : size of the original image, pixels. A network with an input for this size gives its
            boxes in pixels of the original image; here they are scaled to the network's image.
        Raises `DataError` if the outputs cannot be read.
        """
        asks_for_size = self._sizes_input is not None
        read_width = width if asks_for_size else letterbox.width
        read_height = height if asks_for_size else letterbox.height
        corners, scores = self._read_unscaled(outputs, read_width, read_height)
        if len(corners) and np.isnan(corners).all():
            raise DataError(
                "the network's output is not a number for any box: if it calculates with 16 bits, export it "
                "with 32 (half=False)",
                self.path,
            )
        if asks_for_size:
            scale_x = letterbox.width / width
            scale_y = letterbox.height / height
            corners = corners * (scale_x, scale_y, scale_x, scale_y)
        return ScoredBoxes(corners, scores)

    def _read_unscaled(self, outputs: list[NDArray[Any]], width: int, height: int) -> ScoredBoxes:
        """`Reader.read`, but with a `DataError` if the outputs cannot be read."""
        try:
            return self._output_layout.reader.read(outputs, width, height)
        except UnusableOutput as error:
            raise DataError(str(error), self.path) from None

    def _check_boxes(self, boxes: Boxes, letterbox: Letterbox) -> None:
        """Raise `DataError` if most of the boxes, in the network's image, have their centre far outside."""
        size = np.array([letterbox.width, letterbox.height])
        centre = (boxes.xyxy[:, :2] + boxes.xyxy[:, 2:]) / 2
        outside = np.any((centre < -0.5 * size) | (centre > 1.5 * size), axis=1)
        count = np.count_nonzero(outside)
        if count > len(boxes) / 2:
            raise DataError(
                f"{count} of {len(boxes)} boxes are outside the image: the output, taken as "
                f"{self.layout_name}, seems to be of another kind",
                self.path,
            )

    def _find_inputs(self) -> tuple[Any, Any]:
        """The model's input for the image, and that for the size of the original image or None.

        Raises `DataError` for other inputs.
        """
        images, *others = self._session.get_inputs()
        sizes = None
        if len(others) == 1 and others[0].name == SIZES_INPUT and others[0].type == "tensor(int64)":
            sizes = others.pop()
        if others:
            names = ", ".join(other.name for other in others)
            raise DataError(
                f"expected one input [1, 3, height, width], found further ones: {names[:100]}; export the "
                "model so that it needs the image alone",
                self.path,
            )
        self._check_shape(images.shape)
        if images.type not in INPUT_TYPES:
            raise DataError(f"expected an input of floating-point numbers, found {images.type}", self.path)
        return images, sizes

    def _check_shape(self, shape: list[Any]) -> None:
        """Raise `DataError` for an input that is not one image; a number is fixed, a text or None is open."""
        remedy = ""
        if len(shape) == 4:
            batch, channels, _, last = shape
            is_fixed = isinstance(batch, int)
            if channels == 3 and (batch == 1 or not is_fixed):
                return
            if is_fixed and batch > 1:
                remedy = ": export it with batch=1"
            elif last == 3:
                remedy = ": the order of TensorFlow; export it from PyTorch"
        raise DataError(f"expected one input [1, 3, height, width], found {shape}{remedy}", self.path)

    def _recognise_outputs(self) -> OutputLayout:
        """The layout of the outputs, from those for a black image.

        A network that takes every size gets a small image, and one of its usual size if that does not tell.
        Raises `DataError` if neither tells.
        """
        try:
            return self._recognise_at(self._width or TEST_WIDTH, self._height or TEST_HEIGHT)
        except UnusableOutput as error:
            refusal = str(error)
        if not self._width or not self._height:
            usual = self._default_size
            try:
                return self._recognise_at(self._width or usual, self._height or usual)
            except UnusableOutput as error:
                refusal = str(error)
        raise DataError(refusal, self.path)

    def _recognise_at(self, width: int, height: int) -> OutputLayout:
        """The layout of the outputs for a black image of this size; raises as `recognise`."""
        values = self._run(np.zeros((1, 3, height, width), self._type), (width, height))
        names = [output.name for output in self._session.get_outputs()]
        outputs = [Output(name, array) for name, array in zip(names, values, strict=True)]
        return recognise(outputs, self._metadata, width, height)

    def _expects_height_first(self) -> bool:
        """Whether a network with the input of sizes expects the height of the image first, not the width.

        Its boxes are in pixels of the original image, so their x grow with the number that it takes for the
        width. It runs twice on the same black image, with the sizes (long, short) and (short, long). If the x
        are larger the second time, the second number is its width.
        """
        x_if_first_is_long = self._largest_x((LONG_SIDE, SHORT_SIDE))
        x_if_second_is_long = self._largest_x((SHORT_SIDE, LONG_SIDE))
        return x_if_second_is_long > x_if_first_is_long

    def _largest_x(self, original_size: tuple[int, int]) -> float:
        """The largest |x| of the boxes in a black image, for these two numbers in the input of sizes."""
        width = self._width or self._default_size
        height = self._height or self._default_size
        outputs = self._run(np.zeros((1, 3, height, width), self._type), original_size)
        corners, _ = self._read_unscaled(outputs, *original_size)
        return float(np.abs(corners[:, [0, 2]]).max(initial=0.0))


def _open_session(path: Path, threads: int, provider: str) -> Any:
    """ONNX Runtime's session for a model; `DataError` for a file or a provider that it cannot use."""
    provider_class = PROVIDERS[provider]
    if provider_class not in onnxruntime.get_available_providers():
        raise DataError(f"provider {provider} is not in this ONNX Runtime: install onnxruntime-gpu instead")
    model_files(path)  # raises `DataError` for missing files of weights
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = LOG_FATAL
    onnxruntime.set_default_logger_severity(LOG_FATAL)  # the providers' logger
    # Threads that wait in a busy loop would slow down the odometry.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[provider_class])
    except Exception as error:  # ONNX Runtime's exception types have no common base class
        words = f"is not a model that ONNX Runtime can load: {_first_line(error)}"
        if TENSORRT.search(str(error)):
            words += "; it was exported for TensorRT: export it without its suppression (without --end2end)"
        raise DataError(words, path) from None
    if session.get_providers()[0] != provider_class:
        raise DataError(f"provider {provider} did not start: expected an NVIDIA GPU with CUDA and cuDNN")
    return session


def _first_line(error: Exception) -> str:
    """The beginning of an error's message."""
    return str(error).strip().partition("\n")[0][:200]
