"""Measure how much more probable the right body is than the body turned round, if both are tracked side by side.

``LIMB_ERROR`` and ``MEMORY_S`` of ``body.rivals`` stand for what this probe measures if little of a body is seen.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from kidnapped import passes_through
from probe import Row, Scene, answer

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.constraints import no_constraints
from anchorpose.body.limb_proposals import exchanged
from anchorpose.body.matched_places import LEAST_MATCHES, fit_matches, matches_of
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import register
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.tracker.patient import PatientTracker

SIDES = [JOINT_INDEX["ShoulderLeft"], JOINT_INDEX["ShoulderRight"]]


def measure(scene: Scene) -> Iterator[Row]:
    """Yield one row: median and spread (nats) of the right facing's lead, and its correlation from frame to frame."""
    with np.load(scene.truth) as archive:
        truth_m = archive["joints"]
    time_pass, *_ = passes_through(scene)
    leads, other, last_s = list[float](), None, 0.0
    for _, tracker, estimate in time_pass.trackers():
        seen = tracker.window[0]
        elapsed_s, last_s = abs(seen.frame_set.time_s - last_s), seen.frame_set.time_s
        other = _followed(tracker, other, elapsed_s)
        if other is None:
            continue
        right = _facing(tracker.body.joints(tracker.belief.pose), truth_m[estimate.frame_set.frame])
        if right * _facing(tracker.body.joints(other.pose), truth_m[estimate.frame_set.frame]) < 0.0:
            nats = [log_probability(tracker.body, one.pose, seen.evidence) for one in (tracker.belief, other)]
            leads.append(float(np.sign(right)) * (nats[0] - nats[1]))
    lead = np.array(leads)
    alike = np.corrcoef(lead[:-1], lead[1:])[0, 1] if len(lead) > 2 else float("nan")
    yield "", {"lead_nats": float(np.median(lead)), "lead_sd": float(lead.std()), "lead_alike": float(alike)}


def _followed(tracker: PatientTracker, other: PoseBelief | None, elapsed_s: float) -> PoseBelief | None:
    """Register the turned body to the frame; None if it is lost. Without ``other``, begin from the tracked body."""
    body, evidence = tracker.body, tracker.window[0].evidence
    begun = other.later(other.pose, elapsed_s) if other is not None else _turned(tracker)
    found = register(body, begun, evidence, no_constraints(), tracker.config.registration)
    return found.belief if found.found else None


def _turned(tracker: PatientTracker) -> PoseBelief:
    """Return the most probable way to turn the tracked body round, by its joints or by the descriptor's matches."""
    body, evidence, pose = tracker.body, tracker.window[0].evidence, tracker.belief.pose
    matches = matches_of(evidence.views, evidence.cameras, PixelLabel.PATIENT)
    turned = [list(exchanged(body, pose))[-1]]
    if len(matches) >= LEAST_MATCHES:
        turned += [fit_matches(body, matches), fit_matches(body, matches.turned)]
    now_m = body.joints(pose)
    away = [one for one in turned if _facing(body.joints(one), now_m) < 0.0] or turned[:1]
    return vague_belief(max(away, key=lambda one: log_probability(body, one, evidence)))


def _facing(joints_m: np.ndarray, truth_m: np.ndarray) -> float:
    """Return a number above 0 if the found and the true joints face the same way."""
    (left, right), (true_left, true_right) = joints_m[SIDES], truth_m[SIDES]
    return float((left - right)[[0, 2]] @ (true_left - true_right)[[0, 2]])


if __name__ == "__main__":
    answer(measure)
