"""What the page is told of an error."""

from __future__ import annotations

from pathlib import Path

from anchorpose.errors import InputError


def told(error: Exception) -> str:
    """What the page may know of an error: a file by its name, not where it lies, which often says whose it is."""
    if isinstance(error, InputError):
        return str(InputError(error.path.name, error.problem, error.remedy))
    if isinstance(error, OSError):
        name = Path(str(error.filename)).name if error.filename else "The computer"
        return f"{name}: {error.strerror or 'cannot be used'}."
    return str(error)
