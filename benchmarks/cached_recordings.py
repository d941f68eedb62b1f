"""Simulated recordings that are made once and kept in a folder; made again where the simulator has changed."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from pathlib import Path
from typing import Final

import anchorpose
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.write import simulate_recording

KEPT: Final = Path(tempfile.gettempdir()) / "anchorpose-recordings"
MADE_BY: Final = "made_by.txt"
SOURCES: Final = ("simulate", "body/data", "body/kinematics.py", "body/asset.py", "camera.py", "joints.py")
"""What a recording depends on, besides its settings."""


def cached_recording(folder: Path, name: str, config: SimulationConfig, as_it_is: bool = False) -> Path:
    """The folder ``folder/name`` with a recording and its truth; simulated unless it is there as it would be made.

    as_it_is: whatever made it; two versions of the tracker can then be compared on the same recordings.
    """
    out, made_by = folder / name, f"{simulator_digest()}\n{config}\n"
    note = out / MADE_BY
    if note.exists() and (as_it_is or note.read_text() == made_by):
        return out
    shutil.rmtree(out, ignore_errors=True)
    simulate_recording(out, config)
    note.write_text(made_by)
    return out


def simulator_digest() -> str:
    """SHA-256 over the files that a simulated recording depends on."""
    root, digest = Path(anchorpose.__file__).parent, hashlib.sha256()
    for source in SOURCES:
        place = root / source
        for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if path.is_file() and path.suffix in (".py", ".npz"):
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
