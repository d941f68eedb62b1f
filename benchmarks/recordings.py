"""Provide the recordings of the suites: simulated recordings, which are made once and kept, and real recordings."""

from __future__ import annotations

import ast
import functools
import hashlib
import inspect
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from filelock import FileLock

import anchorpose
from anchorpose.simulate.clinic import Programme
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.write import simulate_recording

DATA: Final = Path(__file__).resolve().parents[2] / "shared" / "data"
MOVEMENTS: Final = DATA / "uiprmd_kinect" / "skeletons.npz"
"""Captured rehabilitation movements; recordings that need this file are left out if it is absent."""

STAGES: Final = ("isolation", "descriptor", "calibration", "surface", "geodesics")
"""The tracker's stages, of which the simulator imports classes of data only; a recording does not depend on them."""

DIGITS: Final = 16  # of a digest in a folder's name


@dataclass(frozen=True, slots=True)
class Ready:
    """A recording on disk. truth: its truth.npz, None for a real recording; digest: of its content; config: settings of
    a simulated scene, for probes.
    """

    name: str
    recording: Path
    truth: Path | None
    digest: str
    config: SimulationConfig | None = None


class Recording(Protocol):
    """What a suite declares: a recording that ``ready`` makes or finds."""

    @property
    def name(self) -> str:
        """Name of the recording, unique within its suite."""

    def ready(self, cache: Path) -> Ready | None:
        """Return the recording on disk, after making it in ``cache`` if necessary; None if its data is absent."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """A recording of the simulator. programme: what the patient does, if the settings do not state it."""

    name: str
    config: SimulationConfig
    programme: Programme | None = None

    def ready(self, cache: Path) -> Ready | None:
        """Simulate unless the cache holds a recording of the same settings and the same simulator."""
        if self.config.movement_file is not None and not self.config.movement_file.is_file():
            return None
        digest = digest_of(simulator_digest(), str(self.config), *_source_of(self.programme))
        folder = write_once(
            cache / "recordings" / f"{self.name}-{digest}",
            lambda work: simulate_recording(work, self.config, programme=self.programme),
        )
        return Ready(self.name, folder / "recording", folder / "truth" / "truth.npz", digest, self.config)


@dataclass(frozen=True, slots=True)
class Drawn:
    """A simulated scene that is not written: its probe renders the moments that it needs."""

    name: str
    config: SimulationConfig

    def ready(self, cache: Path) -> Ready:
        """Return the settings."""
        digest = digest_of(simulator_digest(), str(self.config))
        return Ready(self.name, Path(os.devnull), None, digest, self.config)


@dataclass(frozen=True, slots=True)
class FrontAlone:
    """A simulated recording, reduced to its first camera."""

    whole: Simulated

    @property
    def name(self) -> str:
        """Return the name of the whole recording with an ending."""
        return f"{self.whole.name}-front"

    def ready(self, cache: Path) -> Ready | None:
        """Link the images of the first camera into a recording of its own."""
        whole = self.whole.ready(cache)
        if whole is None:
            return None
        digest = digest_of(whole.digest, "front")
        folder = cache / "recordings" / f"{self.name}-{digest}"
        write_once(folder, lambda work: _link_first_camera(whole.recording, work))
        return Ready(self.name, folder, whole.truth, digest)


@dataclass(frozen=True, slots=True)
class OneFrame:
    """A single depth image out of a simulated recording of one camera, and its truth.

    moment: returns the frame's index from the true joints (t, 21, 3).
    """

    whole: Simulated
    moment: Callable[[np.ndarray], int]

    @property
    def name(self) -> str:
        """Return the name of the whole recording with an ending."""
        return f"{self.whole.name}-one"

    def ready(self, cache: Path) -> Ready | None:
        """Copy the chosen image into a recording of one frame, without a depth image of the empty room."""
        whole = self.whole.ready(cache)
        if whole is None or whole.truth is None:
            return None
        with np.load(whole.truth) as file:
            truth = {key: file[key] for key in ("joints", "names", "time", "occluded", "seen_share", "camera_to_world")}
        frame, count = self.moment(truth["joints"]), len(truth["time"])
        digest = digest_of(whole.digest, f"frame {frame}")

        def write(work: Path) -> None:
            _copy_frame(whole.recording, work, frame)
            one = {key: value[[frame]] if len(value) == count else value for key, value in truth.items()}
            np.savez(work / "truth.npz", **(one | {"time": np.zeros(1), "names": truth["names"]}))

        folder = write_once(cache / "recordings" / f"{self.name}-{digest}", write)
        return Ready(self.name, folder / "recording", folder / "truth.npz", digest)


@dataclass(frozen=True, slots=True)
class Real:
    """A recording of ``../shared/data``; folder: its path there."""

    folder: str

    @property
    def name(self) -> str:
        """Path with dashes."""
        return self.folder.replace("/", "-")

    def ready(self, cache: Path) -> Ready | None:
        """Return the recording where it is; None where the data is absent."""
        recording = DATA / self.folder
        if not (recording / "recording.json").is_file():
            return None
        files = sorted(path for path in recording.rglob("*") if path.is_file())
        listed = (f"{path.relative_to(recording)} {path.stat().st_size}" for path in files)
        return Ready(self.name, recording, None, digest_of(*listed))


def digest_of(*parts: str) -> str:
    """Return the first hexadecimal digits of the SHA-256 of texts."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:DIGITS]


def code_of(path: Path) -> bytes:
    """Return the content of a file on which results depend; of a Python file, the code without its prose."""
    if path.suffix != ".py":
        return path.read_bytes()
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            node.body = [step for step in node.body if not _is_prose(step)]
    return ast.dump(tree).encode()


def _is_prose(step: ast.stmt) -> bool:
    """Return whether a statement is a docstring, of a module, class or function or of the constant before it."""
    return isinstance(step, ast.Expr) and isinstance(step.value, ast.Constant) and isinstance(step.value.value, str)


@functools.cache
def simulator_digest() -> str:
    """Return the SHA-256 of all code that the simulator imports, except ``STAGES``, and of the body's data."""
    root, digest = Path(anchorpose.__file__).parent, hashlib.sha256()
    for path in [*sorted(imported(root, (root / "simulate").rglob("*.py"))), *sorted((root / "body/data").iterdir())]:
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + code_of(path))
    return digest.hexdigest()


def imported(root: Path, modules: Iterable[Path]) -> set[Path]:
    """Return the files ``modules``, and the files of the package in folder ``root`` that these import, directly or
    through each other, except those of ``STAGES``.
    """
    found, waiting = set[Path](), list(modules)
    while waiting:
        path = waiting.pop()
        if path in found or path.relative_to(root).parts[0] in STAGES:
            continue
        found.add(path)
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f"{root.name}."):
                place = root.joinpath(*node.module.split(".")[1:])
                names = (place / f"{alias.name}.py" for alias in node.names)
                waiting += [one for one in (place.with_suffix(".py"), *names) if one.is_file()]
    return found


def _source_of(programme: Programme | None) -> tuple[str, ...]:
    """Return the source of the module that defines a programme, and the arguments that the programme is called with."""
    if programme is None:
        return ()
    function = getattr(programme, "func", programme)
    return inspect.getsource(sys.modules[function.__module__]), str(getattr(programme, "keywords", {}))


def _locked(folder: Path) -> FileLock:
    folder.parent.mkdir(parents=True, exist_ok=True)
    return FileLock(folder.with_name(f".{folder.name}.lock"))


def write_once(folder: Path, write: Callable[[Path], None]) -> Path:
    """Write a folder unless it exists; the folder appears only when it is complete."""
    with _locked(folder):
        if not folder.exists():
            work = folder.with_name(f".{folder.name}.work")
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
            write(work)
            work.rename(folder)
    return folder


def _first_camera(recording: Path) -> tuple[dict[str, object], str]:
    """Return recording.json with its first camera only, and that camera's name."""
    document = json.loads((recording / "recording.json").read_text(encoding="utf-8"))
    document["cameras"] = document["cameras"][:1]
    return document, document["cameras"][0]["name"]


def _link_first_camera(recording: Path, out: Path) -> None:
    document, camera = _first_camera(recording)
    (out / "recording.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    for name in (camera, "equipment.json"):
        if (recording / name).exists():
            (out / name).symlink_to((recording / name).resolve())


def _copy_frame(recording: Path, out: Path, frame: int) -> None:
    document, camera = _first_camera(recording)
    depth = out / "recording" / camera / "depth"
    depth.mkdir(parents=True)
    shutil.copyfile(recording / camera / "depth" / f"{frame:06d}.png", depth / "000000.png")
    (out / "recording" / camera / "timestamps.csv").write_text("frame,time_s\n0,0.0\n", encoding="utf-8")
    (out / "recording" / "recording.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    if (recording / "equipment.json").exists():
        shutil.copyfile(recording / "equipment.json", out / "recording" / "equipment.json")
