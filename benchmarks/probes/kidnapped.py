"""Measure whether the tracker returns to the right pose after a wrong prediction.

In the middle of a simulated recording the tracker's pose is made wrong (``spoilt_poses.Kind``): an arm is put into the
trunk, the arms are exchanged, a leg is put onto the other, the body is turned round. The tracker is as confident of
this pose as it was of the right one, the poses that it remembers are spoilt in the same way (``kidnap``), and tracking
goes on. The pose is right again if, from 0.5 s later at the latest until 1 s later, every joint of the limbs concerned
is within 100 mm of the truth, or its error is at most 50 mm larger than that of the undisturbed tracker. Joints are
taken from the tracker's pose, also if it calls them lost. Poses are only made wrong in frames in which one camera sees
most of each of these limbs for the second that follows. The recording is tracked forward and backward in time.

Scores of each kind of wrong pose: the number of trials, the share of trials that became right again, and the median
time until then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any, Final, TypeVar

import numpy as np
from kidnap import Past, kidnap
from probe import Row, Scene, answer
from spoilt_poses import Kind, Spoil, spoilt

from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body
from anchorpose.motion.prediction import load_motions
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import FrameSet
from anchorpose.results.evaluate import LIMBS_JUDGED, in_plain_view
from anchorpose.results.truth import Truth, read_truth
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run
from anchorpose.tracker.start import NoStart, find_start

Choice = TypeVar("Choice")
RIGHT_M, EXCESS_M = 0.10, 0.05  # distance from the truth; error above that of the undisturbed tracker
WITHIN_S, UNTIL_S = 0.5, 1.0  # after the spoiling: when a limb must be right again, and until when it must stay so
EPSILON_S: Final = 1e-6  # times are sums of frame periods
SPOILT_M: Final = 0.15  # a pose nearer to the truth is not wrong, such as an arm that lay on the belly anyway
HEIGHTS: Final = (0.2, 0.75)  # at which a hand is put into the trunk: from the belly to the chest
LEAST_LIMBS: Final = 3  # minimum number of limbs in plain view, the trunk among them, if the body is turned round


@dataclass(frozen=True, slots=True, eq=False)
class TimePass:
    """A pass through a recording in one direction of time: positions of its frames, and the learnt body."""

    run: Run
    shape: FittedShape
    positions: Sequence[int]

    @property
    def body(self) -> Body:
        """The patient's body."""
        return build_body(body_points(), self.shape)

    def read(self, place: int) -> FrameSet:
        """Return the frame at an index of ``positions``; the frames read last are cached."""
        return _read(self.run, self.positions[place])

    def trackers(self) -> Iterator[tuple[int, PatientTracker, Estimate]]:
        """Yield after each estimate the number of frames read, the tracker (not to be changed), and the estimate.

        End if the patient is not found or is lost.
        """
        initial = self.run.room.initial_frame
        start = None if initial is None else find_start(self.read(0), self.run, initial.choice, self.shape)
        if start is None or isinstance(start, NoStart):
            return
        tracker = PatientTracker(self.run, start)
        yield 1, tracker, tracker.first
        for place in range(1, len(self.positions)):
            estimate = tracker.step(self.read(place))
            if estimate is not None:
                yield place + 1, tracker, estimate
            if tracker.last.gone_s > self.run.config.follow.lost_after_s:
                return


@lru_cache(maxsize=64)
def _read(run: Run, position: int) -> FrameSet:
    return read_frame(run.room.recording, position)


def passes_through(scene: Scene) -> tuple[TimePass, ...]:
    """Return two passes: to the farther end of a recording, and back from there; no pass if no person is found."""
    recording, config = open_recording(scene.recording), TrackConfig(**scene.settings)
    room = prepare_room(recording, config)
    run = Run(room, config, load_motions(config.motion_file, recording.rate_hz, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    longer = max(route.forward, route.backward, key=len)
    if learnt is None or len(longer) < 2:
        return ()
    return TimePass(run, learnt.shape, longer), TimePass(run, learnt.shape, longer[::-1])


@dataclass(frozen=True, slots=True, eq=False)
class Undisturbed:
    """Poses of the undisturbed tracker by frame, in the order of tracking. joints_m: (21, 3), also of lost joints."""

    joints_m: dict[int, np.ndarray]
    poses: dict[int, Pose]


def undisturbed(time_pass: TimePass) -> Undisturbed:
    """Track a pass without wrong poses."""
    found = Undisturbed({}, {})
    for _, tracker, estimate in time_pass.trackers():
        found.joints_m[estimate.frame_set.frame] = tracker.body.joints(tracker.belief.pose)
        found.poses[estimate.frame_set.frame] = tracker.belief.pose
    return found


@dataclass(slots=True)
class Judge:
    """Judges the poses after a wrong pose, whatever the states of their joints; ``done`` once the outcome is certain.

    began_s: time of the frame with the wrong pose. joints (k,): those to judge. truth_m, undisturbed_m: joints (21, 3)
    by frame number. right_since_s: s after began_s; None while some joint is wrong.
    """

    began_s: float
    joints: np.ndarray
    truth_m: Callable[[int], np.ndarray]
    undisturbed_m: Callable[[int], np.ndarray]
    done: bool = False
    right_since_s: float | None = None

    def take(self, frame: int, time_s: float, joints_m: np.ndarray) -> None:
        """Judge the next frame in the order of tracking by the joints (21, 3) of the tracker's pose."""
        after_s = abs(time_s - self.began_s)
        if after_s > UNTIL_S + EPSILON_S:
            self.done = True
            return
        truth_m = self.truth_m(frame)[self.joints]
        error_m = np.linalg.norm(joints_m[self.joints] - truth_m, axis=1)
        usual_m = np.linalg.norm(self.undisturbed_m(frame)[self.joints] - truth_m, axis=1)
        if (error_m > np.maximum(RIGHT_M, usual_m + EXCESS_M)).any():
            self.right_since_s = None
        elif self.right_since_s is None:
            self.right_since_s = after_s
        since_s = after_s if self.right_since_s is None else self.right_since_s
        self.done = since_s > WITHIN_S + EPSILON_S

    @property
    def recovered_s(self) -> float:
        """Return the seconds after which the pose was right and stayed right; infinity if that was too late."""
        since_s = self.right_since_s
        return since_s if since_s is not None and since_s <= WITHIN_S + EPSILON_S else float("inf")


def draw_spoil(kind: Kind, seed: int, frame: int) -> Spoil:
    """Draw side and height at random, always the same for the same kind, seed and frame."""
    rng = np.random.default_rng([seed, frame, list(Kind).index(kind)])
    return Spoil(kind, ("Left", "Right")[rng.integers(2)], float(rng.uniform(*HEIGHTS)))


def judged_joints(spoil: Spoil, visible: Mapping[str, Any]) -> np.ndarray | None:
    """Return the joints (k,) to judge; None if too few limbs are visible. visible: whether each stays in plain view."""
    limbs = [limb for limb in spoil.limbs if visible[limb]]
    enough = len(limbs) == len(spoil.limbs)
    if spoil.kind is Kind.TURNED_ROUND:
        enough = "trunk_and_head" in limbs and len(limbs) >= LEAST_LIMBS
    return np.concatenate([LIMBS_JUDGED[limb] for limb in limbs]) if enough else None


@dataclass(frozen=True, slots=True, eq=False)
class Chance:
    """A frame whose pose can be made wrong, and the joints (k,) to judge afterwards."""

    frame: int
    spoil: Spoil
    joints: np.ndarray


def chances(time_pass: TimePass, alone: Undisturbed, truth: Truth, kind: Kind, seed: int) -> Iterator[Chance]:
    """Yield the frames in which a wrong pose of this kind can be tried: the limbs stay in plain view, and the pose is
    right before and wrong after the change.
    """
    body, frames, visible = time_pass.body, list(alone.poses), in_plain_view(truth)
    after = int(np.ceil(UNTIL_S / float(np.median(np.diff(truth.time_s)))))
    for place in range(time_pass.run.config.follow.history, len(frames) - after):
        frame, then = frames[place], frames[place : place + after + 1]
        spoil = draw_spoil(kind, seed, frame)
        joints = judged_joints(spoil, {limb: seen[then].all() for limb, seen in visible.items()})
        if joints is None:
            continue
        true_m, wrong = truth.position_m[frame, joints], body.joints(spoilt(body, alone.poses[frame], spoil))
        usual_m, wrong_m = (np.linalg.norm(at[joints] - true_m, axis=1).max() for at in (alone.joints_m[frame], wrong))
        if usual_m < RIGHT_M and wrong_m > SPOILT_M:
            yield Chance(frame, spoil, joints)


def spread(choices: Sequence[Choice], count: int) -> list[Choice]:
    """Return ``count`` of the choices, evenly spread; all of them where there are no more."""
    if count >= len(choices):
        return list(choices)
    return [choices[int((k + 0.5) * len(choices) / count)] for k in range(count)]


def outcomes(
    time_pass: TimePass, alone: Undisturbed, truth: Truth, chosen: Sequence[Chance]
) -> Iterator[tuple[Kind, float]]:
    """Track the pass again; yield for each chosen trial the seconds after which its pose was right again."""
    past: Past | None = None
    for read, tracker, _ in time_pass.trackers():
        if past is None:
            past = Past.of(tracker)
        else:
            past.note(tracker)
        frame_set = tracker.window[0].frame_set
        for chance in (chance for chance in chosen if chance.frame == frame_set.frame):
            judge = Judge(frame_set.time_s, chance.joints, truth.position_m.__getitem__, alone.joints_m.__getitem__)
            _go_on(time_pass, kidnap(tracker, past, chance.spoil), read, judge)
            yield chance.spoil.kind, judge.recovered_s


def _go_on(time_pass: TimePass, kidnapped: PatientTracker, place: int, judge: Judge) -> None:
    """Track with the wrong pose from the frame at ``place`` of the pass until the outcome is certain."""
    estimates = (kidnapped.step(time_pass.read(later)) for later in range(place, len(time_pass.positions)))
    for estimate in chain(estimates, kidnapped.finish()):
        if estimate is not None:
            seen = estimate.frame_set
            judge.take(seen.frame, seen.time_s, kidnapped.body.joints(kidnapped.belief.pose))
        if judge.done:
            return


def measure(scene: Scene) -> Iterator[Row]:
    """Try each kind of wrong pose in as many frames as option ``trials`` states, or in all suitable frames if fewer."""
    truth, seed = read_truth(scene.truth), scene.simulated.seed
    passes = [(time_pass, undisturbed(time_pass)) for time_pass in passes_through(scene)]
    chosen: list[list[Chance]] = [[] for _ in passes]
    for kind in Kind:
        found = [
            (number, chance)
            for number, (time_pass, alone) in enumerate(passes)
            for chance in chances(time_pass, alone, truth, kind, seed)
        ]
        for number, chance in spread(found, scene.options["trials"]):
            chosen[number].append(chance)
    tried = [
        trial
        for (time_pass, alone), some in zip(passes, chosen, strict=True)
        if some
        for trial in outcomes(time_pass, alone, truth, some)
    ]
    for kind in Kind:
        recovered_s = np.array([seconds for of, seconds in tried if of is kind])
        right = np.isfinite(recovered_s)
        share = float(right.mean()) if right.size else float("nan")
        median_s = float(np.median(recovered_s[right])) if right.any() else float("nan")
        yield str(kind), {"trials": float(right.size), "right": share, "recovery_s": median_s}


if __name__ == "__main__":
    answer(measure, trials=24)
