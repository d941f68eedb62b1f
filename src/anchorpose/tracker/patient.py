"""Follow one patient through time: predict, associate and register frame by frame (paper, Section V)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.body.belief import PATIENT_PACE, Pace, PoseBelief
from anchorpose.body.constraints import Constraints, anchor_points, no_constraints
from anchorpose.body.contact_regions import StandingFeet
from anchorpose.body.inverse_kinematics import (
    CorrectedJoints,
    apply_corrections,
    contradicted,
    pose_from_joints,
    relax_limbs,
)
from anchorpose.body.likelihood import likelihood
from anchorpose.body.pose import LIMB_OF_JOINTS, PARTS, SEGMENT_OF_JOINTS, Pose
from anchorpose.body.registration import Registration, posterior, register
from anchorpose.body.rivals import APART_M, Rival, follow_rivals, rivals_of
from anchorpose.body.skin_map import map_body
from anchorpose.body.skin_points import Body, FittedShape, SkinPoints, body_points, build_body, pose_points
from anchorpose.body.uncertainty import skin_sigma
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.motion.prediction import predict_joints
from anchorpose.recording.recording import FrameSet
from anchorpose.surface.surface import BodyMap, ExpectedSkin
from anchorpose.track_tree.global_hypothesis import GlobalHypothesis, held_by, joints_by_parts
from anchorpose.tracker.bystanders import WALKING
from anchorpose.tracker.config import Method, TrackConfig
from anchorpose.tracker.estimate import Earlier, Estimate, displaced, estimate_of
from anchorpose.tracker.limb_watch import LimbWatch, explained_by
from anchorpose.tracker.observation import Expectation, Observation, Start, is_described
from anchorpose.tracker.observing import Window, gather, isolate, see_anchors, see_surface
from anchorpose.tracker.room import Run
from anchorpose.tracker.scene_hypotheses import KnownPeople, likeliest_scene
from anchorpose.tracker.search import LastSeen, Search, seen_as_strip

# a patient is in view if at least this share of the joints is inside a camera's image
IN_VIEW: Final = 0.25
# m, half a forearm's width: maximum difference between the patient's predicted place with which a frame was observed
# (labelled and meshed), and a later prediction of this place. If the difference of the predicted places is larger, the
# frame is observed again
SEE_AGAIN_M: Final = 0.03


class PatientTracker:
    """The tracker of one patient. Its window holds the last registered frame and the look-ahead: up to ``look_ahead``
    later frames, which are read before the next pose is estimated.
    """

    run: Run
    config: TrackConfig
    points: SkinPoints
    shape: FittedShape
    body: Body
    map: BodyMap
    history: deque[np.ndarray]
    belief: PoseBelief
    window: Window
    ahead: list[Pose]  # predicted poses of the next frames
    joints_ahead: np.ndarray  # (t, 21, 3) m, predicted joints of the next frames
    pace: Pace
    last: LastSeen
    watch: LimbWatch
    rivals: tuple[Rival, ...]  # other poses that fit the last frames almost as well as the best pose
    turned: Rival | None  # the opposite facing in the first frame, as in ``Start``
    moved: bool  # whether limbs were found in another place than earlier frames suggested
    feet: StandingFeet
    ends: frozenset[int]  # joint numbers of hands and feet that were lost and not seen since then
    limb_seen_s: np.ndarray  # (PARTS, 2) s, when a limb's halves (split at elbow or knee) were last seen; NaN = never
    seen_sigma_m: np.ndarray  # (21,) m, sigma of each joint when its part was last seen; NaN = never
    skin_sigma_m: np.ndarray
    first: Estimate

    def __init__(self, run: Run, start: Start) -> None:
        self.run, self.config = run, run.config
        self.points = body_points()
        self.use_shape(start.shape)
        self.history = deque(maxlen=self.config.follow.history)
        self.belief = self._corrected(start.belief, start.observation)
        self.history.append(self.body.joints(self.belief.pose))
        self.window = Window(start.observation, run)
        self.ahead = []
        self.joints_ahead = np.empty((0, 0, 3))
        self.pace = PATIENT_PACE
        self.last = LastSeen(start.observation, start.belief)
        self.watch = LimbWatch(run)
        self.rivals, self.turned, self.moved = start.rivals, start.turned, False
        self.feet = StandingFeet(self.points)
        self.ends = frozenset()
        self.limb_seen_s = np.full((PARTS, 2), np.nan)
        self.seen_sigma_m = np.full(JOINT_COUNT, np.nan)
        self.first = self._estimate(Registration(self.belief, start.explained, True), start.observation, None)

    def step(self, frame_set: FrameSet | None, only_look: bool = False) -> Estimate | None:
        """Add a frame to the look-ahead, and track the next frame whose look-ahead is complete (paper, Section V).

        frame_set: the frame to add, None after the last frame; only_look: do not track. Frames are estimated in order.
        Returns the estimate of the tracked frame, None if no frame was tracked.
        """
        if not self._look(frame_set) or only_look:
            return None
        registration, following, hypothesis = self._advance()
        # estimate: joints of the posed body (the paper's rule J), their states and their uncertainty
        estimate = self._estimate(replace(registration, belief=self.belief), following, hypothesis)
        return replace(estimate, moved=self.moved)

    def _look(self, frame_set: FrameSet | None) -> bool:
        """Add a frame to the window; return whether the next frame to estimate has its whole look-ahead."""
        if frame_set is not None:
            self.window.append(frame_set)
        return len(self.window) >= (2 if frame_set is None else 1 + self.config.follow.look_ahead)

    def _advance(self) -> tuple[Registration, Observation, GlobalHypothesis | None]:
        """Register the body to the second frame of the window, and make this frame the first."""
        # predict, isolate, surface, anchors: observe the second frame of the window, which is estimated now
        poses, elapsed_s = self._observe_until(1), self._elapsed_s()
        # register: fit all parts of the body together to the patient's whole visible surface; search again for limbs
        # whose place does not fit the frame
        registration, hypothesis = self._register(poses, elapsed_s)
        return registration, self._move_on(registration, elapsed_s), hypothesis

    def finish(self) -> Iterator[Estimate]:
        """Yield the estimates of the frames still in the window, with the remaining look-ahead."""
        while (estimate := self.step(None)) is not None:
            yield estimate

    def search(self) -> Search:
        """Return a search for the patient, who was lost in the last frames."""
        return Search(self.window[0], self.last, left=self.has_left or not self._in_view)

    @property
    def has_left(self) -> bool:
        """Return whether the patient leaves or has left the images; if so, a person who appears later may not be the
        patient.
        """
        views = self.window[0].evidence.views
        gone = not self._in_view and not any(view.patient.any() for view in views if view is not None)
        return gone or seen_as_strip(views, self.run.room.cameras)

    @property
    def _in_view(self) -> bool:
        joints_m = self.body.joints(self.belief.pose)
        return any(camera.share_in_image(joints_m) >= IN_VIEW for camera in self.run.room.cameras)

    @property
    def height_m(self) -> float:
        """Return the standing height of the learnt body."""
        return float(np.ptp(self.body.mesh.vertices[:, 1]))

    def use_shape(self, shape: FittedShape) -> None:
        """Continue with another shape of the body, and update everything that is computed from it."""
        self.shape = shape
        self.body = build_body(self.points, shape)
        self.map = map_body(self.body)

    def _elapsed_s(self) -> float:
        return abs(self.window[1].frame_set.time_s - self.window[0].frame_set.time_s)

    def next_hypothesis(self) -> GlobalHypothesis | None:
        """Return the best branches of the track tree from the last registered frame, with the matches of this frame's
        nodes in the next frame; None if the next frame does not show the patient.
        """
        if len(self.window) < 2:
            return None
        self._observe_until(1)
        return self._search_tree() if len(self.window[1].surface) else None

    def _estimate(self, registration: Registration, seen: Observation, hypothesis: GlobalHypothesis | None) -> Estimate:
        """Estimate a frame. Also keep the values that later frames need besides the pose: the skin's sigma, where feet
        stand, and which hands and feet are lost.
        """
        share = None if hypothesis is None else hypothesis.matched_share
        corrected = self._corrections(seen)
        with self.run.stage("states and sigma"):
            honoured = corrected
            if corrected is not None and contradicted(self.body, registration.belief, corrected):
                honoured = None
            unseen_s = self._unseen_s(registration, seen, honoured)
            earlier = Earlier(self.rivals, self.ends, unseen_s, self.seen_sigma_m, self.run.shape)
            estimate = estimate_of(self.body, registration, seen, share, self.config, honoured, earlier)
            self.ends = estimate.ends
            shown = (unseen_s == 0.0).ravel()[SEGMENT_OF_JOINTS] & np.isfinite(estimate.sigma_m)
            self.seen_sigma_m = np.where(shown, estimate.sigma_m, self.seen_sigma_m)
            estimate = displaced(estimate, self.run.room.calibration.displaced_m)
            posed = pose_points(self.body, self.belief.pose)
            self.skin_sigma_m = skin_sigma(self.body, posed, self.belief.covariance, self.config.uncertainty)
            time_s, floor_m = estimate.frame_set.time_s, seen.evidence.floor_m
            self.feet.note(posed.points_m, self.body.joints(self.belief.pose), estimate.shown, time_s, floor_m)
            if corrected is not None:
                self.feet.forget(corrected.joint.tolist())
        return estimate

    def _unseen_s(self, registration: Registration, seen: Observation, corrected: CorrectedJoints | None) -> np.ndarray:
        """Return (PARTS, 2) seconds since each half of a limb was last seen, inf if never; record which halves are seen
        now. corrected: the reviewer's corrections that the images do not contradict.
        """
        time_s = seen.frame_set.time_s
        shown = registration.found & likelihood(self.body, registration.belief.pose, seen.evidence).seen
        if corrected is not None:
            shown[LIMB_OF_JOINTS[corrected.joint]] = True  # the reviewer saw this limb
        self.limb_seen_s = np.where(shown, time_s, self.limb_seen_s)
        return np.asarray(np.where(np.isnan(self.limb_seen_s), np.inf, np.abs(time_s - self.limb_seen_s)))

    def _corrections(self, seen: Observation) -> CorrectedJoints | None:
        """Return the joints of this frame that a reviewer corrected; None without corrections."""
        return self.run.room.review.corrected(seen.frame_set.frame)

    def predict(self, steps: int) -> list[Pose]:
        """Predict the poses of the next ``steps`` frames by scaled motion dynamics. The joints of all look-ahead frames
        are predicted at once; a frame's pose is fitted to its joints when first needed.

        While the patient is not seen, the predicted body keeps its posture and height, and continues its movement over
        the ground. Other movements are not continued, since few movements last for seconds.
        """
        with self.run.stage("prediction"):
            if not self.ahead and self.last.gone_s > 0.0:
                self.ahead = self._gone_on()
            if not self.ahead:
                config = self.config
                history, ahead = np.array(self.history), config.follow.look_ahead
                self.joints_ahead = predict_joints(history, ahead, self.run.motions, config.motion).joints_m
            for joints_m in self.joints_ahead[len(self.ahead) : steps]:
                pose = self.ahead[-1] if self.ahead else self.belief.pose
                self.ahead.append(pose_from_joints(self.body, pose, joints_m))
        return self.ahead[:steps]

    def _gone_on(self) -> list[Pose]:
        """Predict the poses of the look-ahead frames: the present posture, moved over the ground as between the last
        two frames.
        """
        base = JOINT_INDEX["SpineBase"]
        step = self.history[-1][base] - self.history[-2][base] if len(self.history) > 1 else np.zeros(3)
        step[1] = 0.0
        pose, count = self.belief.pose, self.config.follow.look_ahead
        return [replace(pose, root_m=pose.root_m + number * step) for number in range(1, count + 1)]

    def _observe_until(self, last: int) -> list[Pose]:
        """Observe the window's frames 1 to ``last``, and return their predicted poses.

        Frame 1 follows the last registered frame, and may have been observed already as part of an earlier look-ahead.
        Frame 1 is observed again if the patient is now expected in another place.
        """
        if len(self.window.seen) > 1:
            expected, before = self.expect(self.predict(1)[0]), self.window[1].expected
            if before is None or expected.apart_m(before) > SEE_AGAIN_M:
                self.window.replace_next(self._observe(1))
        while len(self.window.seen) <= last:
            self.window.see(self._observe(len(self.window.seen)))
        return self.predict(last)

    def _observe(self, number: int) -> Observation:
        """Observe frame ``number`` of the window; all frames before it must be observed already."""
        frame_set, before = self.window.frames[number], self.window[number - 1]
        # predict: scaled motion dynamics predict where the body will be (Section V)
        expected = self.expect(self.predict(number)[-1])
        # isolate: decide which pixels show the patient, other people, the equipment and the room
        isolated, step = isolate(frame_set, expected, before, self.run)
        if step.any():
            later = self.predict(self.config.follow.look_ahead)[number - 1 :]
            self.ahead[number - 1 :] = [replace(pose, root_m=pose.root_m + step) for pose in later]
            expected = expected.moved(step)
        if number == 1:
            self.pace = WALKING if step.any() else PATIENT_PACE
        # surface: make one mesh from all cameras, cut where the body touches itself, closed where skin is hidden
        surface = see_surface(isolated, expected, self.run)
        # anchors: find head, hands and feet on this surface (Definition 2 of the paper)
        anchors = see_anchors(surface, expected, self.height_m, self.run)
        return gather(frame_set, expected, isolated, surface, anchors, self.run)

    def expect(self, pose: Pose) -> Expectation:
        """Return where the patient is expected in a frame, given the predicted pose."""
        posed = pose_points(self.body, pose)
        trunk = posed.transforms[self.points.asset.bone("Spine1"), :3, 0]
        level = np.array([trunk[0], 0.0, trunk[2]])
        skin = ExpectedSkin(posed.points_m.astype(np.float32), posed.normals.astype(np.float32), self.map)
        return Expectation(
            skin,
            self.skin_sigma_m,
            posed.points_m[anchor_points(self.points)],
            level / max(float(np.linalg.norm(level)), 1e-9),
            self.last.gone_s,
        )

    def _move_on(self, registration: Registration, elapsed_s: float) -> Observation:
        """Make the second frame of the window the first, with the registered pose; return the observation of this
        frame.
        """
        following = self.window[1]
        self.last = self.last.after(following, registration.belief if registration.found else None, elapsed_s)
        self.belief, self.ahead = self._corrected(registration.belief, following), []
        self.history.append(self.body.joints(self.belief.pose))
        self.window.move_on()
        return following

    def _corrected(self, belief: PoseBelief, seen: Observation) -> PoseBelief:
        """Return the belief (pose and its uncertainty) with a reviewer's corrections of this frame's joints; unchanged
        without corrections.

        If the corrections contradict the belief, the tracker has probably assigned depth readings to a wrong limb. The
        limbs are then made more uncertain, so that the corrections get more weight, and the past poses are replaced
        (``_keep_path``). Corrections that the body cannot reach are ignored.
        """
        given = self._corrections(seen)
        if given is None:
            return belief
        wrong = contradicted(self.body, belief, given)
        relaxed = relax_limbs(belief, given) if wrong else belief
        corrected = apply_corrections(self.body, relaxed, given, self.config.uncertainty.inflation)
        if contradicted(self.body, corrected, given):
            return belief
        if wrong:
            self._keep_path(corrected.pose, belief.pose)
        return corrected

    def _search_tree(self) -> GlobalHypothesis:
        """Find each node's best branch: the chain of matches over the look-ahead that is nearest to the prediction."""
        poses = self._observe_until(len(self.window) - 1)
        with self.run.stage("association"):
            return self.window.global_hypothesis(self.body, self.belief.pose, poses)

    def _register(self, poses: list[Pose], elapsed_s: float) -> tuple[Registration, GlobalHypothesis | None]:
        """Register the body to the second frame of the window, or keep the predicted pose if the patient is not seen.
        Also return the track tree's best branches; None if the track tree was not searched.
        """
        predicted, self.moved = self.belief.later(poses[0], elapsed_s, self.pace), False
        with self.run.stage("registration"):
            if self.config.method is Method.ARTICULATED:
                return self._register_body(poses, predicted, elapsed_s)
            if not len(self.window[1].surface):
                return Registration(predicted, 0.0, False), None
            hypothesis = self._search_tree()
            return self._register_parts(hypothesis, poses[0], predicted), hypothesis

    def _register_body(
        self, poses: list[Pose], predicted: PoseBelief, elapsed_s: float
    ) -> tuple[Registration, GlobalHypothesis | None]:
        """Register all parts of the learnt body together, and search for limbs if the frame contradicts the result.
        With ``hypotheses.always``, the track tree's matches constrain the registration.
        """
        shown = len(self.window[1].surface) > 0
        hypothesis = self._search_tree() if shown and self.config.hypotheses.always else None
        found = self._fit(predicted, no_constraints() if hypothesis is None else self._held(hypothesis, poses[0]))
        best = self._with_limbs_found(found, predicted, elapsed_s)
        if self._is_doubtful(best):
            best = self._likeliest_scene(best, predicted)
        if self.moved:
            self._keep_path(best.belief.pose, found.belief.pose)
        return best, hypothesis

    def _with_limbs_found(self, found: Registration, predicted: PoseBelief, elapsed_s: float) -> Registration:
        """Return the registration after comparing it with its rivals (other poses that fit the images almost as well),
        and after a search for misplaced limbs.
        """
        best, seen = found, self.window[1]
        if found.found:
            best, self.rivals = follow_rivals(
                self.body, found, self.rivals, seen.evidence, elapsed_s, self.config.registration, self.pace
            )
            explanation = explained_by(self.body, best, seen)
            # if a rival (another pose that fits almost as well) replaced the best pose, the search for limbs uses the
            # rival's pose as the predicted pose
            expected = predicted if best is found else best.belief
            search = self.watch.look(self.body, best, explanation, expected, seen)
        else:
            search = self.watch.look_for_whole(self.body, found, predicted, seen)
        self.moved = best is not found
        if search is not None:
            best, self.moved = search.registration, self.moved or search.taken
            self.rivals = rivals_of(self.body, best.belief, [*search.rivals, *self.rivals])
        return best

    def _is_doubtful(self, found: Registration) -> bool:
        """Return whether it is in doubt who the patient is: the patient was hidden in the frame before, and either a
        person is found or the learnt descriptor checks the frame (``is_described``). A reviewer's corrections leave no
        doubt.
        """
        return (
            self.last.gone_s > 0.0
            and self._corrections(self.window[1]) is None
            and (found.found or is_described(self.window[1].frame_set))
        )

    def _likeliest_scene(self, found: Registration, predicted: PoseBelief) -> Registration:
        """Return the patient's registration in the likeliest scene hypothesis (assumption about which person is the
        patient), and continue with the person labels of this hypothesis.
        """
        now, before = self.window[1], self.window[0]
        signed_s = now.frame_set.time_s - before.frame_set.time_s
        known = KnownPeople(self.body, self.last, predicted, before, signed_s, self.height_m, self.run)
        best = likeliest_scene(now, found, known)
        if best.seen is not now:
            self.window.restart(best.seen)
            self.moved = best.registration.found
            self.rivals = () if self.moved else self.rivals
        return best.registration

    def _keep_path(self, pose: Pose, wrong: Pose) -> None:
        """Replace the joints of the past frames, after ``pose`` corrected the pose ``wrong``. Only the path of the
        trunk is kept from the past movement (``corrected_past``).
        """
        past_m = corrected_past(np.array(self.history), self.body.joints(pose), self.body.joints(wrong))
        self.history.clear()
        self.history.extend(past_m)

    def _fit(self, predicted: PoseBelief, held: Constraints) -> Registration:
        """Register the body to the next frame; the constraints ``held``, which follow from the track tree's matches and
        the anchors, apply only in the first registration steps.
        """
        seen, config = self.window[1], self.config.registration
        return register(self.body, predicted, seen.evidence, held, config, self.feet.rows(seen.frame_set.time_s))

    def _held(self, hypothesis: GlobalHypothesis, pose: Pose) -> Constraints:
        """Return the constraints that follow from the track tree's matches and the anchors."""
        return held_by(self.body, self.belief.pose, pose, hypothesis, self.window.seen)

    def _register_parts(self, hypothesis: GlobalHypothesis, pose: Pose, predicted: PoseBelief) -> Registration:
        """Register every body part separately from frame to frame: the paper's original method."""
        joints = joints_by_parts(self.body, self.belief.pose, pose, hypothesis, self.window.seen)
        pose = pose_from_joints(self.body, pose, joints)
        return posterior(self.body, pose, predicted, self.window[1].evidence, self.config.registration)


def corrected_past(past_m: np.ndarray, posture_m: np.ndarray, wrong_m: np.ndarray) -> np.ndarray:
    """Return joints (k, 21, 3) for the last k frames, in which limbs were found to be in wrong places. All frames get
    the correct posture ``posture_m`` (21, 3). The trunk moves along its past path, shifted so that repeating the path's
    last step leads to ``posture_m``. Without these past frames, a patient who walks on behind another person would be
    expected to stand still. Metres, world.

    past_m (k, 21, 3): the past joints; wrong_m (21, 3): the joints that ``posture_m`` corrects. The result is empty if
    the trunk was in a wrong place, too, or if fewer than two past frames are known.
    """
    path_m = past_m[:, JOINT_INDEX["SpineBase"]]
    trunk_m = np.linalg.norm((posture_m - wrong_m)[JOINT_INDEX["SpineBase"]])
    if trunk_m > APART_M or len(path_m) < 2:
        return np.empty((0, *posture_m.shape))
    return np.asarray(posture_m + (path_m - path_m[-1] - (path_m[-1] - path_m[-2]))[:, None])
