"""Watches how well the pose explains each frame, and has limbs looked for again where it does not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from anchorpose.body.anchor_limbs import contradicted_by
from anchorpose.body.belief import UNSEEN_S, PoseBelief
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import evidence_cost
from anchorpose.body.explained import Explanation, explain
from anchorpose.body.inverse_kinematics import exchange_crossed_legs
from anchorpose.body.limb_proposals import Chain
from anchorpose.body.limb_search import needs_search, search_limbs
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration, register
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.tracker.claims import claim_limb, hidden_limbs, limbs_in_doubt
from anchorpose.tracker.isolating import relabelled
from anchorpose.tracker.observation import Isolated, Observation
from anchorpose.tracker.rivals import Rival
from anchorpose.tracker.run import Run
from anchorpose.tracker.window import Window

SEARCH_PAUSE, LONGEST_PAUSE = 4, 16  # frames between searches that find nothing, each as long as three frames
LONGEST_CLAIM_PAUSE: Final = 8  # a claim that is tried in vain takes as long as six frames
MORE: Final = 1.5  # times the uncovered area that a search left: so much more is worth another search at once
ELSEWHERE_M: Final = 0.25  # a hand on a bar ends at the bar: its anchor may be at the wrist, or at the elbow's bend
LIMB_ENDS: Final = slice(1, None)  # of the anchors: hands and feet

Observe = Callable[[Isolated, Pose], Observation]
"""Observes the next frame again, with other labels and the patient expected in a pose."""


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """A frame's registration after the watch.

    moved: limbs are elsewhere than the frames before said, so that their movement so far is not their own. rivals:
    poses that a search could not decide against, None where nothing was searched.
    """

    registration: Registration
    moved: bool = False
    rivals: tuple[Rival, ...] | None = None


class LimbWatch:
    """When limbs are searched for, and when the search would only cost time."""

    run: Run
    search_wait: int
    search_pause: int
    left_uncovered_m2: float
    claim_wait: int
    claim_pause: int

    def __init__(self, run: Run) -> None:
        self.run = run
        self.search_wait, self.search_pause = 0, SEARCH_PAUSE  # frames until the next search for limbs
        self.left_uncovered_m2 = 0.0  # by the last search that found nothing: much more is worth another one
        self.claim_wait, self.claim_pause = 0, SEARCH_PAUSE  # the same of limbs among other people's pixels

    def look(
        self,
        body: Body,
        found: Registration,
        explanation: Explanation,
        predicted: PoseBelief,
        window: Window,
        observe: Observe,
    ) -> Watched:
        """The registration of the window's next frame, with limbs found again where it leaves seen skin uncovered or
        a limb covers nothing. explanation: of that frame, by the registered pose."""
        self.search_wait, self.claim_wait = self.search_wait - 1, self.claim_wait - 1
        watched = Watched(found)
        waiting = self.search_wait >= 0 and explanation.uncovered_m2 < MORE * self.left_uncovered_m2
        if is_doubtful(body, found, explanation, window[1]) and not waiting:
            watched = self._search(body, watched, predicted, explanation, window[1])
            explanation = explained_by(body, watched.registration, window[1])
        if self.claim_wait < 0:
            limbs = limbs_in_doubt(body, watched.registration.belief.pose, explanation, window[1])
            if limbs:
                watched = self._claim(body, limbs, watched, predicted, explanation, window, observe)
        return self._uncross(body, watched, predicted, window[1])

    def look_for_whole(self, body: Body, lost: Registration, predicted: PoseBelief, seen: Observation) -> Watched:
        """A body that explains nothing where it is expected may be turned round, or have other limbs."""
        self.search_wait -= 1
        config = self.run.config.registration
        if self.search_wait >= 0 or len(seen.surface) < config.least_nodes:
            return Watched(lost)
        assumed = replace(lost, belief=predicted, found=True)
        search = search_limbs(body, assumed, predicted, seen.evidence, config, seen.geodesics)
        if not search.rounds:
            self.search_wait = SEARCH_PAUSE
            return Watched(lost)
        return Watched(search.registration, moved=True)

    def _search(
        self, body: Body, watched: Watched, predicted: PoseBelief, explanation: Explanation, seen: Observation
    ) -> Watched:
        """Limbs found again from uncovered skin; a search that finds nothing waits longer before the next."""
        config = self.run.config.registration
        search = search_limbs(body, watched.registration, predicted, seen.evidence, config, seen.geodesics)
        if search.rounds:
            self.search_wait, self.search_pause = 0, SEARCH_PAUSE
        else:
            self.search_wait, self.search_pause = self.search_pause, min(2 * self.search_pause, LONGEST_PAUSE)
            self.left_uncovered_m2 = explanation.uncovered_m2
        rivals = tuple(Rival(belief, lag) for belief, lag in search.ties)
        return Watched(search.registration, watched.moved or search.rounds > 0, rivals)

    def _claim(
        self,
        body: Body,
        limbs: Sequence[Chain],
        watched: Watched,
        predicted: PoseBelief,
        explanation: Explanation,
        window: Window,
        observe: Observe,
    ) -> Watched:
        """A limb that was among other people's pixels, which then are the patient's."""
        seen, self.claim_wait = window[1], self.claim_pause
        claim = claim_limb(body, limbs, watched.registration, predicted, explanation, seen, self.run)
        if claim is None:
            self.claim_pause = LONGEST_CLAIM_PAUSE
            return watched
        self.claim_wait = self.claim_pause = SEARCH_PAUSE
        window.replace_next(observe(relabelled(seen, claim.views, window[0], self.run), claim.uncertain.pose))
        config = self.run.config.registration
        again = register(body, claim.uncertain, window[1].evidence, no_constraints(), config)
        return replace(watched, registration=again if again.found else watched.registration, moved=True)

    def _uncross(self, body: Body, watched: Watched, predicted: PoseBelief, seen: Observation) -> Watched:
        """The legs exchanged where they are crossed and the frame is explained better so."""
        config, found = self.run.config.registration, watched.registration
        pose = exchange_crossed_legs(body, found.belief.pose)
        if pose is None:
            return watched
        other = register(body, predicted.later(pose, UNSEEN_S), seen.evidence, no_constraints(), config)
        better = cheaper(body, found, other, seen, self.run)
        return watched if better is found else replace(watched, registration=better, moved=True)


def explained_by(body: Body, found: Registration, seen: Observation) -> Explanation:
    """How well a registered pose explains a frame."""
    return explain(body.points, pose_points(body, found.belief.pose), seen.evidence)


def is_doubtful(body: Body, found: Registration, explanation: Explanation, seen: Observation) -> bool:
    """Whether the frame shows that a limb may be elsewhere: by skin that nothing covers, or by an anchor."""
    if needs_search(explanation, bool(hidden_limbs(body, explanation))):
        return True
    return bool(contradicted_by(body, found.belief.pose, seen.anchors, ELSEWHERE_M)[LIMB_ENDS].any())


def cheaper(body: Body, one: Registration, other: Registration, seen: Observation, run: Run) -> Registration:
    """Which of two registrations explains the frame better; the first where they do so equally."""
    if not (one.found and other.found):
        return other if other.found else one
    config = run.config.registration
    costs = [
        evidence_cost(body, tried.belief.pose, seen.evidence, config.reaches_m[-1], config) for tried in (one, other)
    ]
    return other if costs[1] < costs[0] else one
