"""Left against right while the patient is upright."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.lasting import sigma_of_mean
from anchorpose.results.measures import Measure
from anchorpose.results.stand_training.extension import EXTENDED, NOT_UPRIGHT_WITH, known_upright
from anchorpose.results.stand_training.session import Session, inferred_share

LEAST_STANCE_M: Final = 0.08
"""With the ankles closer than this, the centre of mass between them tells too little of which foot bears it."""

NO_STANCE: Final = (
    "the patient was never known to be upright on feet at least 8 cm apart, with the centre of mass between them and "
    "no joint lost"
)


def symmetry_measures(session: Session) -> list[Measure]:
    """Difference of knees and hips (left less right), and how the load would be shared by a patient who stood still."""
    return [*(_difference(session, angle) for angle in EXTENDED), *_load_shares(session)]


def _difference(session: Session, angle: str) -> Measure:
    measure = f"{angle}_difference"
    (left_known, left), (right_known, right) = (known_upright(session, f"{angle}_{side}") for side in ("left", "right"))
    used = left_known & right_known
    if not used.any():
        return Measure(measure=measure, value=None, unit="deg", frames=0, why=NOT_UPRIGHT_WITH)
    columns = [session.angles.column(f"{angle}_{side}") for side in ("left", "right")]
    sigma = np.sqrt((session.angles.sigma_deg[used][:, columns] ** 2).sum(axis=1))
    return Measure(
        measure=measure,
        value=float(np.mean(left[used] - right[used])),
        unit="deg",
        sigma=sigma_of_mean(sigma, float(session.seconds[used].sum())),
        frames=int(used.sum()),
        inferred_share=inferred_share(session.angles.severity[used][:, columns].max(axis=1)),
    )


def _load_shares(session: Session) -> list[Measure]:
    """Where the centre of mass lies between the ankles, seen from above: 0.5 is the middle, for either foot.

    Beyond an ankle two feet alone do not carry a patient who stands still: such frames tell no shares.
    """
    ankles = [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["AnkleRight"]]
    left, right = (session.joints.position_m[:, joint][:, [0, 2]] for joint in ankles)
    com = session.posture.com_m[:, [0, 2]]
    width = np.linalg.norm(right - left, axis=1)
    along = np.einsum("nk,nk->n", com - 0.5 * (left + right), right - left) / np.where(width > 0, width, np.nan) ** 2
    used = session.standing & (np.abs(along) <= 0.5) & (width >= LEAST_STANCE_M)  # NaN where any of them is lost
    names = (("left", -1.0), ("right", 1.0))
    if not used.any():
        return [Measure(measure="load_share", side=side, value=None, unit="1", frames=0, why=NO_STANCE)
                for side, _ in names]  # fmt: skip
    feet = session.joints.sigma_m[used][:, ankles]
    sigma = np.hypot(session.posture.com_sigma_m[used], 0.5 * np.hypot(feet[:, 0], feet[:, 1])) / width[used]
    severity = np.maximum(session.posture.severity[used], session.joints.severity[used][:, ankles].max(axis=1))
    return [
        Measure(measure="load_share", side=side, value=0.5 + sign * float(along[used].mean()), unit="1",
                sigma=sigma_of_mean(sigma, float(session.seconds[used].sum())), frames=int(used.sum()),
                inferred_share=inferred_share(severity))
        for side, sign in names
    ]  # fmt: skip
