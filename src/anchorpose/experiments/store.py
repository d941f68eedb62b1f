"""Results cached by content: what was asked, of which code and libraries, names the file; nothing stale is read."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

import anchorpose
from anchorpose.versions import versions

PRESENTING: Final = (
    "cli/",
    "experiments/presentation/",
    "experiments/pictures/",
    "experiments/run.py",
    "experiments/show.py",
    "experiments/pool.py",
    "experiments/outcome.py",
    "experiments/paper_times.py",
    "exports/",
    "report/",
    "viewer/",
    "viewing.py",
)
"""Code that changes no result."""


class Store:
    """A folder of results, each a whole .npz file or not there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, kind: str, *asked: object) -> Path:
        """Where the answer to a question is kept; asked: values whose ``repr`` says all that the answer depends on."""
        text = "\n".join([code_digest(), repr(versions()), kind, *map(repr, asked)])
        return self.folder / kind / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"

    def write(self, path: Path, arrays: Mapping[str, object]) -> None:
        """The answer, all of it at once: a kill leaves nothing half-written."""
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.stem}.partial-{os.getpid()}")
        try:
            with partial.open("wb") as stream:
                np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise


def read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an answer."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


@cache
def code_digest() -> str:
    """Of every module and data file of the package that a result may depend on."""
    root, digest = Path(anchorpose.__file__).parent, hashlib.sha256()
    for path in sorted(root.rglob("*")):
        place = path.relative_to(root).as_posix()
        if not path.is_file() or path.suffix not in (".py", ".npz"):
            continue
        if place.startswith(PRESENTING):
            continue
        digest.update(place.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
