"""Determine the true contacts of the patient in a frame, with the skin of other people and with equipment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS, region_of_skin
from anchorpose.simulate.clinic import Clinic, Performance
from anchorpose.simulate.render import Figure

TOUCH_M: Final = 0.03  # m, maximum distance between the skin of two people in contact
JOINT_REGION_M: Final = 0.12  # m; a joint counts as touched if skin within this distance of the joint is touched
# m, maximum distance of skin from a rigid surface in contact; folds of clothes are about as high (``clothing_m``)
EQUIPMENT_TOUCH_M: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """Contacts of the patient in one frame."""

    bones: np.ndarray  # (b,) bool, bones whose skin any other person touches
    joints: np.ndarray  # (n, 21) bool, joints that each of n other people touches
    regions: np.ndarray  # (n, k) bool, ``REGIONS`` of the body that each other person touches
    on_equipment: np.ndarray  # (parts, b) bool, bones whose skin touches each part of the equipment


def touches(clinic: Clinic, performance: Performance, figures: tuple[Figure, ...], frame: int) -> Touch:
    """Return the contacts in one frame, clothes included: skin to skin within 3 cm, skin to equipment within 1 cm. A
    patient who is away has no contacts.
    """
    from scipy.spatial import cKDTree

    body = clinic.patient.person.body
    patient_m, part = figures[0].skin_m, body.asset.main_bone()
    joints_m = body.joints(performance.bones[0][frame])
    bones = np.zeros(len(body.bone_heads), dtype=bool)
    joints = np.zeros((len(figures) - 1, len(joints_m)), dtype=bool)
    regions = np.zeros((len(figures) - 1, len(REGIONS)), dtype=bool)
    if performance.away[frame]:
        return Touch(bones, joints, regions, np.zeros((len(clinic.parts), len(bones)), dtype=bool))
    region = region_of_skin(body.asset, part, body.vertices, body.bone_heads)
    for index, figure in enumerate(figures[1:]):
        low, high = figure.skin_m.min(axis=0) - TOUCH_M, figure.skin_m.max(axis=0) + TOUCH_M
        near = np.flatnonzero(((patient_m > low) & (patient_m < high)).all(axis=1))
        if len(near) == 0:
            continue
        distance, _ = cKDTree(figure.skin_m).query(patient_m[near], distance_upper_bound=TOUCH_M)
        touched = near[np.isfinite(distance)]
        bones[part[touched]] = True
        regions[index, region[touched]] = True
        if len(touched):
            gap_m = np.linalg.norm(joints_m[:, None] - patient_m[touched], axis=2)
            joints[index] = (gap_m < JOINT_REGION_M).any(axis=1)
    return Touch(bones, joints, regions, bones_on_equipment(clinic, patient_m, part, float(performance.times_s[frame])))


def bones_on_equipment(clinic: Clinic, patient_m: np.ndarray, bone: np.ndarray, time_s: float) -> np.ndarray:
    """Return (parts, b) bool: bones with skin within ``EQUIPMENT_TOUCH_M`` of each part of the equipment, or inside
    this part.

    patient_m (v, 3): the patient's dressed skin, world; bone (v,): the bone that moves each vertex. Equipment that was
    pushed before ``time_s`` is at its new place.
    """
    found = np.zeros((len(clinic.parts), len(clinic.patient.person.body.bone_heads)), dtype=bool)
    skin_m = patient_m - clinic.pushed_m(time_s)
    for row, part in enumerate(clinic.parts):
        found[row, bone[part.distance_m(skin_m) < EQUIPMENT_TOUCH_M]] = True
    return found
