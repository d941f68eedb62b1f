"""Measure how far the joints of an ordinary body, fitted to the learnt descriptor alone, are from labels by eye.

The body is fitted in single images of MSR Action3D, which show one person, without surface or earlier frames; its shape
is that of an ordinary person of the fitted stature.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from probe import Row, Scene, answer

from anchorpose.body.matched_places import MatchedPerson, Matches, match_person, matches_of
from anchorpose.body.shape_prior import shape_of_height
from anchorpose.body.skin_points import body_points, build_body, pose_points
from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.research.benchmark.labels import LABELLERS, LabelledPerson, off_m, read_label_set

LABELS: Final = Path(__file__).resolve().parent.parent / "labels"
FAR_M: Final = 1.0  # distance that counts for a joint in front of or far behind the labelled skin
SMALL: Final = ("Wrist", "Hand")


def measure(scene: Scene) -> Iterator[Row]:
    """Yield one row for the labelled frames of a sequence; no row if no joint is labelled clearly."""
    recording = open_recording(scene.recording)
    first, second = (read_label_set(LABELS, "msr_action3d", name)[scene.recording.name] for name in LABELLERS)
    camera = replace(recording.cameras[0], T_world_camera=np.eye(4))
    away, small, statures_m = list[float](), list[float](), list[float]()
    for frames in read_frames(recording):
        depth_m = frames.depths_m[0]
        if frames.frame not in first or depth_m is None:
            continue
        person = match_person(_matches(depth_m, camera))
        statures_m.append(person.stature_m)
        label = _between(first[frames.frame][0], second[frames.frame][0])
        for name, distance_m in off_m(label, _joints_m(person), depth_m, camera).items():
            away.append(distance_m)
            small += [distance_m] * name.startswith(SMALL)
    if not away:
        return
    yield (
        "",
        {
            "labels": float(len(away)),
            "within_60": float(np.mean(np.array(away) < 0.06)),
            "within_100": float(np.mean(np.array(away) < 0.1)),
            "hands_within_100": float(np.mean(np.array(small) < 0.1)) if small else float("nan"),
            "median_mm": 1e3 * float(np.median(np.minimum(away, FAR_M))),
            "stature_m": float(np.median(statures_m)),
        },
    )


def _matches(depth_m: np.ndarray, camera: Camera) -> Matches:
    """Return the descriptor's matches. Every reading counts as the patient, since these images have no background."""
    labels = np.where(depth_m > 0, PixelLabel.PATIENT, 0).astype(np.uint8)
    return matches_of([View(depth_m, labels)], [camera], PixelLabel.PATIENT)


def _joints_m(person: MatchedPerson) -> np.ndarray:
    body = build_body(body_points(), shape_of_height(body_points().asset, person.stature_m))
    return body.mesh.joints(pose_points(body, person.pose).transforms)


def _between(one: LabelledPerson, other: LabelledPerson) -> LabelledPerson:
    """Return the labelled person with each joint half-way between both labels, without joints unclear to a labeller."""
    both = (one.joints.keys() & other.joints.keys()) - one.unclear - other.unclear
    middle = {name: tuple(np.mean([one.joints[name], other.joints[name]], axis=0).tolist()) for name in sorted(both)}
    return replace(one, joints=middle)


if __name__ == "__main__":
    answer(measure)
