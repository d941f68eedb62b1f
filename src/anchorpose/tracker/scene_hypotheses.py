"""Decide who is who after an occlusion, by comparing scene hypotheses (paper, Section III, transient occlusion).

A scene hypothesis is a pose of the patient and of every other person in view, with the label of each pixel. While the
patient is hidden, prediction and labels may be wrong: a helper who comes into view where the patient was expected gets
the patient's label, and the patient's own pixels may get the label of a person who touches them. Labels alone cannot
show this. So all people of the frame are found again without labels, each of them is tried as the patient, and so is
the hypothesis that the patient is still hidden. The bodies of all people together decide: how much of what the cameras
read they explain, and how far each person has moved since this person was last seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.likelihood import likelihood
from anchorpose.body.pose import LIMB_OF_JOINTS, PARTS, TRUNK, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import Registration, descend, posterior
from anchorpose.body.rivals import DECIDED, LEAST_GAIN, believed
from anchorpose.body.skin_points import Body, body_points
from anchorpose.isolation.bystander_memory import update_memory
from anchorpose.isolation.patient_label import LAST_LABEL
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.separation import first_free
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_COUNT
from anchorpose.tracker.bystanders import (
    GROWTH_M_S,
    SKIN_SIGMA_M,
    Bystander,
    ahead,
    follow_bystanders,
    labels_of,
    person_evidence,
    rough_person,
)
from anchorpose.tracker.observation import Isolated, Observation
from anchorpose.tracker.observing import UNFITTED_M_S, isolate_first, observe, people_of
from anchorpose.tracker.room import Run
from anchorpose.tracker.search import NEAR_M, WALK_M_S, LastSeen
from anchorpose.tracker.sighting import TWO_PEOPLE_M

# m, error of the place of a rough body's trunk
ROUGH_SIGMA_M: Final = 0.1
# deviations, in sigmas, up to which a movement costs its square; beyond, the cost grows linearly, since people stumble
USUAL: Final = 3.0
# nats, cost of a person who is in view and was not seen before, or who was in view and is gone: once in 400 frames
STRANGE: Final = 6.0
# (21,) bool, joints whose movement counts: all joints of the patient; a bystander's trunk, since limbs of rough bodies
# are often misplaced
EVERY: Final = np.ones(JOINT_COUNT, dtype=bool)
OF_TRUNK: Final = LIMB_OF_JOINTS == TRUNK


@dataclass(frozen=True, slots=True, eq=False)
class SceneHypothesis:
    """The people of a frame: their pixels, the bystanders' bodies, and the patient's pose."""

    seen: Observation
    registration: Registration  # of the patient; ``found`` is False if the patient is hidden
    readings: float  # nats, how much of the readings the bodies of all people explain
    movement: float  # nats, log probability of all people's movements since they were last seen
    joints_m: Mapping[int, np.ndarray | None]  # joints (21, 3) of each bystander in view, by label; None without a body

    def is_elsewhere(self, other: SceneHypothesis) -> bool:
        """Return whether both hypotheses see the patient, but at different places."""
        apart_m = self.registration.belief.pose.root_m - other.registration.belief.pose.root_m
        seen = self.registration.found and other.registration.found
        return seen and float(np.linalg.norm(apart_m)) > TWO_PEOPLE_M

    def ahead_of(self, other: SceneHypothesis) -> float:
        """Return by how many nats this hypothesis is likelier than another. Readings are trusted less than they say:
        errors of shape and clothes affect the bodies of two people whose places are exchanged.
        """
        return believed(self.readings - other.readings, 2 * PARTS) + self.movement - other.movement


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedJoints:
    """The places at which a person's joints are expected."""

    joints_m: np.ndarray  # (21, 3) world
    sigma_m: float  # m, standard deviation of each joint from its expected place

    def cost(self, joints_m: np.ndarray, counted: np.ndarray) -> float:
        """Return the cost, in nats, of the movement to the joints (21, 3). counted (21,) bool: joints that count."""
        away = np.linalg.norm((joints_m - self.joints_m)[counted], axis=1) / self.sigma_m
        parts = len(np.unique(LIMB_OF_JOINTS[counted]))  # the joints of one part move together
        return parts * float(np.where(away < USUAL, 0.5 * away**2, USUAL * away - 0.5 * USUAL**2).mean())


@dataclass(frozen=True, slots=True, eq=False)
class KnownPeople:
    """What is known of all people before a frame."""

    body: Body
    last: LastSeen
    predicted: PoseBelief  # the patient's predicted pose in this frame
    seen: Observation  # the frame before this one
    elapsed_s: float  # s, since that frame; negative in a backward pass
    height_m: float
    run: Run

    def moved(self, joints_m: np.ndarray) -> float:
        """Return the cost, in nats, of the patient's movement to the joints (21, 3): from the last seen pose, or from
        the pose predicted from it, whichever is nearer.
        """
        sigma_m = _sigma_m(self.elapsed_s, self.last.gone_s)
        poses = (self.last.belief.pose, self.predicted.pose)
        return min(ExpectedJoints(self.body.joints(pose), sigma_m).cost(joints_m, EVERY) for pose in poses)

    @property
    def in_view(self) -> frozenset[int]:
        """Return the labels of the bystanders with a body who were in view in the frame before."""
        return frozenset(one.label for one in self.seen.bystanders.followed if one.hidden_s == 0.0)

    @property
    def bystanders(self) -> dict[int, ExpectedJoints]:
        """Return where each bystander with a body is expected, by label."""
        return {
            one.label: ExpectedJoints(
                one.body.joints(ahead(one, body_points(), self.elapsed_s)),
                ROUGH_SIGMA_M + _sigma_m(self.elapsed_s, one.hidden_s),
            )
            for one in self.seen.bystanders.followed
        }

    def came_and_went(self, joints_m: Mapping[int, np.ndarray | None]) -> float:
        """Return the cost, in nats, of the bystanders' movements. joints_m: the joints (21, 3) of each bystander in
        view, by label; None without a body.
        """
        expected = self.bystanders
        came = sum(_came(expected.get(label), at) for label, at in joints_m.items())
        return came + STRANGE * len(self.in_view - joints_m.keys())


def _sigma_m(elapsed_s: float, hidden_s: float) -> float:
    """Return the standard deviation of a person's joints from their expected places, metres: that of predicted skin."""
    return SKIN_SIGMA_M + GROWTH_M_S * abs(elapsed_s) + UNFITTED_M_S * hidden_s


def _came(expected: ExpectedJoints | None, joints_m: np.ndarray | None) -> float:
    """Return the cost, in nats, of a bystander's movement to the joints (21, 3). expected: None if the bystander was
    not seen before.
    """
    return STRANGE if expected is None or joints_m is None else min(STRANGE, expected.cost(joints_m, OF_TRUNK))


def likeliest_scene(now: Observation, found: Registration, known: KnownPeople) -> SceneHypothesis:
    """Return the likeliest scene hypothesis of a frame. ``now`` and ``found`` are what tracking suggests; another
    hypothesis replaces them only if it is clearly likelier.
    """
    suggested = _scored(now, found, known)
    others = list(_exchanged(now, known))
    shown = [one for one in (suggested, *others) if one.registration.found]
    if shown:
        others.append(_hidden(max(shown, key=lambda one: one.ahead_of(suggested)), known))
    best = max(others, key=lambda one: one.ahead_of(suggested), default=suggested)
    if best is suggested or best.ahead_of(suggested) < DECIDED:
        return suggested
    if not any(one.is_elsewhere(best) and best.ahead_of(one) < LEAST_GAIN for one in others):
        return best
    return others[-1] if found.found else suggested  # undecided: the patient counts as hidden


def _scored(seen: Observation, found: Registration, known: KnownPeople) -> SceneHypothesis:
    """Return a hypothesis with the log probabilities of its readings and of its movements."""
    views, cameras = seen.evidence.views, known.run.room.cameras
    readings = log_probability(known.body, found.belief.pose, seen.evidence)
    bodies = {one.label: one for one in seen.bystanders.followed if one.hidden_s == 0.0}
    joints_m = dict[int, np.ndarray | None]()
    for label in labels_of(views):
        one, own = bodies.get(label) or rough_person(views, cameras, label), person_evidence(views, cameras, label)
        joints_m[label] = None
        if one is not None:
            pose = one.belief.pose if isinstance(one, Bystander) else one.found.belief.pose
            pose = descend(one.body, pose, vague_belief(pose), own, known.run.config.registration)
            readings += max(0.0, log_probability(one.body, pose, own))
            joints_m[label] = one.body.joints(pose)
    moved = known.moved(known.body.joints(found.belief.pose)) if found.found else 0.0
    return SceneHypothesis(seen, found, readings, -moved - known.came_and_went(joints_m), joints_m)


def _hidden(of: SceneHypothesis, known: KnownPeople) -> SceneHypothesis:
    """Return the hypothesis that the patient is hidden, and that the patient of another hypothesis is a bystander. In
    both, the same body explains this person's pixels. So only two things decide between them: how far people have
    moved, and whether cameras see past the patient's expected place. The patient may be hidden elsewhere, so the cost
    of skin that cameras see past is limited.
    """
    cameras, views = known.run.room.cameras, of.seen.evidence.views
    at = known.body.joints(of.registration.belief.pose)
    away = {label: one for label, one in known.bystanders.items() if label not in of.joints_m}
    label = int(_names([at], away, first_free(of.seen.memory, known.elapsed_s))[0])
    renamed = np.arange(256, dtype=np.uint8)
    renamed[PixelLabel.PATIENT] = label
    seen = _observed(of.seen, _renamed(views, renamed), known)
    past = likelihood(
        known.body, known.predicted.pose, person_evidence(seen.evidence.views, cameras, PixelLabel.PATIENT)
    )
    joints_m = {**of.joints_m, label: at}
    elsewhere = min(-believed(min(past.total, 0.0), PARTS), 2.0 * STRANGE)
    nobody = Registration(known.predicted, 0.0, False)
    return SceneHypothesis(seen, nobody, of.readings, -elsewhere - known.came_and_went(joints_m), joints_m)


def _exchanged(now: Observation, known: KnownPeople) -> Iterator[SceneHypothesis]:
    """Yield the hypotheses that the patient is one of the people whom the descriptor finds, each of them in turn."""
    run = known.run
    crowd = people_of(now.frame_set, run)
    place = known.last.belief.pose.root_m[[0, 2]]
    reach_m = NEAR_M + WALK_M_S * known.last.gone_s
    for person in crowd.people.people:
        if np.linalg.norm(person.ground_xz_m - place) > reach_m:
            continue
        isolated = isolate_first(now.frame_set, PatientChoice(person.ground_xz_m, "", sure=False), run, crowd)
        seen = _observed(now, _renamed(isolated.views, _known_labels(isolated, now, known)), known)
        rough = crowd.body_at(person.ground_xz_m)
        registration = _registered(seen, None if rough is None else rough.found.belief.pose, known)
        if registration.found:
            yield _scored(seen, registration, known)


def _known_labels(isolated: Isolated, now: Observation, known: KnownPeople) -> np.ndarray:
    """Return (256,) uint8 the label of each label of a frame whose people were found anew: that of the bystander who
    was expected there, or a new one.
    """
    renamed = np.arange(256, dtype=np.uint8)
    shown, free = labels_of(isolated.views), first_free(now.memory, known.elapsed_s)
    joints_m = {one.label: one.body.joints(one.belief.pose) for one in isolated.bystanders.followed}
    renamed[shown] = _names([joints_m.get(label) for label in shown], known.bystanders, free)
    return renamed


def _names(found: Sequence[np.ndarray | None], expected: Mapping[int, ExpectedJoints], free: int) -> np.ndarray:
    """Return the label (n,) uint8 of each person found: that of the bystander whose way there costs least, or a
    new one from ``free`` on. found: each person's joints (21, 3), None without a body.
    """
    labels = np.minimum(free + np.arange(len(found)), LAST_LABEL).astype(np.uint8)
    costs = np.array([[_came(one, joints_m) for one in expected.values()] for joints_m in found])
    if costs.size:
        for person, number in zip(*linear_sum_assignment(costs), strict=True):
            if costs[person, number] < STRANGE:
                labels[person] = list(expected)[number]
    return labels


def _renamed(views: Sequence[View | None], renamed: np.ndarray) -> tuple[View | None, ...]:
    return tuple(None if view is None else View(view.depth_m, renamed[view.labels]) for view in views)


def _observed(now: Observation, views: tuple[View | None, ...], known: KnownPeople) -> Observation:
    """Return the observation of the frame with other labels."""
    run, seen = known.run, known.seen
    memory = update_memory(seen.memory, now.pieces, views, run.room.cameras, known.elapsed_s)
    bystanders = follow_bystanders(seen.bystanders, views, run.room.cameras, body_points(), known.elapsed_s)
    isolated = Isolated(now.pieces, views, memory, bystanders)
    return observe(now.frame_set, isolated, None, known.height_m, run)


def _registered(seen: Observation, rough: Pose | None, known: KnownPeople) -> Registration:
    """Return the patient's registration to other pixels: of those from the predicted pose, from this pose at the rough
    body's place, and from the rough body's pose, the likeliest.
    """
    config, body, predicted = known.run.config.registration, known.body, known.predicted
    starts = [predicted.pose]
    if rough is not None:
        starts += [replace(predicted.pose, root_m=rough.root_m), rough]
    tried = [descend(body, pose, vague_belief(pose), seen.evidence, config) for pose in starts]
    found = [posterior(body, pose, vague_belief(pose), seen.evidence, config) for pose in tried]
    return max(found, key=lambda one: log_probability(body, one.belief.pose, seen.evidence) if one.found else -np.inf)
