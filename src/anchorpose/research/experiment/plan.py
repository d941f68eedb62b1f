"""Define the tasks of an experiment, and the store of their results.

The name of a stored file is a hash of the task, the code and the libraries, so that no outdated result is read.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.recording.regular_file import open_regular
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.config import ExperimentConfig, Form, Scene
from anchorpose.research.experiment.method import Family, Method, load_methods
from anchorpose.research.experiment.methods.references import ABLATED
from anchorpose.versions import code_digest, versions

PRESENTING: Final = (
    "batch/",
    "cli/",
    "exports/",
    "pages/",
    "report/",
    "research/benchmark/",
    "research/experiment/results.py",
    "research/experiment/page/",
    "research/experiment/pictures/",
    "research/experiment/clip_jobs.py",
    "research/experiment/costs.py",
    "research/experiment/run.py",
    "viewer/",
)
"""Folders and modules of the package whose code does not affect any stored result."""


class ResultStore:
    """A folder of results, each of which is either a complete .npz file or absent."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, kind: str, *asked: object) -> Path:
        """Return the file of a result. asked: values whose ``repr`` contains everything on which the result depends."""
        text = "\n".join([experiment_code(), repr(versions()), kind, *map(repr, asked)])
        return self.folder / kind / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.npz"

    def write(self, path: Path, arrays: Mapping[str, object]) -> None:
        """Write a result as a whole, so that an interruption leaves no partial file."""
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
    """Return the arrays of a stored result."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def experiment_code() -> str:
    """Return the digest of all code that a result of the experiment may depend on."""
    return code_digest(PRESENTING)


# Scenes in which the ablated variants of the tracker run. In all other scenes, tracking is too easy to compare the
# variants.
ABLATION_SCENES: Final = (Scene.FRAME, Scene.CLINIC_FRONT, Scene.CLINIC)
# Radius in m of the hole in half of the pairs of training frames. The other pairs have no hole, since a setting must
# work with and without holes.
TUNING_HOLE_M: Final = 0.12


class Kind(StrEnum):
    """The quantity that a task measures."""

    MATCHED = "matched"  # the distance of matches from the truth
    TRACKED = "tracked"  # the distance of joints from the truth


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A task: to run a method, with a setting, on a clip (recording) with one size of hole."""

    kind: Kind
    clip: Clip
    hole_m: float
    method: Method
    setting: object
    path: Path  # file of the task's result
    forms: tuple[Form, ...]  # forms (variants) of the paper's framework in which joints are tracked
    pairs: int  # number of pairs of frames whose matches are compared

    @property
    def done(self) -> bool:
        """Return whether the task's result is stored already."""
        return self.path.is_file()


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The plan of an experiment: the methods that run on each clip (recording), and the way in which they run."""

    config: ExperimentConfig
    methods: tuple[Method, ...]
    settings: Mapping[str, object]  # setting of each method, by the method's key
    movements: Path  # file of the reference movements
    movements_digest: str  # digest of the content of ``movements``
    store: ResultStore
    training: bool = False  # whether the plan serves to choose settings: every setting of every method is then tried

    def tasks(self, clip: Clip) -> Iterator[Task]:
        """Yield all tasks of a clip (recording)."""
        if self.training:
            yield from self._tried(clip)
            return
        for hole_m in self.holes(clip):
            for method in self.methods_on(clip):
                setting = self.settings.get(method.key)
                if method.associate is not None and self.has_windows(clip):
                    yield self._task(Kind.MATCHED, clip, hole_m, method, setting)
                yield self._task(Kind.TRACKED, clip, hole_m, method, setting)

    def _tried(self, clip: Clip) -> Iterator[Task]:
        for hole_m in self.holes(clip):
            for method in self.methods:
                for setting in method.settings if len(method.settings) > 1 else ():
                    yield self._task(Kind.MATCHED, clip, hole_m, method, setting)

    @property
    def windows(self) -> int:
        """Return the number of pairs of frames whose matches are compared, per recording, size of hole and gap (time
        between the two frames).
        """
        return self.config.training_windows if self.training else self.config.windows

    @property
    def gaps_s(self) -> tuple[float, ...]:
        """Return the gaps in seconds between two frames whose matches are compared; in training, return only the first
        gap.
        """
        return self.config.gaps_s[:1] if self.training else self.config.gaps_s

    def holes(self, clip: Clip) -> tuple[float, ...]:
        """Return the radii in metres of the holes that are cut into a clip's depth images, 0 = no hole. In training,
        the radii are 0 and ``TUNING_HOLE_M``; otherwise, a clip with loose clothes has only 0 and the largest radius.
        """
        if self.training:
            return (0.0, TUNING_HOLE_M)
        if clip.scene is Scene.LOOSE:
            return tuple(sorted({0.0, max(self.config.holes_m)}))
        return self.config.holes_m if clip.holes_are_cut else (0.0,)

    def forms(self, clip: Clip, hole_m: float, method: Method) -> tuple[Form, ...]:
        """Return the forms (variants) of the paper's framework in which a method tracks a clip (recording).

        In the paper's scene, these are all forms if there is no hole or the largest hole; with holes of other sizes,
        these are the forms that fit body parts to the surface. In other scenes, and for a complete tracker, only the
        first form is used.
        """
        every = self.config.forms
        if clip.scene is not Scene.PAPER or method.family is Family.TRACKER:
            return every[:1]
        at_end = hole_m in (0.0, max(self.config.holes_m))
        return tuple(form for form in every if at_end or form.refined)

    def methods_on(self, clip: Clip) -> tuple[Method, ...]:
        """Return all methods; in ``ABLATION_SCENES``, also the ablated variants of this project's tracker.

        The variants are left out if the tracker is not among the methods, or if ``config.ablation`` is False.
        """
        own = any(method.family is Family.TRACKER for method in self.methods)
        ablated = own and self.config.ablation and clip.scene in ABLATION_SCENES
        return (*self.methods, *(ABLATED if ablated else ()))

    def has_windows(self, clip: Clip) -> bool:
        """Return whether matches are compared with the truth. They are compared only in the paper's scene."""
        return clip.scene is Scene.PAPER

    def reference(self, clip: Clip) -> Path:
        """Return the file of a clip's reference (``given.Reference``): the poses and pixels that methods are given."""
        return self.store.path("reference", identity(clip))

    def _task(self, kind: Kind, clip: Clip, hole_m: float, method: Method, setting: object) -> Task:
        config, forms = self.config, self.forms(clip, hole_m, method)
        how = (config.hole_share, config.segment_frames, config.segments, self.movements_digest)
        of_kind = (self.windows, self.gaps_s) if kind is Kind.MATCHED else forms
        what = (identity(clip), hole_m, method.key, method.content, setting)
        path = self.store.path(kind, *what, *how, *of_kind)
        return Task(kind, clip, hole_m, method, setting, path, forms, self.windows * len(self.gaps_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanSpec:
    """The data of a plan in a form that can be sent to another process."""

    config: ExperimentConfig
    wanted: tuple[str, ...]  # keys or files of the methods
    chosen: tuple[tuple[str, int], ...]  # key of each method, and the index of its setting in ``Method.settings``
    movements: Path
    movements_digest: str
    cache: Path
    code: str  # digest of the experiment's code, by which the other process notices that the code has changed
    training: bool = False

    def plan(self) -> Plan:
        """Make the plan. Raises AnchorposeError if the code has changed since this object was made."""
        if self.code != experiment_code():
            raise AnchorposeError("the program was changed while it ran; start the experiment again.")
        methods = load_methods(self.wanted)
        numbers = dict(self.chosen)
        settings = {method.key: method.settings[numbers.get(method.key, 0)] for method in methods}
        return Plan(
            self.config,
            methods,
            settings,
            self.movements,
            self.movements_digest,
            ResultStore(self.cache),
            self.training,
        )


def identity(clip: Clip) -> str:
    """Return a text that identifies the content of a clip (recording): its simulation, or a digest of its files."""
    if clip.simulation is not None or clip.folder is None:
        return repr(clip.simulation)
    return _content(clip.folder)


@cache
def _content(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
            with open_regular(path) as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()
