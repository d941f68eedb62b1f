"""Observe a frame: label its people, mesh the patient, find the anchors. Hold the look-ahead, which is the later frames
that are read before a pose is estimated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress, pairwise

import numpy as np

from anchorpose.body.evidence import gather_evidence
from anchorpose.body.explanation import segment_of_points
from anchorpose.body.kinematics import missing_anchors
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, body_points
from anchorpose.geodesics.anchors import Anchors, find_anchors
from anchorpose.isolation.bystander_memory import BystanderMemory, empty_memory, update_memory
from anchorpose.isolation.hidden_limbs import HiddenSkin, label_hidden_limbs
from anchorpose.isolation.ownership import OwnershipLikelihood, join_likelihoods
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.scene import Pieces, find_all_pieces
from anchorpose.isolation.separation import by_distance, label_people, separate
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.rotations import FORWARD, UP
from anchorpose.surface.border import Border, border
from anchorpose.surface.patient_surface import blank_view, patient_surface
from anchorpose.surface.surface import seen_part
from anchorpose.track_tree.global_hypothesis import GlobalHypothesis, global_hypothesis, link
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.bystanders import (
    GROWTH_M_S,
    SKIN_SIGMA_M,
    Bystanders,
    bystander_likelihood,
    bystanders_placed,
    first_bystanders,
    follow_bystanders,
    label_by_bodies,
)
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import (
    AnchorDistances,
    Expectation,
    Isolated,
    Observation,
    SeenSurface,
    is_described,
)
from anchorpose.tracker.one_patient import one_patient
from anchorpose.tracker.room import Run
from anchorpose.tracker.sighting import IN_EACH_OTHER_M, Crowd, see_people_apart
from anchorpose.tracker.steps import facing_points, find_steps, step_onto

# m, half a limb's width; predicted skin with a larger sigma is not used to decide which pixels show the patient
LOOSEST_SKIN_M = 0.05
UNFITTED_M_S = 1.2  # m/s, growth of the skin's sigma while the body is not fitted: the speed of a leg


def observe_first(
    frame_set: FrameSet, choice: PatientChoice, height_m: float, run: Run, crowd: Crowd | None = None
) -> Observation:
    """Observe a frame in which only the patient's place is known. crowd: the frame's people, None if not found yet."""
    isolated = isolate_first(frame_set, choice, run, crowd)
    return observe(frame_set, isolated, None, height_m, run)


def people_of(frame_set: FrameSet, run: Run) -> Crowd:
    """Return the people of a frame, found without knowledge from other frames."""
    with run.stage("isolation"):
        return see_people_apart(find_all_pieces(frame_set, run.room.scenes), run.room.cameras)


def isolate_first(frame_set: FrameSet, choice: PatientChoice, run: Run, crowd: Crowd | None = None) -> Isolated:
    """Label the people of a frame in which only the patient's place is known. crowd: the frame's people, None if not
    found yet.
    """
    cameras, bystanders = run.room.cameras, Bystanders()
    crowd = crowd or people_of(frame_set, run)
    with run.stage("isolation"):
        order = by_distance(crowd.people, choice.ground_xz_m)
        views = label_people(crowd.pieces, crowd.people, order)
    if run.config.follow.bystanders:
        with run.stage("bystanders"):
            fitted = {PixelLabel.PATIENT + k: crowd.bodies[number] for k, number in enumerate(order.tolist())}
            bystanders, patient = first_bystanders(fitted, views, cameras), fitted.get(PixelLabel.PATIENT)
            if bystanders.followed and patient is not None:
                views = label_by_bodies(crowd.pieces, views, patient, bystanders, cameras)
    return _isolated(crowd.pieces, views, empty_memory(), bystanders, 0.0, run)


def isolate(frame_set: FrameSet, expected: Expectation, before: Observation, run: Run) -> tuple[Isolated, np.ndarray]:
    """Label the people of a frame from the patient's expected place and the bystanders of the frame before.

    Also return the step (3,) over the ground from the patient's expected place to the seen place; zero if both agree.
    """
    with run.stage("isolation"):
        pieces = find_all_pieces(frame_set, run.room.scenes)
        memory = walked(before, pieces, run)
        step = step_of(expected, memory, pieces, run)
    elapsed_s = frame_set.time_s - before.frame_set.time_s  # negative in a backward pass
    expected = expected.moved(step) if step.any() else expected
    others = bystanders_placed(before.bystanders, memory, pieces, run.room.cameras, elapsed_s)
    apart = _not_in(others, expected.skin.points_m.mean(axis=0))
    views = _separated(pieces, expected, memory, apart, is_described(frame_set), elapsed_s, run)
    bystanders = see_bystanders(others, views, elapsed_s, run)
    return _isolated(pieces, views, memory, bystanders, elapsed_s, run), step


def _not_in(bystanders: Bystanders, place_m: np.ndarray) -> Bystanders:
    """Return the bystanders, except those with a body that overlaps the patient's expected place (3,): such a body was
    fitted to the patient's surface by mistake.
    """
    apart = [
        np.linalg.norm((one.belief.pose.root_m - place_m)[[0, 2]]) > IN_EACH_OTHER_M for one in bystanders.followed
    ]
    return replace(bystanders, followed=tuple(compress(bystanders.followed, apart)))


def walked(before: Observation, pieces: Sequence[Pieces | None], run: Run) -> BystanderMemory:
    """Return the memory of ``before`` (the skin of all people as last seen). In it, the skin that ``before`` shows is
    moved by each person's step, to where the next frame's pixels (``pieces``) show this person.
    """
    memory = before.memory
    return memory.moved(find_steps(memory.seen_last, pieces, run.room.cameras))


def step_of(expected: Expectation, memory: BystanderMemory, pieces: Sequence[Pieces | None], run: Run) -> np.ndarray:
    """Return the step (3,) from the patient's expected place to the place where the remembered skin (``memory``) shows
    the patient; zero if both agree.
    """
    seen_m = memory.seen_last.get(PixelLabel.PATIENT)
    if seen_m is None:
        return np.zeros(3)
    cameras = run.room.cameras
    front = facing_points(expected.skin.points_m, expected.skin.normals, cameras)
    return step_onto(front, seen_m, pieces, cameras)


def patient_likelihood(expected: Expectation, elapsed_s: float) -> tuple[OwnershipLikelihood, HiddenSkin]:
    """Return the likelihood that a place belongs to the patient, from the predicted skin; and, as a separate value, the
    predicted skin of limbs that have been hidden for long. elapsed_s: time since the last frame.

    The patient's predicted skin is assumed to be as uncertain as a bystander's. Where the patient and a bystander are
    both expected, a pixel gets the label of the person whose predicted skin is nearer, or to whose surface the pixel is
    connected. If the patient's skin were assumed to be more certain, it would take pixels from other people, and these
    pixels would then confirm a wrong pose.

    A limb that has been hidden for long is left out of the likelihood, since otherwise any surface near its predicted
    place would be mistaken for this limb. When the limb reappears, its connection to the patient's surface shows whose
    limb it is. If it reappears as a separate piece without a person's label, the place of the piece's centre decides
    whether the piece gets the patient's label (``label_hidden_limbs``).
    """
    spread = SKIN_SIGMA_M + GROWTH_M_S * abs(elapsed_s) + UNFITTED_M_S * expected.unfitted_s
    sure, sigma = expected.sigma_m < LOOSEST_SKIN_M, np.hypot(spread, expected.sigma_m)
    points_m, owner = expected.skin.points_m, np.full(int(sure.sum()), PixelLabel.PATIENT, np.uint8)
    hidden = HiddenSkin(points_m[~sure], sigma[~sure], segment_of_points(body_points())[~sure])
    return OwnershipLikelihood(points_m[sure], owner, sigma[sure].astype(np.float32)), hidden


def _separated(
    pieces: Sequence[Pieces | None],
    expected: Expectation,
    memory: BystanderMemory,
    bystanders: Bystanders,
    due: bool,
    elapsed_s: float,
    run: Run,
) -> tuple[View | None, ...]:
    """Label the pixels of all people; due: whether the learnt descriptor searches the patient's pixels for other people
    in any case; elapsed_s: time since the frame in which the bystanders' bodies were fitted.
    """
    with run.stage("isolation"):
        others = bystander_likelihood(bystanders, body_points(), elapsed_s)
        mine, hidden = patient_likelihood(expected, elapsed_s)
        views = separate(pieces, memory, join_likelihoods([others, mine]), elapsed_s, run.room.cameras)
        views = label_hidden_limbs(pieces, views, hidden)
        place_xz_m, free = expected.skin.points_m.mean(axis=0)[[0, 2]], memory.free_labels(elapsed_s)
        return one_patient(pieces, views, run.room.cameras, mine.points_m, place_xz_m, free, due)


def see_bystanders(before: Bystanders, views: Sequence[View | None], elapsed_s: float, run: Run) -> Bystanders:
    """Return the bystanders of the next frame, or ``before`` if the settings switch off the bystanders' bodies."""
    if not run.config.follow.bystanders:
        return before
    with run.stage("bystanders"):
        return follow_bystanders(before, views, run.room.cameras, body_points(), elapsed_s)


def _isolated(
    pieces: Sequence[Pieces | None],
    views: Sequence[View | None],
    before: BystanderMemory,
    bystanders: Bystanders,
    elapsed_s: float,
    run: Run,
) -> Isolated:
    with run.stage("isolation"):
        memory = update_memory(before, pieces, views, run.room.cameras, elapsed_s)
    return Isolated(tuple(pieces), tuple(views), memory, bystanders)


def observe(
    frame_set: FrameSet, isolated: Isolated, expected: Expectation | None, height_m: float, run: Run
) -> Observation:
    """Compute the patient's surface and anchors in a frame whose people are labelled. height_m: the patient's height,
    with which the distances between anchors scale.
    """
    surface = see_surface(isolated, expected, run)
    anchors = see_anchors(surface, expected, height_m, run)
    return gather(frame_set, expected, isolated, surface, anchors, run)


def see_surface(isolated: Isolated, expected: Expectation | None, run: Run) -> SeenSurface:
    """Mesh the patient's pixels; cut the mesh where body parts are expected to touch, and close it over hidden skin."""
    cameras = run.room.cameras
    shown = [blank_view(camera) if view is None else view for view, camera in zip(isolated.views, cameras, strict=True)]
    with run.stage("surface"):
        whole = patient_surface(shown, cameras, None if expected is None else expected.skin, run.config.surface)
        kind = border(whole, shown)
        seen = seen_part(whole)
    with run.stage("registration"):
        noises = [None if pieces is None else pieces.sensor.noise for pieces in isolated.pieces]
        evidence = gather_evidence(seen, isolated.views, cameras, run.room.calibration.floor_height_m, noises)
    return SeenSurface(whole, seen, kind, evidence)


def see_anchors(surface: SeenSurface, expected: Expectation | None, height_m: float, run: Run) -> Anchors:
    """Find the anchors (head, hands and feet) on the patient's surface. height_m: the patient's height, with which the
    distances between anchors scale.
    """
    with run.stage("geodesics"):
        facing, places = (FORWARD, None) if expected is None else (expected.facing, expected.anchors_m)
        cut = surface.border == Border.CUT
        missing = missing_anchors(run.room.recording.subject.missing)
        return find_anchors(surface.whole, UP, facing, height_m, cut, places, run.config.anchors, missing)


def gather(
    frame_set: FrameSet,
    expected: Expectation | None,
    isolated: Isolated,
    surface: SeenSurface,
    anchors: Anchors,
    run: Run,
) -> Observation:
    """Join the results of all stages of one frame."""
    return Observation(
        frame_set,
        expected,
        surface.evidence,
        surface.seen,
        surface.whole,
        anchors,
        AnchorDistances(surface, anchors, run.config.hypotheses.trusted_only, run.stopwatch),
        surface.border[: len(surface.seen)],
        isolated.pieces,
        isolated.memory,
        isolated.bystanders,
    )


Associate = Callable[[Observation, Observation, TrackConfig], Matcher]
"""Function that decides which nodes of two successive frames show the same place of the skin; by default ``link``."""


class Window:
    """The last registered frame and the look-ahead (later frames that are read before the next pose is estimated).
    Nodes are matched only if the track tree is used.
    """

    run: Run
    frames: deque[FrameSet]  # all frames of the window
    seen: deque[Observation]  # observations of the window's first frames; its last frames may not be observed yet
    _matchers: deque[Matcher | None]

    def __init__(self, first: Observation, run: Run) -> None:
        self.run = run
        self.frames = deque([first.frame_set])
        self.seen = deque([first])
        self._matchers = deque()

    def __getstate__(self) -> dict[str, object]:
        """Return the state to store, without the matches, which are computed again when needed."""
        return {**self.__dict__, "_matchers": deque([None] * len(self._matchers))}

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, number: int) -> Observation:
        return self.seen[number]

    def append(self, frame_set: FrameSet) -> None:
        """Add one more frame to the look-ahead."""
        self.frames.append(frame_set)

    def see(self, seen: Observation) -> None:
        """Add the observation of the first frame of the window that has no observation yet."""
        self._matchers.append(None)
        self.seen.append(seen)

    def replace_next(self, seen: Observation) -> None:
        """Replace the observation of the frame after the last registered frame."""
        self.seen[1] = seen
        for number in range(min(2, len(self._matchers))):
            self._matchers[number] = None

    def restart(self, seen: Observation) -> None:
        """Replace the observation of the frame after the last registered frame by an observation with other person
        labels, and forget the later observations, whose labels follow from the replaced labels.
        """
        while len(self.seen) > 2:
            self.seen.pop()
            self._matchers.pop()
        self.replace_next(seen)

    def move_on(self) -> None:
        """Drop the window's first frame, since its second frame is registered now."""
        for held in (self.frames, self.seen, self._matchers):
            held.popleft()

    def matchers(self) -> list[Matcher]:
        """Return one matcher for each pair of successive observed frames. For each node of the earlier frame, a matcher
        gives one node of the later frame per subset of the anchors.
        """
        associate = self.run.associate or (lambda now, later, config: link(now, later, config.hypotheses, config.gate))
        found = [
            associate(now, following, self.run.config) if matcher is None else matcher
            for matcher, (now, following) in zip(self._matchers, pairwise(self.seen), strict=True)
        ]
        self._matchers = deque(found)
        return found

    def global_hypothesis(self, body: Body, pose: Pose, predicted: Sequence[Pose]) -> GlobalHypothesis:
        """Search the track tree over all observed frames. pose: the pose in the first frame; predicted: the predicted
        poses in all later frames.
        """
        config = self.run.config
        return global_hypothesis(
            body, pose, predicted, list(self.seen), self.matchers(), config.follow.tree_nodes, config.tree
        )
