"""Decide who is who after an occlusion, by comparing scene hypotheses (paper, Section V, transient occlusions).

A scene hypothesis is a pose of the patient and of every other person in view, with the label of each pixel. While the
patient is hidden, prediction and labels may be wrong: a helper who comes into view where the patient was expected gets
the patient's label, and the patient's own pixels may get the label of a person who touches them. Labels alone cannot
show this. So all people of the frame are found again, without the labels. Each of them in turn is assumed to be the
patient; a further hypothesis is that the patient is still hidden. The hypotheses are compared by the bodies of all
people: how much of the depth readings these bodies explain, and how far each person has moved since this person was
last seen.
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
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_COUNT
from anchorpose.tracker.bystanders import (
    GROWTH_M_S,
    SKIN_SIGMA_M,
    Bystander,
    ahead,
    labels_of,
    person_evidence,
    rough_person,
)
from anchorpose.tracker.observation import Isolated, Observation
from anchorpose.tracker.observing import UNFITTED_M_S, isolate_first, observe, people_of, see_bystanders
from anchorpose.tracker.room import Run
from anchorpose.tracker.search import NEAR_M, WALK_M_S, LastSeen
from anchorpose.tracker.sighting import TWO_PEOPLE_M

# m, assumed error of the place of a bystander's trunk, since the rough body has average proportions; half the depth of
# a chest
ROUGH_SIGMA_M: Final = 0.1
# (k, 3) m, displacements over the ground from the predicted place of a hidden patient, the shortest first: half a
# trunk's breadth apart, as far as a hidden patient may walk in a second
PLACES_M: Final = np.array(
    sorted(
        ((0.25 * x, 0.0, 0.25 * z) for x in range(-4, 5) for z in range(-4, 5)),
        key=lambda away: float(np.hypot(*away[::2])),
    )
)
# sigmas; up to this deviation from the expected place, the cost of a movement grows with the square of the deviation.
# The cost of larger deviations grows linearly, since people stumble
USUAL: Final = 3.0
# nats, cost of a bystander who appears or disappears between two frames, assumed to happen once in 400 frames. The cost
# of a bystander's movement is limited to the same value; the cost of the assumption that the patient is hidden is
# limited to twice this value
STRANGE: Final = 6.0
# (21,) bool, joints whose movement counts. EVERY: all joints, for the patient; OF_TRUNK: the joints of the trunk, for a
# bystander, since limbs of rough bodies are often misplaced
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

    def differs(self, other: SceneHypothesis) -> bool:
        """Return whether one hypothesis sees the patient and the other does not, or both at different places."""
        apart_m = self.registration.belief.pose.root_m - other.registration.belief.pose.root_m
        if self.registration.found != other.registration.found:
            return True
        return self.registration.found and float(np.linalg.norm(apart_m)) > TWO_PEOPLE_M

    def ahead_of(self, other: SceneHypothesis) -> float:
        """Return by how many nats this hypothesis is likelier than another. The lead in ``readings`` (how much of the
        depth readings each hypothesis explains) is reduced (``believed``), since errors of body shape and clothes can
        cause it. The reduction assumes such errors in the trunk and limbs of two bodies, since the hypotheses may
        exchange two people.
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
    """The data of all people from earlier frames, by which the hypotheses of a frame are compared."""

    body: Body
    last: LastSeen
    predicted: PoseBelief  # the patient's predicted pose in this frame; a hidden patient is assumed there
    seen: Observation  # the frame before this one
    elapsed_s: float  # s, since that frame; negative in a backward pass
    height_m: float
    run: Run

    def moved(self, joints_m: np.ndarray) -> float:
        """Return the cost, in nats, of the patient's movement from the last seen pose to the joints (21, 3)."""
        expected = self.body.joints(self.last.belief.pose)
        return ExpectedJoints(expected, _sigma_m(self.elapsed_s, self.last.gone_s)).cost(joints_m, EVERY)

    def hiding(self, views: Sequence[View | None]) -> float:
        """Return the cost, in nats, of the assumption that the patient is hidden, in the predicted posture: the least
        cost over ``PLACES_M`` around the predicted place. A place costs what the movement there costs, and more if
        cameras see past the body there (read something farther away). The cost is limited, since the posture may have
        changed, too.
        """
        nobody, predicted = person_evidence(views, self.run.room.cameras, PixelLabel.PATIENT), self.predicted.pose
        least = 2.0 * STRANGE
        for away_m in PLACES_M:
            pose = replace(predicted, root_m=predicted.root_m + away_m)
            moved = self.moved(self.body.joints(pose)) if away_m.any() else 0.0
            if moved < least:
                past = likelihood(self.body, pose, nobody).total
                least = min(least, moved - believed(min(past, 0.0), PARTS))
        return least

    @property
    def in_view(self) -> frozenset[int]:
        """Return the labels of the bystanders with a body who were in view in the frame before."""
        return frozenset(one.label for one in self.seen.bystanders.followed if one.hidden_s == 0.0)

    @property
    def bystanders(self) -> dict[int, ExpectedJoints]:
        """Return the expected joints of each bystander with a fitted body, by the bystander's label."""
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
        expected, shown = self.bystanders, self.seen.memory.without_patient.seen_last.keys()
        moved = sum(_came(one, joints_m[label]) for label, one in expected.items() if label in joints_m)
        # a bystander who was in view before, but without a fitted body, may be anywhere now, and have a new label
        came = max(0, len(joints_m.keys() - expected.keys()) - len(shown - expected.keys()))
        return moved + STRANGE * (came + len(self.in_view - joints_m.keys()))


def _sigma_m(elapsed_s: float, hidden_s: float) -> float:
    """Return the standard deviation, in metres, of a person's joints around their expected places; the patient's
    predicted skin gets its uncertainty by the same formula (``patient_likelihood``). elapsed_s: time since the last
    frame; hidden_s: time for which the person has been hidden.
    """
    return SKIN_SIGMA_M + GROWTH_M_S * abs(elapsed_s) + UNFITTED_M_S * hidden_s


def _came(expected: ExpectedJoints, joints_m: np.ndarray | None) -> float:
    """Return the cost, in nats, of a bystander's movement to the joints (21, 3), None without a body."""
    return STRANGE if joints_m is None else min(STRANGE, expected.cost(joints_m, OF_TRUNK))


def likeliest_scene(now: Observation, found: Registration, known: KnownPeople) -> SceneHypothesis:
    """Return the likeliest scene hypothesis of a frame. now, found: the observation and the registration that tracking
    suggests; another hypothesis replaces them only if it is clearly likelier.
    """
    suggested = _scored(now, found, known)
    others = list(_exchanged(now, known))
    shown = [one for one in (suggested, *others) if one.registration.found]
    if shown:
        others.append(_hidden(_best(shown), known))
    best = _best([suggested, *others])
    if best is suggested or best.ahead_of(suggested) < DECIDED:
        return suggested
    rivals = [one for one in others if one.differs(best)]
    if best.registration.found and any(best.ahead_of(one) < LEAST_GAIN for one in rivals):
        return others[-1] if found.found else suggested  # undecided: the patient counts as hidden
    return best


def _best(hypotheses: Sequence[SceneHypothesis]) -> SceneHypothesis:
    """Return the best of all hypotheses. Each hypothesis has a lead, possibly negative, over every other hypothesis
    (``ahead_of``); the hypothesis whose smallest lead is largest is the best.
    """
    leads = [min((one.ahead_of(other) for other in hypotheses if other is not one), default=0.0) for one in hypotheses]
    return hypotheses[int(np.argmax(leads))]


def _scored(seen: Observation, found: Registration, known: KnownPeople) -> SceneHypothesis:
    """Return the hypothesis with this observation and this registration of the patient, with the log probabilities of
    its depth readings and of all people's movements.
    """
    views, cameras = seen.evidence.views, known.run.room.cameras
    readings, movement = 0.0, -known.hiding(views)
    if found.found:
        readings = log_probability(known.body, found.belief.pose, seen.evidence)
        movement = -known.moved(known.body.joints(found.belief.pose))
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
    return SceneHypothesis(seen, found, readings, movement - known.came_and_went(joints_m), joints_m)


def _hidden(of: SceneHypothesis, known: KnownPeople) -> SceneHypothesis:
    """Return the hypothesis that the patient is hidden, and that the patient of another hypothesis is a bystander. Both
    hypotheses explain the depth readings equally well (same value ``readings``), since the same body explains this
    person's pixels.
    """
    at = known.body.joints(of.registration.belief.pose)
    away = {label: one for label, one in known.bystanders.items() if label not in of.joints_m}
    label = int(_names([at], away, of.seen.memory.free_labels(known.elapsed_s))[0])
    renamed = np.arange(256, dtype=np.uint8)
    renamed[PixelLabel.PATIENT] = label
    seen = _observed(of.seen, _renamed(of.seen.evidence.views, renamed), known)
    joints_m = {**of.joints_m, label: at}
    movement = -known.hiding(seen.evidence.views) - known.came_and_went(joints_m)
    return SceneHypothesis(seen, Registration(known.predicted, 0.0, False), of.readings, movement, joints_m)


def _exchanged(now: Observation, known: KnownPeople) -> Iterator[SceneHypothesis]:
    """Yield, for each person whom the learnt descriptor finds near the patient's last place, the hypothesis that this
    person is the patient. People whom the patient's body does not fit are left out.
    """
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
    """Return (256,) uint8: for each label that ``isolate_first`` gave, the label of the bystander who was expected at
    this person's place, or a new label.
    """
    renamed = np.arange(256, dtype=np.uint8)
    shown, free = labels_of(isolated.views), now.memory.free_labels(known.elapsed_s)
    joints_m = {one.label: one.body.joints(one.belief.pose) for one in isolated.bystanders.followed}
    renamed[shown] = _names([joints_m.get(label) for label in shown], known.bystanders, free)
    return renamed


def _names(found: Sequence[np.ndarray | None], expected: Mapping[int, ExpectedJoints], free: np.ndarray) -> np.ndarray:
    """Return the label (n,) uint8 of each person found. Bystanders are assigned to people so that the total cost of
    movement is least; a person whose movement would cost ``STRANGE`` (the maximum cost) gets a new label, one of
    ``free``. found: each person's joints (21, 3), None without a body.
    """
    labels = free[: len(found)].copy()
    costs = np.array([[_came(one, joints_m) for one in expected.values()] for joints_m in found])
    if costs.size:
        for person, number in zip(*linear_sum_assignment(costs), strict=True):
            if costs[person, number] < STRANGE:
                labels[person] = list(expected)[number]
    return labels


def _renamed(views: Sequence[View | None], renamed: np.ndarray) -> tuple[View | None, ...]:
    return tuple(None if view is None else View(view.depth_m, renamed[view.labels]) for view in views)


def _observed(now: Observation, views: tuple[View | None, ...], known: KnownPeople) -> Observation:
    """Return the observation of the frame after its person labels were replaced by the labels in ``views``."""
    run, seen = known.run, known.seen
    memory = update_memory(seen.memory, now.pieces, views, run.room.cameras, known.elapsed_s)
    bystanders = see_bystanders(seen.bystanders, views, known.elapsed_s, run)
    isolated = Isolated(now.pieces, views, memory, bystanders)
    return observe(now.frame_set, isolated, None, known.height_m, run)


def _registered(seen: Observation, rough: Pose | None, known: KnownPeople) -> Registration:
    """Register the patient's body to the pixels that have the patient's label in ``seen``; ``found`` is False if no
    pose fits. Three poses are tried: the predicted pose, the predicted pose moved to the place of ``rough`` (pose of a
    body of average shape fitted to the same pixels), and the pose ``rough``. The likeliest result is returned.
    """
    config, body, predicted = known.run.config.registration, known.body, known.predicted
    starts = [predicted.pose]
    if rough is not None:
        starts += [replace(predicted.pose, root_m=rough.root_m), rough]
    tried = [descend(body, pose, vague_belief(pose), seen.evidence, config) for pose in starts]
    found = [posterior(body, pose, vague_belief(pose), seen.evidence, config) for pose in tried]
    return max(found, key=lambda one: log_probability(body, one.belief.pose, seen.evidence) if one.found else -np.inf)
