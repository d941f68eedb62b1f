"""Propose poses from the picture, each source by itself; none depends on where the pose was predicted.

A prediction has a part in it only through the trunk that limbs hang on, and that is proposed too.
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
from anchorpose.body.limb_proposals import anchor_poses, exchanged, limb_poses, uncovered_paths
from anchorpose.body.matched_places import LEAST_MATCHES, fit_matches, matches_of
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.geodesics.anchors import SeenAnchors
from anchorpose.isolation.view import PixelLabel

MOST_UNUSUAL: Final = 10.0  # squared deviations of all joint ranges by which a pose may be rarer than before


@dataclass(frozen=True, slots=True, eq=False)
class Doubted:
    """A pose in doubt and what the frame shows.

    anchors: None where the pose is a first one, which comes from the descriptor, and nobody has looked for anchors yet.
    """

    body: Body
    pose: Pose
    evidence: Evidence
    anchors: SeenAnchors | None


def proposals(doubted: Doubted, sources: Sequence[Source]) -> Iterator[Pose]:
    """Yield the poses that some sources propose, but for limbs that are bent much more than those in doubt.

    Else a leg that nobody sees could be laid along an arm. Which side a limb is decide the images alone.
    """
    most = rarity(doubted.body, doubted.pose) + MOST_UNUSUAL
    for source in sources:
        for pose in SOURCES[source](doubted):
            if source is Source.SIDES or rarity(doubted.body, pose) <= most:
                yield pose


def rarity(body: Body, pose: Pose) -> float:
    """Return how far the joints are bent: the sum of squared deviations from their usual range."""
    return prior_equations(body.points, pose, None).cost


def _along_surface(doubted: Doubted) -> Iterator[Pose]:
    """Yield a limb along skin that nothing covers."""
    body, pose, evidence = doubted.body, doubted.pose, doubted.evidence
    explanation = explain(body.points, pose_points(body, pose), evidence)
    for path in uncovered_paths(evidence, explanation):
        yield from limb_poses(body, pose, path)


def _to_anchors(doubted: Doubted) -> Iterator[Pose]:
    """Yield a limb along the geodesic path of an anchor, or of an end without a name (paper, Definition 2)."""
    if doubted.anchors is not None:
        yield from anchor_poses(doubted.body, doubted.pose, doubted.anchors)


def _by_descriptor(doubted: Doubted) -> Iterator[Pose]:
    """Yield the whole body by the learnt descriptor, and the same with front and back exchanged, which it mistakes
    most.
    """
    if doubted.anchors is None:
        return
    matches = matches_of(doubted.evidence.views, doubted.evidence.cameras, PixelLabel.PATIENT)
    if len(matches) >= LEAST_MATCHES:
        yield fit_matches(doubted.body, matches)
        yield fit_matches(doubted.body, matches.turned)


def _exchanged(doubted: Doubted) -> Iterator[Pose]:
    """Yield the arms, legs or all sides exchanged: limbs stay where they are and change their names."""
    yield from exchanged(doubted.body, doubted.pose)


SOURCES: Final[Mapping[Source, Callable[[Doubted], Iterator[Pose]]]] = MappingProxyType(
    {
        Source.SURFACE: _along_surface,
        Source.ANCHORS: _to_anchors,
        Source.DESCRIPTOR: _by_descriptor,
        Source.SIDES: _exchanged,
    }
)
