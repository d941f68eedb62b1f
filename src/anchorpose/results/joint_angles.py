"""Compute the body's angles from joint centres, for all frames, with state and uncertainty.

The angles of the pelvis are computed in the order rotation, obliquity, tilt (Baker 2001,
doi:10.1016/S0966-6362(00)00083-7), the reverse of the order that is used for joints. With this order, each angle agrees
with its clinical name even if the patient has turned.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_INDEX
from anchorpose.results.angle_definition import (
    LEAST_LEVER,
    PLANE_KNOWN_RAD,
    PLANE_UNKNOWN_RAD,
    AngleGroup,
    Axes,
    Points,
    Reading,
    arcsin,
    between,
    cross,
    dot,
    hinge_sigma,
    length,
    pelvis_axes,
    square_to,
    thorax_axes,
    trunk_axes,
    unit,
)
from anchorpose.results.frame_time import blocks
from anchorpose.results.tables import AngleTable, JointTable


def trunk_lean(points: Points) -> tuple[Reading, ...]:
    """Return the lean of the line from SpineBase to SpineShoulder against the vertical: forwards, then to the patient's
    right.

    Forwards is the horizontal direction perpendicular to the line through both hip joints. If this line is nearly
    vertical (the patient lies on a side), both angles are undetermined.
    """
    across, up = points["HipRight"] - points["HipLeft"], unit(points["SpineShoulder"] - points["SpineBase"])
    nothing = np.zeros_like(across[0])
    right = unit(np.stack([across[0], nothing, across[2]]))
    forward = np.stack([right[2], nothing, -right[0]])
    ahead, aside = dot(up, forward), dot(up, right)
    level = np.hypot(*unit(across)[[0, 2]])
    return (np.arctan2(ahead, up[1]), np.minimum(level, np.hypot(ahead, up[1]))), (arcsin(aside), level)


def trunk_heading(points: Points) -> tuple[Reading, ...]:
    """Return the direction in which the shoulders face, as an angle about the vertical: 0 = along the world's X,
    positive to the left.
    """
    z = unit(points["ShoulderRight"] - points["ShoulderLeft"])
    return ((np.arctan2(z[0], z[2]), np.hypot(z[0], z[2])),)


def trunk_on_pelvis(points: Points) -> tuple[Reading, ...]:
    """Return the angles of the thorax against the pelvis, Cardan angles in the order z, x, y: flexion, bend (positive
    to the right), turn (positive to the left).
    """
    pelvis, thorax = pelvis_axes(points), thorax_axes(points)
    aside = dot(pelvis.z, thorax.y)
    lever = np.sqrt(np.clip(1.0 - aside**2, 0.0, 1.0))
    turn = np.arctan2(-dot(pelvis.z, thorax.x), dot(pelvis.z, thorax.z))
    return (_flexion(pelvis, thorax.y), lever), (arcsin(aside), 1.0), (turn, lever)


def neck_lean(points: Points) -> tuple[Reading, ...]:
    """Return the angles of the line from Neck to Head against the thorax: flexion, bend (positive to the right)."""
    thorax, line = thorax_axes(points), unit(points["Head"] - points["Neck"])
    aside = dot(thorax.z, line)
    return (_flexion(thorax, line), np.sqrt(np.clip(1.0 - aside**2, 0.0, 1.0))), (arcsin(aside), 1.0)


def _flexion(axes: Axes, line: np.ndarray) -> np.ndarray:
    return np.arctan2(dot(line, axes.x), dot(line, axes.y))


def pelvis_angles(points: Points) -> tuple[Reading, ...]:
    """Return the pelvis angles: tilt (front down positive), obliquity (right hip higher positive), rotation (turned to
    the left positive).
    """
    pelvis = pelvis_axes(points)
    z = pelvis.z
    level = np.hypot(z[0], z[2])
    forward = unit(np.stack([z[2], np.zeros_like(level), -z[0]]))  # cross product of the vertical and z
    tilt = np.arctan2(dot(pelvis.y, forward), dot(pelvis.y, cross(z, forward)))
    return (tilt, level), (arcsin(z[1]), 1.0), (np.arctan2(z[0], z[2]), level)


SOLE_SLOPE_DEG: Final = 19.3
"""Downward slope in degrees of the line from ankle to toe base when the sole is level, as the mean over the shapes of
the body model. The slope's standard deviation between adults, 1.5 degrees, is not included in the ankle's sigma.
"""


VARUS_VALGUS_RAD: Final = np.radians(3.0)
"""Standard deviation, between people, of the angle by which knees are bowed in or out; assumed, not measured here."""


def hip_to_trunk(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the angle of the thigh against the whole trunk in the patient's sagittal plane: 0 = thigh and trunk in
    line, positive = knee forward.
    """
    right = unit(points["HipRight"] - points["HipLeft"])
    up = square_to(points["SpineShoulder"] - points["SpineBase"], right)
    return (_swing(up, right, unit(points[f"Knee{side}"] - points[f"Hip{side}"])),)


def hip_to_pelvis(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the angles of the thigh against the pelvis in ISB's joint coordinate system: flexion about the pelvis' z,
    then adduction.
    """
    pelvis, thigh = pelvis_axes(points), unit(points[f"Knee{side}"] - points[f"Hip{side}"])
    inwards = 1.0 if side == "Left" else -1.0
    return _swing(pelvis.y, pelvis.z, thigh), (inwards * arcsin(dot(thigh, pelvis.z)), 1.0)


def hip_rotation(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the rotation of the thigh about its long axis, as determined by the plane in which the leg is bent. The
    angle is 0 if the shank points straight back from the knee, perpendicular to the line through the hip joints. It is
    positive if the thigh is rotated inwards, so that the foot moves outwards.

    The rotation is the last of ISB's Cardan angles in the order z, x, y. The normal of the plane through hip, knee and
    ankle is taken as the thigh's z axis. The angle has no value for a leg that is within ``PLANE_KNOWN_RAD`` of
    straight or of folded, since the plane is then undetermined. A leg that is bent backwards has no value either, since
    the normal of its plane is reversed.
    """
    hip, knee, ankle = (points[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle"))
    across, y = unit(points["HipRight"] - points["HipLeft"]), unit(hip - knee)
    normal = cross(unit(ankle - knee), y)  # its length is the sine of the bending angle
    bent, z = length(normal), unit(-normal)
    aside, along = dot(across, cross(y, z)), dot(across, z)
    inwards = -1.0 if side == "Left" else 1.0
    # ``along`` is negative if the leg is bent backwards, since this reverses the normal of the plane through hip, knee
    # and ankle
    hinged = (bent >= np.sin(PLANE_KNOWN_RAD)) & (along > 0)
    return ((inwards * np.arctan2(-aside, along), np.where(hinged, bent * np.hypot(aside, along), 0.0)),)


def knee_flexion(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the flexion of the knee: 0 = straight leg, negative = bent backwards (hyperextended).

    The plane in which a nearly straight leg bends is mostly determined by noise and by the leg's sideways bow. Below
    ``PLANE_UNKNOWN_RAD``, the angle is therefore the signed rotation about the line through the hip joints: for a
    straight knee, noise then gives positive and negative angles, whose mean is zero. A clearly bent leg is bent in the
    plane of its hinge: above ``PLANE_KNOWN_RAD``, the angle is the whole angle between thigh and shank. Between the two
    limits, the angle changes gradually from the first definition to the second. No knee bends backwards beyond
    ``PLANE_KNOWN_RAD``, so above this limit the angle is positive, and the line through the hip joints is not needed.
    """
    hip, knee, ankle = (points[f"{name}{side}"] for name in ("Hip", "Knee", "Ankle"))
    thigh, shank = unit(knee - hip), unit(ankle - knee)
    across = unit(points["HipRight"] - points["HipLeft"])
    hinge, axis = square_to(across, thigh), cross(shank, thigh)
    bend, about_hinge = between(thigh, shank), dot(axis, hinge)
    clear = np.clip((bend - PLANE_UNKNOWN_RAD) / (PLANE_KNOWN_RAD - PLANE_UNKNOWN_RAD), 0.0, 1.0)
    part = np.arctan2(about_hinge, dot(thigh, shank))
    signed = clear * np.copysign(bend, about_hinge) + (1.0 - clear) * part
    return ((np.where(clear == 1.0, bend, signed), np.where(clear == 1.0, 1.0, length(cross(across, thigh)))),)


def ankle_dorsiflexion(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the angle of the foot against the shank: 0 = the sole of a foot of mean shape is perpendicular to the
    shank, positive = toes up (dorsiflexion).
    """
    knee, ankle, foot = (points[f"{name}{side}"] for name in ("Knee", "Ankle", "Foot"))
    return ((0.5 * np.pi + np.radians(SOLE_SLOPE_DEG) - between(knee - ankle, foot - ankle), 1.0),)


def _swing(up: np.ndarray, right: np.ndarray, thigh: np.ndarray) -> Reading:
    ahead, along = dot(thigh, cross(up, right)), -dot(thigh, up)
    return np.arctan2(ahead, along), np.hypot(ahead, along)


CARRYING_RAD: Final = np.radians(5.0)
"""Standard deviation, between people, of the angle by which elbows are bowed sideways (carrying angle); assumed, not
measured here.
"""


def shoulder_elevation(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the angle between the upper arm and the trunk, in whatever direction the arm is raised: 0 = hanging along
    the trunk, pi = overhead.
    """
    trunk = points["SpineBase"] - points["SpineShoulder"]
    return ((between(trunk, points[f"Elbow{side}"] - points[f"Shoulder{side}"]), 1.0),)


def shoulder_plane(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the direction in which the arm is raised (ISB's plane of elevation): 0 = sideways, 90 degrees =
    forwards.
    """
    trunk, arm = trunk_axes(points), unit(points[f"Elbow{side}"] - points[f"Shoulder{side}"])
    outwards = 1.0 if side == "Right" else -1.0
    ahead, aside = dot(arm, trunk.x), outwards * dot(arm, trunk.z)
    return ((np.arctan2(ahead, aside), np.hypot(ahead, aside)),)


def shoulder_rotation(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the rotation of the upper arm about its long axis, as determined by the plane in which the arm is bent.
    The angle is 0 if the forearm of the hanging arm points forward. It is positive if the arm is rotated inwards, so
    that the hand moves towards the other side of the body.

    The angle is computed from the arm's rotation relative to the trunk. From this rotation, the shortest rotation that
    takes the hanging arm to the arm's direction is removed; the remaining rotation is about the arm's long axis. ISB's
    third angle is not used, since it is undetermined for a hanging arm, the usual posture of patients. An arm that is
    within ``PLANE_KNOWN_RAD`` of straight or of folded has no reliable plane, and so no value. An arm that is raised
    high has no value either, since near overhead the shortest rotation is undetermined.
    """
    shoulder, elbow, wrist = (points[f"{name}{side}"] for name in ("Shoulder", "Elbow", "Wrist"))
    trunk, y = trunk_axes(points), unit(shoulder - elbow)
    normal = cross(unit(wrist - elbow), y)  # its length is the sine of the bending angle
    bent, z = length(normal), unit(normal)
    x = cross(y, z)
    inwards = 1.0 if side == "Right" else -1.0
    turn = np.arctan2(dot(trunk.x, z) - dot(trunk.z, x), dot(trunk.x, x) + dot(trunk.z, z))
    not_overhead = np.sqrt(np.clip(0.5 * (1.0 + dot(trunk.y, y)), 0.0, 1.0))
    hinged = bent >= np.sin(PLANE_KNOWN_RAD)
    return ((inwards * turn, np.where(hinged, bent * not_overhead, 0.0)),)


def elbow_flexion(points: Points, side: str) -> tuple[Reading, ...]:
    """Return the flexion of the elbow: 0 = straight arm, pi = folded arm."""
    shoulder, elbow, wrist = (points[f"{name}{side}"] for name in ("Shoulder", "Elbow", "Wrist"))
    return ((between(elbow - shoulder, wrist - elbow), 1.0),)


_HINGES: Final = {
    hip_rotation: partial(hinge_sigma, limb=("Hip", "Knee", "Ankle"), aside_rad=VARUS_VALGUS_RAD),
    shoulder_rotation: partial(hinge_sigma, limb=("Shoulder", "Elbow", "Wrist"), aside_rad=CARRYING_RAD),
}
"""For each formula whose angle depends on the plane in which a limb is bent: the function for ``AngleGroup.own_sigma``.
The function includes the limb's joints, and the standard deviation in rad of the angle by which the limb is bowed
sideways.
"""


def _sided(*rows: tuple[str, str, Callable[..., tuple[Reading, ...]]]) -> tuple[AngleGroup, ...]:
    """Return the angle groups of the left side, then of the right side. Each row of the argument holds the names of
    angles and of joints (with ``*`` for the side), and the formula.
    """
    return tuple(
        AngleGroup(
            tuple(f"{name}_{side.lower()}" for name in names.split()),
            tuple(joints.replace("*", side).split()),
            partial(formula, side=side),
            partial(_HINGES[formula], side=side) if formula in _HINGES else None,
        )
        for side in ("Left", "Right")
        for names, joints, formula in rows
    )


_HIPS, _SHOULDERS = ("HipLeft", "HipRight"), ("ShoulderLeft", "ShoulderRight")

TRUNK: Final = (
    AngleGroup(("pelvis_tilt", "pelvis_obliquity", "pelvis_rotation"), (*_HIPS, "SpineMid"), pelvis_angles),
    AngleGroup(("trunk_flexion", "trunk_side_bend"), ("SpineBase", "SpineShoulder", *_HIPS), trunk_lean),
    AngleGroup(("trunk_rotation",), _SHOULDERS, trunk_heading),
    AngleGroup(
        ("trunk_pelvis_flexion", "trunk_pelvis_side_bend", "trunk_pelvis_rotation"),
        (*_HIPS, "SpineMid", "SpineShoulder", *_SHOULDERS),
        trunk_on_pelvis,
    ),
    AngleGroup(
        ("neck_flexion", "neck_side_bend"), ("SpineMid", "SpineShoulder", *_SHOULDERS, "Neck", "Head"), neck_lean
    ),
)
LEGS: Final = _sided(
    ("hip_flexion", "SpineBase SpineShoulder HipLeft HipRight Knee*", hip_to_trunk),
    ("hip_pelvis_flexion hip_adduction", "SpineMid HipLeft HipRight Knee*", hip_to_pelvis),
    ("hip_rotation", "HipLeft HipRight Knee* Ankle*", hip_rotation),
    ("knee_flexion", "HipLeft HipRight Knee* Ankle*", knee_flexion),
    ("ankle_dorsiflexion", "Knee* Ankle* Foot*", ankle_dorsiflexion),
)
ARMS: Final = _sided(
    ("shoulder_elevation", "SpineBase SpineShoulder Shoulder* Elbow*", shoulder_elevation),
    ("shoulder_plane", "SpineBase SpineShoulder ShoulderLeft ShoulderRight Elbow*", shoulder_plane),
    ("shoulder_rotation", "SpineBase SpineShoulder ShoulderLeft ShoulderRight Elbow* Wrist*", shoulder_rotation),
    ("elbow_flexion", "Shoulder* Elbow* Wrist*", elbow_flexion),
)


AT_ONCE: Final = 128
"""Number of frames processed at once. The joints in these frames, with all variants of ``_moved_too``, fit into a CPU
core's cache.
"""


def angles_with_sigma(group: AngleGroup, position_m: np.ndarray, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a group's angles and their standard deviations, (k, n) radians each; NaN where a joint is lost, or where
    the joints determine the angle too poorly: the angle's lever, a number from 0 to 1 that states how well they
    determine it (``Reading``), is then below ``LEAST_LEVER``.

    position_m (21, 3, n), sigma_m (21, n): errors are assumed independent between joints and axes. To find the error of
    an angle, each coordinate of its joints is moved by its sigma in both directions. A derivative is not used, since
    the derivative of a straight knee's angle is undefined, so that no error could be computed from it. The error of the
    formula itself (``own_sigma``) is added in quadrature.
    """
    angle, sigma = np.empty((2, len(group.names), position_m.shape[-1]))
    for rows in blocks(angle.shape[1], AT_ONCE):
        points = {name: position_m[JOINT_INDEX[name]][:, rows] for name in group.joints}
        angle[:, rows], sigma[:, rows] = _angles_of_some(group, points, sigma_m[:, rows])
    lost = np.isnan(position_m[[JOINT_INDEX[name] for name in group.joints]]).any(axis=(0, 1))
    angle[:, lost] = sigma[:, lost] = np.nan  # even angles of the group that do not need the lost joint
    return angle, sigma


def _angles_of_some(group: AngleGroup, points: Points, sigma_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    readings = group.formula(_moved_too(group, points, sigma_m))
    values = np.stack([value for value, _ in readings])  # (k, moves, n); the first "move" leaves all joints in place
    levers = np.stack([np.broadcast_to(lever, values.shape[1:])[0] for _, lever in readings])
    angle = np.where(levers >= LEAST_LEVER, values[:, 0], np.nan)
    variance = 0.5 * (_shorter_way(values[:, 1:] - angle[:, None]) ** 2).sum(axis=1)
    if group.own_sigma is not None:
        variance += group.own_sigma(points) ** 2
    return angle, np.where(np.isnan(angle), np.nan, np.sqrt(variance))


def _moved_too(group: AngleGroup, points: Points, sigma_m: np.ndarray) -> Points:
    """Return 1 + 6 j variants of the group's j joints, as an array (3, 1 + 6 j, n) for each joint. The first variant
    has all joints unchanged. In each other variant, one coordinate of one joint is moved by the joint's sigma, down or
    up.

    The formula is called once for all variants. For a single live frame (n = 1), separate calls for all variants would
    take longer than tracking.
    """
    count = len(group.joints)
    rows = np.repeat(np.stack([points[name] for name in group.joints])[:, :, None], 1 + 6 * count, axis=2)
    joint, axis, up = (index.ravel() for index in np.indices((count, 3, 2)))
    step_m = sigma_m[[JOINT_INDEX[name] for name in group.joints]]
    rows[joint, axis, 1 + np.arange(6 * count)] += np.where(up[:, None], 1.0, -1.0) * step_m[joint]
    return dict(zip(group.joints, rows, strict=True))


def _shorter_way(angle: np.ndarray) -> np.ndarray:
    """Return the angle, shifted by whole turns into the range from -pi to pi."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


ANGLE_GROUPS: Final = (*TRUNK, *LEGS, *ARMS)

ANGLE_NAMES: Final = tuple(name for group in ANGLE_GROUPS for name in group.names)
"""The angles that joint centres determine, in the order of the table of angles."""


def joint_angles(joints: JointTable) -> AngleTable:
    """Return the angles ``ANGLE_NAMES`` of all frames. The state of an angle is the worst state of the joints involved.

    An angle has no value where one of its joints is lost; its state is then ``lost``, too. An angle also has no value
    where the pose leaves it undetermined; its state is then the state of the joints. docs/angles.md states for each
    angle when it is undetermined.
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
