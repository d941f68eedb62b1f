"""Reading a JSON file as a declared document; every refusal names the file, the place in it and the remedy."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Final, Literal, TypeVar, cast

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    PlainValidator,
    StringConstraints,
    TypeAdapter,
    ValidationError,
)

from anchorpose.errors import InputError
from anchorpose.recording.json_text import LARGEST_BYTES, parse_json
from anchorpose.recording.regular_file import is_there, read_whole
from anchorpose.settings import LARGEST, STRICT, Unfit, explain, shown

ROTATION_TOLERANCE: Final = 5e-4
"""Largest entry of R^T R - I that rounding to four decimals explains; more is a scale, a shear or a mistake."""

LONGEST_NAME: Final = 200
"""Bytes in a file's name: file systems allow 255 or fewer."""


LARGEST_WITH_HASHES: Final = 128 * 2**20
"""Bytes of a document that has the hash of each depth image, about 100 bytes: 32 MB in an hour of three cameras."""


class Entry(BaseModel):
    """An object of a JSON file; its fields say which keys it has and what they may hold."""

    model_config = STRICT


def numbers(*shape: int, meaning: str) -> PlainValidator:
    """Nested lists of finite numbers as a float64 array of exactly ``shape``; ``meaning`` says what to write."""

    def check(value: Any) -> np.ndarray:
        cells = np.array(value, dtype=object)
        if cells.shape != shape or not all(type(cell) in (int, float) and abs(cell) <= LARGEST for cell in cells.flat):
            size = " x ".join(str(count) for count in shape)
            raise Unfit(f"is not a list of {size} numbers of a sensible size", f"write {meaning}")
        return cells.astype(np.float64)

    return PlainValidator(check)


def is_rotation(matrix: np.ndarray) -> bool:
    """Whether a (3, 3) matrix is a proper rotation within ``ROTATION_TOLERANCE``."""
    orthonormal = np.abs(matrix.T @ matrix - np.eye(3)).max() <= ROTATION_TOLERANCE
    return bool(orthonormal and np.linalg.det(matrix) > 0)


def require_rigid(pose: np.ndarray, instead: str = "") -> np.ndarray:
    """The pose (4, 4); raises Unfit unless it is a rigid motion: lengths in a scaled or mirrored world mean nothing."""
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9 or not is_rotation(pose[:3, :3]):
        remedy = f"write a rotation and a translation in metres with the last row 0 0 0 1{instead}"
        raise Unfit("is not a rigid motion", remedy)
    return pose


def _require_inside(name: str) -> str:
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in name:
        raise Unfit(f"leads out of the recording folder ({shown(name)})", "put the file into the folder")
    return require_file_name(name)


def require_file_name(name: str) -> str:
    """The name; raises Unfit where no file can have it: it is too long, or has characters that names cannot hold."""
    if not name.isprintable() or len(name.encode()) > LONGEST_NAME:
        raise Unfit(f"is {shown(name)}", "it names a file: use letters, digits, - and _, no more than 50 of them")
    return name


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


Document = TypeVar("Document")

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
Whole = Annotated[int, BeforeValidator(_whole)]  # some programs write every number with a decimal point
Version = Annotated[
    Literal[1],
    BeforeValidator(_whole),
    Field(description="the version that this release reads, a later one needs a later anchorpose"),
]
Pose = Annotated[np.ndarray, numbers(4, 4, meaning="four rows of four numbers"), AfterValidator(require_rigid)]
FileInFolder = Annotated[Text, AfterValidator(_require_inside)]


def read_document(path: Path, kind: type[Document]) -> Document:
    """A JSON file as the declared ``kind``; raises InputError naming the file, the key and the remedy."""
    return validate(path, kind, read_json(path))


def validate(path: Path, kind: type[Document], values: Any) -> Document:
    """``values`` of the file ``path`` as ``kind``, nothing rounded or converted from text; raises InputError."""
    try:
        found: Document = _adapter(cast("Any", kind)).validate_json(json.dumps(values, default=str), strict=True)
    except ValidationError as error:
        raise InputError(path, *explain(error, kind)) from None
    except RecursionError:
        raise InputError(path, "is nested too deeply", "correct the file") from None
    return found


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def read_text(path: Path, largest_bytes: int = LARGEST_BYTES) -> str:
    """The text of a file in UTF-8; raises InputError."""
    if not is_there(path):
        raise InputError(path, "there is no such file", "check the path")
    try:
        return read_whole(path, largest_bytes, "give the right file, and check its permissions").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(path, "is not text in UTF-8", "save it again as UTF-8") from None


def read_json(path: Path, largest_bytes: int = LARGEST_BYTES) -> dict[str, Any]:
    """The object that a JSON file holds; raises InputError unless it is one that ``parse_json`` accepts."""
    try:
        values = parse_json(read_text(path, largest_bytes), largest_bytes)
    except Unfit as error:
        raise InputError(path, error.problem, error.remedy) from None
    if not isinstance(values, dict):
        raise InputError(path, "is not a JSON object", "it must start with a curly bracket")
    return values
