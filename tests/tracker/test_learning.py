"""For how long the first pass follows the patient, and what it learns from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import asset

from anchorpose.body.config import LearningConfig
from anchorpose.body.learning import LearnedBody
from anchorpose.body.shape_prior import ShapeBelief, adult_belief
from anchorpose.body.skin_points import FittedShape
from anchorpose.tracker import learning
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.learning import LearntPatient, learn_patient
from anchorpose.tracker.room import NO_REVIEW, Review
from anchorpose.tracker.run import Run

ROOM = SimpleNamespace(recording=SimpleNamespace(subject_height_m=None), initial_frame=None, review=NO_REVIEW)
START = FittedShape(np.zeros(asset().shape_count), 0.006)


@dataclass
class Pass:
    """A recording in which each window multiplies what is known by ``gains`` in turn, and what was asked of it."""

    gains: list[float]
    step_s: float = 0.1
    explained: float = 1.0
    read: int = 0
    windows: list[list[float]] = field(default_factory=list)  # times of the frames that were learnt from
    worn: list[FittedShape] = field(default_factory=list)

    def follow(self, *_: object) -> Iterator[tuple[SimpleNamespace, SimpleNamespace]]:
        for number in range(1000):
            self.read = number + 1
            time_s = 50.0 + number * self.step_s
            seen = SimpleNamespace(evidence=time_s)
            yield (
                SimpleNamespace(
                    frame_set=SimpleNamespace(frame=number, time_s=time_s), belief=SimpleNamespace(pose=None),
                    shape=START, explained=self.explained, observation=seen,
                ),
                SimpleNamespace(use_shape=self.worn.append),
            )  # fmt: skip

    def learn(
        self, _points: object, _shape: object, _poses: object, evidence: list[float], known: ShapeBelief, *_: object
    ) -> LearnedBody:
        self.windows.append(evidence)
        gain = self.gains[min(len(self.windows), len(self.gains)) - 1]
        coefficients = known.shape.coefficients + 0.01
        return LearnedBody(ShapeBelief(FittedShape(coefficients, 0.006), gain * known.information), ())

    def run(
        self, monkeypatch: pytest.MonkeyPatch, config: LearningConfig | None = None, room: SimpleNamespace = ROOM
    ) -> LearntPatient | None:
        monkeypatch.setattr(learning, "follow_openly", self.follow)
        monkeypatch.setattr(learning, "learn_body", self.learn)
        return learn_patient(Run(room, replace(TrackConfig(), learning=config or LearningConfig())), [])


@pytest.mark.parametrize("step_s", [0.1, -0.1])
def test_one_window_is_enough_where_it_shows_all_bones_forwards_and_backwards(monkeypatch, step_s):
    tried = Pass([1e6], step_s)
    learnt = tried.run(monkeypatch)
    assert learnt is not None
    assert len(tried.windows) == 1
    assert len(tried.windows[0]) >= 10  # spread over the window
    assert learnt.seconds == pytest.approx(4.0, abs=0.4)
    assert tried.worn == []
    assert tried.read == 42  # the window, and the frame that closes it
    assert learnt.belief is learnt.first


def test_frames_that_a_reviewer_marked_as_unusable_teach_nothing(monkeypatch):
    tried = Pass([1e6])
    marked = SimpleNamespace(**{**vars(ROOM), "review": Review(unusable=((10, 19, "a curtain"),))})
    assert tried.run(monkeypatch, room=marked) is not None
    frames = [round((time_s - 50.0) / 0.1) for time_s in tried.windows[0]]
    assert not set(frames) & set(range(10, 20))
    assert max(frames) > 19


def test_he_is_followed_on_with_what_is_known_until_every_bone_is(monkeypatch):
    tried = Pass([10.0, 10.0, 1e6])
    learnt = tried.run(monkeypatch)
    assert learnt is not None
    assert len(tried.windows) == 3
    assert not {*tried.windows[0]} & {*tried.windows[1]}  # no frame says its own twice
    assert [shape.coefficients[0] for shape in tried.worn] == pytest.approx([0.01, 0.02])
    assert learnt.shape.coefficients[0] == pytest.approx(0.03)
    np.testing.assert_allclose(learnt.belief.information, 1e8 * adult_belief(asset()).information)
    np.testing.assert_allclose(learnt.first.information, 10.0 * adult_belief(asset()).information)


def test_learning_ends_where_a_bone_stays_hidden(monkeypatch):
    tried = Pass([1.0])
    learnt = tried.run(monkeypatch, LearningConfig(longest_s=10.0))
    assert learnt is not None
    assert learnt.seconds == pytest.approx(10.0, abs=0.4)
    assert tried.read == 102


def test_frames_that_the_body_does_not_explain_teach_nothing(monkeypatch):
    assert Pass([1e6], explained=0.2).run(monkeypatch) is None
