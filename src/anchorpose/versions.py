"""Which program made a result: this package and the libraries that its numbers hang on."""

from __future__ import annotations

import platform
from functools import cache
from importlib import metadata
from typing import Final

from anchorpose import __version__

LIBRARIES: Final = ("numpy", "scipy", "numba", "pyarrow", "opencv-python-headless", "embreex")


@cache
def versions() -> dict[str, str]:
    """By name: of this package, Python, and the libraries."""
    libraries = {name: metadata.version(name) for name in LIBRARIES}
    return {"anchorpose": __version__, "python": platform.python_version(), **libraries}
