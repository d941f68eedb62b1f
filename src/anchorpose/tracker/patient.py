"""One patient followed through time: predict, associate, register, frame by frame (paper, Section IV)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.association.hypotheses import Matcher
from anchorpose.body.belief import UNSEEN_S, PoseBelief
from anchorpose.body.body_map import map_body
from anchorpose.body.constraints import place_constraints
from anchorpose.body.evidence import Evidence, evidence_cost
from anchorpose.body.explained import Explanation, explain
from anchorpose.body.initial import anchor_points
from anchorpose.body.inverse_kinematics import (
    CorrectedJoints,
    apply_corrections,
    contradicted,
    exchange_crossed_legs,
    pose_from_joints,
    relax_limbs,
)
from anchorpose.body.limb_search import needs_search, search_limbs
from anchorpose.body.part_registration import ITERATIONS, joints_of_parts
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration, posterior, register
from anchorpose.body.skin_points import FittedShape, body_points, build_body, pose_points
from anchorpose.body.uncertainty import skin_sigma
from anchorpose.geodesics.seen import SeenGeodesics
from anchorpose.recording.recording import FrameSet
from anchorpose.surface.surface import ExpectedSkin
from anchorpose.tracker.association import (
    GlobalHypothesis,
    global_hypothesis,
    held_by,
    link,
    part_motion,
    parts_by_icp,
)
from anchorpose.tracker.claims import claim_limb, hidden_limbs
from anchorpose.tracker.config import Method
from anchorpose.tracker.estimate import Estimate, estimate_of
from anchorpose.tracker.observation import (
    Expectation,
    Observation,
    gather,
    isolate,
    isolate_again,
    observe,
    relabelled,
    see_anchors,
    see_surface,
)
from anchorpose.tracker.rivals import Rival, follow_rivals
from anchorpose.tracker.run import Run
from anchorpose.tracker.standing_feet import StandingFeet
from anchorpose.tracker.start import Start
from anchorpose.tracking.motion import predict_joints

SEE_AGAIN_M: Final = 0.03  # skin expected this far from where it was when the frame came in: half a forearm's width
SEARCH_PAUSE, LONGEST_PAUSE = 4, 16  # frames between searches that find nothing, each as long as three frames
MORE: Final = 1.5  # times the uncovered area that a search left: so much more is worth another search at once
NOTHING_HELD = place_constraints(np.zeros(0, np.int64), np.zeros((0, 3)), 1.0, 1.0)  # pairs and anchors go by the legs


class PatientTracker:
    """The patient from a start on. The window holds the frame last registered and up to ``look_ahead`` later ones."""

    def __init__(self, run: Run, start: Start) -> None:
        self.run, self.config = run, run.config
        self.associate = run.associate or link
        self.points = body_points()
        self.use_shape(start.shape)
        self.history: deque[np.ndarray] = deque(maxlen=self.config.follow.history)
        self.belief = self._corrected(start.belief, start.observation)
        self.history.append(self.body.joints(self.belief.pose))
        self.window: deque[Observation] = deque([start.observation])
        self.links: deque[Matcher] = deque()
        self.ahead: list[Pose] = []
        self.unseen_s, self.unseen_frames = 0.0, 0
        self.last_found = start.observation
        self.search_wait, self.search_pause = 0, SEARCH_PAUSE  # frames until the next search for limbs
        self.left_uncovered_m2 = 0.0  # by the last search that found nothing: much more than that is worth another one
        self.claim_wait = 0  # frames until limbs may be looked for among other people's pixels
        self.rivals: tuple[Rival, ...] = ()  # poses that explain the last frames almost as well
        self.feet = StandingFeet(self.points)
        self.first = self._estimate(Registration(self.belief, start.explained, True), start.observation, None)

    def step(self, frame_set: FrameSet | None, only_look: bool = False) -> Estimate | None:
        """One frame of the method (paper, Section IV).

        frame_set: the next frame, None when no more come; only_look: it only joins the look-ahead. Returns the estimate
        of the first frame after the last estimated one, once its whole look-ahead is in the window; else None.
        """
        if frame_set is not None:
            # predict: scaled motion dynamics say where the body will be (Section IV-C)
            expected = self.expect(self.predict(len(self.window))[-1])
            # isolate: which pixels are the patient's, which are others', the equipment's and the room's
            isolated = isolate(frame_set, expected, self.window[-1], self.run)
            # surface: one mesh of all cameras, cut where the body touches itself, closed where it is hidden
            surface = see_surface(isolated, expected, self.run)
            # anchors: head, hands and feet; every node's geodesic distance to them is its descriptor (Definition 3)
            anchors, descriptor = see_anchors(surface, expected, self.height_m, self.run)
            seen = gather(frame_set, expected, isolated, surface, anchors, descriptor)
            # link: for every subset of anchors, the node of this frame that each node of the last one matches
            self._link(self.window[-1], seen)
            self.window.append(seen)
        enough = 2 if frame_set is None else 1 + self.config.follow.look_ahead
        if only_look or len(self.window) < enough:
            return None
        # the second frame of the window is estimated now, by a prediction from the frame before it
        poses, elapsed_s = self._look_ahead(), self._elapsed_s()
        # tree: the chain of hypotheses over the look-ahead that agrees best with the prediction (Section IV-D)
        hypothesis = self._search_tree(poses)
        # register: the body, all parts at once, to the tree's matches and to all that is seen of the patient
        registration = self._register(hypothesis, poses, elapsed_s)
        # estimate: joints by the rule J, their states and their uncertainty
        following = self._move_on(registration, elapsed_s)
        return self._estimate(replace(registration, belief=self.belief), following, hypothesis)

    def finish(self) -> Iterator[Estimate]:
        """The estimates of the frames still in the window, with what look-ahead is left."""
        while (estimate := self.step(None)) is not None:
            yield estimate

    @property
    def height_m(self) -> float:
        """Standing height of the learnt body."""
        return float(np.ptp(self.body.mesh.vertices[:, 1]))

    def use_shape(self, shape: FittedShape) -> None:
        """Go on with this shape, and all that depends on it."""
        self.shape = shape
        self.body = build_body(self.points, shape)
        self.map = map_body(self.body)

    def _elapsed_s(self) -> float:
        return abs(self.window[1].frame_set.time_s - self.window[0].frame_set.time_s)

    def _link(self, now: Observation, following: Observation) -> None:
        with self.run.stage("association"):
            self.links.append(self.associate(now, following, self.config))

    def next_hypothesis(self) -> GlobalHypothesis | None:
        """What the registration of the next frame will start from; None without a next frame that shows the patient."""
        return None if len(self.window) < 2 else self._search_tree(self._look_ahead())

    def _estimate(self, registration: Registration, seen: Observation, hypothesis: GlobalHypothesis | None) -> Estimate:
        """The estimate of a frame; notes of it what the next frames need besides the pose."""
        share = None if hypothesis is None else hypothesis.matched_share
        corrected = self._corrections(seen)
        with self.run.stage("states and sigma"):
            honoured = corrected
            if corrected is not None and contradicted(self.body, registration.belief, corrected):
                honoured = None
            estimate = estimate_of(self.body, registration, seen, share, self.config, honoured, self.rivals)
            posed = pose_points(self.body, self.belief.pose)
            self.skin_sigma_m = skin_sigma(self.body, posed, self.belief.covariance, self.config.uncertainty)
            self.feet.note(posed.points_m, estimate.joints_m, estimate.states, estimate.frame_set.time_s)
            if corrected is not None:
                self.feet.forget(corrected.joint.tolist())
        return estimate

    def _corrections(self, seen: Observation) -> CorrectedJoints | None:
        """Joints of this frame that a reviewer corrected."""
        return self.run.room.review.joints.get(seen.frame_set.frame)

    def predict(self, steps: int) -> list[Pose]:
        """The next poses by scaled motion dynamics: those of the whole look-ahead, once a registered frame."""
        with self.run.stage("prediction"):
            if not self.ahead:
                config = self.config
                joints = predict_joints(
                    np.array(self.history), config.follow.look_ahead, self.run.motions, config.motion
                ).joints_m
                pose = self.belief.pose
                for joints_m in joints:
                    pose = pose_from_joints(self.body, pose, joints_m)
                    self.ahead.append(pose)
        return self.ahead[:steps]

    def _look_ahead(self) -> list[Pose]:
        """Predicted poses of the window's later frames; the next frame is observed again where that may change it.

        Its pose is now predicted from the frame before. Where the patient is expected at another place than when the
        frame came in, the people are separated again, and the patient's surface is built again.
        """
        poses = self.predict(len(self.window) - 1)
        expected, before = self.expect(poses[0]), self.window[1].expected
        if before is None or _apart_m(expected, before) > SEE_AGAIN_M:
            self._see_again(expected)
        return poses

    def _see_again(self, expected: Expectation) -> None:
        now = self.window[0]
        isolated = isolate_again(self.window[1], expected, now, self.run)
        self._replace_next(observe(self.window[1].frame_set, isolated, expected, self.height_m, self.run))

    def _replace_next(self, seen: Observation) -> None:
        """Another observation of the next frame, linked to those before and after it."""
        now, self.window[1] = self.window[0], seen
        with self.run.stage("association"):
            self.links[0] = self.associate(now, seen, self.config)
            if len(self.window) > 2:
                self.links[1] = self.associate(seen, self.window[2], self.config)

    def expect(self, pose: Pose) -> Expectation:
        """What a frame should show in which the patient has this pose."""
        posed = pose_points(self.body, pose)
        trunk = posed.transforms[self.points.asset.bone("Spine1"), :3, 0]
        level = np.array([trunk[0], 0.0, trunk[2]])
        skin = ExpectedSkin(posed.points_m.astype(np.float32), posed.normals.astype(np.float32), self.map)
        return Expectation(
            skin,
            self.skin_sigma_m,
            posed.points_m[anchor_points(self.points)],
            level / max(float(np.linalg.norm(level)), 1e-9),
            self.unseen_frames,
        )

    def _move_on(self, registration: Registration, elapsed_s: float) -> Observation:
        """Make the second frame of the window the first, with the registered pose; returns it."""
        following = self.window[1]
        self.unseen_s = 0.0 if registration.found else self.unseen_s + elapsed_s
        self.unseen_frames = 0 if registration.found else self.unseen_frames + 1
        self.last_found = following if registration.found else self.last_found
        self.belief, self.ahead = self._corrected(registration.belief, following), []
        self.history.append(self.body.joints(self.belief.pose))
        self.window.popleft()
        self.links.popleft()
        return following

    def _corrected(self, belief: PoseBelief, seen: Observation) -> PoseBelief:
        """The belief with a reviewer's corrections of this frame's joints, if there are any.

        Where they contradict it, the evidence was attributed to the wrong limb: the corrections then count for more,
        and the movement so far is forgotten. A place that the body cannot reach is not believed.
        """
        given = self._corrections(seen)
        if given is None:
            return belief
        wrong = contradicted(self.body, belief, given)
        relaxed = relax_limbs(belief, given, UNSEEN_S) if wrong else belief
        corrected = apply_corrections(self.body, relaxed, given, self.config.uncertainty.inflation)
        if contradicted(self.body, corrected, given):
            return belief
        if wrong:
            self.history.clear()
        return corrected

    def _search_tree(self, poses: list[Pose]) -> GlobalHypothesis | None:
        """The best branch; None where the frame shows nothing of the patient."""
        if not len(self.window[1].surface):
            return None
        with self.run.stage("association"):
            return global_hypothesis(
                self.body, self.belief.pose, poses, list(self.window), list(self.links), self.config
            )

    def _register(self, hypothesis: GlobalHypothesis | None, poses: list[Pose], elapsed_s: float) -> Registration:
        """The pose of the second frame of the window; the predicted one where nothing is seen."""
        predicted = self.belief.later(poses[0], elapsed_s)
        if hypothesis is None:
            return Registration(predicted, 0.0, False)
        with self.run.stage("registration"):
            if self.config.method is not Method.ARTICULATED:
                return self._register_parts(hypothesis, poses[0], predicted)
            return self._register_body(hypothesis, poses[0], predicted)

    def _register_body(self, hypothesis: GlobalHypothesis, pose: Pose, predicted: PoseBelief) -> Registration:
        """All parts at once, joined, on the learnt body."""
        config, following = self.config, self.window[1]
        now = pose_points(self.body, self.belief.pose)
        T_predicted = part_motion(now.transforms, pose_points(self.body, pose).transforms)
        held = held_by(self.points, now, hypothesis, list(self.window), T_predicted)
        feet = self.feet.rows(following.frame_set.time_s)
        found = register(self.body, predicted, following.evidence, held, config.registration, feet)
        if not found.found:
            return self._search_whole(found, predicted, following.evidence)
        best, self.rivals = follow_rivals(
            self.body, found, self.rivals, following.evidence, self._elapsed_s(), config.registration
        )
        if best is not found:
            self.history.clear()  # another pose took its place
        return self._look_for_limbs(best, predicted, following.evidence)

    def _look_for_limbs(self, found: Registration, predicted: PoseBelief, evidence: Evidence) -> Registration:
        """The registration, with limbs searched for where it leaves seen skin uncovered, or a limb is nowhere seen."""
        self.search_wait, self.claim_wait = self.search_wait - 1, self.claim_wait - 1
        explanation = explain(self.points, pose_points(self.body, found.belief.pose), evidence)
        waiting = self.search_wait >= 0 and explanation.uncovered_m2 < MORE * self.left_uncovered_m2
        hidden = bool(hidden_limbs(self.body, explanation))
        if needs_search(explanation, hidden) and not waiting:
            found = self._search(found, predicted, explanation)
            explanation = explain(self.points, pose_points(self.body, found.belief.pose), evidence)
        if self.claim_wait < 0 and hidden_limbs(self.body, explanation):
            found = self._claim(found, predicted, explanation)
        return self._uncross(found, predicted, self.window[1].evidence)

    def _search_whole(self, lost: Registration, predicted: PoseBelief, evidence: Evidence) -> Registration:
        """A body that explains nothing where it is expected may be turned round, or have other limbs."""
        self.search_wait -= 1
        if self.search_wait >= 0 or len(evidence.surface) < self.config.registration.least_nodes:
            return lost
        assumed = replace(lost, belief=predicted, found=True)
        search = search_limbs(self.body, assumed, predicted, evidence, self.config.registration, self._seen())
        if not search.rounds:
            self.search_wait = SEARCH_PAUSE
            return lost
        self.history.clear()
        return search.registration

    def _seen(self) -> SeenGeodesics:
        """Anchors and distances of the frame that is estimated."""
        return SeenGeodesics(self.window[1].whole, self.window[1].anchors, self.window[1].descriptor)

    def _search(self, found: Registration, predicted: PoseBelief, explanation: Explanation) -> Registration:
        """Limbs found again from uncovered skin; a search that finds nothing waits longer before the next."""
        evidence, config = self.window[1].evidence, self.config.registration
        search = search_limbs(self.body, found, predicted, evidence, config, self._seen())
        self.rivals = tuple(Rival(belief, lag) for belief, lag in search.ties)
        if search.rounds:
            self.history.clear()  # the limbs moved as other ones
            self.search_wait, self.search_pause = 0, SEARCH_PAUSE
        else:
            self.search_wait, self.search_pause = self.search_pause, min(2 * self.search_pause, LONGEST_PAUSE)
            self.left_uncovered_m2 = explanation.uncovered_m2
        return search.registration

    def _claim(self, found: Registration, predicted: PoseBelief, explanation: Explanation) -> Registration:
        """The registration, with a limb that was among other people's pixels, which then are the patient's."""
        seen, self.claim_wait = self.window[1], SEARCH_PAUSE
        claim = claim_limb(self.body, found, predicted, explanation, seen, self.run)
        if claim is None:
            return found
        isolated = relabelled(seen, claim.views, self.window[0], self.run)
        self._replace_next(
            observe(seen.frame_set, isolated, self.expect(claim.uncertain.pose), self.height_m, self.run)
        )
        self.history.clear()
        again = register(self.body, claim.uncertain, self.window[1].evidence, NOTHING_HELD, self.config.registration)
        return again if again.found else found

    def _register_parts(self, hypothesis: GlobalHypothesis, pose: Pose, predicted: PoseBelief) -> Registration:
        """The paper's own way: every part by itself, from frame to frame."""
        config = self.config.registration
        now = pose_points(self.body, self.belief.pose)
        T_predicted = part_motion(now.transforms, pose_points(self.body, pose).transforms)
        iterations = 0 if self.config.method is Method.PAIRS else ITERATIONS
        T_next_now = parts_by_icp(now, hypothesis, list(self.window), T_predicted, iterations)
        joints = joints_of_parts(self.points.asset, self.body.mesh, T_next_now @ now.transforms)
        pose = pose_from_joints(self.body, pose, joints)
        return posterior(self.body, pose, predicted, self.window[1].evidence, config)

    def _uncross(self, found: Registration, predicted: PoseBelief, evidence: Evidence) -> Registration:
        """The registration with the legs exchanged where they are crossed and the frame is explained better so."""
        config = self.config.registration
        pose = exchange_crossed_legs(self.body, found.belief.pose)
        if pose is None:
            return found
        uncertain = predicted.later(pose, UNSEEN_S)
        other = register(self.body, uncertain, evidence, NOTHING_HELD, config)
        costs = [
            evidence_cost(self.body, tried.belief.pose, evidence, config.reaches_m[-1], config)
            for tried in (found, other)
        ]
        if not other.found or costs[1] >= costs[0]:
            return found
        self.history.clear()  # its legs moved as each other's
        return other


def _apart_m(one: Expectation, other: Expectation) -> float:
    """How far the skin is moved between two expectations, nine tenths of it less."""
    return float(np.quantile(np.linalg.norm(one.skin.points_m - other.skin.points_m, axis=1), 0.9))
