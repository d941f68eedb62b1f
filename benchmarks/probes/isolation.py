"""Measure how many person labels of tracking are right in a simulated clinic.

Only readings on a surface are counted: within 3 cm of the true depth at their pixel, and not on the outermost pixels of
a person or thing, where the sensor mixes the depths on both sides. held: scores of the frames in which another person
touches the patient.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import cv2
import numpy as np
from probe import Row, Scene, answer

from anchorpose.isolation.view import PixelLabel, View
from anchorpose.motion.prediction import load_motions
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.render import EQUIPMENT, PATIENT
from anchorpose.simulate.shoot import Shot, set_up
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run

ON_IT_M: Final = 0.03


def count(views: Sequence[View | None], shot: Shot) -> Counter[str]:
    """Count the pixels of one frame by true and found label, all cameras together."""
    total: Counter[str] = Counter()
    for view, image in zip(views, shot.images, strict=True):
        if view is None:
            continue
        on_it = (view.depth_m > 0) & (np.abs(view.depth_m - image.depth_m) < ON_IT_M)
        on_it &= cv2.dilate(image.label, np.ones((3, 3))) == cv2.erode(image.label, np.ones((3, 3)))
        equipment, patient = (on_it & (image.label == label) for label in (EQUIPMENT, PATIENT))
        total["equipment"] += int(equipment.sum())
        total["equipment left"] += int((equipment & (view.labels >= PixelLabel.PATIENT)).sum())
        total["patient"] += int(patient.sum())
        total["patient removed"] += int((patient & (view.labels == PixelLabel.EQUIPMENT)).sum())
        total["patient kept"] += int((patient & view.patient).sum())
        total["called patient"] += int((on_it & view.patient).sum())
        total["others included"] += int((on_it & (image.label > PATIENT) & view.patient).sum())
    return total


def tracked_views(recording: Recording, config: TrackConfig) -> Iterator[tuple[int, Sequence[View | None]]]:
    """Track the recording; yield the number of each frame, and for each camera the labels that tracking used."""
    room = prepare_room(recording, config)
    run = Run(room, config, load_motions(config.motion_file, recording.rate_hz, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    for positions in (route.backward[1:], route.forward):
        for estimate in follow_patient(run, route.frames(positions), None if learnt is None else learnt.shape):
            if estimate.observation is not None:
                yield estimate.frame_set.frame, estimate.observation.evidence.views


def measure(scene: Scene) -> Iterator[Row]:
    """Compare the labels of every frame with the true ones."""
    studio = set_up(draw_clinic(scene.simulated))
    with np.load(scene.truth) as truth:
        touched = truth["touched"].any(axis=1)
    views = tracked_views(open_recording(scene.recording), TrackConfig())
    yield "", _scores({frame: count(labels, studio.shoot(frame)) for frame, labels in views}, touched)


def _scores(counts: dict[int, Counter[str]], touched: np.ndarray) -> dict[str, float]:
    sums = {held: sum((c for frame, c in counts.items() if touched[frame] == held), Counter()) for held in (0, 1)}
    every = sums[0] + sums[1]

    def percent(part: str, whole: str, of: Counter[str]) -> float:
        return 100.0 * of[part] / of[whole] if of[whole] else float("nan")

    return {
        "equipment_left_percent": percent("equipment left", "equipment", every),
        "patient_removed_percent": percent("patient removed", "patient", every),
        "kept_percent": percent("patient kept", "patient", sums[0]),
        "others_included_percent": percent("others included", "called patient", sums[0]),
        "kept_held_percent": percent("patient kept", "patient", sums[1]),
        "others_included_held_percent": percent("others included", "called patient", sums[1]),
        "frames_swapped": float(sum(c["others included"] > c["called patient"] / 2 for c in counts.values())),
    }


if __name__ == "__main__":
    answer(measure)
