"""The files of one ONNX model: the .onnx file, and the files with weights that it refers to.

PyTorch's exporter writes the weights of a model into a second file, such as best.onnx.data; other programs
write one file a tensor. The .onnx file names them. Its format is Protocol Buffers: fields with a number and a
kind, nested in each other. Only the fields on the way to these names are read here (onnx.proto):
https://github.com/onnx/onnx/blob/main/docs/ExternalData.md.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import NamedTuple

from ..errors import DataError
from ..files import file_sha256, locked_draft, read_bytes, write_atomic

# Kinds of fields
VARINT = 0
FIXED_8 = 1
LENGTH_DELIMITED = 2
FIXED_4 = 5

# Messages of ONNX that contain tensors: number of a field → the message in it.
NESTED: dict[str, dict[int, str]] = {
    "Model": {7: "Graph", 20: "Training", 25: "Function"},
    "Training": {1: "Graph", 2: "Graph"},
    "Graph": {1: "Node", 5: "Tensor", 15: "SparseTensor"},
    "Function": {7: "Node", 11: "Attribute"},
    "Node": {5: "Attribute"},
    "Attribute": {5: "Tensor", 6: "Graph", 10: "Tensor", 11: "Graph", 22: "SparseTensor", 23: "SparseTensor"},
    "SparseTensor": {1: "Tensor", 2: "Tensor"},
}
EXTERNAL_DATA = 13  # field of a tensor: an entry about its data in another file
ENTRY_KEY = 1
ENTRY_VALUE = 2
LOCATION = b"location"  # key of the entry with the file's name
MAX_DEPTH = 60  # of messages in messages
MAX_VARINT_BYTES = 10  # of an integer of 64 bits, 7 bits a byte


class _Field(NamedTuple):
    """A field of a message: its number, its kind, and its bytes without number, kind and length."""

    number: int
    kind: int
    value: memoryview


def model_files(path: Path) -> tuple[Path, ...]:
    """The .onnx file, then the files with weights that it refers to, by name.

    Raises `DataError` if one of these files is missing, and as `external_names`.
    """
    parts = [path.parent / name for name in external_names(path)]
    for part in parts:
        if not part.is_file():
            raise DataError(f"its file of weights {part.name} is missing: copy both into one folder", path)
    return path, *parts


def external_names(path: Path) -> list[str]:
    """Names, relative to the model's folder, of the files with weights that an ONNX file refers to, sorted.

    Empty for a file that is not ONNX. Raises `DataError` for a name that leads out of the model's folder, or
    is the model's own.
    """
    content = read_bytes(path)
    if LOCATION not in content:  # so in most models; to go through all messages takes some milliseconds
        return []
    try:
        names = {bytes(name).decode() for name in _locations(memoryview(content), "Model", depth=0)}
    except ValueError:  # not ONNX, or a name that is not text; ONNX Runtime says so
        return []
    for name in names:
        if not _stays_inside(name) or PurePosixPath(name) == PurePosixPath(path.name):
            raise DataError(
                f"refers to {name[:80]!r} for its weights, which is not a file in its folder: "
                "export the model again, into one folder",
                path,
            )
    return sorted(names)


def model_sha256(path: Path) -> str:
    """SHA-256 of a model, 64 hexadecimal digits; raises as `model_files`.

    For a model of one file this is the file's own. For a model of several files it is that of the lines
    "digest  name" of its files, as the program sha256sum prints them, the .onnx file first.
    """
    files = model_files(path)
    if len(files) == 1:
        return file_sha256(path)
    lines = [f"{file_sha256(file)}  {file.relative_to(path.parent).as_posix()}\n" for file in files]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def copy_model(source: Path, target: Path) -> None:
    """Copy a model of one or several files. The .onnx file gets the name `target`; the others keep theirs.

    A model under the same name is removed first and the new .onnx file is written last: there is never a
    network with the weights of another one. Raises `DataError` as `model_files`, and if a file of weights has
    the name of the .onnx file.
    """
    target_parts = [target.parent / name for name in external_names(source)]
    source_parts = model_files(source)[1:]
    if target in target_parts:
        raise DataError(f"its weights are in a file named {target.name}: choose another name", source)
    content = read_bytes(source)
    target.unlink(missing_ok=True)
    for part, copied in zip(source_parts, target_parts, strict=True):
        copied.parent.mkdir(parents=True, exist_ok=True)
        with locked_draft(copied) as draft:
            shutil.copyfile(part, draft)
            os.replace(draft, copied)
    write_atomic(target, content)


def _stays_inside(name: str) -> bool:
    """Whether a name, read as on any operating system, is relative and leads to a file in the folder."""
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        if path.anchor or not path.parts or ".." in path.parts:
            return False
    return "\0" not in name


def _locations(message: memoryview, kind: str, depth: int) -> Iterator[memoryview]:
    """Names of the files of external data in a message of ONNX and in those nested in it, as bytes.

    kind : a key of `NESTED`, or "Tensor". Raises ValueError if the message is malformed.
    """
    if depth > MAX_DEPTH:
        raise ValueError("nested too deeply")
    nested = NESTED.get(kind, {})
    nothing = memoryview(b"")
    for field in _fields(message):
        if field.kind != LENGTH_DELIMITED:
            continue
        if kind == "Tensor" and field.number == EXTERNAL_DATA:
            entry = {part.number: part.value for part in _fields(field.value)}
            if bytes(entry.get(ENTRY_KEY, nothing)) == LOCATION:
                yield entry.get(ENTRY_VALUE, nothing)
        elif field.number in nested:
            yield from _locations(field.value, nested[field.number], depth + 1)


def _fields(message: memoryview) -> Iterator[_Field]:
    """The fields of a message of Protocol Buffers; ValueError if malformed."""
    position = 0
    while position < len(message):
        tag, start = _varint(message, position)
        number = tag >> 3  # the lower three bits are the kind
        kind = tag & 7
        if kind == VARINT:
            _, end = _varint(message, start)
        elif kind == LENGTH_DELIMITED:
            length, start = _varint(message, start)
            end = start + length
        elif kind == FIXED_4:
            end = start + 4
        elif kind == FIXED_8:
            end = start + 8
        else:
            raise ValueError(f"a field of the unknown kind {kind}")
        if number == 0 or end > len(message):
            raise ValueError("a field is longer than its message")
        yield _Field(number, kind, message[start:end])
        position = end


def _varint(message: memoryview, position: int) -> tuple[int, int]:
    """The integer that begins at a position of a message, and the position after it; ValueError if malformed.

    A byte has 7 bits of it, the lowest first, and its highest bit says whether another byte follows.
    """
    value = 0
    for shift in range(0, MAX_VARINT_BYTES * 7, 7):
        if position >= len(message):
            raise ValueError("a number is longer than its message")
        byte = message[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise ValueError("a number of more than 64 bits")
