"""Track the patient in the paper's framework, which computes the pose from matches of surface nodes (Section V)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from anchorpose.body.belief import PoseBelief
from anchorpose.body.constraints import anchor_points, join, place_constraints
from anchorpose.body.fit import damped_step
from anchorpose.body.inverse_kinematics import pose_from_joints
from anchorpose.body.limb_proposals import CHAINS, CONTRADICTED_M, contradicted_by
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration, posterior
from anchorpose.body.skin_map import map_body
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body, pose_points
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.recording.recording import FrameSet
from anchorpose.research.experiment.config import Form, Update
from anchorpose.research.experiment.given import GivenFrames
from anchorpose.research.experiment.own_surface import SeenGeodesics, match_skin
from anchorpose.research.experiment.pose_filters import FAR_M, match_rows, update_by_rows
from anchorpose.surface.surface import BodyMap
from anchorpose.track_tree.global_hypothesis import GlobalHypothesis, joints_by_parts
from anchorpose.track_tree.parts import ITERATIONS
from anchorpose.tracker.observation import Observation, Start
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """The form (variant) of the paper's framework in which a method runs, and the method's options other than how it
    matches nodes.
    """

    form: Form = Form.REFINED
    anchored: bool = True  # whether the method uses anchors; if not, anchors are not searched
    update: Update = Update.PARTS  # way in which the matches update the pose
    # whether an arm is moved if its hand is seen elsewhere than the pose states (``bring_limbs_back``)
    own_surface: bool = False


class PaperTracker(PatientTracker):
    """The tracker of a patient in the paper's framework."""

    def __init__(self, run: Run, start: Start, way: Way, given: GivenFrames) -> None:
        self.way, self.given = way, given
        super().__init__(run, start)

    def use_shape(self, shape: FittedShape) -> None:
        """Set the shape as ``PatientTracker`` does, but cache the body built from it, since tracking restarts often."""
        self.shape = shape
        self.body, self.map = _body_of(shape)

    def follow(self, frame_set: FrameSet | None) -> bool:
        """Track the next frame as ``PatientTracker.step`` does, but without joints' states and sigmas, which are not
        compared.

        Return whether a frame was registered. The result is False until the frames of the look-ahead (the next frames,
        which the track tree uses) have been read, and after the last frame.
        """
        ready = self._look(frame_set)
        if ready:
            self._advance()
        return ready

    def _observe(self, number: int) -> Observation:
        """Observe a frame of the window as ``PatientTracker`` does, but with the patient's pixels given."""
        expected = self.expect(self.predict(number)[-1])
        return self.given.observe(self.window.frames[number], expected, self.height_m, self.run, self.way.anchored)

    def _register_parts(self, hypothesis: GlobalHypothesis, pose: Pose, predicted: PoseBelief) -> Registration:
        config, form, robust = self.config.registration, self.way.form, self.way.form.rejects
        now, window = pose_points(self.body, self.belief.pose), list(self.window.seen)
        if self.way.update is not Update.PARTS:
            rows = match_rows(self.body, now, hypothesis, window, predicted, robust)
            seed = window[1].frame_set.frame
            predicted = update_by_rows(self.way.update, self.body, rows, predicted, config, seed)
            pose = predicted.pose
            if not form.refined:
                return Registration(replace(predicted, pose=self._with_limbs(pose)), 1.0, True)
            hypothesis = replace(hypothesis, matched_m=np.full_like(hypothesis.matched_m, np.nan))
        steps = ITERATIONS if form.refined else 0
        joints = joints_by_parts(self.body, self.belief.pose, pose, hypothesis, window, steps, robust)
        pose = self._with_limbs(pose_from_joints(self.body, pose, joints))
        found = posterior(self.body, pose, predicted, self.window[1].evidence, config)
        # a form that rejects no matches keeps the fitted pose even if ``posterior`` finds that the seen surface does
        # not belong to the body in this pose
        if not robust and not found.found:
            return Registration(replace(predicted, pose=pose), found.explained, True)
        return found

    def _with_limbs(self, pose: Pose) -> Pose:
        """Return the pose; with ``own_surface``, arms whose hand is seen elsewhere than in the pose are moved."""
        if not self.way.own_surface:
            return pose
        seen = self.window[1]
        return bring_limbs_back(self.body, pose, SeenGeodesics(seen.whole, seen.anchors, seen.descriptor))


@lru_cache(maxsize=1)
def _body_of(shape: FittedShape) -> tuple[Body, BodyMap]:
    body = build_body(body_points(), shape)
    return body, map_body(body)


HANDS: Final = np.array(["Hand" in name for name in ANCHOR_NAMES])
# m, scale of the robust kernel in each step that moves an arm; large at first, since the arm is then far from its
# matches
BACK_SCALES_M: Final = (0.5, 0.5, 0.3, 0.15)
BACK_SIGMA_M: Final = 0.05  # m, standard deviation of the distance of a node from its skin point on the arm
HELD_SIGMA_M: Final = 0.01  # m, standard deviation with which the skin outside of the arm is held in place
# Step between the skin points outside of the arm that are held in place: every fourth point is held
HELD_EVERY: Final = 4


def bring_limbs_back(body: Body, pose: Pose, seen: SeenGeodesics) -> Pose:
    """Return the pose after moving each arm whose hand is seen more than ``CONTRADICTED_M`` from its place in the pose.

    The arm's skin points are pulled to the nodes that ``match_skin`` matches with them, and the tip of its hand to the
    hand's anchor. The skin points of the rest of the body are held in place.
    """
    lost = contradicted_by(body, pose, seen.anchors, CONTRADICTED_M) & HANDS
    bones = [bone for chain in CHAINS for bone in chain.bones if lost[ANCHOR_NAMES.index(chain.joints[0])]]
    if not bones:
        return pose
    numbers, part = [body.points.asset.bone(name) for name in bones], body.points.part
    matches, tips = match_skin(body, seen), anchor_points(body.points)
    own = np.isin(part[matches.point], numbers)
    point = np.concatenate([matches.point[own], tips[lost]])
    places = np.concatenate([seen.whole.points_m[matches.node[own]].astype(np.float64), seen.anchors.position_m[lost]])
    others = np.flatnonzero(~np.isin(part, _with_fingers(body, numbers)))[::HELD_EVERY]
    stay = place_constraints(others, pose_points(body, pose).points_m[others], HELD_SIGMA_M, FAR_M)
    for scale_m in BACK_SCALES_M:
        rows = join([place_constraints(point, places, BACK_SIGMA_M, scale_m), stay])
        pose = damped_step(body, pose, rows, None, 1.0)
    return pose


def _with_fingers(body: Body, bones: Sequence[int]) -> list[int]:
    """Return the bones and all their descendants, such as the fingers of a hand."""
    found = list(bones)
    for bone, parent in enumerate(body.points.asset.bone_parents):
        if parent in found and bone not in found:
            found.append(bone)
    return found
