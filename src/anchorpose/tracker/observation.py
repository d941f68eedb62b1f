"""Hold the values of one frame: where the patient was expected, person labels, surface, anchors, evidence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.belief import PoseBelief
from anchorpose.body.evidence import Evidence
from anchorpose.body.rivals import Rival
from anchorpose.body.skin_points import FittedShape
from anchorpose.geodesics.anchors import Anchors, SeenAnchors, anchor_descriptor
from anchorpose.geodesics.trusted_anchors import trusted_anchors
from anchorpose.isolation.bystander_memory import BystanderMemory
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import View
from anchorpose.recording.recording import FrameSet
from anchorpose.surface.border import Border
from anchorpose.surface.surface import ExpectedSkin, Surface
from anchorpose.tracker.bystanders import Bystanders
from anchorpose.tracker.stopwatch import Stopwatch

# anchors; three identify a node (paper, Section IV-D), and four give two subsets; a node with fewer keeps all distances
LEAST_TRUSTED = 4
# frames between looks by the learnt descriptor at the patient, which take a third of a frame's time
DESCRIBED_EVERY: Final = 8


def is_described(frame: int) -> bool:
    """Return whether the learnt descriptor looks at the patient in this frame, whatever the prediction says: at the
    names of limbs, and at the number of people.
    """
    return frame % DESCRIBED_EVERY == 0


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """The expected patient: skin, uncertainty of each skin point (p,), anchors_m (5, 3), heading (3,) as a unit vector;
    number of frames since the last fit.
    """

    skin: ExpectedSkin
    sigma_m: np.ndarray
    anchors_m: np.ndarray
    facing: np.ndarray
    frames_without_fit: int

    def apart_m(self, other: Expectation) -> float:
        """Return the distance between two expectations: the 90th percentile of the distances between their skin
        points.
        """
        return float(np.quantile(np.linalg.norm(self.skin.points_m - other.skin.points_m, axis=1), 0.9))

    def moved(self, step: np.ndarray) -> Expectation:
        """Return the expectation moved by ``step`` (3,) metres, world."""
        skin = replace(self.skin, points_m=self.skin.points_m + step.astype(np.float32))
        return replace(self, skin=skin, anchors_m=self.anchors_m + step)


@dataclass(frozen=True, slots=True, eq=False)
class Isolated:
    """The people of one frame: per camera the people's pixels and all labels (None without a depth image), the memory
    of all people's skin, and the bystanders' bodies.
    """

    pieces: tuple[Pieces | None, ...]
    views: tuple[View | None, ...]
    memory: BystanderMemory
    bystanders: Bystanders


@dataclass(frozen=True, slots=True, eq=False)
class SeenSurface:
    """The patient's surface in one frame.

    whole: surface including hidden skin, which is inferred; seen: only the seen surface. border (n,) uint8 of
    ``Border``: what bounds the surface at each node of the whole. evidence: the data to which the body is registered,
    including the seen surface.
    """

    whole: Surface
    seen: Surface
    border: np.ndarray
    evidence: Evidence


class AnchorDistances:
    """The distances from the seen nodes to the anchors, computed only when they are used, which most frames do not
    need.
    """

    _surface: SeenSurface
    _anchors: Anchors
    _trusted_only: bool
    _stopwatch: Stopwatch
    _found: np.ndarray | None

    def __init__(self, surface: SeenSurface, anchors: Anchors, trusted_only: bool, stopwatch: Stopwatch) -> None:
        self._surface, self._anchors = surface, anchors
        self._trusted_only, self._stopwatch = trusted_only, stopwatch
        self._found = None

    def of_seen_nodes(self) -> np.ndarray:
        """Return the distances (n, 5) as ``Observation.descriptor`` defines them."""
        if self._found is None:
            with self._stopwatch.stage("geodesics"):
                self._found = self._compute()
        return self._found

    def _compute(self) -> np.ndarray:
        whole, cut = self._surface.whole, self._surface.border == Border.CUT
        descriptor = anchor_descriptor(whole, self._anchors)
        if self._trusted_only:
            trusted = trusted_anchors(whole, descriptor, cut)
            trusted |= trusted.sum(axis=1, keepdims=True) < LEAST_TRUSTED
            descriptor = np.where(trusted, descriptor, np.nan).astype(np.float32)
        return descriptor[: len(self._surface.seen)]


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One frame after the stages up to geodesics.

    surface: the seen skin of the patient; whole: seen skin and inferred hidden skin. expected: where the patient was
    expected, None in a frame without expectation. border (n,) uint8 of ``Border``: what bounds the surface at each seen
    node.
    """

    frame_set: FrameSet
    expected: Expectation | None
    evidence: Evidence
    surface: Surface
    whole: Surface
    anchors: Anchors
    distances: AnchorDistances
    border: np.ndarray
    pieces: tuple[Pieces | None, ...]
    memory: BystanderMemory
    bystanders: Bystanders

    @property
    def descriptor(self) -> np.ndarray:
        """Return (n, 5) metres: the distance from each seen node to each anchor, inf where not reached, NaN where
        missed.

        A distance that a hole lengthens is also NaN if the node has enough other distances.
        """
        return self.distances.of_seen_nodes()

    @property
    def seen_anchors(self) -> SeenAnchors:
        """Return surface and anchors together, for proposals of limbs."""
        return SeenAnchors(self.whole, self.anchors)


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first frame of a track: its observation, the body, the belief in its pose.

    rivals: other poses that explain the frame almost as well. turned: the person facing the other way, however well
    this explains the frame; None unless the body is still to be learnt.
    """

    observation: Observation
    shape: FittedShape
    belief: PoseBelief
    explained: float
    rivals: tuple[Rival, ...] = ()
    turned: Rival | None = None
