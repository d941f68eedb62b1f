"""Suites of real depth, with labels by eye or an inertial sensor on the thigh. Both uses have the same recordings."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import scores
from recordings import DATA, Real
from suite import Case, Use
from sync_scores import sensor_clock

PEOPLE: Final = ("people_in_line", "iit_rehab_room", "five_people", "realsense_board")


def real(use: Use, quick: bool) -> Iterator[Case]:
    """Yield sequences with labelled joints (MSR Action3D), recordings with a sensor on the thigh, and labelled people
    in whole rooms.
    """
    sequences = scores.labelled_sequences()
    sequences = sequences[:: len(sequences) // 6] if quick else sequences
    for sequence in sequences:
        yield Case("MSR Action3D: labels", Real(f"msr_action3d/{sequence}"), scores.against_msr_labels)
    for exercise, clip in _thigh_clips(quick):
        yield Case(f"thigh sensor: {exercise}", clip, scores.against_inertial_sensor)
    for folder in PEOPLE[2:] if quick else PEOPLE:
        for person in scores.people_in(folder):
            yield Case(
                f"people: {folder}",
                Real(folder),
                partial(scores.against_people_labels, person=person),
                partial(scores.name_labelled, person=person),
            )
    # Last, long after the same sequences above: two processes must not track one recording at the same time.
    for sequence in sequences:
        yield Case("joint", Real(f"msr_action3d/{sequence}"), scores.by_joint)


def _thigh_clips(quick: bool) -> Iterator[tuple[str, Real]]:
    """Yield recordings of people with an inertial sensor on the thigh, with the name of the exercise."""
    clips = sorted(path.parent.name for path in DATA.glob("utd_mhad/*/recording.json"))
    for clip in clips[::8] if quick else clips:
        yield clip.split("_", 3)[-1].replace("_", " "), Real(f"utd_mhad/{clip}")


def sync(use: Use, quick: bool) -> Iterator[Case]:
    """Yield the recordings with an inertial sensor on the thigh; the suite searches for the sensor's clock offset."""
    for exercise, clip in _thigh_clips(quick):
        yield Case(exercise, clip, sensor_clock)
