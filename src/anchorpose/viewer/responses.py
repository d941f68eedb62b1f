"""What a server sends back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from anchorpose.errors import InputError

BYTES: Final = "application/octet-stream"
JSON: Final = "application/json"


@dataclass(frozen=True, slots=True)
class Response:
    """What is sent back: bytes and their media type."""

    content: bytes
    kind: str


def json_response(value: Any) -> Response:
    """Raises ValueError where a number is NaN: JSON has none."""
    return Response(json.dumps(value, allow_nan=False).encode(), JSON)


def describe_error(error: Exception) -> str:
    """What the page may know of an error: the name of a file without its folder, which may name the patient."""
    if isinstance(error, InputError):
        return str(InputError(error.path.name, error.problem, error.remedy))
    if isinstance(error, OSError):
        name = Path(str(error.filename)).name if error.filename else "The computer"
        return f"{name}: {error.strerror or 'cannot be used'}."
    return str(error)
