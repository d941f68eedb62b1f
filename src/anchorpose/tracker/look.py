"""Who is seen in the sampled frames: mirrors are walls, the patient is chosen, and must have the shape of a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.isolation.background import BackgroundSource
from anchorpose.isolation.scene import Scene
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import FrameSet
from anchorpose.threads import each
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.initial_frame import rank_initial_frames
from anchorpose.tracker.mirrors import find_mirrors, through_a_gap, with_mirrors
from anchorpose.tracker.patient_choice import STAYS_M
from anchorpose.tracker.room import NOBODY_SEEN, InitialFrame
from anchorpose.tracker.sighting import ONE_PERSON, Sighting, body_of_chosen, shows_limbs_alone, sight_people
from anchorpose.tracker.start import NoStart

CHECKED: Final = 5  # frames with a body each: of real people 5 of 5 show one, of a wheelchair that is pushed 1 or 2
NOT_A_PERSON: Final = "what moved in the sampled frames has not the shape of a person"


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """scenes: with walls in place of mirrors; sightings: of each sample; initial_frames: best first, none where nobody
    may be the patient; notes: sentences on mirrors and gaps in walls; why_nobody: why there is no initial frame."""

    scenes: tuple[Scene, ...]
    sightings: tuple[Sighting, ...]
    initial_frames: tuple[InitialFrame, ...]
    notes: tuple[str, ...]
    why_nobody: str


def look_around(
    positions: Sequence[int],
    samples: Sequence[FrameSet],
    scenes: tuple[Scene, ...],
    equipment: EquipmentModel | None,
    config: TrackConfig,
    before: Look | None = None,
) -> Look:
    """Who may be the patient in sampled frames; positions: theirs in the recording.

    before: a look at the same frames that found nobody, so that the people seen in it are not the patient either.
    Whom the user names or who stands in the equipment is trusted to be a person, and whoever stands out from a given
    picture of the empty room, or is all that a recorder kept.
    """
    sightings = each(lambda sample: sight_people(sample, scenes, config), samples)
    mirrors = find_mirrors(sightings, scenes, config.patient_xz_m)
    if mirrors:
        scenes = with_mirrors(scenes, mirrors)
        sightings = each(lambda sample: sight_people(sample, scenes, config), samples)
    if before is not None:
        sightings = [_newly_seen(now, then) for now, then in zip(sightings, before.sightings, strict=True)]
    notes = tuple(mirror.sentence for mirror in mirrors)
    cameras = [scene.camera for scene in scenes]
    initial = rank_initial_frames(positions, sightings, equipment, config.patient_xz_m, cameras)
    of = dict(zip(positions, samples, strict=True))
    learnt = any(scene.background.source is BackgroundSource.RECORDING for scene in scenes)
    trusted = equipment is not None or config.patient_xz_m is not None or not learnt
    if initial and (trusted or _is_person(initial, of, scenes, config)):
        return Look(scenes, tuple(sightings), initial, (*notes, *_gap_note(initial[0], sightings, scenes)), NOBODY_SEEN)
    limbs = sum(shows_limbs_alone(sample, scenes) for sample in samples)
    why = NOT_A_PERSON if initial else NOBODY_SEEN
    return Look(scenes, tuple(sightings), (), notes, str(NoStart.LIMBS_ALONE) if 2 * limbs > len(samples) else why)


def _newly_seen(now: Sighting, before: Sighting) -> Sighting:
    """Without the people who were seen in the same frame before."""
    known = [one.place_xz_m for one in before.people]
    new = [one for one in now.people if all(np.linalg.norm(one.place_xz_m - place) > STAYS_M for place in known)]
    return replace(now, people=tuple(new))


def _gap_note(initial: InitialFrame, sightings: Sequence[Sighting], scenes: Sequence[Scene]) -> tuple[str, ...]:
    sentence = through_a_gap(initial.choice, sightings, scenes)
    return () if sentence is None else (sentence,)


def _is_person(
    initial: Sequence[InitialFrame], samples: dict[int, FrameSet], scenes: Sequence[Scene], config: TrackConfig
) -> bool:
    """Whether a body explains who was chosen, and no camera sees past it, in half of some frames."""
    ordered = sorted(initial, key=lambda one: one.frame)
    checked = [ordered[k] for k in thin(len(ordered), CHECKED)]
    human = 0
    for one in checked:
        body = body_of_chosen(samples[one.frame], one.choice, scenes, config)
        human += body is not None and body.possible and body.explained >= ONE_PERSON
        if 2 * human >= len(checked):
            return True
    return False
