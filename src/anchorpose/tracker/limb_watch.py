"""Watch how well the pose explains each frame, and find limbs again: on uncovered skin or on other people's pixels.

A therapist who stands behind a patient's leg, or a person who walks past an arm, leaves pixels with a wrong label, and
a wrong label is remembered. Where a limb of the patient is nowhere seen, or lies on pixels that continue another
person, it is looked for on all skin of other people that their own bodies leave unexplained. It is claimed if it
explains the frame better there and continues the patient rather than the other person.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.belief import UNSEEN_S, PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import Explanation, explain, limb_of_points
from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.body.limb_proposals import CHAINS, REACH_SLACK_M, Chain, contradicted_by, end_points, reaching
from anchorpose.body.limb_search import LEAST_GAIN, MOST_UNUSUAL, TRIAL_NODES, Rival, needs_search, rarity, search_limbs
from anchorpose.body.pose import TRUNK, Pose
from anchorpose.body.pose_probability import log_probability, named_nats
from anchorpose.body.registration import Registration, descend, register
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.surface.surface import Nodes, join_nodes
from anchorpose.threads import each
from anchorpose.tracker.bystanders import COARSE, nodes_of_pixels
from anchorpose.tracker.continuity import limb_borders, relabelled_limb
from anchorpose.tracker.observation import Isolated, Observation
from anchorpose.tracker.observing import Window, relabelled
from anchorpose.tracker.room import Run

EXPLAINED_M: Final = 0.07  # from a bystander's rough body: clothes, and a body of ordinary shape
HIDDEN_SHARE: Final = 0.15  # a limb with less of its end's skin on seen nodes is nowhere seen
SEEN_SHARE: Final = 0.3  # an upper arm or thigh with so much skin on seen nodes says where elbow or knee is
PLACES: Final = 20  # where the end of a limb is tried, spread over the free skin in its reach
SHANK_SLACK_M: Final = 0.15  # of the end's distance from a known knee or elbow
MIDDLES: Final = 8  # where elbow or knee is tried: the end leaves a circle for it, in steps of a limb's width
MIDDLE_SLACK_M: Final = 0.10  # of the elbow's or knee's distance from shoulder or hip: skin, and a trunk that leans
REACHES_M: Final = (0.20, 0.15, 0.10, 0.07, 0.06)  # of each step from a tried place on: places are 0.2 m apart
ALONG_M: Final = 0.10  # free nodes so near the limb's skin are looked at
CLAIMED_M: Final = 0.06  # pixels so near it are the limb's
LEAST_COVERING: Final = 0.2  # share of the limb's end that must lie on free nodes: half of what one camera sees
LEAST_NODES: Final = 25  # of free skin on a limb: half a shank that one camera sees
REFINED: Final = 3  # of the places tried: registered once more with the free nodes near the limb as it lies then


@dataclass(frozen=True, slots=True, eq=False)
class Claim:
    """A limb found among other people's pixels: the pose, the belief it is to be judged by, and the new labels."""

    pose: Pose
    uncertain: PoseBelief
    views: tuple[View | None, ...]


def hidden_limbs(body: Body, explanation: Explanation) -> list[Chain]:
    """The limbs of whose end nothing is seen."""
    return [chain for chain in CHAINS if explanation.covering[end_points(body.points, chain)].mean() < HIDDEN_SHARE]


def limbs_in_doubt(body: Body, pose: Pose, explanation: Explanation, seen: Observation) -> list[Chain]:
    """The limbs that are nowhere seen, or that lie on pixels which continue another person."""
    views = seen.evidence.views
    if not any(view is not None and (view.labels >= PixelLabel.OTHER_PERSON).any() for view in views):
        return []
    borders, hidden = limb_borders(body, pose, seen.pieces, views), hidden_limbs(body, explanation)
    return [chain for chain in CHAINS if chain in hidden or borders[chain].doubtful]


def claim_limb(
    body: Body,
    limbs: Sequence[Chain],
    found: Registration,
    predicted: PoseBelief,
    explanation: Explanation,
    seen: Observation,
    run: Run,
) -> Claim | None:
    """The limb of those in doubt that other people's unexplained skin shows most of; None without one."""
    pose, config = found.belief.pose, run.config.registration
    free = _free_nodes(seen, run)
    if len(free) < LEAST_NODES:
        return None
    uncertain = predicted.later(predicted.pose, UNSEEN_S)
    trial = replace(config, reaches_m=REACHES_M, node_count=min(config.node_count, TRIAL_NODES))
    best, most = None, LEAST_GAIN
    trying = _Trying(body, pose, uncertain, _open_to(seen.evidence, free), free, trial)
    for chain in limbs:
        for tried, gain in trying.best_of(chain, _starts(body, pose, chain, explanation, free)):
            if gain <= most:
                break
            views = relabelled_limb(body, pose, tried, chain, seen)
            if views is not None:
                best, most = Claim(tried, replace(uncertain, pose=tried), views), gain
                break
    return best


@dataclass(frozen=True, slots=True, eq=False)
class _Trying:
    """What every trial of one frame needs."""

    body: Body
    pose: Pose
    uncertain: PoseBelief
    evidence: Evidence
    free: Nodes
    config: RegistrationConfig

    def best_of(self, chain: Chain, starts: Iterable[Pose]) -> list[tuple[Pose, float]]:
        """The poses that explain most when registered, and how much more, the best first; a few are refined."""
        tried = sorted(each(lambda start: self.settled(start, chain), starts), key=lambda one: -one[1])
        refined = [
            max((self.settled(pose, chain), (pose, gain)), key=lambda one: one[1]) for pose, gain in tried[:REFINED]
        ]
        return sorted(refined, key=lambda one: -one[1])

    def settled(self, start: Pose, chain: Chain) -> tuple[Pose, float]:
        """A pose registered, with the free nodes near the limb, and its ``gain_of``."""
        near = self._near(start, chain, 2.0 * ALONG_M)
        if len(near) < LEAST_NODES:
            return start, -np.inf
        evidence = _with_nodes(self.evidence, self.free, near)
        tried = descend(self.body, start, replace(self.uncertain, pose=start), evidence, self.config)
        return tried, self.gain_of(tried, chain)

    def gain_of(self, tried: Pose, chain: Chain) -> float:
        """How much more of the frame a pose explains than the present one.

        Both are compared where the free pixels may be the patient's, nats. -inf where too little of the limb lies on
        free nodes, or the limb would be bent as people hardly bend.
        """
        along = self._near(tried, chain, ALONG_M)
        if len(along) < LEAST_NODES or self._covering(tried, chain, along) < LEAST_COVERING:
            return -np.inf
        if rarity(self.body, tried) > rarity(self.body, self.pose) + MOST_UNUSUAL:
            return -np.inf
        before, after = (log_probability(self.body, pose, self.evidence) for pose in (self.pose, tried))
        return after - before

    def _near(self, pose: Pose, chain: Chain, within_m: float) -> np.ndarray:
        """Free nodes near the limb's end."""
        skin = cKDTree(pose_points(self.body, pose).points_m[end_points(self.body.points, chain)])
        away, _ = skin.query(self.free.points_m, distance_upper_bound=within_m)
        return np.flatnonzero(np.isfinite(away))

    def _covering(self, pose: Pose, chain: Chain, nodes: np.ndarray) -> float:
        """Share of the skin of the limb's end that lies on free nodes."""
        skin = pose_points(self.body, pose).points_m[end_points(self.body.points, chain)]
        away, _ = cKDTree(self.free.points_m[nodes]).query(skin, distance_upper_bound=CLAIMED_M)
        return float(np.isfinite(away).mean())


def _starts(body: Body, pose: Pose, chain: Chain, explanation: Explanation, free: Nodes) -> Iterator[Pose]:
    """Poses with the limb's end, or its elbow or knee, on free skin, spread over all that each can reach."""
    joints = body.joints(pose)
    end, middle, root = (joints[JOINT_INDEX[name]] for name in (chain.joints[1], chain.joints[2], chain.root))
    upper_m, lower_m = float(np.linalg.norm(middle - root)), float(np.linalg.norm(end - middle))
    points = free.points_m.astype(np.float64)
    away = np.linalg.norm(points - root, axis=1)
    possible = away < upper_m + lower_m + REACH_SLACK_M
    upper = np.setdiff1d(end_points(body.points, chain, whole=True), end_points(body.points, chain))
    if explanation.covering[upper].mean() >= SEEN_SHARE:
        possible &= np.abs(np.linalg.norm(points - middle, axis=1) - lower_m) < SHANK_SLACK_M
    for place in spread_out(points[possible], PLACES):
        yield reaching(body, pose, chain, place)
    near_middle = (np.abs(away - upper_m) < MIDDLE_SLACK_M) & (
        np.abs(np.linalg.norm(points - end, axis=1) - lower_m) < SHANK_SLACK_M
    )
    for place in spread_out(points[near_middle], MIDDLES):
        yield bent_at(body, pose, chain, place)


def bent_at(body: Body, pose: Pose, chain: Chain, place_m: np.ndarray) -> Pose:
    """The pose with the elbow or knee of one limb at a place (3,), and the limb's end where it is."""
    wanted = body.joints(pose)
    wanted[JOINT_INDEX[chain.joints[2]]] = place_m
    for _ in range(4):
        pose = pose_from_joints(body, pose, wanted)
    return pose


def spread_out(points_m: np.ndarray, count: int) -> np.ndarray:
    """(k, 3) up to ``count`` of the points (n, 3), each as far as possible from those before."""
    chosen = list[np.ndarray]()
    away = np.full(len(points_m), np.inf)
    while len(chosen) < min(count, len(points_m)):
        chosen.append(points_m[0] if not chosen else points_m[int(np.argmax(away))])
        away = np.minimum(away, np.linalg.norm(points_m - chosen[-1], axis=1))
    return np.array(chosen).reshape(-1, 3)


def _free_nodes(seen: Observation, run: Run) -> Nodes:
    """Nodes of other people's pixels that no trunk or head of theirs explains."""
    views, cameras = seen.evidence.views, run.room.cameras
    masks = [None if view is None else view.labels >= PixelLabel.OTHER_PERSON for view in views]
    surface = nodes_of_pixels([None if view is None else view.depth_m for view in views], masks, cameras)
    label = np.zeros(len(surface), np.uint8)
    for number, view in enumerate(views):
        if view is not None:
            mine = surface.camera == number
            row, column = surface.pixel[mine].T
            label[mine] = view.labels[row, column]
    kept = np.ones(len(surface), dtype=bool)
    for one in seen.bystanders.followed:
        mine = np.flatnonzero(label == one.label)
        if len(mine):
            skin = pose_points(one.body, one.belief.pose).points_m
            _, nearest = cKDTree(skin).query(surface.points_m[mine], distance_upper_bound=EXPLAINED_M)
            kept[mine[np.append(limb_of_points(one.body.points), -1)[nearest] == TRUNK]] = False
    return surface.take(kept)


def _open_to(evidence: Evidence, free: Nodes) -> Evidence:
    """The evidence with pixels and outlines in which the patient may also be where skin is free."""
    outlines, views = list(evidence.outlines), list(evidence.views)
    for number, (outline, view) in enumerate(zip(evidence.outlines, evidence.views, strict=True)):
        if view is None:
            continue
        row, column = free.pixel[free.camera == number].T.astype(np.int64)
        height, width = view.labels.shape
        opened = np.zeros((height, width), dtype=bool)
        for d_r in range(COARSE.step):
            for d_c in range(COARSE.step):
                opened[np.minimum(row + d_r, height - 1), np.minimum(column + d_c, width - 1)] = True
        outlines[number] = None if outline is None else outline | opened
        others = opened & (view.labels >= PixelLabel.OTHER_PERSON)
        views[number] = View(view.depth_m, np.where(others, np.uint8(PixelLabel.PATIENT), view.labels))
    return replace(evidence, outlines=tuple(outlines), views=tuple(views))


def _with_nodes(evidence: Evidence, free: Nodes, nodes: np.ndarray) -> Evidence:
    """The evidence with some of the free nodes beside the patient's."""
    return replace(evidence, surface=join_nodes([evidence.surface, free.take(nodes)]))


SEARCH_PAUSE, LONGEST_PAUSE = 4, 16  # frames between searches that find nothing, each as long as three frames
NAMED_PAUSE: Final = 8  # frames between looks at the descriptor's places, each as long as a tenth of a frame
MISNAMED: Final = -1.0  # nats of a limb: of 119 frames of real and simulated people rightly tracked, one of 50 has less
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
    named_wait: int

    def __init__(self, run: Run) -> None:
        self.run = run
        self.search_wait, self.search_pause = 0, SEARCH_PAUSE  # frames until the next search for limbs
        self.left_uncovered_m2 = 0.0  # by the last search that found nothing: much more is worth another one
        self.claim_wait, self.claim_pause = 0, SEARCH_PAUSE  # the same of limbs among other people's pixels
        self.named_wait = 0  # frames until the descriptor is asked again whether it names the limbs as the pose does

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
        if not waiting and (is_doubtful(body, found, explanation, window[1]) or self._misnamed(body, found, window[1])):
            watched = self._search(body, watched, predicted, explanation, window[1])
            explanation = explained_by(body, watched.registration, window[1])
        if self.claim_wait < 0:
            limbs = limbs_in_doubt(body, watched.registration.belief.pose, explanation, window[1])
            if limbs:
                watched = self._claim(body, limbs, watched, predicted, explanation, window, observe)
        return watched

    def _misnamed(self, body: Body, found: Registration, seen: Observation) -> bool:
        """Whether the descriptor names a limb's skin otherwise than the pose does; asked now and then."""
        self.named_wait -= 1
        if self.named_wait >= 0:
            return False
        self.named_wait = NAMED_PAUSE
        return bool(named_nats(body, found.belief.pose, seen.evidence).sum(axis=1).min() < MISNAMED)

    def look_for_whole(self, body: Body, lost: Registration, predicted: PoseBelief, seen: Observation) -> Watched:
        """A body that explains nothing where it is expected may be turned round, or have other limbs."""
        self.search_wait -= 1
        config = self.run.config.registration
        if self.search_wait >= 0 or len(seen.surface) < config.least_nodes:
            return Watched(lost)
        assumed = replace(lost, belief=predicted, found=True)
        search = search_limbs(body, assumed, predicted, seen.evidence, config, seen.seen_anchors)
        if not search.rounds:
            self.search_wait = SEARCH_PAUSE
            return Watched(lost)
        return Watched(search.registration, moved=True)

    def _search(
        self, body: Body, watched: Watched, predicted: PoseBelief, explanation: Explanation, seen: Observation
    ) -> Watched:
        """Limbs found again from uncovered skin; a search that finds nothing waits longer before the next."""
        config = self.run.config.registration
        search = search_limbs(body, watched.registration, predicted, seen.evidence, config, seen.seen_anchors)
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


def explained_by(body: Body, found: Registration, seen: Observation) -> Explanation:
    """How well a registered pose explains a frame."""
    return explain(body.points, pose_points(body, found.belief.pose), seen.evidence)


def is_doubtful(body: Body, found: Registration, explanation: Explanation, seen: Observation) -> bool:
    """Whether the frame shows that a limb may be elsewhere: by skin that nothing covers, or by an anchor."""
    if needs_search(explanation, bool(hidden_limbs(body, explanation))):
        return True
    return bool(contradicted_by(body, found.belief.pose, seen.anchors, ELSEWHERE_M)[LIMB_ENDS].any())
