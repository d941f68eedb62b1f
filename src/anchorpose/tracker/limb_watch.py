"""Check how well the pose fits each frame, and search for misplaced limbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import Source
from anchorpose.body.explanation import Explanation, explain
from anchorpose.body.likelihood import LEAST_SHARE
from anchorpose.body.limb_proposals import CHAINS, Chain, contradicted_by, end_points
from anchorpose.body.limb_search import Search, needs_search, search_limbs
from anchorpose.body.pose_probability import named_nats
from anchorpose.body.registration import Registration
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.tracker.observation import Observation, is_described
from anchorpose.tracker.room import Run

# first and largest number of frames to wait after a search for limbs without a result, since a search takes as long as
# tracking three frames; each such search doubles this number
SEARCH_PAUSE, LONGEST_PAUSE = 4, 16
# nats, limit of the sum of the log likelihood ratios of a limb's two halves (``named_nats``). If a limb's sum is below
# this limit, the learnt descriptor assigns the limb's skin to another limb; in correctly tracked people, the sums of
# all limbs are larger (``tools/measure_named_places.py``)
MISNAMED: Final = -1.0
# factor; the pause between searches ends early if the area of visible skin that the body does not cover has grown by
# this factor since the last search without a result
MORE: Final = 1.5
# m, maximum distance of an anchor (an end of the seen surface) from the pose's hand or foot. The maximum distance is
# large, since the seen surface of an arm ends at wrist or elbow if a bar hides the hand
ELSEWHERE_M: Final = 0.25
LIMB_ENDS: Final = slice(1, None)  # the anchors that are hands and feet; the first anchor is the head


class LimbWatch:
    """The object that decides in each frame whether to search for misplaced limbs; it pauses after searches without a
    result.
    """

    run: Run
    search_wait: int  # number of frames until the next search for limbs
    search_pause: int  # number of frames to wait after the next search, if that search finds nothing
    left_uncovered_m2: float  # m2, area of visible skin that the body did not cover at the last search without a result

    def __init__(self, run: Run) -> None:
        self.run = run
        self.search_wait, self.search_pause = 0, SEARCH_PAUSE
        self.left_uncovered_m2 = 0.0

    def look(
        self, body: Body, found: Registration, explanation: Explanation, predicted: PoseBelief, seen: Observation
    ) -> Search | None:
        """Search for misplaced limbs if the frame contradicts the pose (``is_doubtful``, ``_misnamed``). Return None if
        the frame agrees with the pose, and during a pause between searches.

        explanation: how well the registered pose fits the frame.
        """
        self.search_wait -= 1
        waiting = self.search_wait >= 0 and explanation.uncovered_m2 < MORE * self.left_uncovered_m2
        sources = self.run.config.registration.sources
        if waiting or not (
            is_doubtful(body, found, explanation, seen, sources) or _misnamed(body, found, seen, sources)
        ):
            return None
        return self._search(body, found, predicted, explanation, seen)

    def look_for_whole(self, body: Body, lost: Registration, predicted: PoseBelief, seen: Observation) -> Search | None:
        """Search for another pose after the registration failed: the body may face the opposite way, or its limbs may
        be in other places. Return None if no search is due or if the search finds nothing.
        """
        self.search_wait -= 1
        config = self.run.config.registration
        if self.search_wait >= 0 or len(seen.surface) < config.least_nodes:
            return None
        assumed = replace(lost, belief=predicted, found=True)
        search = search_limbs(body, assumed, predicted, seen.evidence, config, seen.seen_anchors)
        if search.taken:
            return search
        self.search_wait = SEARCH_PAUSE
        return None

    def _search(
        self, body: Body, found: Registration, predicted: PoseBelief, explanation: Explanation, seen: Observation
    ) -> Search:
        """Search for misplaced limbs; after a search without a result, the next search waits longer."""
        config = self.run.config.registration
        search = search_limbs(body, found, predicted, seen.evidence, config, seen.seen_anchors)
        if search.taken:
            self.search_wait, self.search_pause = 0, SEARCH_PAUSE
        else:
            self.search_wait, self.search_pause = self.search_pause, min(2 * self.search_pause, LONGEST_PAUSE)
            self.left_uncovered_m2 = explanation.uncovered_m2
        return search


def _misnamed(body: Body, found: Registration, seen: Observation, sources: Sequence[Source]) -> bool:
    """Return whether the learnt descriptor, which estimates the place on the skin that a pixel shows, assigns a limb's
    skin to another limb than the pose does; False in frames that the descriptor does not check (``is_described``).
    """
    if Source.DESCRIPTOR not in sources or not is_described(seen.frame_set):
        return False
    return bool(named_nats(body, found.belief.pose, seen.evidence).sum(axis=1).min() < MISNAMED)


def hidden_limbs(body: Body, explanation: Explanation) -> list[Chain]:
    """Return the limbs whose end (hand or foot) is not seen."""
    return [chain for chain in CHAINS if explanation.covering[end_points(body.points, chain)].mean() < LEAST_SHARE]


def explained_by(body: Body, found: Registration, seen: Observation) -> Explanation:
    """Compute how well a registered pose fits a frame."""
    return explain(body.points, pose_points(body, found.belief.pose), seen.evidence)


def is_doubtful(
    body: Body, found: Registration, explanation: Explanation, seen: Observation, sources: Sequence[Source]
) -> bool:
    """Return whether a limb may be misplaced: the body leaves much seen skin uncovered, or its hand or foot is far from
    the anchor (the hand or foot found on the surface).
    """
    if Source.SURFACE in sources and needs_search(explanation, bool(hidden_limbs(body, explanation))):
        return True
    away = contradicted_by(body, found.belief.pose, seen.anchors, ELSEWHERE_M)[LIMB_ENDS]
    return Source.ANCHORS in sources and bool(away.any())
