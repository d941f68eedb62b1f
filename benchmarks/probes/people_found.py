"""Who the learnt descriptor finds in single images of real rooms, against people labelled by eye.

Each image stands alone: nobody moves in it. Found: most pixels of a found person lie in the box of a labelled one.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from probe import Row, Scene, answer

from anchorpose.descriptor.learnt import Described, describe
from anchorpose.descriptor.people import FoundPerson, find_people
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.research.benchmark.labels import LabelledPerson, read_labels

LABELS: Final = Path(__file__).resolve().parent.parent / "labels"
INSIDE: Final = 0.7
SURE: Final = (0.5, 0.7, 0.8, 0.9)  # least mean probability of a person's pixels


def measure(scene: Scene) -> Iterator[Row]:
    """Yield a row for each least certainty, over all labelled images."""
    recording = open_recording(scene.recording)
    labelled = read_labels(LABELS, scene.recording.name, "first")
    counts = {sure: np.zeros(4) for sure in SURE}
    for frames in read_frames(recording):
        depth_m = frames.depths_m[0]
        if frames.frame not in labelled or depth_m is None:
            continue
        said = describe(depth_m, recording.cameras[0])
        found, people = find_people(said, depth_m), labelled[frames.frame]
        for sure in SURE:
            owners = [_owner(person, said, people) for person in found if person.certainty >= sure]
            plain = [number for number, person in enumerate(people) if person.plain]
            hit = len(set(owners) & set(plain))
            counts[sure] += [1, len(plain), hit, owners.count(None)]
    for sure, (images, plain, hit, wrong) in counts.items():
        yield (
            f", certainty from {sure:g}",
            {
                "images": float(images),
                "people": float(plain),
                "found_percent": 100.0 * hit / plain if plain else float("nan"),
                "wrong_an_image": wrong / images if images else float("nan"),
            },
        )


def _owner(person: FoundPerson, said: Described, people: tuple[LabelledPerson, ...]) -> int | None:
    """The labelled person whose box holds most pixels of a found one; None where no box holds enough."""
    row, column = said.row[person.rays], said.column[person.rays]
    shares = []
    for labelled in people:
        left, top, right, bottom = labelled.box
        shares.append(float(((column >= left) & (column <= right) & (row >= top) & (row <= bottom)).mean()))
    return int(np.argmax(shares)) if shares and max(shares) > INSIDE else None


if __name__ == "__main__":
    answer(measure)
