"""Define the results of an experiment before averaging. Tables, figures and the page are made from these results alone.

This module also chooses each method's setting on the training recordings, by the same measure for all methods.
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
    """The joints that one method tracked in one recording with one size of hole, in one form (variant) of the paper's
    framework.
    """

    scene: Scene
    recording: str
    hole_m: float  # radius of the holes; 0 = no hole
    method: str
    frame: np.ndarray  # (f,) int64, positions of the frames in the recording; frames whose pose was given are left out
    occluded: np.ndarray  # (f,) bool, whether the frame has a hole
    # (f, 21), distance of the tracked joint from the true joint (in real recordings, from the reference skeleton's
    # joint); NaN if either is unknown
    error_mm: np.ndarray
    form: Form = Form.REFINED

    def __post_init__(self) -> None:
        if self.error_mm.shape != (len(self.frame), JOINT_COUNT) or self.occluded.shape != self.frame.shape:
            raise ValueError(f"errors {self.error_mm.shape} do not fit {len(self.frame)} frames")


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """One method's matches between two frames of a simulated recording.

    Arrays have an entry for each of m nodes (points of the patient's mesh) of the first frame. The m nodes are drawn at
    random, at most ``matching.COMPARED``, from all nodes whose true place is seen in the second frame. Errors are
    distances of the match from this place, NaN without a match. Direct matches are made without the track tree, which
    chooses matches with the help of later frames. A method with several hypotheses (possible matches) per node has no
    direct matches, since only the tree chooses among the hypotheses.
    """

    scene: Scene
    recording: str
    hole_m: float
    method: str
    frame: int
    occluded: bool  # whether either frame has a hole
    region: np.ndarray  # (m,) int8, region of the node, as an index into ``REGIONS``
    direct_mm: np.ndarray  # (m,), straight distance from the true place to the direct match
    tree_mm: np.ndarray  # (m,), straight distance from the true place to the track tree's match
    direct_skin_mm: np.ndarray  # (m,), distance along the skin from the true place to the direct match
    tree_skin_mm: np.ndarray  # (m,), distance along the skin from the true place to the track tree's match
    # (m,) bool, whether the match is on the same part of the body's other side, such as the other hand. The match is
    # the direct match or, without a direct match, the match of the track tree.
    mirrored: np.ndarray
    nodes: int  # number of all nodes of the first frame
    describe_s: float  # seconds on one core for the descriptors and anchors of two frames, and the matches between them
    body_m: float  # m, standing height of the patient; errors along the skin are also stated as shares of this height
    gap_s: float  # seconds between the two frames
    moved_mm: np.ndarray  # (m,), distance of the true place in the second frame from the node's place in the first
    every_mm: np.ndarray  # (m,), as ``tree_mm``, but for a track tree that rejects no match


@dataclass(frozen=True, slots=True)
class TriedSetting:
    """One setting of a method that was tried on the training recordings."""

    setting: str
    score_mm: float  # mm, mean distance of the track tree's matches from the truth, as in ``capped_mean_mm``
    chosen: bool


@dataclass(frozen=True, slots=True)
class PaperTimes:
    """Times on one core, in s, for making a mesh with a node at every pixel, and for computing the distances of all
    nodes to five nodes.

    These times are compared with the paper's times.
    """

    image: str  # width x height of the depth image, in which the mesh is about as large as the paper's
    nodes: int
    edges: int
    mesh_s: float
    feature_s: float  # seconds for distances by fast marching
    dijkstra_s: float  # seconds for distances by Dijkstra's algorithm along the edges, as in the paper


@dataclass(frozen=True, slots=True, eq=False)
class ExperimentResults:
    """All results of an experiment."""

    config: ExperimentConfig
    methods: tuple[Method, ...]  # all methods, in the order in which tables show them
    tried: tuple[tuple[str, tuple[TriedSetting, ...]], ...]  # key of each method, and the settings tried for it
    tracked: tuple[Tracked, ...]
    matched: tuple[Matched, ...]
    times: PaperTimes | None  # None if times were not measured
    failed: tuple[str, ...]  # sentences on recordings that could not be used or drawn, or that lack results
    real: Path | None  # folder of real recordings


MISSED_MM: Final = 100.0
"""Error that is counted for a node without a match in scores; it equals ``missed_cost_m`` of ``TreeConfig``."""


def capped_mean_mm(tree_mm: Sequence[np.ndarray]) -> float:
    """Return the mean distance of the track tree's matches from the truth, over all nodes of all pairs of frames.

    A distance counts at most ``MISSED_MM``, as much as a node without a match, since a very wrong match does little
    harm: the forms (variants) of the paper's framework that reject bad matches give outliers less weight. tree_mm: one
    array (m,) for each pair of frames, NaN without a match. The result is NaN without nodes.
    """
    every = np.concatenate([np.zeros(0), *(np.where(np.isfinite(e), e, MISSED_MM) for e in tree_mm)])
    return float(np.minimum(every, MISSED_MM).mean()) if len(every) else np.nan


def choose(settings: Sequence[object], scores_mm: Sequence[float]) -> tuple[TriedSetting, ...]:
    """Return the tried settings of a method, each with its score and the flag ``chosen``.

    The setting with the smallest score is chosen, or the first of equally good settings; without scores, the first of
    all settings is chosen.
    """
    known = np.where(np.isfinite(scores_mm), scores_mm, np.inf)
    best = int(np.argmin(known))
    return tuple(
        TriedSetting(setting_text(setting), float(value), number == best)
        for number, (setting, value) in enumerate(zip(settings, scores_mm, strict=True))
    )


def setting_text(setting: object) -> str:
    """Return a setting as text for tables."""
    return "no settings" if setting is None else repr(setting)
