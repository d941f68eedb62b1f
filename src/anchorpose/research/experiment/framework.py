"""Run methods in the paper's tracking framework, from a given pose.

The methods differ in how they match the nodes of the patient's mesh in two frames (Section VI of the paper). A few
methods also differ in other options, which ``Way`` lists, or in settings of the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.calibration.clocks import ClockConfig
from anchorpose.motion.prediction import MotionConfig, MotionRule, load_motions
from anchorpose.recording.recording import FrameSet, Recording, align_clocks
from anchorpose.research.experiment.config import Form
from anchorpose.research.experiment.given import GivenFrames, Reference
from anchorpose.research.experiment.paper_tracker import PaperTracker, Way
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.track_tree.hypotheses import GateConfig, HypothesisConfig
from anchorpose.track_tree.tree import TreeConfig
from anchorpose.tracker.config import FollowConfig, Method, TrackConfig
from anchorpose.tracker.observation import Start
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room, Run

# m, stands for the patient's unknown height in an observation without anchors, since only the search for anchors needs
# the height
NO_HEIGHT_M = np.nan
NEVER_M = 1000.0  # m; no match is this far from its node's predicted place, so the track tree rejects no match
# m, radius around a node's predicted place in which matches are searched, so large that all nodes are searched, as in
# the paper
ANYWHERE_M = 10.0
ALL_NODES = 100_000  # maximum number of nodes that the track tree tracks, so large that it tracks all nodes
PAPER_GATE = GateConfig(anchor_bound_m=0.05, surface_bound_per_m=0.01, search_radius_m=ANYWHERE_M)
"""The paper's limit of the change of a node's distance to an anchor between two frames, as a sum of two parts. The
first part, 5 cm as in the paper, allows for the anchor's jitter. The second part allows for noise of the surface; it is
proportional to the node's mean distance to the anchors. The paper calls this part a "linear function" and states no
numbers; here it is 1 cm per metre.
"""


def paper_config(motions: Path, form: Form = Form.REFINED) -> TrackConfig:
    """Return the paper's configuration of the tracker.

    Holes in the mesh stay open, the pose is predicted from the most similar piece of the reference movements, and each
    body part is registered separately. motions: the file of the reference movements. form: determines whether bad
    matches are rejected.
    """
    return TrackConfig(
        method=Method.PARTS,
        clocks=ClockConfig(estimate=False),  # clocks are not estimated again, since ``Reference`` has them
        tree=TreeConfig() if form.rejects else TreeConfig(missed_cost_m=NEVER_M),
        surface=SurfaceConfig(by_body=False),
        hypotheses=HypothesisConfig(trusted_only=False),
        gate=PAPER_GATE,
        motion=MotionConfig(rule=MotionRule.BEST_SUBLIST, displacement_weight=0.0),
        motions=str(motions),
        follow=FollowConfig(tree_nodes=ALL_NODES),
    )


def paper_room(recording: Recording, reference: Reference, movements: Path) -> Room:
    """Return the recording prepared for tracking (``Room``), with its cameras' clocks aligned as in the reference. All
    forms (variants) of the paper's framework use the same ``Room``.
    """
    return prepare_room(align_clocks(recording, reference.clocks), paper_config(movements))


def run_in(room: Room, movements: Path, form: Form = Form.REFINED, stride: int = 1) -> Run:
    """Return a run: the prepared recording, the configuration ``paper_config`` and the reference movements, which are
    all known before the first frame is tracked.

    stride: number of frames from one used frame to the next. With a stride above 1, the last pose serves as the
    prediction: at so low a rate, the reference movements have too few frames to predict poses.
    """
    config = paper_config(movements, form)
    if stride > 1:
        config = replace(config, motion=MotionConfig(rule=MotionRule.STANDSTILL))
    return Run(room, config, load_motions(config.motion_file, room.recording.rate_hz, config.motion))


def start_at(frame: int, given: GivenFrames, run: Run, way: Way | None = None, stride: int = 1) -> PaperTracker:
    """Return a tracker that starts at a frame (position in the recording) in which the pose is given.

    The prediction of poses (motion dynamics) uses joints of earlier frames, one frame in every ``stride`` frames. The
    joints of these earlier frames are given, too: as many frames as the prediction uses, but only frames after the last
    frame in which the patient was lost.
    """
    reference, way = given.reference, way or Way()
    tracker = PaperTracker(run, given_start(frame, given, run, way.anchored), way, given)
    lost = np.flatnonzero(~reference.found[:frame])
    since = max(lost[-1] + 1 if len(lost) else 0, frame - stride * (run.config.follow.history - 1))
    tracker.history.extendleft(reference.joints_m[since:frame][::-1][stride - 1 :: stride])
    return tracker


def given_start(frame: int, given: GivenFrames, run: Run, anchored: bool = True) -> Start:
    """Return the start of tracking (observation, body and pose) in a frame in which the pose is given.

    All runs whose settings give the same observation of this frame share one start.
    """

    def make() -> Start:
        pose, frame_set = given.reference.pose(frame), given.frame(frame)
        unexpected = given.observe(frame_set, None, NO_HEIGHT_M, run, anchored=False)
        start = Start(unexpected, given.reference.shape, _confident(vague_belief(pose)), 1.0)
        unnamed = PaperTracker(run, start, Way(), given)
        seen = given.observe(frame_set, unnamed.expect(pose), unnamed.height_m, run, anchored)
        return replace(start, observation=seen)

    return given.start(frame, (anchored, _observing(run.config)), make)


def _observing(config: TrackConfig) -> TrackConfig:
    """Return the settings with fixed values for the prediction of poses, the limits of matches (``gate``) and the track
    tree, since observations do not depend on these.
    """
    follow = replace(config.follow, look_ahead=1, tree_nodes=1)
    return replace(config, tree=TreeConfig(), gate=GateConfig(), motion=MotionConfig(), follow=follow)


def follow_segment(tracker: PaperTracker, later: Sequence[FrameSet]) -> np.ndarray:
    """Return the joints (n, 21, 3) in each of the n later frames, metres, world, even of joints that count as lost.

    later: the frames after the tracker's first frame.
    """
    joints = []
    for frame_set in later:
        if tracker.follow(frame_set):
            joints.append(tracker.history[-1])
    while tracker.follow(None):
        joints.append(tracker.history[-1])
    return np.array(joints).reshape(-1, 21, 3)


def _confident(belief: PoseBelief) -> PoseBelief:
    """Return the pose with standard deviations ten times smaller, as if it had been tracked in earlier frames."""
    return PoseBelief(belief.pose, belief.covariance / 100.0, belief.information * 100.0)
