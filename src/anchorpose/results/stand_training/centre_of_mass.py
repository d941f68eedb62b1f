"""The whole-body centre of mass, estimated from the joints and a table of segment masses.

Source of the masses: de Leva 1996 (doi:10.1016/0021-9290(95)00178-6), Table 4: living young adults, women and men. The
patient's sex is unknown, so the mean of both columns is used; they differ by 4 mm in the height of a standing body's
centre.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import numpy as np

from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.results.tables import JointTable


class Segment(NamedTuple):
    """mass: share of the body's, of one side. fraction: of the way from the start to the end at which the centre lies.

    starts, ends: the joints in whose middle the segment starts and ends; ``{side}`` stands for Left and Right.
    """

    mass: float
    starts: tuple[str, ...]
    ends: tuple[str, ...]
    fraction: float


_SHOULDERS, _HIPS = ("ShoulderLeft", "ShoulderRight"), ("HipLeft", "HipRight")

SINGLE_SEGMENTS: Final = (
    # VERT-CERV 0.492 from the vertex, which on the body asset is 0.72 of the way from SpineShoulder to Head
    Segment(0.0681, ("SpineShoulder",), ("Head",), 0.72),
    Segment(0.43015, _SHOULDERS, _HIPS, 0.4046),
)

PAIRED_SEGMENTS: Final = (
    Segment(0.0263, ("Shoulder{side}",), ("Elbow{side}",), 0.5763),
    Segment(0.0150, ("Elbow{side}",), ("Wrist{side}",), 0.4567),
    # the hand, its centre 68 mm beyond the wrist in line with the forearm, whichever way it is bent: at most 0.4 mm of
    # the body's centre, and a hand that is lost does not take it away
    Segment(0.00585, ("Elbow{side}",), ("Wrist{side}",), 1.29),
    Segment(0.1447, ("Hip{side}",), ("Knee{side}",), 0.3854),
    Segment(0.0457, ("Knee{side}",), ("Ankle{side}",), 0.4374),
    # 0.42 from the heel to the tip of the toes, on the body asset 0.36 of the way from Ankle to Foot
    Segment(0.0133, ("Ankle{side}",), ("Foot{side}",), 0.36),
)


@cache
def joint_weights() -> np.ndarray:
    """(21,) weights, sum 1, read only: the centre of mass is this mean of the joints. Some may be negative."""
    paired = (_on_side(segment, side) for segment in PAIRED_SEGMENTS for side in ("Left", "Right"))
    weights = np.zeros(JOINT_COUNT)
    for segment in (*SINGLE_SEGMENTS, *paired):
        for joints, share in ((segment.starts, 1.0 - segment.fraction), (segment.ends, segment.fraction)):
            for name in joints:
                weights[JOINT_INDEX[name]] += segment.mass * share / len(joints)
    weights /= weights.sum()  # the table's rounding: 0.9999
    weights.setflags(write=False)
    return weights


def _on_side(segment: Segment, side: str) -> Segment:
    starts, ends = (tuple(name.format(side=side) for name in joints) for joints in (segment.starts, segment.ends))
    return Segment(segment.mass, starts, ends, segment.fraction)


SHARED_ERROR: Final = 0.3
"""Share of the variance of a joint's error that all joints have in common: a body that is placed too far away has all
its joints too far away. Independent errors would give the centre of mass a sigma of 1.6 mm; on simulated recordings it
was up to 5 mm off (docs/measures.md)."""


class CentreOfMass(NamedTuple):
    """position_m (n, 3) world, NaN where a joint that carries mass is lost; sigma_m (n,) per axis; state_code (n,).

    sigma_m follows from the joints' sigma; it does not include that the patient's masses differ from the table.
    """

    position_m: np.ndarray
    sigma_m: np.ndarray
    state_code: np.ndarray


def centre_of_mass(joints: JointTable) -> CentreOfMass:
    """Of every frame; the joints' errors are taken as partly shared (``SHARED_ERROR``)."""
    weights = joint_weights()
    used = weights != 0
    position_m = np.einsum("j,njk->nk", weights[used], joints.position_m[:, used])
    own, shared = (joints.sigma_m[:, used] ** 2) @ weights[used] ** 2, (joints.sigma_m[:, used] @ weights[used]) ** 2
    sigma_m = np.sqrt((1.0 - SHARED_ERROR) * own + SHARED_ERROR * shared)
    return CentreOfMass(position_m, sigma_m, joints.state_code[:, used].max(axis=1))
