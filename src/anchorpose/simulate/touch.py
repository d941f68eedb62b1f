"""Where a therapist's skin is on the patient's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.simulate.clinic import Clinic, Performance
from anchorpose.simulate.render import Figure

TOUCH_M = 0.03
JOINT_REGION_M = 0.12  # a joint is touched where skin so near to it is


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """bones (b,) bool: the patient's body parts that anybody touches; joints (n, 21) bool: by each therapist."""

    bones: np.ndarray
    joints: np.ndarray


def touches(clinic: Clinic, performance: Performance, figures: tuple[Figure, ...], frame: int) -> Touch:
    """Contacts within 3 cm, skin to skin, clothes included."""
    from scipy.spatial import cKDTree

    body = clinic.patient.person.body
    patient_m, part = figures[0].skin_m, body.asset.main_bone()
    joints_m = body.joints(performance.bones[0][frame])
    bones = np.zeros(len(body.bone_heads), dtype=bool)
    joints = np.zeros((len(figures) - 1, len(joints_m)), dtype=bool)
    for index, figure in enumerate(figures[1:]):
        low, high = figure.skin_m.min(axis=0) - TOUCH_M, figure.skin_m.max(axis=0) + TOUCH_M
        near = np.flatnonzero(((patient_m > low) & (patient_m < high)).all(axis=1))
        if len(near) == 0:
            continue
        distance, _ = cKDTree(figure.skin_m).query(patient_m[near], distance_upper_bound=TOUCH_M)
        touched = near[np.isfinite(distance)]
        bones[part[touched]] = True
        if len(touched):
            gap_m = np.linalg.norm(joints_m[:, None] - patient_m[touched], axis=2)
            joints[index] = (gap_m < JOINT_REGION_M).any(axis=1)
    return Touch(bones, joints)
