"""All angles of all frames, with the state and the uncertainty that follow from their joints."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.frame_time import blocks
from anchorpose.results.kinematics.definition import LEAST_LEVER, AngleGroup, Points
from anchorpose.results.kinematics.limbs import ARMS, LEGS
from anchorpose.results.kinematics.trunk import NECK, PELVIS, TRUNK
from anchorpose.results.tables import AngleTable, JointTable

AT_ONCE: Final = 128
"""Frames: with all their moved joints they stay in a core's cache."""


def angles_with_sigma(group: AngleGroup, position_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A group's angles and their standard deviations, (k, n) radians each; NaN where a joint is or the lever is short.

    position_m (21, 3, n), sigma_m (21, n): errors are taken as independent between joints and axes. Each coordinate is
    moved by its own sigma, both ways, instead of using a derivative: at a straight knee the derivative of the angle is
    not defined and would give no error at all. The formula's own error is added as squares.
    """
    angle, sigma = np.empty((2, len(group.names), position_m.shape[-1]))
    for rows in blocks(angle.shape[1], AT_ONCE):
        points = {name: position_m[JOINT_INDEX[name]][:, rows] for name in group.joints}
        angle[:, rows], sigma[:, rows] = _angles_of_some(group, points, sigma_m[:, rows])
    return angle, sigma


def _angles_of_some(group: AngleGroup, points: Points, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    readings = group.formula(_moved_too(group, points, sigma_m))
    values = np.stack([value for value, _ in readings])  # (k, moves, n), nothing moved first
    levers = np.stack([np.broadcast_to(lever, values.shape[1:])[0] for _, lever in readings])
    angle = np.where(levers >= LEAST_LEVER, values[:, 0], np.nan)
    variance = 0.5 * (_shorter_way(values[:, 1:] - angle[:, None]) ** 2).sum(axis=1)
    if group.own_sigma is not None:
        variance += group.own_sigma(points) ** 2
    return angle, np.where(np.isnan(angle), np.nan, np.sqrt(variance))


def _moved_too(group: AngleGroup, points: Points, sigma_m: np.ndarray) -> Points:
    """Each joint (3, 1 + 6 joints, n): as it is, then each coordinate of each joint moved by its sigma, down and up.

    All at once, because a live frame, n = 1, would take longer to call the formula for each than to track.
    """
    count = len(group.joints)
    rows = np.repeat(np.stack([points[name] for name in group.joints])[:, :, None], 1 + 6 * count, axis=2)
    joint, axis, up = (index.ravel() for index in np.indices((count, 3, 2)))
    step_m = sigma_m[[JOINT_INDEX[name] for name in group.joints]]
    rows[joint, axis, 1 + np.arange(6 * count)] += np.where(up[:, None], 1.0, -1.0) * step_m[joint]
    return dict(zip(group.joints, rows, strict=True))


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
    position_m, sigma_m = joints.position_m.transpose(1, 2, 0), joints.sigma_m.T
    column = 0
    for group in ANGLE_GROUPS:
        own = slice(column, column + len(group.names))
        value, spread = angles_with_sigma(group, position_m, sigma_m)
        degrees[:, own], sigma_deg[:, own] = np.degrees(value).T, np.degrees(spread).T
        worst = joints.state_code[:, [JOINT_INDEX[name] for name in group.joints]].max(axis=1)
        state_code[:, own] = worst[:, None]
        column = own.stop
    return AngleTable(joints.frame, joints.time_s, ANGLE_NAMES, degrees, state_code, sigma_deg)
