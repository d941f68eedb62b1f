"""Propose other poses for a pose in doubt (a pose that may be wrong), from each source independently.

The images determine the places of the proposed limbs, except for hidden limbs, which get a usual posture. The trunk is
taken from the pose in doubt, but the descriptor also proposes other poses of the trunk, and one proposal turns the body
round.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from anchorpose.body.config import Source
from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import explain
from anchorpose.body.fit import prior_equations
from anchorpose.body.limb_proposals import anchor_poses, exchanged, limb_poses, uncovered_paths, usual_poses
from anchorpose.body.matched_places import LEAST_MATCHES, fit_matches, matches_of
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.geodesics.anchors import SeenAnchors
from anchorpose.isolation.view import PixelLabel

# maximum by which the ``rarity`` of a proposed pose may exceed the ``rarity`` of the pose in doubt
MOST_UNUSUAL: Final = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Doubted:
    """A pose in doubt (a pose that may be wrong), with the body, and with the evidence and the anchors of the frame."""

    body: Body
    pose: Pose
    evidence: Evidence
    anchors: SeenAnchors | None  # None for a first pose, since the search for anchors comes later


def proposals(doubted: Doubted, sources: Sequence[Source]) -> Iterator[Pose]:
    """Yield the poses that the sources propose, except poses that are much rarer in people than the pose in doubt.

    Rare poses are, for example, poses in which a hidden leg lies along an arm. Poses with exchanged sides are always
    yielded: the images alone decide whether these poses are better.
    """
    most = rarity(doubted.body, doubted.pose) + MOST_UNUSUAL
    for source in sources:
        for pose in SOURCES[source](doubted):
            if source is Source.SIDES or rarity(doubted.body, pose) <= most:
                yield pose


def rarity(body: Body, pose: Pose) -> float:
    """Return a measure of how rare a pose is in people: the sum of squared deviations of the joints from their usual
    range.
    """
    return prior_equations(body.points, pose, None).cost


def _along_surface(doubted: Doubted) -> Iterator[Pose]:
    """Yield poses with a limb laid along seen skin that the body does not cover, for each limb that can reach this
    skin.
    """
    body, pose, evidence = doubted.body, doubted.pose, doubted.evidence
    explanation = explain(body.points, pose_points(body, pose), evidence)
    for path in uncovered_paths(evidence, explanation):
        yield from limb_poses(body, pose, path)


def _to_anchors(doubted: Doubted) -> Iterator[Pose]:
    """Yield poses with a limb laid along a geodesic path (a shortest path over the seen surface). The path begins at an
    anchor that contradicts the pose, or at an end of the surface (paper, Definition 2) that was not identified as an
    anchor.
    """
    if doubted.anchors is not None:
        yield from anchor_poses(doubted.body, doubted.pose, doubted.anchors)


def _by_descriptor(doubted: Doubted) -> Iterator[Pose]:
    """Yield the pose that fits the learnt descriptor's predictions for the whole body, then the pose with the opposite
    facing, since a wrong facing is the descriptor's most frequent mistake. If the pose in doubt is a first pose, yield
    nothing, since the descriptor has already found this pose.
    """
    if doubted.anchors is None:
        return
    matches = matches_of(doubted.evidence.views, doubted.evidence.cameras, PixelLabel.PATIENT)
    if len(matches) >= LEAST_MATCHES:
        yield fit_matches(doubted.body, matches)
        yield fit_matches(doubted.body, matches.turned)


def _exchanged(doubted: Doubted) -> Iterator[Pose]:
    """Yield three poses: the left and right arms exchanged, the legs exchanged, and both exchanged with the body turned
    round. The limbs stay in their places.
    """
    yield from exchanged(doubted.body, doubted.pose)


def _hidden(doubted: Doubted) -> Iterator[Pose]:
    """Yield two poses for each limb, in which this limb is hidden in a usual posture (``usual_poses``)."""
    yield from usual_poses(doubted.body, doubted.pose)


SOURCES: Final[Mapping[Source, Callable[[Doubted], Iterator[Pose]]]] = MappingProxyType(
    {
        Source.SURFACE: _along_surface,
        Source.ANCHORS: _to_anchors,
        Source.DESCRIPTOR: _by_descriptor,
        Source.SIDES: _exchanged,
        Source.HIDDEN: _hidden,
    }
)
