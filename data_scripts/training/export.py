"""The trained network as an ONNX file of YOLOv8's layout, with class names, for any image size."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import onnx
import torch

from training.network import Detector, Exported
from vo_lib.core.files import write_bytes_atomic

OPSET = 17
EXAMPLE = (1, 3, 192, 640)


def export_onnx(network: Detector, classes: tuple[str, ...], path: Path, size: int) -> None:
    """Write a network, with metadata as in Ultralytics' exports: class names, and the longer side of the
    images it is made for, `size` pixels.

    Input `images` [1, 3, H, W], RGB in 0..1, H and W multiples of 32; output `output0` [1, 4 + C, N].
    """
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # PyTorch recommends its other exporter, which needs one more package and traces no better here.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Exported(network).eval(),
            (torch.zeros(EXAMPLE),),
            buffer,
            dynamo=False,
            opset_version=OPSET,
            input_names=["images"],
            output_names=["output0"],
            dynamic_axes={"images": {2: "height", 3: "width"}, "output0": {2: "boxes"}},
        )
    model = onnx.load_from_string(buffer.getvalue())
    about = {
        "names": repr(dict(enumerate(classes))),
        "task": "detect",
        "stride": "32",
        "imgsz": repr([size, size]),
    }
    onnx.helper.set_model_props(model, about)
    onnx.checker.check_model(model)
    write_bytes_atomic(path, model.SerializeToString(deterministic=True))
