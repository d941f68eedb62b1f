"""Hold the results of an experiment before averaging; tables, figures and the page are made from these alone.

The module also chooses each method's setting on the training recordings, by the same measure for all methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_COUNT
from anchorpose.research.experiment.config import ExperimentConfig, Form, Scene
from anchorpose.research.experiment.method import Method


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """One method on one recording with one size of hole (0: none), in one form of the framework.

    frame (f,) int64: positions in the recording, without the frames whose pose was given. occluded (f,) bool: the frame
    has a hole. error_mm (f, 21): distance from the truth, or from the reference skeleton of a real recording; NaN where
    either has no joint.
    """

    scene: Scene
    recording: str
    hole_m: float
    method: str
    frame: np.ndarray
    occluded: np.ndarray
    error_mm: np.ndarray
    form: Form = Form.REFINED

    def __post_init__(self) -> None:
        if self.error_mm.shape != (len(self.frame), JOINT_COUNT) or self.occluded.shape != self.frame.shape:
            raise ValueError(f"errors {self.error_mm.shape} do not fit {len(self.frame)} frames")


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """One method's matches between two frames of a simulated recording, ``gap_s`` apart.

    Over m nodes of the first frame whose place is seen in the other: region (m,) int8 index into ``REGIONS``; moved_mm
    (m,): how far that place is from the node; direct_mm, tree_mm, every_mm (m,): straight distance of the match from
    that place, without the track tree, with it, and with a tree that gives no node up, NaN without a match (all of
    direct_mm where a method has several hypotheses); direct_skin_mm, tree_skin_mm: the same along the skin;
    mirrored (m,) bool: the direct match, or without one the tree's, lies on the same part of the other side, such as
    the other hand. occluded: either frame has a hole. nodes: of the first frame. describe_s: seconds on one core for
    two frames' descriptors, anchors included, and the matches between them. body_m: standing height, to express
    distances along the skin relative to it.
    """

    scene: Scene
    recording: str
    hole_m: float
    method: str
    frame: int
    occluded: bool
    region: np.ndarray
    direct_mm: np.ndarray
    tree_mm: np.ndarray
    direct_skin_mm: np.ndarray
    tree_skin_mm: np.ndarray
    mirrored: np.ndarray
    nodes: int
    describe_s: float
    body_m: float
    gap_s: float
    moved_mm: np.ndarray
    every_mm: np.ndarray


@dataclass(frozen=True, slots=True)
class TriedSetting:
    """One setting of a method on the training recordings: mean distance of its matches from the truth, millimetres.

    A node without a match counts as ``MISSED_MM``.
    """

    setting: str
    score_mm: float
    chosen: bool


@dataclass(frozen=True, slots=True)
class PaperTimes:
    """Seconds on one core for a mesh at every pixel and for its five geodesic fields, as measured in the paper.

    image: the size of the depth image, and how near the person is, so that the mesh is as large as the paper's.
    """

    image: str
    nodes: int
    edges: int
    mesh_s: float
    feature_s: float
    dijkstra_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ExperimentResults:
    """All results of an experiment.

    methods: in the order of the tables; tried: the settings of each method; times: None where none were measured;
    failed: a sentence for each recording that could not be used; real: the folder of real recordings.
    """

    config: ExperimentConfig
    methods: tuple[Method, ...]
    tried: tuple[tuple[str, tuple[TriedSetting, ...]], ...]
    tracked: tuple[Tracked, ...]
    matched: tuple[Matched, ...]
    times: PaperTimes | None
    failed: tuple[str, ...]
    real: Path | None


MISSED_MM: Final = 100.0
"""The error of a node without a match: the track tree's ``missed_cost_m``."""


def capped_mean_mm(tree_mm: Sequence[np.ndarray]) -> float:
    """Return the mean distance from the truth after the track tree, over all nodes of all windows, each at most
    ``MISSED_MM``.

    The cap is there because the framework's registration is robust to outliers. tree_mm: of each window (m,), NaN
    without a match. NaN without nodes.
    """
    every = np.concatenate([np.zeros(0), *(np.where(np.isfinite(e), e, MISSED_MM) for e in tree_mm)])
    return float(np.minimum(every, MISSED_MM).mean()) if len(every) else np.nan


def choose(settings: Sequence[object], scores_mm: Sequence[float]) -> tuple[TriedSetting, ...]:
    """Return the settings with their scores; the best setting is chosen, of equals the first; without scores the first
    setting is chosen.
    """
    known = np.where(np.isfinite(scores_mm), scores_mm, np.inf)
    best = int(np.argmin(known))
    return tuple(
        TriedSetting(setting_text(setting), float(value), number == best)
        for number, (setting, value) in enumerate(zip(settings, scores_mm, strict=True))
    )


def setting_text(setting: object) -> str:
    """Return a setting as text."""
    return "no settings" if setting is None else repr(setting)
