"""Examine sampled frames before tracking: find people, recognise mirror images, and list possible initial frames.

A person who is seen beyond a wall is either in the next room or a mirror image. A mirror image has a twin, the real
person. If the place of the image is reflected in the wall's plane, the twin stands at the reflected place in most of
the sampled frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.room_planes import Wall, find_walls, with_wall
from anchorpose.isolation.scene import Scene
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import FrameSet
from anchorpose.threads import each
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.initial_frame import rank_initial_frames
from anchorpose.tracker.patient_choice import BEFORE_M, CHEST_M, looks_at_most
from anchorpose.tracker.room import InitialFrame
from anchorpose.tracker.sighting import SeenPerson, Sighting, sight_people

# m, maximum distance between the twin (the real person) and the reflected place of the mirror image. The camera may see
# the front of the real person and the back of the mirror image; a person's front and back are this far apart
TWIN_M: Final = 0.35
# minimum number of frames in which a mirror image must have a twin (the real person). Two people who pass each other
# may look like a person and their mirror image in one or two frames, without a mirror
LEAST_TWINS: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """A gap in a wall of one scene that shows mirror images."""

    scene: int
    wall: Wall
    gap: np.ndarray  # (height, width) bool, the gap's pixels
    twins: int  # number of frames that show both a mirror image and its twin
    shown: int  # number of frames that show both a person beyond the gap and the place where the twin would be

    def is_in(self, other: Mirror) -> bool:
        """Return whether both mirrors are the same gap. A gap is found twice if the wall around it was mistaken for two
        planes.
        """
        return self.scene == other.scene and bool((self.gap & other.gap).any())

    @property
    def sentence(self) -> str:
        """Return a sentence about the mirror for the run's notes."""
        away_m = self.wall.offset_m - self.wall.normal @ self.wall.camera.position_m
        return (
            f"a mirror was found {away_m:.1f} m from camera {self.wall.camera.name}: in {self.twins} of {self.shown} "
            "frames with a person beyond this wall, another person is as far in front; people in the mirror are ignored"
        )


def find_mirrors(
    sightings: Sequence[Sighting], scenes: Sequence[Scene], patient_xz_m: tuple[float, float] | None
) -> list[Mirror]:
    """Find mirrors in which people are seen; a wall beyond which the user placed the patient is not a mirror."""
    if max((len(sighting.people) for sighting in sightings), default=0) < 2:
        return []
    found = list[Mirror]()
    for number, scene in enumerate(scenes):
        for wall in find_walls(scene):
            named = None if patient_xz_m is None else np.array([patient_xz_m[0], 0.0, patient_xz_m[1]])
            if named is None or wall.beyond_m(named) < 0.0:
                mirrors = _mirrors_in(wall, number, sightings, [one.camera for one in scenes])
                found += [one for one in mirrors if not any(one.is_in(other) for other in found)]
    return found


def with_mirrors(scenes: Sequence[Scene], mirrors: Sequence[Mirror]) -> tuple[Scene, ...]:
    """Return the scenes with walls in place of mirrors, so that no person is found in a mirror."""
    changed = list(scenes)
    for mirror in mirrors:
        changed[mirror.scene] = with_wall(changed[mirror.scene], mirror.wall, mirror.gap)
    return tuple(changed)


def through_a_gap(choice: PatientChoice, sightings: Sequence[Sighting], scenes: Sequence[Scene]) -> str | None:
    """Return a note for the user if the chosen patient is seen through a gap in a wall, else None."""
    people = next(sighting.people for sighting in sightings if sighting.frame == choice.frame)
    patient = min(people, key=lambda one: float(np.linalg.norm(one.person.ground_xz_m - choice.ground_xz_m)))
    for scene in scenes:
        for wall in find_walls(scene):
            gap = _gap_before(patient, wall)
            if gap is not None and wall.frames(gap):
                return (
                    "the patient is seen through a gap in a wall: a doorway or a window, or a mirror, which exchanges "
                    "left and right; nobody was seen in front of it whose reflection this could be"
                )
    return None


def _gap_before(one: SeenPerson, wall: Wall) -> np.ndarray | None:
    """Return the gap in a wall through which a person is seen, as pixels (height, width) bool. Return None if the
    person is not clearly beyond the wall, or is not seen through a gap.
    """
    middle = _middle(one)
    return wall.gap_before(middle) if wall.beyond_m(middle) > TWIN_M else None


def _mirrors_in(wall: Wall, number: int, sightings: Sequence[Sighting], cameras: Sequence[Camera]) -> list[Mirror]:
    """Return the gaps of a wall that are mirrors. A gap is a mirror if most people seen through it have a twin (the
    real person); people whose twin would stand out of view are not counted.
    """
    gaps, twins, shown = list[np.ndarray](), list[int](), list[int]()
    for sighting in sightings:
        for one in sighting.people:
            gap = _gap_before(one, wall)
            has_twin = None if gap is None else _has_twin(one, sighting, wall, cameras)
            if gap is None or has_twin is None:
                continue
            known = next((k for k, other in enumerate(gaps) if (other & gap).any()), len(gaps))
            if known == len(gaps):
                gaps, twins, shown = [*gaps, gap], [*twins, 0], [*shown, 0]
            twins[known] += has_twin
            shown[known] += 1
    return [
        Mirror(number, wall, gap, with_twin, count)
        for gap, with_twin, count in zip(gaps, twins, shown, strict=True)
        if with_twin >= LEAST_TWINS and 2 * with_twin > count
    ]


def _has_twin(image: SeenPerson, sighting: Sighting, wall: Wall, cameras: Sequence[Camera]) -> bool | None:
    """Return whether a twin (real person) stands where the original of a mirror image would stand; None if no camera
    sees that place.
    """
    x, z = image.place_xz_m
    middle = wall.reflected(np.array([x, _middle(image)[1], z]))
    others = [one.place_xz_m for one in sighting.people if one is not image]
    if any(np.linalg.norm(other - middle[[0, 2]]) < TWIN_M for other in others):
        return True
    chest = image.person.top_m - CHEST_M
    axis = np.column_stack([np.full(len(chest), middle[0]), chest, np.full(len(chest), middle[2])])
    return False if _seen_past(axis, sighting.depths_m, cameras) else None


def _middle(one: SeenPerson) -> np.ndarray:
    """Return the point (3,) above a person's place on the ground, halfway between the lowest and the highest seen
    surface.
    """
    person = one.person
    return np.array([person.ground_xz_m[0], (person.bottom_m + person.top_m) / 2.0, person.ground_xz_m[1]])


def _seen_past(points_m: np.ndarray, depths_m: Sequence[np.ndarray | None], cameras: Sequence[Camera]) -> bool:
    """Return whether some camera that has most of the points (n, 3) in view reads something behind most of these
    points.
    """
    return any(np.mean(read > own + BEFORE_M) > 0.5 for own, read in looks_at_most(points_m, depths_m, cameras))


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The result of examining sampled frames."""

    scenes: tuple[Scene, ...]  # one per camera, with walls in place of mirrors
    sightings: tuple[Sighting, ...]  # one per sampled frame
    initial_frames: tuple[InitialFrame, ...]  # best first; empty if no patient is found
    notes: tuple[str, ...]  # sentences for the user about mirrors and gaps in walls


def look_around(
    positions: Sequence[int],
    samples: Sequence[FrameSet],
    scenes: tuple[Scene, ...],
    equipment: EquipmentModel | None,
    config: TrackConfig,
) -> Look:
    """Find people, mirrors and possible initial frames in sampled frames.

    positions: the samples' positions in the recording.
    """
    sightings = each(lambda sample: sight_people(sample, scenes), samples)
    mirrors = find_mirrors(sightings, scenes, config.patient_xz_m)
    if mirrors:
        scenes = with_mirrors(scenes, mirrors)
        sightings = each(lambda sample: sight_people(sample, scenes), samples)
    notes = tuple(mirror.sentence for mirror in mirrors)
    cameras = [scene.camera for scene in scenes]
    initial = rank_initial_frames(positions, sightings, equipment, config.patient_xz_m, cameras)
    if initial:
        notes = (*notes, *_gap_note(initial[0], sightings, scenes))
    return Look(scenes, tuple(sightings), initial, notes)


def _gap_note(initial: InitialFrame, sightings: Sequence[Sighting], scenes: Sequence[Scene]) -> tuple[str, ...]:
    sentence = through_a_gap(initial.choice, sightings, scenes)
    return () if sentence is None else (sentence,)
