"""Follow rivals until the images decide (paper, Section V). Rivals are poses that explain the images almost as well
as the best pose.

The best pose and its rivals are registered to every frame. A rival that becomes clearly likelier (by half of
``LEAST_GAIN``) replaces the best pose. Until then, each rival increases the sigma of the joints.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import log_ndtr

from anchorpose.body.belief import PATIENT_PACE, Pace, PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.expected_joints import Expected, expected_joints
from anchorpose.body.likelihood import likelihood
from anchorpose.body.pose import LIMB_OF_JOINTS, TRUNK
from anchorpose.body.pose_probability import facing_nats, log_probability
from anchorpose.body.registration import Registration, register
from anchorpose.body.skin_points import Body

# m; two poses count as the same if no joint lies farther than this from its place in the other pose. Clothes and
# gripping hands shift estimated joints by as much as this distance
APART_M: Final = 0.08
LIMB_ERROR: Final = 4.0
"""Standard deviation, in nats, of the lead of one pose over another (the difference of their log probabilities), due to
errors of shape and clothes. The value holds if the place of one part (limb or trunk) differs; if several parts differ,
it is multiplied by their number.

In two scenes, only head and arms were visible. The lead of the correct pose over the pose with the opposite facing was
3 and 5 nats in the median, with standard deviations of 14 and 25 (``benchmarks/run.py facings``)."""
OWN_BODY_ERROR: Final = 6.0
"""Like ``LIMB_ERROR``, in nats, but for two poses that each have a body of their own, fitted together with the pose.
For poses that differ in all five parts (trunk and limbs), the standard deviation was 30 nats, measured in 18 windows of
9 hard scenes."""

# s, time after which a frame's weight in ``Rival.lag`` has fallen to a third; limbs have moved in this time, so older
# frames count less
MEMORY_S: Final = 0.3
# s, like ``MEMORY_S``, but for a rival with a body of its own; errors of this body's shape are the same in many frames,
# so ``Rival.lag`` averages over a longer time
OWN_MEMORY_S: Final = 4.0
# nats by which a pose found by a search must be likelier than the best pose to replace the best pose: twenty times as
# likely. A rival replaces the best pose at half of this value, so the replaced pose must gain the whole value to return
LEAST_GAIN: Final = 3.0
# nats (a factor of e^6), difference at which the images decide between two poses. A rival is dropped if the best pose
# explains the last frames better by at least this much (``Rival.lag``). Also used for the facing that learning decides,
# and for scene hypotheses
DECIDED: Final = 6.0
MOST: Final = 3  # maximum number of rivals; each rival takes as much time as registering the best pose


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """A pose that competes with the best pose.

    A rival may have a body of its own, with another shape. Such a rival only increases sigma and never becomes the best
    pose, since the patient's bones keep their length.
    """

    belief: PoseBelief
    # nats by which the best pose explains the last frames better than the rival: weighted mean over the frames, reduced
    # by ``believed``
    lag: float
    # nats, cost of the rival's distance from the expected pose; this cost decays with time, but not for limbs that are
    # not seen
    moved: float = 0.0
    body: Body | None = None  # the rival's own body; None if it has the body of the best pose

    @property
    def behind(self) -> float:
        """Return by how many nats the rival is less likely than the best pose."""
        return self.lag + self.moved

    def joints_m(self, body: Body) -> np.ndarray:
        """Return the rival's joints (21, 3), metres, world. body: the body of the best pose."""
        return (self.body or body).joints(self.belief.pose)

    def beside(self, best: Rival) -> Rival:
        """Return this rival for the case that another rival, ``best``, becomes the best pose: the fields ``lag`` and
        ``moved`` of ``best`` are subtracted from this rival's fields.
        """
        return replace(self, lag=self.lag - best.lag, moved=self.moved - best.moved)


def believed(lead: float, parts: int, error: float = LIMB_ERROR) -> float:
    """Reduce the lead of a pose over another pose (the difference of their log probabilities, in nats), since errors of
    shape and clothes may cause the lead. The result is at most the log odds that the leading pose is indeed the
    likelier pose. A negative lead gives a negative result.

    parts: number of parts (limbs or trunk) whose place differs between the poses. The lead's standard deviation is
    ``error`` times ``parts``.
    """
    deviations = abs(lead) / (error * max(parts, 1))
    odds = float(log_ndtr(deviations) - log_ndtr(-deviations))
    return float(np.copysign(min(abs(lead), odds), lead))


def parts_apart(one_m: np.ndarray, other_m: np.ndarray) -> int:
    """Count the parts (limbs or trunk) whose places differ between the joints (21, 3) of two poses."""
    away_m = np.linalg.norm(one_m - other_m, axis=1)
    return len(np.unique(LIMB_OF_JOINTS[away_m > APART_M]))


def follow_rivals(
    body: Body,
    best: Registration,
    rivals: Sequence[Rival],
    evidence: Evidence,
    elapsed_s: float,
    config: RegistrationConfig,
    pace: Pace = PATIENT_PACE,
) -> tuple[Registration, tuple[Rival, ...]]:
    """Register the rivals to a frame, and return the frame's best registration and the remaining rivals. A rival that
    is likelier by half of ``LEAST_GAIN`` replaces the best pose.

    pace: the rate at which a predicted pose becomes uncertain, the same as for the best pose.
    """
    if not rivals:
        return best, ()
    most, followed = log_probability(body, best.belief.pose, evidence), list[tuple[Registration, Rival]]()
    facing, expected = facing_nats(body, best.belief.pose, evidence.cameras), expected_joints(body, best.belief)
    shown = np.asarray(likelihood(body, best.belief.pose, evidence).seen.any(axis=1))
    for rival in rivals:
        memory_s, error = (MEMORY_S, LIMB_ERROR) if rival.body is None else (OWN_MEMORY_S, OWN_BODY_ERROR)
        old = math.exp(-elapsed_s / memory_s)
        own, predicted = rival.body or body, rival.belief.later(rival.belief.pose, elapsed_s, pace)
        found = register(own, predicted, evidence, no_constraints(), config)
        if not found.found:
            continue
        lead = most - log_probability(own, found.belief.pose, evidence)
        lead = believed(lead, parts_apart(body.joints(best.belief.pose), own.joints(found.belief.pose)), error)
        lead += facing - facing_nats(own, found.belief.pose, evidence.cameras)
        faded, unseen = old * rival.moved, _unseen_moved(expected, shown, own, found, evidence)
        # a rival that is nearer to the expected pose than the best pose (``moved`` below 0) keeps this advantage
        moved = max(faded, unseen + min(faded, 0.0))
        followed.append((found, Rival(found.belief, old * rival.lag + (1.0 - old) * lead, moved, rival.body)))
    able = (one for one in followed if one[1].body is None)
    first = min(able, key=lambda one: one[1].behind, default=None)
    if first is None or first[1].behind >= -LEAST_GAIN / 2.0:
        return best, rivals_of(body, best.belief, [rival for _, rival in followed])
    found, taken = first
    others = [rival for one, rival in followed if one is not found]
    return found, rivals_of(body, found.belief, [rival.beside(taken) for rival in (*others, Rival(best.belief, 0.0))])


def _unseen_moved(expected: Expected, shown: np.ndarray, own: Body, rival: Registration, evidence: Evidence) -> float:
    """Return the cost, in nats, of the places that a rival gives to the limbs which are seen neither in the best pose
    nor in the rival's pose; 0 if both poses differ in the trunk. No image decides about these limbs, only the time
    since they were seen.

    expected: the joints' places in the best pose; their sigma grows while a limb is hidden. shown (PARTS,) bool: the
    limbs that are seen in the best pose.
    """
    joints_m = own.joints(rival.belief.pose)
    away_m = np.linalg.norm(joints_m - expected.joints_m, axis=1)
    if (away_m[LIMB_OF_JOINTS == TRUNK] > APART_M).any():
        return 0.0  # the images of the trunk decide, and hidden limbs follow the trunk
    hidden = ~(shown | likelihood(own, rival.belief.pose, evidence).seen.any(axis=1))
    return float(expected.moved_parts(joints_m)[hidden].sum())


def rivals_of(body: Body, best: PoseBelief, others: Sequence[Rival]) -> tuple[Rival, ...]:
    """Return up to ``MOST`` of the poses ``others``: the poses that increase the sigma of the joints most.

    The returned poses are not excluded by the images (their ``lag`` is below ``DECIDED``), and differ from the best
    pose and from each other. The poses are ranked by their effect on sigma: a body with the opposite facing comes
    before a likelier pose in which only a hand differs.
    """
    kept, places_m = list[Rival](), [body.joints(best.pose)]
    for rival in sorted(others, key=lambda one: one.behind):
        joints_m = rival.joints_m(body)
        if rival.lag < DECIDED and all(parts_apart(joints_m, other_m) for other_m in places_m):
            kept.append(rival)
            places_m.append(joints_m)
    away2 = [float(((joints_m - places_m[0]) ** 2).sum()) for joints_m in places_m[1:]]
    order = sorted(range(len(kept)), key=lambda k: kept[k].behind - np.log(away2[k]))
    return tuple(kept[k] for k in order[:MOST])


def with_rivals(body: Body, joints_m: np.ndarray, sigma_m: np.ndarray, rivals: Sequence[Rival]) -> np.ndarray:
    """Return the sigma (21,) per axis of the joints joints_m (21, 3) of the best pose, enlarged because each of the
    rivals may be the true pose.

    Each rival enlarges a joint's variance by the squared distance between the rival's joint and the joint of the best
    pose (a third per axis), weighted by the rival's probability. The joints of a rival are assumed to have the sigma of
    the best pose.
    """
    weight = np.exp(-np.array([0.0, *(rival.behind for rival in rivals)]))
    weight /= weight.sum()
    variance = sigma_m**2
    for share, rival in zip(weight[1:], rivals, strict=True):
        variance = variance + share * ((rival.joints_m(body) - joints_m) ** 2).sum(axis=1) / 3.0
    return np.asarray(np.sqrt(variance))
