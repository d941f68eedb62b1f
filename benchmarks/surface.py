"""Surface, geodesics and anchors against the true body: python benchmarks/surface.py --seeds 4 --seconds 3.

Simulated recordings are tracked, and every few frames what tracking made of the surface is compared with the truth:
distances from the found anchors to all seen nodes with exact geodesics on the whole dressed body, whatever of it is
hidden; anchors with the limb that they lie on. A limb's end counts as visible where some camera sees half of what it
would see of it alone. Jitter is how far an anchor moves when the same moment is read again with other sensor noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from true_body import TrueBody, limb_of_bones

from anchorpose.body.skin_points import body_points
from anchorpose.geodesics.anchors import anchor_descriptor
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.motion.database_file import load_motions
from anchorpose.pipeline import TrackConfig
from anchorpose.recording.reader import open_recording
from anchorpose.simulate.clinic import draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import PATIENT, TrueImage, draw_figures
from anchorpose.simulate.sensor import SENSORS, sense
from anchorpose.simulate.shoot import Shot, Studio, set_up
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import isolate, observe
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room, Run

ALONE: Final = {"equipment": "none", "stool": False, "therapists": 0}
SCENES: Final = {
    "one camera": {"cameras": 1, **ALONE},
    "three cameras": {"cameras": 3, **ALONE},
    "standing frame, one": {"cameras": 1, "therapists": 0},
    "standing frame, three": {"cameras": 3, "therapists": 0},
    "clinic, three": {"cameras": 3},
}
EVERY: Final = 4  # frames between two that are looked at
ON_BODY_M: Final = 0.03  # a node farther off the true skin is no node of it
VISIBLE: Final = 0.5
COLUMNS: Final = ("mean mm", "median", "p95", "signed", "unreached %", "five of five %", "of frames", "found %",
                  "wrong %", "jitter mm", "median", "sigma mm")  # fmt: skip


@dataclass(slots=True)
class Score:
    """What the frames of one kind of scene add up to."""

    errors_m: list[np.ndarray] = field(default_factory=list)
    unreached: int = 0
    pairs: int = 0
    all_right: int = 0
    all_visible: int = 0
    visible: int = 0
    right: int = 0
    found: int = 0
    wrong: int = 0
    jitter_m: list[float] = field(default_factory=list)
    sigma_m: list[float] = field(default_factory=list)

    def row(self) -> list[float]:
        """In the order of ``COLUMNS``."""
        error = 1000 * np.concatenate(self.errors_m) if self.errors_m else np.array([np.nan])
        size = np.abs(error)
        return [
            size.mean(), np.median(size), np.percentile(size, 95), error.mean(),
            100 * self.unreached / max(self.pairs, 1), 100 * self.all_right / max(self.all_visible, 1),
            self.all_visible, 100 * self.right / max(self.visible, 1), 100 * self.wrong / max(self.found, 1),
            1000 * float(np.mean(self.jitter_m or [np.nan])), 1000 * float(np.median(self.jitter_m or [np.nan])),
            1000 * float(np.mean(self.sigma_m or [np.nan])),
        ]  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What tracking saw in a frame and in the one before, the room, and the height of the learnt body."""

    seen: Observation
    before: Observation
    room: Room
    height_m: float


def moments(folder: Path, config: TrackConfig) -> Iterator[Moment]:
    """Every frame of a recording in which the patient was expected somewhere."""
    recording = open_recording(folder)
    room = prepare_room(recording, config)
    run = Run(room, config, load_motions(config.motion_file, 15.0, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    shape = None if learnt is None else learnt.shape
    height_m = float(np.ptp(shape.mesh(body_points().asset).vertices[:, 1])) if shape else 1.75
    for positions in (route.backward[1:], route.forward):
        before: Observation | None = None
        for estimate in follow_patient(run, route.frames(positions), shape):
            seen = estimate.observation
            if seen is not None and seen.expected is not None and before is not None:
                yield Moment(seen, before, room, height_m)
            before = seen


def visible_limbs(shot: Shot, studio: Studio) -> np.ndarray:
    """(5,) bool: of which limb's end some camera sees enough."""
    asset = studio.clinic.patient.person.body.asset
    limb = np.append(-1, limb_of_bones(asset))  # part 0 is nobody
    patient = shot.figures[0]
    seen = np.zeros(len(ANCHOR_NAMES), bool)
    for camera, picture in zip(studio.clinic.cameras, shot.images, strict=True):
        own = limb[picture.part][picture.label == PATIENT]
        for number in range(len(ANCHOR_NAMES)):
            faces = limb[patient.face_part] == number
            only = replace(patient, faces=patient.faces[faces], face_part=patient.face_part[faces])
            shape = picture.depth_m.shape
            nothing = TrueImage(np.zeros(shape, np.float32), np.ones(shape, np.float32), np.zeros(shape, np.uint8),
                              np.zeros(shape, np.uint8))  # fmt: skip
            alone = int((draw_figures(camera, nothing, (only,)).label == PATIENT).sum())
            seen[number] |= alone > 0 and (own == number).sum() >= VISIBLE * alone
    return seen


def add_frame(score: Score, seen: Observation, shot: Shot, studio: Studio) -> None:
    """Compare one frame."""
    body = TrueBody(shot.figures[0].skin_m, studio.clinic.patient.person.body.asset)
    face, share, away = body.project(seen.surface.points_m)
    distance = anchor_descriptor(seen.whole, seen.anchors)  # also those that tracking does not trust
    distance = distance[: len(seen.surface)]
    limb = np.array([-1 if node < 0 else body.limb_at(place)
                     for node, place in zip(seen.anchors.node, seen.anchors.position_m, strict=True)])  # fmt: skip
    right = limb == np.arange(len(limb))
    for number in np.flatnonzero(right):
        node = seen.anchors.node[number]
        true = body.read(body.exact_field(face[node], share[node]), face, share)
        error = distance[:, number] - true
        score.pairs += len(error)
        score.unreached += int(np.isinf(distance[:, number]).sum())
        score.errors_m.append(error[np.isfinite(error) & (away < ON_BODY_M)])
    visible = visible_limbs(shot, studio)
    score.visible += int(visible.sum())
    score.right += int((right & visible).sum())
    score.found += int(seen.anchors.found.sum())
    score.wrong += int((seen.anchors.found & ~right).sum())
    if visible.all():
        score.all_visible += 1
        score.all_right += bool(right.all())


def add_jitter(score: Score, moment: Moment, shot: Shot, studio: Studio, config: TrackConfig) -> None:
    """Anchors of the same moment read twice, each time with noise of its own, and isolated anew."""
    clinic, expected = studio.clinic, moment.seen.expected
    if expected is None or any(depth is None for depth in moment.seen.frame_set.depths_m):
        return
    found = []
    for again in (1, 2):
        depths = []
        for index, (picture, camera) in enumerate(zip(shot.images, clinic.cameras, strict=True)):
            rng = random_stream(clinic.config, "sensor", index, shot_number(moment, again))
            spec, wiggle = SENSORS[clinic.config.sensor], studio.readers[index].wiggle_m
            reading = sense(rng, spec, picture.depth_m, picture.cosine, wiggle)
            depths.append((reading * camera.depth_scale).astype(np.float32))
        frame_set = replace(moment.seen.frame_set, depths_m=tuple(depths))
        again_run = Run(moment.room, config)
        isolated = isolate(frame_set, expected, moment.before, again_run)
        seen = observe(frame_set, isolated, expected, moment.height_m, again_run)
        found.append(seen.anchors)
    both = found[0].found & found[1].found
    score.jitter_m += np.linalg.norm(found[0].position_m - found[1].position_m, axis=1)[both].tolist()
    score.sigma_m += found[0].sigma_m[both].tolist()


def shot_number(moment: Moment, again: int) -> int:
    """A stream of noise that no picture of the recording had."""
    return moment.seen.frame_set.frame + 10_000 * again


def run(kind: str, seeds: range, seconds: float) -> Score:
    """All recordings of one kind."""
    score, config = Score(), TrackConfig()
    for seed in seeds:
        scene = SimulationConfig(seed=seed, seconds=seconds, fps=15.0, **SCENES[kind])  # type: ignore[arg-type]
        with TemporaryDirectory() as folder:
            simulate_recording(Path(folder) / "s", scene)
            studio = set_up(draw_clinic(scene))
            for moment in moments(Path(folder) / "s" / "recording", config):
                if moment.seen.frame_set.frame % EVERY == 0:
                    shot = studio.shoot(moment.seen.frame_set.frame)
                    add_frame(score, moment.seen, shot, studio)
                    add_jitter(score, moment, shot, studio, config)
    return score


def main() -> None:
    """One row a kind of scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--scenes", nargs="*", choices=list(SCENES), default=list(SCENES))
    chosen = parser.parse_args()
    print(f"{'':24s}" + " ".join(f"{name:>14s}" for name in COLUMNS))
    with one_thread():
        for kind in chosen.scenes:
            score = run(kind, range(chosen.first_seed, chosen.first_seed + chosen.seeds), chosen.seconds)
            print(f"{kind:24s}" + " ".join(f"{value:14.1f}" for value in score.row()), flush=True)


if __name__ == "__main__":
    main()
