"""For how long the first pass follows the patient, and what it learns from."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from body_builder import asset, standing

from anchorpose.body.config import LearningConfig
from anchorpose.body.learning import LearnedBody
from anchorpose.body.pose import Pose
from anchorpose.body.shape_prior import ShapeBelief, adult_belief, shape_of_height
from anchorpose.body.skin_points import FittedShape, even_clothes
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import UNKNOWN, Subject
from anchorpose.tracker import learning_pass
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.learning_pass import LearntPatient, Stretch, learn_patient, likelier
from anchorpose.tracker.other_statures import PosedFrame
from anchorpose.tracker.room import NO_REVIEW, InitialFrame, Review, Room, Run

ROOM = SimpleNamespace(recording=SimpleNamespace(subject=UNKNOWN), initial_frame=None, review=NO_REVIEW)
START = FittedShape(np.zeros(asset().shape_count), even_clothes(0.006))
ADULT = adult_belief(asset())


def each_more_bent(number: int) -> Pose:
    return standing(LeftLeg=(0.0, 0.0, -0.3 * number))


@dataclass
class Pass:
    """A recording of which each window adds ``gain`` to what was seen, and what was asked of it."""

    step_s: float = 0.1
    gain: float = 10.0
    explained: float = 1.0
    pose: Callable[[int], Pose] = each_more_bent  # of each frame, counted from 0
    read: int = 0
    windows: list[list[float]] = field(default_factory=list)  # times of the frames that were learnt from
    known: list[ShapeBelief] = field(default_factory=list)  # before each of them
    reaches_m: list[float] = field(default_factory=list)  # the first of each
    doubted: list[list[float]] = field(default_factory=list)  # times of the frames on which other statures were tried
    unclear: bool = False  # whether a much taller body explains the frames as well
    worn: list[FittedShape] = field(default_factory=list)
    begun: list[FittedShape | None] = field(default_factory=list)  # with which body each stretch began
    found: tuple[bool, ...] = (True,) * 3  # whether the patient is found in each stretch

    def follow(self, *given: object) -> Iterator[tuple[SimpleNamespace, SimpleNamespace]]:
        *_, known, _start = given
        self.begun.append(known)
        there, tracker = self.found[len(self.begun) - 1], SimpleNamespace(use_shape=self.worn.append, turned=None)
        for number in range(1000):
            self.read = number + 1
            time_s = 50.0 + number * self.step_s
            seen = SimpleNamespace(evidence=time_s)
            yield (
                SimpleNamespace(
                    frame_set=SimpleNamespace(frame=number, time_s=time_s),
                    belief=SimpleNamespace(pose=self.pose(number)) if there else None,
                    shape=START,
                    moved=False,
                    explained=self.explained,
                    observation=seen,
                ),
                tracker,
            )

    def learn(self, *given: Any) -> LearnedBody:
        _, _, poses, evidence, known, _, reaches_m = given
        for pose, time_s in zip(poses, evidence, strict=True):  # what was seen in a frame goes with its pose
            np.testing.assert_array_equal(pose.rotations, self.pose(self.number(time_s)).rotations)
        self.windows.append(evidence)
        self.known.append(known)
        self.reaches_m.append(reaches_m[0])
        shape = replace(known.shape, coefficients=known.shape.coefficients + 0.01)
        return LearnedBody(known.having_seen(shape, self.gain * np.eye(len(known.mean)), known.pull), ())

    def doubt(self, learnt: ShapeBelief, known: ShapeBelief, frames: Sequence[PosedFrame], *_: Any) -> ShapeBelief:
        self.doubted.append([frame.evidence for frame in frames])
        return learnt.including([shape_of_height(asset(), 2.2)], np.array([0.3])) if self.unclear else learnt

    def number(self, time_s: float) -> int:
        return round((time_s - 50.0) / self.step_s)

    def run(
        self,
        monkeypatch: pytest.MonkeyPatch,
        config: LearningConfig | None = None,
        room: SimpleNamespace = ROOM,
        stretches: int = 1,
    ) -> LearntPatient | None:
        monkeypatch.setattr(learning_pass, "follow_openly", self.follow)
        monkeypatch.setattr(learning_pass, "learn_body", self.learn)
        monkeypatch.setattr(learning_pass, "with_other_statures", self.doubt)
        run = Run(room, replace(TrackConfig(), learning=config or LearningConfig()))
        return learn_patient(run, [Stretch(None, None, list)] * stretches)


@pytest.mark.parametrize("step_s", [0.1, -0.1])
def test_a_first_window_is_learnt_from_forwards_and_backwards(monkeypatch, step_s):
    tried = Pass(step_s)
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=4.0))
    assert len(tried.windows) == 1
    assert len(tried.windows[0]) == LearningConfig().frame_count
    times = np.array(tried.windows[0])
    assert (np.diff(times) * step_s > 0.0).all()
    assert np.ptp(times) > 3.5  # spread over the window
    assert learnt.seconds == pytest.approx(4.0, abs=0.4)
    assert tried.worn == []
    assert tried.read == 42  # the window, and the frame that is beyond it
    assert learnt.belief is learnt.first


@pytest.mark.parametrize("longest_s", [10.0, 30.0])
def test_learning_goes_on_to_its_end_however_much_is_known(monkeypatch, longest_s):
    """More frames always measure better: nothing says that enough is known."""
    tried = Pass(gain=1e9)
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=longest_s))
    assert learnt.seconds == pytest.approx(longest_s, abs=0.4)
    assert tried.read == round(longest_s / 0.1) + 2
    assert len(tried.windows) == -(-longest_s // 4.1)


def test_each_window_adds_its_frames_to_what_is_known(monkeypatch):
    tried = Pass()
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=12.0))
    assert len(tried.windows) == 3
    every = [time_s for window in tried.windows for time_s in window]
    assert len({*every}) == len(every)  # no frame says its own twice
    assert every == sorted(every)
    np.testing.assert_array_equal(tried.known[0].prior, ADULT.prior)
    for before, known in enumerate(tried.known):
        np.testing.assert_allclose(known.seen, before * 10.0 * np.eye(len(known.seen)))
    np.testing.assert_allclose(learnt.belief.seen, 30.0 * np.eye(len(ADULT.seen)))
    np.testing.assert_allclose(learnt.first.seen, 10.0 * np.eye(len(ADULT.seen)))
    assert learnt.shape is learnt.belief.shape
    assert learnt.shape.coefficients[0] == pytest.approx(0.03)


def test_each_stretch_of_the_recording_has_its_share_and_begins_with_what_is_known(monkeypatch):
    tried = Pass()
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=12.0), stretches=3)
    assert [len(window) for window in tried.windows] == [12, 6, 6]
    assert learnt.seconds == pytest.approx(12.0, abs=0.4)
    assert tried.begun[0] is None
    assert [shape.coefficients[0] for shape in tried.begun[1:]] == pytest.approx([0.01, 0.02])
    np.testing.assert_allclose(learnt.belief.seen, 30.0 * np.eye(len(ADULT.seen)))


def test_who_is_not_found_in_a_later_stretch_is_not_waited_for(monkeypatch):
    tried = Pass(found=(True, False))
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=8.0), stretches=2)
    assert learnt is not None
    assert len(tried.windows) == 1
    assert tried.read == 42


def test_who_is_found_only_in_a_later_stretch_is_learnt_there(monkeypatch):
    tried = Pass(found=(False, True))
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=8.0), stretches=2)
    assert learnt is not None
    assert len(tried.windows) == 1


def test_the_patient_is_followed_on_with_what_is_known_so_far(monkeypatch):
    tried = Pass()
    tried.run(monkeypatch, LearningConfig(longest_s=12.0))
    assert [shape.coefficients[0] for shape in tried.worn] == pytest.approx([0.01, 0.02])


def test_later_windows_refine_with_half_as_many_frames(monkeypatch):
    tried = Pass()
    tried.run(monkeypatch, LearningConfig(longest_s=12.0, frame_count=8))
    assert [len(window) for window in tried.windows] == [8, 4, 4]
    assert tried.reaches_m[0] > tried.reaches_m[1] == tried.reaches_m[2]


def test_frames_with_different_poses_are_chosen_of_twice_as_many(monkeypatch):
    """Every third frame is a candidate; in five of these, and in two others, a knee is bent, each time farther."""
    bent = {9, 10, 15, 20, 24, 30, 33}
    tried = Pass(pose=lambda number: standing(LeftLeg=(0.0, 0.0, -3.0 * number if number in bent else -0.01 * number)))
    tried.run(monkeypatch, LearningConfig(longest_s=4.0, frame_count=8))
    (times,) = tried.windows
    chosen = {tried.number(time_s) for time_s in times}
    assert len(chosen) == 8
    assert all(number % 3 == 0 for number in chosen)
    assert chosen & bent == {9, 15, 24, 30, 33}


def test_fewer_frames_than_asked_for_are_all_learnt_from(monkeypatch):
    tried = Pass(step_s=1.0)
    tried.run(monkeypatch, LearningConfig(longest_s=4.0))
    assert tried.windows == [[50.0, 51.0, 52.0, 53.0, 54.0]]


def test_frames_that_a_reviewer_marked_as_unusable_teach_nothing(monkeypatch):
    tried = Pass()
    marked = SimpleNamespace(**{**vars(ROOM), "review": Review(unusable=((10, 19, "a curtain"),))})
    assert tried.run(monkeypatch, room=marked) is not None
    frames = [tried.number(time_s) for time_s in tried.windows[0]]
    assert not set(frames) & set(range(10, 20))
    assert max(frames) > 19


def test_where_nothing_is_to_be_learnt_the_first_body_is_kept_and_unexplained_frames_teach_nothing(monkeypatch):
    tried = Pass()
    learnt = tried.run(monkeypatch, LearningConfig(own_shape=False))
    assert tried.read == 1
    assert tried.windows == []
    assert learnt.shape is START
    assert learnt.belief is learnt.first
    assert learnt.seconds == 0.0
    assert Pass(explained=0.2).run(monkeypatch) is None


def test_other_statures_are_tried_on_the_longest_window_of_each_stretch(monkeypatch):
    tried = Pass()
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=12.0), stretches=2)
    (times,) = tried.doubted
    assert len(times) == 2 * 21  # every 0.2 s of 4 s
    assert learnt.belief is not learnt.first


@pytest.mark.parametrize("unclear", [False, True])
def test_a_height_is_refused_only_by_images_that_show_the_height(monkeypatch, unclear):
    stated = SimpleNamespace(recording=SimpleNamespace(subject=Subject(height_m=2.1)), review=NO_REVIEW)
    tried = Pass(unclear=unclear, gain=1e6)
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=4.0), stated)
    assert ("stated height" in learnt.contradiction) != unclear
    # tried before the stated height is refused, and, once it is refused, for the body without it
    assert len(tried.doubted) == (1 if unclear else 2)


def turning_round(number: int) -> Pose:
    return standing(Hips=(0.0, 180.0 if number >= 60 else 0.0, 0.0))


@pytest.mark.parametrize(("one_facing", "windows"), [(False, 2), (True, 1)])
def test_a_pass_for_one_facing_ends_where_the_body_turns_round(monkeypatch, one_facing, windows):
    monkeypatch.setattr(learning_pass, "follow_openly", Pass(pose=turning_round).follow)
    monkeypatch.setattr(learning_pass, "_moved", lambda before, after: 9.0)
    run = Run(ROOM, TrackConfig())
    found = list(learning_pass._windows(run, Stretch(None, None, list), None, 8.0, one_facing))
    assert len(found) == windows
    assert [one.moved for one in found] == [0.0, 9.0][:windows]


def test_tracking_begins_where_learning_found_the_patient():
    """In a room whose initial frame shows too little of the patient, and in a room where it shows enough."""
    recording = SimpleNamespace(streams=[SimpleNamespace(frame=np.array([10, 12, 14, 16]))])
    place = PatientChoice(np.array([9.0, 9.0]), "", sure=True)
    initial = InitialFrame(3, place, 0.5, 1.0, alone=False)
    room = Room(recording, None, None, (), (initial,), NO_REVIEW)
    learnt = LearntPatient(ADULT, ADULT, 0.0, standing((0.1, 0.9, 0.2)), 12)
    found, before = learnt.where_found(room).initial_frames
    assert before is initial
    assert (found.frame, found.choice.frame) == (1, 12)
    np.testing.assert_allclose(found.choice.ground_xz_m, [0.1, 0.2])
    assert replace(learnt, frame=16).where_found(room) is room


def facing(
    name: str, known: list[float], moved: float = 0.0, seen: float = 0.0
) -> Iterator[tuple[LearntPatient, SimpleNamespace]]:
    """Windows of a facing, each with the log probability of what is known and seen, and the cost of turning round."""
    shape = FittedShape(START.coefficients + (name == "theirs"), START.offset_m)
    learnt = LearntPatient(replace(ADULT, shape=shape), ADULT, 0.0, standing(), 7)
    for number, nats in enumerate(known):
        yield replace(learnt, seconds=float(number)), SimpleNamespace(known=nats, moved=moved, nats=seen, kept=[])


@pytest.mark.parametrize(
    ("mine", "theirs", "moved", "wins", "behind"),
    [
        ([0.0], [-9.0], 0.0, "mine", None),  # the other body is rare, or faces away from the camera
        ([0.0, 0.0], [4.0, 9.0], 0.0, "theirs", None),  # later windows decide where the first one does not
        ([0.0, 0.0], [0.0, 0.0], 20.0, "theirs", None),  # mine turned round between two frames
        ([0.0, 0.0], [0.0, -4.0], 0.0, "mine", 4.0),  # the end does not decide
        ([0.0, 0.0], [0.0, 4.0], 0.0, "theirs", 4.0),
        ([0.0, 0.0], [], 0.0, "mine", None),  # nobody who faces the other way is found
        ([0.0, 0.0], [5.0], 0.0, "mine", None),  # or not for as long
    ],
)
def test_all_windows_together_decide_on_the_facing(monkeypatch, mine, theirs, moved, wins, behind):
    monkeypatch.setattr(learning_pass, "known_nats", lambda learnt, window, run: window.known)
    monkeypatch.setattr(learning_pass, "window_nats", lambda learnt, window, run: window.nats)
    learnt = likelier(facing("mine", mine, moved), facing("theirs", theirs), None)[0]
    own, other = START.coefficients[0], START.coefficients[0] + 1.0
    assert learnt.shape.coefficients[0] == (own if wins == "mine" else other)
    assert learnt.seconds == len(mine) - 1.0 if wins == "mine" else len(theirs) - 1.0
    assert (None if learnt.turned is None else learnt.turned.behind) == behind
    if learnt.turned is not None:  # the body of the facing that lost
        assert learnt.turned.shape.coefficients[0] == (other if wins == "mine" else own)


def test_images_count_by_their_mean_since_errors_of_shape_are_the_same_in_all_windows(monkeypatch):
    """A lead of 30 nats has a standard error of 30: three such windows decide no more than one."""
    monkeypatch.setattr(learning_pass, "known_nats", lambda learnt, window, run: 0.0)
    monkeypatch.setattr(learning_pass, "window_nats", lambda learnt, window, run: window.nats)
    for count in (1, 3):
        learnt = likelier(facing("mine", [0.0] * count), facing("theirs", [0.0] * count, seen=-30.0), None)[0]
        assert learnt.turned.behind == pytest.approx(1.67, abs=0.01)
    assert likelier(facing("mine", [0.0]), facing("theirs", [0.0], seen=-200.0), None)[0].turned is None


@pytest.mark.parametrize("height_m", [None, 1.7])
def test_an_unusual_shape_has_the_error_of_the_images_but_a_stated_height_has_not(monkeypatch, height_m):
    monkeypatch.setattr(learning_pass, "frames_nats", lambda shape, frames, config: 0.0)
    recording = SimpleNamespace(subject=replace(UNKNOWN, height_m=height_m))
    run = SimpleNamespace(room=SimpleNamespace(recording=recording, cameras=()), config=TrackConfig())
    window = SimpleNamespace(kept=[SimpleNamespace(pose=standing(), evidence=None)])
    usual, tall = (
        replace(
            LearntPatient(ADULT, ADULT, 0.0, standing(), 7), belief=replace(ADULT, shape=shape_of_height(asset(), m))
        )
        for m in (1.7, 1.95)
    )
    seen = learning_pass.window_nats(usual, window, run) - learning_pass.window_nats(tall, window, run)
    known = learning_pass.known_nats(usual, window, run) - learning_pass.known_nats(tall, window, run)
    assert 0.5 < seen < 5.0
    assert known == pytest.approx(0.0, abs=1e-9) if height_m is None else known > 20.0


def test_what_is_decided_is_not_followed_on(monkeypatch):
    monkeypatch.setattr(learning_pass, "known_nats", lambda learnt, window, run: window.known)
    monkeypatch.setattr(learning_pass, "window_nats", lambda learnt, window, run: window.nats)
    other = facing("theirs", [-100.0] * 3)
    assert likelier(facing("mine", [0.0] * 3), other, None)[0].seconds == 2.0
    assert len(list(other)) == 2
