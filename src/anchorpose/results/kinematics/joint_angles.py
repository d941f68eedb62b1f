"""All angles of all frames, with the state and the uncertainty that they inherit from their joints."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.angles import AngleTable
from anchorpose.results.kinematics.arm import ARMS
from anchorpose.results.kinematics.leg import LEGS
from anchorpose.results.kinematics.pelvis import PELVIS
from anchorpose.results.kinematics.propagation import angles_with_sigma
from anchorpose.results.kinematics.trunk import NECK, TRUNK
from anchorpose.results.tables import JointTable

ANGLE_GROUPS: Final = (*PELVIS, *TRUNK, *NECK, *LEGS, *ARMS)

ANGLE_NAMES: Final = tuple(name for group in ANGLE_GROUPS for name in group.names)
"""The angles that joint centres carry, in the order of the table."""


def joint_angles(joints: JointTable) -> AngleTable:
    """``ANGLE_NAMES`` of all frames; the state is the worst of the joints involved.

    No value where one of them is lost (then the state is ``lost`` too) and where the pose leaves the angle undetermined
    (then the state is that of the joints; docs/angles.md says for each angle when that is).
    """
    position_m = np.ascontiguousarray(joints.position_m.transpose(1, 2, 0))
    sigma_m = np.ascontiguousarray(joints.sigma_m.T)
    angle, sigma, severity = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    for group in ANGLE_GROUPS:
        value, spread = angles_with_sigma(group, position_m, sigma_m)
        worst = joints.severity[:, [JOINT_INDEX[name] for name in group.joints]].max(axis=1)
        angle.extend(value)
        sigma.extend(spread)
        severity.extend([worst] * len(group.names))
    return AngleTable(
        frame=joints.frame,
        time_s=joints.time_s,
        names=ANGLE_NAMES,
        degrees=np.degrees(np.stack(angle, axis=1)),
        severity=np.stack(severity, axis=1).astype(np.int8),
        sigma_deg=np.degrees(np.stack(sigma, axis=1)),
    )
