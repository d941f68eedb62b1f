"""Reading arrays from an .npz file, up to a bound on what they take unpacked."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.regular_file import LARGEST_ARRAYS, open_regular


def read_arrays(path: Path, names: Sequence[str], remedy: str) -> dict[str, Any]:
    """Return those of the named arrays that an .npz file has; raises InputError where it is not one."""
    try:
        with open_regular(path) as stream, zipfile.ZipFile(stream) as packed:
            size = sum(packed.getinfo(f"{name}.npy").file_size for name in names if f"{name}.npy" in packed.namelist())
            if size > LARGEST_ARRAYS:
                raise ValueError(f"{size:,} bytes unpacked, {LARGEST_ARRAYS:,} at most")
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as file:
                return {name: file[name] for name in names if name in file.files}
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path") from None
    except (OSError, ValueError, zipfile.BadZipFile, zlib.error, EOFError, MemoryError, RuntimeError) as error:
        first = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(path, f"is not a readable .npz file ({first})", remedy) from None
