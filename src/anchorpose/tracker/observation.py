"""Hold the values of one frame: where the patient was expected, person labels, surface, anchors, and the data to which
the body is registered (evidence).
"""

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

# minimum number of a node's distances to anchors that must remain after the distances lengthened by a hole in the
# surface are left out; with fewer, all distances of the node are kept. The distances to three anchors identify a node
# (paper, Section IV-D), and four distances allow four different choices of three anchors
LEAST_TRUSTED = 4
# number of frames from a check by the learnt descriptor to the next check; a check takes a third of the time for
# tracking a frame
DESCRIBED_EVERY: Final = 8


def is_described(frame_set: FrameSet) -> bool:
    """Return whether the learnt descriptor checks this frame. The frame's position in the recording decides; the
    frame's number decides only if the position is unknown, since the numbers of a recording's images may leave out
    every multiple of ``DESCRIBED_EVERY``. A check has two parts: the limb to which the descriptor assigns seen skin is
    compared with the limb to which the pose assigns this skin, and the patient's pixels are searched for several
    people.
    """
    place = frame_set.frame if frame_set.position is None else frame_set.position
    return place % DESCRIBED_EVERY == 0


@dataclass(frozen=True, slots=True, eq=False)
class Expectation:
    """The place and pose in which the patient is expected in a frame."""

    skin: ExpectedSkin
    sigma_m: np.ndarray  # (p,) m, standard deviation of each skin point's place
    anchors_m: np.ndarray  # (5, 3) expected places of the anchors: head, hands and feet
    facing: np.ndarray  # (3,) direction in which the trunk faces, a horizontal unit vector
    unfitted_s: float  # s, time since the body was last fitted

    def apart_m(self, other: Expectation) -> float:
        """Return the distance (m) between the expected places of a skin point: the 90th percentile over all skin
        points.
        """
        return float(np.quantile(np.linalg.norm(self.skin.points_m - other.skin.points_m, axis=1), 0.9))

    def moved(self, step: np.ndarray) -> Expectation:
        """Return the expectation moved by ``step`` (3,) metres, world."""
        skin = replace(self.skin, points_m=self.skin.points_m + step.astype(np.float32))
        return replace(self, skin=skin, anchors_m=self.anchors_m + step)


@dataclass(frozen=True, slots=True, eq=False)
class Isolated:
    """The people of one frame: the label of each pixel, the skin of each person as last seen, and the bystanders'
    bodies.
    """

    pieces: tuple[Pieces | None, ...]  # the pixels of all people, per camera; None without a depth image
    views: tuple[View | None, ...]  # depth frame with the label of each pixel, per camera; None without a depth image
    memory: BystanderMemory  # the skin of all people, the patient included, as last seen
    bystanders: Bystanders  # the bodies that were fitted to the bystanders


@dataclass(frozen=True, slots=True, eq=False)
class SeenSurface:
    """The patient's surface in one frame."""

    whole: Surface  # the seen surface, and hidden skin that is inferred
    seen: Surface  # only the seen part of the surface
    # (n,) uint8 of ``Border``, per node of ``whole`` (seen and inferred surface): whether the surface ends near the
    # node, and the kind of border
    border: np.ndarray
    evidence: Evidence  # the data to which the body is registered, including the seen surface


class AnchorDistances:
    """The geodesic distances from the seen nodes to the anchors, computed on first use: most frames never need them."""

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
        """Return (n, 5) metres: the geodesic distance from each seen node to each anchor, with inf and NaN as in
        ``Observation.descriptor``.
        """
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
    """One frame with the results of all stages before registration."""

    frame_set: FrameSet
    # where the patient was expected; None in an initial frame, and if a scene hypothesis replaced the frame's labels
    expected: Expectation | None
    evidence: Evidence
    surface: Surface  # the patient's seen skin
    whole: Surface  # seen skin and inferred hidden skin
    anchors: Anchors
    distances: AnchorDistances
    # (n,) uint8 of ``Border``, per seen node: whether the surface ends near the node, and the kind of border
    border: np.ndarray
    pieces: tuple[Pieces | None, ...]
    memory: BystanderMemory
    bystanders: Bystanders

    @property
    def descriptor(self) -> np.ndarray:
        """Return (n, 5) metres: the geodesic distance from each seen node to each anchor; inf if no path leads to the
        anchor, NaN if the anchor is missed.

        A distance that a hole in the surface lengthens, or that is infinite, becomes NaN, too, if the node has at least
        ``LEAST_TRUSTED`` other distances that are not lengthened; with the setting ``hypotheses.trusted_only`` switched
        off, it is kept.
        """
        return self.distances.of_seen_nodes()

    @property
    def seen_anchors(self) -> SeenAnchors:
        """Return the surface and its anchors together, for the limb search."""
        return SeenAnchors(self.whole, self.anchors)


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The frame in which tracking begins: its observation, and the body with its pose."""

    observation: Observation
    shape: FittedShape
    belief: PoseBelief
    explained: float  # 0 to 1, share of the patient's visible surface that lies near the body
    rivals: tuple[Rival, ...] = ()  # other poses that fit the frame almost as well as the best pose
    turned: Rival | None = None  # the opposite facing, even if it fits the frame badly; None once a body is learnt
