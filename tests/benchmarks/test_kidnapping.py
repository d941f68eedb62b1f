"""A tracker in mid-recording: a fork goes on exactly as it does, a kidnapped one is wrong throughout and as sure."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from body_builder import true_shape
from kidnapping import SEEN_AGAIN, Past, fork, kidnap
from spoilt_poses import Kind, Spoil, depth_in_trunk_m
from ways import Way

from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.reader import open_recording
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import FollowConfig, TrackConfig
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run

FRAMES = 11
CONFIG = TrackConfig(follow=FollowConfig(history=SEEN_AGAIN + 2))
HAND, HEAD = JOINT_INDEX["HandLeft"], JOINT_INDEX["Head"]
LEFT_HAND_ANCHOR = 1


@dataclass(frozen=True, slots=True, eq=False)
class MidRecording:
    """A tracker after some frames, what went before, and where the next frame is on its way."""

    way: Way
    tracker: PatientTracker
    past: Past
    read: int


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> MidRecording:
    out = tmp_path_factory.mktemp("kidnapping") / "single"
    simulate_recording(out, single(5, seconds=FRAMES / 10.0, fps=10.0))
    room = prepare_room(open_recording(out / "recording"), CONFIG)
    with np.load(out / "truth/truth.npz") as truth:
        shape = true_shape(truth["shape_coefficients"], 0.007)  # known: here only the state is tested
    way, past = Way("forward", Run(room, CONFIG), shape, range(FRAMES)), None
    for read, tracker, _ in way.trackers():
        past = Past.of(tracker) if past is None else past
        if tracker.window[0].frame_set.frame > 0:
            past.note(tracker)
        if past.full:
            return MidRecording(way, tracker, past, read)
    raise AssertionError("the recording is too short")


def left_hand_expected(tracker: PatientTracker) -> np.ndarray:
    """(w, 3) where the left hand was expected in the observed frames of the window."""
    return np.array([seen.expected.anchors_m[LEFT_HAND_ANCHOR] for seen in tracker.window.seen])


def test_a_fork_goes_on_exactly_as_the_tracker_and_leaves_it_alone(here):
    forked, again = fork(here.tracker), fork(here.tracker)
    ahead = [here.way.read(place) for place in range(here.read, FRAMES)]
    by_fork = [forked.step(frame_set).joints_m for frame_set in ahead]
    before = here.tracker.belief
    by_other = [again.step(frame_set).joints_m for frame_set in ahead]
    np.testing.assert_array_equal(by_fork, by_other)
    assert here.tracker.belief is before
    assert [frame_set.frame for frame_set in here.tracker.window.frames] == list(range(here.read - 3, here.read))


def test_a_kidnapped_tracker_is_wrong_and_as_sure_as_before(here):
    tracker, spoil = here.tracker, Spoil(Kind.ARM_IN_TRUNK, "Left")
    kidnapped = kidnap(tracker, here.past, spoil)
    hand = tracker.body.joints(kidnapped.belief.pose)[HAND]
    assert depth_in_trunk_m(tracker.body, kidnapped.belief.pose, hand) > 0.06
    assert depth_in_trunk_m(tracker.body, tracker.belief.pose, tracker.body.joints(tracker.belief.pose)[HAND]) < 0.0
    np.testing.assert_array_equal(kidnapped.belief.covariance, tracker.belief.covariance)
    np.testing.assert_array_equal(kidnapped.belief.information, tracker.belief.information)


def test_its_past_and_what_it_has_looked_at_are_wrong_alike(here):
    tracker = here.tracker
    kidnapped = kidnap(tracker, here.past, Spoil(Kind.ARM_IN_TRUNK, "Left"))
    moved_m = np.linalg.norm(np.array(kidnapped.history) - np.array(tracker.history), axis=2)
    assert moved_m[:, HAND].min() > 0.15
    assert moved_m[:, HEAD].max() < 1e-9
    assert list(kidnapped.window.frames) == list(tracker.window.frames)
    away_m = np.linalg.norm(left_hand_expected(kidnapped) - left_hand_expected(tracker), axis=1)
    assert away_m.min() > 0.15
    assert kidnapped.window[0] is not tracker.window[0]


def test_without_enough_past_a_tracker_cannot_be_spoilt_as_a_whole(here):
    past = Past.of(here.tracker)
    assert not past.full
