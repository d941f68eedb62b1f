"""Read text files: CSV, and JSON whose allowed keys a class declares. Every error names the file, the place and the
remedy.

JSON text is parsed only here. The text's size, nesting depth and numbers have limits, so that no file can stall a run.
"""

from __future__ import annotations

import csv
import json
import tomllib
from collections import Counter
from collections.abc import Sequence
from functools import cache
from io import StringIO
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
from anchorpose.recording.regular_file import LARGEST_TABLE, is_there, read_whole
from anchorpose.settings import LARGEST, STRICT, Unfit, explain, shown

LARGEST_BYTES: Final = 16 * 2**20
"""Maximum size of a JSON file in bytes. A description of a recording has some thousand bytes. The parsed values need up
to twenty times as much memory as the file.
"""

DEEPEST: Final = 64
"""Maximum depth of nested objects and lists; no format that is read here has more than ten levels."""

LARGEST_INTEGER: Final = 2**64
"""Largest accepted integer, above every counter and time stamp; arrays cannot hold arbitrarily large integers."""

ROTATION_TOLERANCE: Final = 5e-4
"""Maximum size of an entry of R^T R - I for a rotation R. Rounding R to four decimals causes smaller entries; a larger
entry means a scale, a shear or a mistake.
"""

LONGEST_NAME: Final = 200
"""Maximum length of a file name in bytes: file systems allow 255 or fewer."""

LARGEST_WITH_HASHES: Final = 128 * 2**20
"""Maximum size in bytes of a JSON file with a hash (100 bytes) per depth image: an hour of three cameras has 32 MB."""

FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""Characters that make a spreadsheet run a cell as a formula if the cell begins with one of them."""


def parse_json(text: str | bytes, largest_bytes: int = LARGEST_BYTES) -> Any:
    """Parse a JSON text in which every key of an object occurs once. NaN and infinities are not refused here.

    If ``text`` is bytes, its encoding is UTF-8, UTF-16 or UTF-32. Raises Unfit, a ValueError, if the text is not JSON,
    is larger than ``largest_bytes``, or has values that ``require_plain`` refuses. The time that the checks take is at
    most proportional to the size of the text.
    """
    if len(text) > largest_bytes:
        raise Unfit(f"is larger than {largest_bytes / 2**20:g} MB", "give the right file: this one describes no more")
    try:
        decoded = text if isinstance(text, str) else text.decode(json.detect_encoding(text))
        values = json.loads(decoded, object_pairs_hook=_unique_pairs, parse_int=_integer)
    except UnicodeDecodeError:
        raise Unfit("is not text in UTF-8", "save it again as UTF-8") from None
    except json.JSONDecodeError as error:
        raise Unfit(f"is not JSON (line {error.lineno}: {error.msg})", "correct that line") from None
    except RecursionError:
        raise _too_deep() from None
    require_plain(values)
    return values


def require_plain(value: Any, levels: int = DEEPEST) -> None:
    """Raise Unfit if values are nested too deeply, an integer is too large, or a text contains a null character or half
    a surrogate pair. A text with such characters can neither be printed nor be a file's name.
    """
    if levels < 0:
        raise _too_deep()
    if isinstance(value, str):
        if "\0" in value or not (value.isascii() or value.encode("utf-8", "replace").decode() == value):
            raise Unfit(f"holds a text with a character that has no meaning, {value[:40]!a}", "remove that character")
    elif isinstance(value, dict):
        for key, inner in value.items():
            require_plain(key, levels - 1)
            require_plain(inner, levels - 1)
    elif isinstance(value, list):
        for inner in value:
            require_plain(inner, levels - 1)
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise _too_large()


def _unique_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise Unfit(f"cannot be used: the key '{twice}' is given twice", "remove one")
    return values


def _integer(digits: str) -> int:
    if len(digits) > len(str(LARGEST_INTEGER)) + 1:  # one character more for the sign
        raise _too_large()
    return int(digits)


def _too_deep() -> Unfit:
    return Unfit(f"is nested more than {DEEPEST} levels deep", "correct the file")


def _too_large() -> Unfit:
    return Unfit("holds an integer of more than 64 bits", "correct that number")


class Entry(BaseModel):
    """An object of a JSON file; its fields declare the allowed keys and their content."""

    model_config = STRICT


def numbers(*shape: int, meaning: str) -> PlainValidator:
    """Return a validator that turns nested lists of finite numbers into a float64 array of exactly ``shape``. meaning:
    words for the error message that describe what the user should write.
    """

    def check(value: Any) -> np.ndarray:
        cells = np.array(value, dtype=object)
        if cells.shape != shape or not all(type(cell) in (int, float) and abs(cell) <= LARGEST for cell in cells.flat):
            size = " x ".join(str(count) for count in shape)
            raise Unfit(f"is not a list of {size} numbers of a sensible size", f"write {meaning}")
        return cells.astype(np.float64)

    return PlainValidator(check)


def is_rotation(matrix: np.ndarray) -> bool:
    """Return whether a (3, 3) matrix is a proper rotation within ``ROTATION_TOLERANCE``."""
    orthonormal = np.abs(matrix.T @ matrix - np.eye(3)).max() <= ROTATION_TOLERANCE
    return bool(orthonormal and np.linalg.det(matrix) > 0)


def require_rigid(pose: np.ndarray, instead: str = "") -> np.ndarray:
    """Return the pose (4, 4); raises Unfit unless it is a rigid motion, since lengths in a scaled or mirrored world are
    meaningless. instead: an alternative to correcting the pose, as the end of the error message.
    """
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
    """Return the name; raises Unfit if it is too long, or has characters that file names cannot have."""
    if not name.isprintable() or len(name.encode()) > LONGEST_NAME:
        raise Unfit(f"is {shown(name)}", "it names a file: use letters, digits, - and _, no more than 50 of them")
    return name


def _whole(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value


Document = TypeVar("Document")

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
Whole = Annotated[int, BeforeValidator(_whole)]  # accepts 3.0 as 3, since some programs write every number with .0
Version = Annotated[
    Literal[1],
    BeforeValidator(_whole),
    Field(description="the version that this release reads, a later one needs a later anchorpose"),
]
Pose = Annotated[np.ndarray, numbers(4, 4, meaning="four rows of four numbers"), AfterValidator(require_rigid)]
FileInFolder = Annotated[Text, AfterValidator(_require_inside)]


def read_document(path: Path, kind: type[Document]) -> Document:
    """Read a JSON file as an object of class ``kind``; raises InputError naming the file, the key and the remedy."""
    return validate(path, kind, read_json(path))


def validate(path: Path, kind: type[Document], values: Any) -> Document:
    """Return the ``values`` that were read from the file ``path`` as an object of the class ``kind``. Numbers are not
    rounded and texts not converted; raises InputError if the values do not fit.
    """
    try:
        found: Document = _adapter(cast("Any", kind)).validate_json(json.dumps(values, default=str), strict=True)
    except ValidationError as error:
        raise InputError(path, *explain(error, kind)) from None
    except RecursionError:
        raise InputError(path, "is nested too deeply", "correct the file") from None
    return found


def plain_values(value: Any) -> Any:
    """Return a value in the form of JSON: numpy's numbers become Python's numbers, and arrays and tuples become lists,
    also inside nested values.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: plain_values(inner) for key, inner in value.items()}
    return [plain_values(inner) for inner in value] if isinstance(value, list | tuple) else value


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def read_content(path: Path, largest_bytes: int = LARGEST_BYTES) -> bytes:
    """Read a file; raises InputError if the file cannot be read."""
    if not is_there(path):
        raise InputError(path, "there is no such file", "check the path")
    return read_whole(path, largest_bytes, "give the right file, and check its permissions")


def read_text(path: Path, largest_bytes: int = LARGEST_BYTES) -> str:
    """Read the text of a file in UTF-8; raises InputError if the file cannot be read or is not UTF-8."""
    try:
        return read_content(path, largest_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(path, "is not text in UTF-8", "save it again as UTF-8") from None


def read_json(path: Path, largest_bytes: int = LARGEST_BYTES) -> dict[str, Any]:
    """Read a JSON file that contains an object; raises InputError unless ``parse_json`` accepts it."""
    try:
        values = parse_json(read_text(path, largest_bytes), largest_bytes)
    except Unfit as error:
        raise InputError(path, error.problem, error.remedy) from None
    if not isinstance(values, dict):
        raise InputError(path, "is not a JSON object", "it must start with a curly bracket")
    return values


def read_rows(path: Path, delimiter: str = ",", largest_bytes: int = LARGEST_TABLE) -> list[tuple[int, list[str]]]:
    """Read the non-empty rows of a table. For each row, the number of its last line in the file is returned, and its
    cells without spaces around them.

    Raises InputError if the file cannot be read, or is not a table with this delimiter.
    """
    text = read_text(path, largest_bytes)
    if "\0" in text:
        raise InputError(path, "holds null characters", "save it again as text in UTF-8")
    rows = csv.reader(StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        found = [(rows.line_num, [cell.strip() for cell in row]) for row in rows]
    except csv.Error as error:
        kind = "CSV" if delimiter == "," else "a table"
        hint = ": a cell that begins with a quotation mark must also end with one" if '"' in text else ""
        raise InputError(path, f"is not {kind} in line {rows.line_num} ({error})", f"correct that line{hint}") from None
    return [(number, row) for number, row in found if any(row)]


def require_distinct(path: Path, columns: Sequence[str]) -> None:
    """Raise InputError if two columns have the same name."""
    repeated = next((name for name, count in Counter(columns).items() if count > 1 and name), None)
    if repeated is not None:
        raise InputError(path, f"has two columns '{repeated[:40]}'", "keep one of them")


def cell_text(cell: object) -> str:
    """Return a cell as text: empty for None, with all digits for a float. A text that a spreadsheet would run as a
    formula gets an apostrophe in front.
    """
    if cell is None:
        return ""
    text = repr(float(cell)) if isinstance(cell, float) else str(cell)
    return f"'{text}" if text.startswith(FORMULA) and not _is_number(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def load_config(path: Path, kind: type[Document]) -> Document:
    """Read settings of the class ``kind`` from a file; values that the file lacks keep their defaults.

    Raises InputError for a file that is neither TOML nor JSON, for an unknown name (the message then has the nearest
    known name), and for a value of the wrong type or an impossible value.
    """
    return validate(path, kind, read_config(path))


def read_config(path: Path) -> dict[str, Any]:
    """Read a configuration file; raises InputError if it is neither TOML nor JSON."""
    if path.suffix not in (".toml", ".json"):
        raise InputError(path, "is neither .toml nor .json", "give a configuration file of one of the two")
    return read_json(path) if path.suffix == ".json" else read_toml(path)


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; raises InputError unless ``require_plain`` accepts its values."""
    try:
        values = tomllib.loads(read_text(path))
        require_plain(values)
    except Unfit as error:
        raise InputError(path, error.problem, error.remedy) from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"is not TOML ({error})", "correct the file") from None
    return values
