"""One patient followed through time: predict, associate, register, frame by frame (paper, Section IV)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from anchorpose.association.matcher import Matcher
from anchorpose.body.body_map import map_body
from anchorpose.body.constraints import place_constraints
from anchorpose.body.corrected_joints import contradicted, doubted, with_told
from anchorpose.body.evidence import Evidence, evidence_cost
from anchorpose.body.initial import anchor_points
from anchorpose.body.inverse_kinematics import pose_from_joints, uncrossed
from anchorpose.body.part_registration import joints_of_parts
from anchorpose.body.pose import Pose
from anchorpose.body.registration import PoseBelief, Registration, posterior, register
from anchorpose.body.skin_points import FittedShape, body_points, build_body, pose_points
from anchorpose.body.uncertainty import skin_sigma
from anchorpose.recording.recording import FrameSet
from anchorpose.surface.surface import ExpectedSkin
from anchorpose.tracker.association import (
    Associate,
    GlobalHypothesis,
    global_hypothesis,
    held_by,
    link,
    part_motion,
    parts_by_icp,
)
from anchorpose.tracker.config import Method, TrackConfig
from anchorpose.tracker.estimate import Estimate, estimate_of
from anchorpose.tracker.observation import Expectation, Observation, observe, observe_again
from anchorpose.tracker.room import Room
from anchorpose.tracker.standing_feet import StandingFeet
from anchorpose.tracker.start import Start
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracking.joint_motion import predict_joints
from anchorpose.tracking.motion_database import MotionDatabase

NOTHING_HELD = place_constraints(np.zeros(0, np.int64), np.zeros((0, 3)), 1.0, 1.0)  # pairs and anchors go by the legs


class PatientTracker:
    """The patient from a start on. The window holds the frame last registered and up to ``look_ahead`` later ones."""

    def __init__(
        self, room: Room, start: Start, motions: MotionDatabase | None, config: TrackConfig, watch: Stopwatch,
        associate: Associate = link,
    ) -> None:  # fmt: skip
        self.watch, self.associate = watch, associate
        self.room, self.config, self.motions = room, config, motions
        self.points = body_points()
        self.wear(start.shape)
        self.history: deque[np.ndarray] = deque(maxlen=config.follow.history)
        self.belief = self._corrected(start.belief, start.observation)
        self.history.append(self.body.joints(self.belief.pose))
        self.window: deque[Observation] = deque([start.observation])
        self.links: deque[Matcher] = deque()
        self.ahead: list[Pose] = []
        self.unseen_s, self.unseen_frames = 0.0, 0
        self.last_found = start.observation
        self.search_wait = 0  # frames until arms may be searched for again
        self.feet = StandingFeet(self.points, config.standing)
        self.first = self._remember(self._estimate(Registration(self.belief, start.explained, True), start.observation))

    @property
    def height_m(self) -> float:
        """Standing height of the learnt body."""
        return float(np.ptp(self.body.mesh.vertices[:, 1]))

    def wear(self, shape: FittedShape) -> None:
        """Go on with this shape, and all that depends on it."""
        self.shape = shape
        self.body = build_body(self.points, shape)
        self.map = map_body(self.body)

    def push(self, frame_set: FrameSet) -> Iterator[Estimate]:
        """Take one more frame; yields the estimate of the frame that now has enough look-ahead."""
        self.take(frame_set)
        if len(self.window) > self.config.follow.look_ahead:
            yield self._advance()

    def take(self, frame_set: FrameSet) -> None:
        """Look at one more frame of the look-ahead and link it with the last."""
        expected = self._expect(len(self.window))
        seen = observe(frame_set, self.room, expected, self.window[-1], self.height_m, self.config, self.watch)
        with self.watch.stage("association"):
            self.links.append(self.associate(self.window[-1], seen, self.config))
        self.window.append(seen)

    def next_hypothesis(self) -> GlobalHypothesis | None:
        """What the registration of the next frame will start from; None without a next frame that shows the patient."""
        if len(self.window) < 2:
            return None
        poses = self._look_ahead()
        return self._hypothesise(poses) if len(self.window[1].surface) else None

    def finish(self) -> Iterator[Estimate]:
        """The estimates of the frames still in the window, with what look-ahead is left."""
        while len(self.window) > 1:
            yield self._advance()

    def _estimate(
        self, registration: Registration, seen: Observation, hypothesis: GlobalHypothesis | None = None
    ) -> Estimate:
        share = None if hypothesis is None else hypothesis.matched_share
        with self.watch.stage("states and sigma"):
            told = self.room.review.joints.get(seen.frame_set.frame)
            if told is not None and contradicted(self.body, registration.belief, told):
                told = None
            return estimate_of(self.body, registration, seen, share, self.config, told)

    def _remember(self, estimate: Estimate) -> Estimate:
        """What the next frames need to know of this one beside the pose; returns the estimate."""
        with self.watch.stage("states and sigma"):
            posed = pose_points(self.body, self.belief.pose)
            self.skin_sigma_m = skin_sigma(self.body, posed, self.belief.covariance, self.config.uncertainty)
            time_s = estimate.frame_set.time_s
            self.feet.note(posed.points_m, estimate.joints_m, estimate.states, time_s)
            told = self.room.review.joints.get(estimate.frame_set.frame)
            if told is not None:
                self.feet.forget(told.joint.tolist())
        return estimate

    def predict(self, steps: int) -> list[Pose]:
        """The next poses by scaled motion dynamics: those of the whole look-ahead, once a registered frame."""
        with self.watch.stage("prediction"):
            if not self.ahead:
                config = self.config
                joints = predict_joints(
                    np.array(self.history), config.follow.look_ahead, self.motions, config.motion
                ).joints_m
                pose = self.belief.pose
                for joints_m in joints:
                    pose = pose_from_joints(self.body, pose, joints_m, config.registration.fit)
                    self.ahead.append(pose)
        return self.ahead[:steps]

    def _look_ahead(self) -> list[Pose]:
        """Predicted poses of the window's later frames; the next one is looked at again where that may change it.

        Its pose is now predicted from the frame before. Where the patient is expected at another place than when the
        frame came in, he is told apart from others anew, and his surface is made anew.
        """
        poses = self.predict(len(self.window) - 1)
        expected, before = self.expectation(poses[0]), self.window[1].expected
        if before is None or _apart_m(expected, before) > self.config.follow.see_again_m:
            self._see_again(expected)
        return poses

    def _see_again(self, expected: Expectation) -> None:
        now, config = self.window[0], self.config
        seen = observe_again(self.window[1], self.room, expected, now, self.height_m, config, self.watch)
        self.window[1] = seen
        with self.watch.stage("association"):
            self.links[0] = self.associate(now, seen, config)
            if len(self.window) > 2:
                self.links[1] = self.associate(seen, self.window[2], config)

    def _expect(self, steps: int) -> Expectation:
        return self.expectation(self.predict(steps)[-1])

    def expectation(self, pose: Pose) -> Expectation:
        """What a frame should show in which the patient has this pose."""
        posed = pose_points(self.body, pose)
        trunk = posed.transforms[self.points.asset.bone("Spine1"), :3, 0]
        level = np.array([trunk[0], 0.0, trunk[2]])
        skin = ExpectedSkin(posed.points_m.astype(np.float32), posed.normals.astype(np.float32), self.map)
        return Expectation(
            skin,
            self.skin_sigma_m,
            posed.points_m[anchor_points(self.points.asset, self.points)],
            level / max(float(np.linalg.norm(level)), 1e-9),
            self.unseen_frames,
        )

    def _advance(self) -> Estimate:
        """Register the second frame of the window and make it the first."""
        elapsed_s = abs(self.window[1].frame_set.time_s - self.window[0].frame_set.time_s)
        poses = self._look_ahead()
        following = self.window[1]
        predicted = self.belief.later(poses[0], elapsed_s, self.config.registration.fit)
        hypothesis = self._hypothesise(poses) if len(following.surface) else None
        if hypothesis is not None:
            with self.watch.stage("registration"):
                registration = self._register(hypothesis, list(self.window), poses, predicted)
        else:
            registration = Registration(predicted, 0.0, False)
        self.unseen_s = 0.0 if registration.found else self.unseen_s + elapsed_s
        self.unseen_frames = 0 if registration.found else self.unseen_frames + 1
        self.last_found = following if registration.found else self.last_found
        registration = replace(registration, belief=self._corrected(registration.belief, following))
        self.belief, self.ahead = registration.belief, []
        self.history.append(self.body.joints(self.belief.pose))
        self.window.popleft()
        self.links.popleft()
        return self._remember(self._estimate(registration, following, hypothesis))

    def _corrected(self, belief: PoseBelief, seen: Observation) -> PoseBelief:
        """The belief by what a reviewer said of this frame's joints, if he did.

        Where he contradicts it, what was seen was taken for the wrong limb: then it says less than he, and the limbs'
        movement so far was somebody else's. A place that the body cannot reach is not believed.
        """
        told, fit = self.room.review.joints.get(seen.frame_set.frame), self.config.registration.fit
        if told is None:
            return belief
        wrong = contradicted(self.body, belief, told)
        open_minded = doubted(belief, told, self.config.registration.restart_doubt_s, fit) if wrong else belief
        corrected = with_told(self.body, open_minded, told, fit, self.config.uncertainty.inflation)
        if contradicted(self.body, corrected, told):
            return belief
        if wrong:
            self.history.clear()
        return corrected

    def _hypothesise(self, poses: list[Pose]) -> GlobalHypothesis:
        with self.watch.stage("association"):
            return global_hypothesis(
                self.body, self.belief.pose, poses, list(self.window), list(self.links), self.config
            )

    def _register(
        self, hypothesis: GlobalHypothesis, window: list[Observation], poses: list[Pose], predicted: PoseBelief
    ) -> Registration:
        config = self.config
        now = pose_points(self.body, self.belief.pose)
        T_predicted = part_motion(now.transforms, pose_points(self.body, poses[0]).transforms)
        evidence = window[1].evidence
        if config.method is Method.ARTICULATED:
            held = held_by(self.points, now, hypothesis, window, T_predicted)
            found = register(
                self.body,
                predicted,
                evidence,
                held,
                config.registration,
                self.search_wait == 0,
                self.feet.rows(window[1].frame_set.time_s),
            )
            self.search_wait = config.follow.search_pause if found.searched else max(0, self.search_wait - 1)
            return self._uncross(found, predicted, evidence) if found.found else found
        T_next_now = parts_by_icp(now, hypothesis, window, T_predicted, config)
        joints = joints_of_parts(self.points.asset, self.body.mesh, T_next_now @ now.transforms)
        pose = pose_from_joints(self.body, poses[0], joints, config.registration.fit)
        return posterior(self.body, pose, predicted, evidence, config.registration)

    def _uncross(self, found: Registration, predicted: PoseBelief, evidence: Evidence) -> Registration:
        """The registration with the legs exchanged where they are crossed and the frame is explained better so."""
        config = self.config.registration
        pose = uncrossed(self.body, found.belief.pose, config.fit)
        if pose is None:
            return found
        doubted = predicted.later(pose, config.restart_doubt_s, config.fit)
        other = register(self.body, doubted, evidence, NOTHING_HELD, config, may_search=False)
        costs = [
            evidence_cost(
                self.body,
                tried.belief.pose,
                evidence,
                config.reaches_m[-1],
                config.constraints,
                config.fit,
            )
            for tried in (found, other)
        ]
        if not other.found or costs[1] >= costs[0]:
            return found
        self.history.clear()  # its legs moved as each other's
        return other


def _apart_m(one: Expectation, other: Expectation) -> float:
    """How far the skin is moved between two expectations, nine tenths of it less."""
    return float(np.quantile(np.linalg.norm(one.skin.points_m - other.skin.points_m, axis=1), 0.9))
