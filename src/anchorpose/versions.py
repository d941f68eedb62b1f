"""Identify the program that made a result: the version and code of this package, and the libraries on which the
result's numbers depend.
"""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Final

from anchorpose import __version__

LIBRARIES: Final = ("numpy", "scipy", "numba", "pyarrow", "opencv-python-headless", "embreex")


@cache
def versions() -> dict[str, str]:
    """Return the versions by name: this package, Python, and the libraries."""
    libraries = {name: metadata.version(name) for name in LIBRARIES}
    return {"anchorpose": __version__, "python": platform.python_version(), **libraries}


@cache
def machine() -> dict[str, str]:
    """Return the operating system and the processor, on which the last digits of results depend."""
    return {"system": platform.platform(), "processor": platform.machine()}


@cache
def code_digest(leave_out: tuple[str, ...] = ()) -> str:
    """Return a SHA-256 in hex of the package's modules, .npz files and learnt weights.

    Files whose path starts with one of ``leave_out`` are left out. Equal digests mean equal code. Equal version numbers
    do not mean equal code: the code changes between releases, and a user may modify a copy.
    """
    root, digest = Path(__file__).parent, hashlib.sha256()
    for path in sorted(root.rglob("*")):
        place = path.relative_to(root).as_posix()
        if path.is_file() and path.suffix in (".py", ".npz", ".weights") and not place.startswith(leave_out):
            digest.update(place.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
