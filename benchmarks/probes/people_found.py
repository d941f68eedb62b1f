"""Compare the people found in single images of real rooms with people labelled by eye.

Each image is used alone, as if no person ever moved: the room is learnt from this image. A labelled person is found if
most pixels of a found person lie in the labelled box. A found person is wrong if no box holds most of that person.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from probe import Row, Scene, answer

from anchorpose.descriptor.learnt import describe
from anchorpose.descriptor.people import find_people
from anchorpose.isolation.people import see_people
from anchorpose.isolation.scene import find_all_pieces
from anchorpose.isolation.separation import label_people
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.recording.recording import FrameSet
from anchorpose.research.benchmark.labels import LabelledPerson, read_labels
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.patient_choice import HUMAN, MOST_PAST
from anchorpose.tracker.preparation import Settled, scenes_of, settle
from anchorpose.tracker.sighting import rough_body_of

LABELS: Final = Path(__file__).resolve().parent.parent / "labels"
INSIDE: Final = 0.7
SURE: Final = (0.5, 0.7, 0.8, 0.9)  # least certainty: mean probability of a person's pixels

Pixels = tuple[np.ndarray, np.ndarray]


def measure(scene: Scene) -> Iterator[Row]:
    """Yield a row for each least certainty of the descriptor, and one for people whom a body explains."""
    recording = open_recording(scene.recording)
    settled = settle(recording, TrackConfig())
    labelled = read_labels(LABELS, scene.recording.name, "first")
    counts = {title: np.zeros(4) for title in (*(f"certainty from {sure:g}" for sure in SURE), "a body explains it")}
    for frames in read_frames(recording):
        if frames.frame not in labelled or frames.depths_m[0] is None:
            continue
        people = labelled[frames.frame]
        for title, found in _found(frames, settled):
            owners = [_owner(pixels, people) for pixels in found]
            plain = [number for number, person in enumerate(people) if person.plain]
            counts[title] += [1, len(plain), len(set(owners) & set(plain)), owners.count(None)]
    for title, (images, plain, hit, wrong) in counts.items():
        yield (
            title,
            {
                "images": float(images),
                "people": float(plain),
                "found_percent": 100.0 * hit / plain if plain else float("nan"),
                "wrong_an_image": wrong / images if images else float("nan"),
            },
        )


def _found(frames: FrameSet, settled: Settled) -> Iterator[tuple[str, Sequence[Pixels]]]:
    """Yield, for each way to find people that is compared, its title and the pixels of each found person."""
    camera, depth_m = settled.calibration.cameras[0], frames.depths_m[0]
    assert depth_m is not None
    said = describe(depth_m, camera)
    everybody = find_people([said], [depth_m], [np.eye(4)])
    for sure in SURE:
        rays = [one.rays[0] for one in everybody if one.certainty >= sure and one.rays[0] is not None]
        yield f"certainty from {sure:g}", [(said.row[own], said.column[own]) for own in rays]
    scenes = scenes_of(replace(settled, samples=(frames,)))
    pieces = find_all_pieces(frames, scenes)
    people = see_people(pieces, [camera])
    views = label_people(pieces, people, np.arange(len(people.people)))
    explained = []
    for number in range(len(people.people)):
        body = rough_body_of(views, [camera], PixelLabel.PATIENT + number)
        if body is not None and body.explained >= HUMAN and body.past <= MOST_PAST:
            assert views[0] is not None
            explained.append(np.nonzero(views[0].labels == PixelLabel.PATIENT + number))
    yield "a body explains it", explained


def _owner(pixels: Pixels, people: tuple[LabelledPerson, ...]) -> int | None:
    """Return the labelled person (index) whose box holds most pixels of a found one; None if no box holds enough."""
    row, column = pixels
    shares = []
    for labelled in people:
        left, top, right, bottom = labelled.box
        shares.append(float(((column >= left) & (column <= right) & (row >= top) & (row <= bottom)).mean()))
    return int(np.argmax(shares)) if shares and max(shares) > INSIDE else None


if __name__ == "__main__":
    answer(measure)
