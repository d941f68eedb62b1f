"""All angles of all frames, with the state and the uncertainty that follow from their joints."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.frame_time import blocks
from anchorpose.results.kinematics.definition import LEAST_LEVER, AngleGroup
from anchorpose.results.kinematics.limbs import ARMS, LEGS
from anchorpose.results.kinematics.trunk import NECK, PELVIS, TRUNK
from anchorpose.results.tables import AngleTable, JointTable


def angles_with_sigma(group: AngleGroup, position_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A group's angles and their standard deviations, (k, n) radians each; NaN where a joint is or the lever is short.

    position_m (21, 3, n), sigma_m (21, n): errors are taken as independent between joints and axes. Each coordinate is
    moved by its own sigma, both ways, instead of using a derivative: at a straight knee the derivative of the angle is
    not defined and would give no error at all. The formula's own error is added as squares.
    """
    points = {name: position_m[JOINT_INDEX[name]] for name in group.joints}
    readings = group.formula(points)
    angle = np.stack([value for value, _ in readings])
    determined = np.stack([np.broadcast_to(lever, angle[0].shape) for _, lever in readings]) >= LEAST_LEVER
    angle = np.where(determined, angle, np.nan)
    variance = np.zeros_like(angle)
    for name in group.joints:
        for axis in range(3):
            for sign in (-1.0, 1.0):
                moved = points[name].copy()
                moved[axis] += sign * sigma_m[JOINT_INDEX[name]]
                change = np.stack([value for value, _ in group.formula(points | {name: moved})]) - angle
                variance += 0.5 * _shorter_way(change) ** 2
    if group.own_sigma is not None:
        variance += group.own_sigma(points) ** 2
    return angle, np.where(np.isnan(angle), np.nan, np.sqrt(variance))


def _shorter_way(angle: np.ndarray) -> np.ndarray:
    """The same angle between minus pi and pi."""
    turn: np.ndarray = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    return turn


ANGLE_GROUPS: Final = (*PELVIS, *TRUNK, *NECK, *LEGS, *ARMS)

ANGLE_NAMES: Final = tuple(name for group in ANGLE_GROUPS for name in group.names)
"""The angles that joint centres determine, in the order of the table."""


def joint_angles(joints: JointTable) -> AngleTable:
    """``ANGLE_NAMES`` of all frames; the state is the worst of the joints involved.

    No value where one of them is lost (then the state is ``lost`` too) and where the pose leaves the angle undetermined
    (then the state is that of the joints; docs/angles.md says for each angle when that is).
    """
    shape = (len(joints.frame), len(ANGLE_NAMES))
    degrees, sigma_deg, state_code = np.empty(shape), np.empty(shape), np.empty(shape, dtype=np.int8)
    for rows in blocks(len(joints.frame)):
        position_m = np.ascontiguousarray(joints.position_m[rows].transpose(1, 2, 0))
        sigma_m = np.ascontiguousarray(joints.sigma_m[rows].T)
        column = 0
        for group in ANGLE_GROUPS:
            own = slice(column, column + len(group.names))
            value, spread = angles_with_sigma(group, position_m, sigma_m)
            worst = joints.state_code[rows][:, [JOINT_INDEX[name] for name in group.joints]].max(axis=1)
            degrees[rows, own], sigma_deg[rows, own] = np.degrees(value).T, np.degrees(spread).T
            state_code[rows, own] = worst[:, None]
            column = own.stop
    return AngleTable(joints.frame, joints.time_s, ANGLE_NAMES, degrees, state_code, sigma_deg)
