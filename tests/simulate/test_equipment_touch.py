"""What the truth says of the equipment that a simulated patient touches."""

from dataclasses import replace

import numpy as np
import pytest

from anchorpose.simulate import config as presets
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.touches import EQUIPMENT_TOUCH_M, bones_on_equipment

BARS = replace(presets.clinic(61, seconds=2.0), equipment="parallel-bars", therapists=0, motions=("reach",))


def on_parts(clinic: Clinic, time_s: float = 0.0) -> dict[str, set[str]]:
    """The bones on each part of the equipment at a time."""
    person = clinic.patient.person
    skin_m = person.skin(clinic.patient.bones(np.array([time_s]))[0], time_s)
    found = bones_on_equipment(clinic, skin_m, person.body.asset.main_bone(), time_s)
    names = np.array(person.body.asset.bone_names)
    return {part.name: set(names[row].tolist()) for part, row in zip(clinic.parts, found, strict=True)}


def test_a_patient_who_holds_the_rails_touches_each_with_the_hand_of_its_side():
    found = on_parts(draw_clinic(BARS))
    for side, other in (("Left", "Right"), ("Right", "Left")):
        bones = found[f"rail-{side.lower()}"]
        assert f"{side}FingerBase" in bones
        assert not any(bone.startswith(other) for bone in bones)


def test_the_truth_is_the_distance_of_the_nearest_vertex():
    clinic = draw_clinic(BARS)
    person = clinic.patient.person
    skin_m = person.skin(clinic.patient.bones(np.zeros(1))[0], 0.0)
    bone = person.body.asset.main_bone()
    for part, row in zip(clinic.parts, bones_on_equipment(clinic, skin_m, bone, 0.0), strict=True):
        distance_m = part.distance_m(skin_m)
        assert [bool((distance_m[bone == k] < EQUIPMENT_TOUCH_M).any()) for k in range(len(row))] == row.tolist()


@pytest.mark.parametrize(("time_s", "held"), [(0.5, True), (1.5, False)])
def test_rails_that_were_pushed_away_are_not_held(time_s, held):
    clinic = draw_clinic(replace(BARS, equipment_moves_at_s=1.0, equipment_shift_m=(0.0, 2.0)))
    person = clinic.patient.person
    skin_m = person.skin(clinic.patient.bones(np.zeros(1))[0], 0.0)
    found = bones_on_equipment(clinic, skin_m, person.body.asset.main_bone(), time_s)
    left = next(row for part, row in zip(clinic.parts, found, strict=True) if part.name == "rail-left")
    assert left.any() == held


def test_without_equipment_there_is_nothing_to_touch():
    clinic = draw_clinic(presets.single(62, seconds=1.0))
    assert clinic.parts == ()
    assert on_parts(clinic) == {}
