"""ONNX files of a few bytes, written field by field: networks with constant outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# ONNX's numbers of element types
FLOAT, UINT8, INT64, FLOAT16 = 1, 2, 7, 10
KINDS = {"float32": FLOAT, "uint8": UINT8, "int64": INT64, "float16": FLOAT16}
EXTERNAL = 1  # a tensor's data are in another file

Shape = Sequence[int | str]


def _varint(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def field(number: int, value: int | str | bytes) -> bytes:
    """One field of a protocol-buffer message."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _value_info(name: str, shape: Shape, kind: int = FLOAT) -> bytes:
    dims = b"".join(field(1, field(1 if isinstance(d, int) else 2, d)) for d in shape)
    return field(1, name) + field(2, field(1, field(1, kind) + field(2, dims)))


def _entry(key: str, value: str) -> bytes:
    return field(1, key) + field(2, value)


def tensor(name: str, values: NDArray[Any], location: str | None = None) -> bytes:
    """A tensor with its values, or with the name of the file that has them."""
    out = b"".join(field(1, side) for side in values.shape) + field(2, KINDS[values.dtype.name])
    out += field(8, name)
    if location is None:
        return out + field(9, values.tobytes())
    return out + field(13, _entry("location", location)) + field(14, EXTERNAL)


def node(operator: str, inputs: Sequence[str], output: str, **integers: int | tuple[int, ...]) -> bytes:
    """A node with one output; `integers` : attributes, whole numbers or tuples of them."""
    out = b"".join(field(1, name) for name in inputs) + field(2, output) + field(4, operator)
    for name, value in integers.items():
        attribute = field(1, name)
        if isinstance(value, tuple):
            attribute += b"".join(field(8, number) for number in value) + field(20, 7)
        else:
            attribute += field(3, value) + field(20, 2)
        out += field(5, attribute)
    return out


def write_network(
    path: Path,
    outputs: Mapping[str, NDArray[Any]],
    inputs: Mapping[str, tuple[Shape, int]] | None = None,
    metadata: Mapping[str, str] | None = None,
    *,
    locations: Mapping[str, str] | None = None,
    nodes: Sequence[bytes] = (),
    constants: Mapping[str, NDArray[Any]] | None = None,
) -> Path:
    """Write a network whose outputs are constant, or are made by `nodes`, which replace those constants.

    Parameters
    ----------
    outputs : constant value of each output, by name.
    inputs : shape and element type of each input, by name; by default one image of 64×64 px.
    metadata : entries of the file.
    locations : by output, the name of the file with its constant, which is written beside the ONNX file.
    nodes : nodes that make outputs from inputs, from `constants`, and from the values of the outputs, which
        are named as the outputs with "_constant" behind.
    """
    inputs = inputs or {"images": ((1, 3, 64, 64), FLOAT)}
    made = b"".join(field(1, each) for each in nodes)
    tensors = b"".join(field(5, tensor(name, values)) for name, values in (constants or {}).items())
    for name, values in outputs.items():
        location = (locations or {}).get(name)
        tensors += field(5, tensor(f"{name}_constant", values, location))
        if location is not None:
            (path.parent / location).parent.mkdir(parents=True, exist_ok=True)
            (path.parent / location).write_bytes(values.tobytes())
        if not any(field(2, name) in each for each in nodes):
            made += field(1, node("Identity", [f"{name}_constant"], name))
    graph = made + field(2, "answering") + tensors
    for name, (shape, kind) in inputs.items():
        graph += field(11, _value_info(name, shape, kind))
    for name, values in outputs.items():
        dims = [f"{name}_{axis}" for axis in range(values.ndim)]
        graph += field(12, _value_info(name, dims, KINDS[values.dtype.name]))
    model = field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 17))
    for key, value in (metadata or {}).items():
        model += field(14, _entry(key, value))
    path.write_bytes(model)
    return path


def write_answering(
    path: Path,
    answer: NDArray[Any],
    input_shape: Shape = (1, 3, 64, 64),
    names: str | None = None,
    input_kind: int = FLOAT,
) -> Path:
    """Write a network with the output `answer` for every `input_shape` image; `names` : metadata text."""
    metadata = {} if names is None else {"names": names}
    inputs = {"images": (input_shape, input_kind)}
    return write_network(path, {"output0": answer.astype(np.float32)}, inputs, metadata)
