"""The tracking framework of the paper, in which each method replaces the association, all else equal (Section V)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.association.hypotheses import GateConfig, HypothesisConfig
from anchorpose.body.part_registration import PartRegistrationConfig
from anchorpose.body.registration import PoseBelief, vague_belief
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet
from anchorpose.research.experiment.reference import Reference
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.config import FollowConfig, Method, TrackConfig
from anchorpose.tracker.observation import isolate_again, observe, observe_first
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.run import Run
from anchorpose.tracker.start import Start
from anchorpose.tracking.motion import MotionConfig, MotionRule

ANYWHERE_M = 10.0  # every node may be matched with every other, as in the paper
ALL_NODES = 100_000  # the tree starts from every node: a random method needs them all to be told from a good one
PAPER_GATE = GateConfig(anchor_bound_m=0.05, surface_bound_per_m=0.01, search_radius_m=ANYWHERE_M)
"""The paper's bound on the anchors; its "linear function increasing with distance" is not given."""


def paper_config(motions: Path, refined: bool = True) -> TrackConfig:
    """Meshes as the pictures show them, holes and all; the best sub-list predicts; every part by itself.

    motions: the file of the training samples' movements. refined: whether parts that follow their matches are then
    registered to the surface; without, the matches have to say it all.
    """
    return TrackConfig(
        method=Method.PARTS,
        surface=SurfaceConfig(by_body=False),
        hypotheses=HypothesisConfig(trusted_only=False),
        gate=PAPER_GATE,
        motion=MotionConfig(rule=MotionRule.BEST_SUBLIST, displacement_weight=0.0),
        motions=str(motions),
        parts=PartRegistrationConfig() if refined else PartRegistrationConfig(iterations=0),
        follow=FollowConfig(tree_nodes=ALL_NODES),
    )


def start_at(frame: int, frame_set: FrameSet, reference: Reference, run: Run) -> PatientTracker:
    """A tracker of the patient from a frame (position in the recording) on, in which his pose is given.

    So are his joints in the frames before, as far back as he was followed without a gap: the dynamics need a past.
    """
    pose = reference.pose(frame)
    choice = PatientChoice(pose.root_m[[0, 2]], "was followed before anything was removed", True)
    first = observe_first(frame_set, choice, 1.7, run)
    belief = _sure(vague_belief(pose))
    start = Start(first, reference.shape, belief, 1.0)
    unnamed = PatientTracker(run, start)
    expected = unnamed.expect(pose)
    isolated = isolate_again(first, expected, first, run)
    seen = observe(frame_set, isolated, expected, unnamed.height_m, run)
    tracker = PatientTracker(run, replace(start, observation=seen))
    lost = np.flatnonzero(~reference.found[:frame])
    since = max(lost[-1] + 1 if len(lost) else 0, frame - run.config.follow.history + 1)
    tracker.history.extendleft(reference.joints_m[since:frame][::-1])
    return tracker


def follow_segment(tracker: PatientTracker, later: Sequence[FrameSet]) -> np.ndarray:
    """(n, 21, 3) metres, world: the joints in each of the later frames, lost or not: what a method says, counts."""
    joints = []
    for frame_set in later:
        if tracker.step(frame_set) is not None:
            joints.append(tracker.history[-1])
    joints += [tracker.history[-1] for _ in tracker.finish()]
    return np.array(joints).reshape(-1, 21, 3)


def _sure(belief: PoseBelief) -> PoseBelief:
    """A tenth of the spread: the pose was tracked."""
    return PoseBelief(belief.pose, belief.covariance / 100.0, belief.information * 100.0)
