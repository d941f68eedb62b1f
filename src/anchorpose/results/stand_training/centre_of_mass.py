"""The whole-body centre of mass, estimated from the joints and a table of segment masses."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from anchorpose.results.stand_training.segment_masses import joint_weights
from anchorpose.results.tables import JointTable

SHARED_ERROR: Final = 0.3
"""Of the variance of a joint's error, how much all joints have in common: a body that is placed too far away has all
its joints too far away. Joints whose errors had nothing in common would promise a centre of mass known to 1.6 mm; on
simulated recordings it was up to 5 mm off (docs/measures.md)."""


class CentreOfMass(NamedTuple):
    """position_m (n, 3) world, NaN where a joint that carries mass is lost; sigma_m (n,) an axis; severity (n,) int8.

    sigma_m is what the joints' sigma makes of it. That the patient's masses are not those of the table is not in it.
    """

    position_m: np.ndarray
    sigma_m: np.ndarray
    severity: np.ndarray


def centre_of_mass(joints: JointTable) -> CentreOfMass:
    """Of every frame; the joints' errors are taken as partly shared (``SHARED_ERROR``)."""
    weights = joint_weights()
    used = weights != 0
    position_m = np.einsum("j,njk->nk", weights[used], joints.position_m[:, used])
    own, shared = (joints.sigma_m[:, used] ** 2) @ weights[used] ** 2, (joints.sigma_m[:, used] @ weights[used]) ** 2
    sigma_m = np.sqrt((1.0 - SHARED_ERROR) * own + SHARED_ERROR * shared)
    return CentreOfMass(position_m, sigma_m, joints.severity[:, used].max(axis=1))
