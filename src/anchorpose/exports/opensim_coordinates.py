"""Compute joint coordinates with the names, signs and zeros of OpenSim's whole-body models, from joint centres.

Axes are X forward, Y up, Z right, as OpenSim's bodies have them. Joint centres do not determine the rotation of thigh,
upper arm and forearm about their long axes; for thigh and upper arm, this rotation follows from the knee and elbow axes
of the patient's learnt body model.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.joint_ranges import hinge_axes
from anchorpose.body.pose import MOVING_BONES
from anchorpose.body.segments import load_body_asset
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.exports.formats import Product, Source, rounded_text, write_rows
from anchorpose.exports.regular_time import near_in_time, stretch_name, stretches_of
from anchorpose.joints import JOINT_INDEX
from anchorpose.options import CoordinateModel, ExportConfig
from anchorpose.results.joint_angles import SOLE_SLOPE_DEG, knee_flexion
from anchorpose.results.tables import POSES_FILE, PoseTable, read_poses
from anchorpose.rotations import unit

SIDES: Final = (("Right", "r", 1), ("Left", "l", -1))
"""For each side: its name in this project, its name in OpenSim, and 1 if the Z axis points to this side, else -1."""

LOWER_SPINE_LEAN_DEG: Final = 4.4
UPPER_SPINE_LEAN_DEG: Final = 5.2
"""Inclinations of the spine, in degrees, of the body model's mean shape in upright standing. The line from the hips to
SpineMid leans back by ``LOWER_SPINE_LEAN_DEG``; the line from SpineMid to SpineShoulder leans forward by
``UPPER_SPINE_LEAN_DEG``. These leans define the zeros of the pelvis and lumbar coordinates, as ``SOLE_SLOPE_DEG``
defines the zero of the ankle; a test compares these values with the body model.
"""


def joint(position_m: np.ndarray, name: str) -> np.ndarray:
    """Return the positions (n, 3) of one joint."""
    return position_m[:, JOINT_INDEX[name]]


def pelvis_axes(position_m: np.ndarray) -> np.ndarray:
    """Return the pelvis's axes (n, 3, 3), columns X, Y, Z in the world: Z points from the left to the right hip; Y
    points as nearly as possible from the midpoint between the hips towards SpineMid, then is tilted about Z by
    ``LOWER_SPINE_LEAN_DEG``, since this line leans back in a person who stands upright. NaN where a joint is missing.
    """
    right = joint(position_m, "HipRight") - joint(position_m, "HipLeft")
    middle = 0.5 * (joint(position_m, "HipRight") + joint(position_m, "HipLeft"))
    up = joint(position_m, "SpineMid") - middle
    z = unit(right)
    x = unit(np.cross(up, z))
    return _about_z(np.stack([x, np.cross(z, x), z], axis=-1), -LOWER_SPINE_LEAN_DEG)


def torso_axes(position_m: np.ndarray) -> np.ndarray:
    """Return the trunk's axes (n, 3, 3), columns X, Y, Z in the world: Z is as near as possible to the line of the
    shoulders; Y points from SpineMid to SpineShoulder, then is tilted about Z by ``UPPER_SPINE_LEAN_DEG``, since this
    line leans forward in a person who stands upright. NaN where a joint is missing.
    """
    right = joint(position_m, "ShoulderRight") - joint(position_m, "ShoulderLeft")
    y = unit(joint(position_m, "SpineShoulder") - joint(position_m, "SpineMid"))
    x = unit(np.cross(y, right))
    return _about_z(np.stack([x, y, np.cross(x, y)], axis=-1), UPPER_SPINE_LEAN_DEG)


def in_axes(axes: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return the components of world vectors (n, 3) along the axes (n, 3, 3)."""
    return np.einsum("nji,nj->ni", axes, vector)


def known_median(values: np.ndarray) -> np.ndarray:
    """Return the median (k,) of each column of ``values`` (n, k), over the rows without NaN; NaN if every row has a
    NaN.
    """
    known = values[np.isfinite(values).all(axis=1)]
    return np.median(known, axis=0) if len(known) else np.full(values.shape[1], np.nan)


def rotations_deg(axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return OpenSim's three rotations of a pelvis or trunk: ``axes = Rz(first) Rx(second) Ry(third)``, each (n,)
    degrees.
    """
    second = np.arcsin(np.clip(axes[:, 2, 1], -1.0, 1.0))
    first = np.arctan2(-axes[:, 0, 1], axes[:, 1, 1])
    third = np.arctan2(-axes[:, 2, 0], axes[:, 2, 2])
    return np.degrees(first), np.degrees(second), np.degrees(third)


def limb_angles_deg(direction: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return flexion and adduction (n,) of a limb, in degrees, both zero if the limb hangs along -Y. direction (n, 3):
    direction of the limb in the axes of the pelvis or trunk.

    side: 1 right, -1 left; adduction is towards the body's midline on both sides.
    """
    along = unit(direction)
    flexion = np.arctan2(along[:, 0], -along[:, 1])
    return np.degrees(flexion), np.degrees(np.arcsin(np.clip(-side * along[:, 2], -1.0, 1.0)))


def bend_deg(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angle (n,) between two vectors, exact also for small angles; NaN where a vector is missing or has
    length zero.
    """
    along = np.sum(unit(first) * unit(second), axis=-1)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(unit(first), unit(second)), axis=-1), along))


def _about_z(axes: np.ndarray, degrees: float) -> np.ndarray:
    """Return the axes (n, 3, 3), rotated about their own Z axis."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return axes @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class HingeAxes:
    """Knee and elbow axes of the patient's learnt body model, which determine the rotation of thigh and upper arm about
    their long axes.

    knee, elbow (n, 2, 3): unit axes in the world, right then left, pointing to the right where the limb hangs down; NaN
    where the patient is lost.
    """

    knee: np.ndarray
    elbow: np.ndarray


def read_hinge_axes(path: Path, frame: np.ndarray) -> HingeAxes | None:
    """Read the axes of knees and elbows from poses.parquet; None if the results have no such table. Raises InputError
    if the table's frames are not ``frame`` (n,).
    """
    if not path.exists():
        return None
    poses = read_poses(path)
    if not np.array_equal(poses.frame, frame):
        raise InputError(path, "has other frames than joints.parquet", "track the recording again")
    knee, elbow = np.empty((len(frame), len(SIDES), 3)), np.empty((len(frame), len(SIDES), 3))
    for index, (side, _, _) in enumerate(SIDES):
        # knee axes point to the left in the body model, to the right in OpenSim
        knee[:, index] = -_axis(poses, f"{side}UpLeg", f"{side}Leg")
        elbow[:, index] = _axis(poses, f"{side}Arm", f"{side}ForeArm")
    return HingeAxes(knee, elbow)


def _axis(poses: PoseTable, upper: str, lower: str) -> np.ndarray:
    """Return the unit axis (n, 3) in the world about which the lower bone bends; this axis is fixed to the upper
    bone.
    """
    hinge, _ = hinge_axes(load_body_asset(), lower)
    quaternion = poses.quaternion[:, MOVING_BONES.index(upper)].astype(np.float64)
    axis = np.full((len(quaternion), 3), np.nan)
    known = np.isfinite(quaternion).all(axis=1)
    axis[known] = Rotation.from_quat(quaternion[known], scalar_first=True).apply(hinge[0])
    return axis


SHIFTS: Final = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
"""Names of the OpenSim coordinates that are lengths, not angles."""


def opensim_coordinates(
    position_m: np.ndarray, model: CoordinateModel, hinges: HingeAxes | None = None
) -> dict[str, np.ndarray]:
    """Compute OpenSim's coordinates, by name, from joints (n, 21, 3), world, metres; leave out coordinates that joints
    do not determine. Each coordinate is an array (n,), in degrees for rotations and in metres for ``SHIFTS``, NaN where
    a joint is missing. Rotations are between -180 and 180 degrees, arm_flex between -90 and 270.

    hinges: the knee and elbow axes of the patient's learnt body model, from which hip_rotation and arm_rot are
    computed; None leaves both out. The model that ``opensim_model`` writes has the same axes and zeros: if it is given
    these coordinates, its markers are at the joints. Names, axes and signs are those of Rajagopal et al. 2016
    (doi:10.1109/TBME.2016.2586891), or of Delp et al. 1990 (doi:10.1109/10.102791) for gait2392, in which a bent knee
    is negative.
    """
    pelvis, torso = pelvis_axes(position_m), torso_axes(position_m)
    place, back = joint(position_m, "SpineBase"), np.einsum("nji,njk->nik", pelvis, torso)
    named = dict(zip(("pelvis_tilt", "pelvis_list", "pelvis_rotation"), rotations_deg(pelvis), strict=True))
    named |= {name: place[:, index] for index, name in enumerate(SHIFTS)}
    named |= zip(("lumbar_extension", "lumbar_bending", "lumbar_rotation"), rotations_deg(back), strict=True)
    for index, (side, end, sign) in enumerate(SIDES):
        named |= _leg(position_m, pelvis, side, end, sign, model) | _arm(position_m, torso, side, end, sign)
        if hinges is not None:
            thigh = joint(position_m, f"Knee{side}") - joint(position_m, f"Hip{side}")
            upper_arm = joint(position_m, f"Elbow{side}") - joint(position_m, f"Shoulder{side}")
            named[f"hip_rotation_{end}"] = _axial_rotation_deg(pelvis, thigh, hinges.knee[:, index], sign)
            named[f"arm_rot_{end}"] = _axial_rotation_deg(torso, upper_arm, hinges.elbow[:, index], sign)
    return named


def _leg(
    position_m: np.ndarray, pelvis: np.ndarray, side: str, end: str, sign: int, model: CoordinateModel
) -> dict[str, np.ndarray]:
    hip, knee, ankle, foot = (joint(position_m, f"{name}{side}") for name in ("Hip", "Knee", "Ankle", "Foot"))
    flexion, adduction = limb_angles_deg(in_axes(pelvis, knee - hip), sign)
    bent = 1.0 if model is CoordinateModel.RAJAGOPAL else -1.0
    return {
        f"hip_flexion_{end}": flexion,
        f"hip_adduction_{end}": adduction,
        f"knee_angle_{end}": bent * _knee_deg(position_m, side),
        f"ankle_angle_{end}": 90.0 + SOLE_SLOPE_DEG - bend_deg(knee - ankle, foot - ankle),
    }


def _knee_deg(position_m: np.ndarray, side: str) -> np.ndarray:
    """Return the knee angle (n,), degrees, as in angles.parquet; the angle may be negative in a nearly straight knee,
    since OpenSim's models can overextend the knee.
    """
    names = (f"Hip{side}", f"Knee{side}", f"Ankle{side}", "HipLeft", "HipRight")
    ((radians, lever),) = knee_flexion({name: joint(position_m, name).T for name in names}, side)
    return np.where(np.greater(lever, 0.0), np.degrees(radians), np.nan)


def _arm(position_m: np.ndarray, torso: np.ndarray, side: str, end: str, sign: int) -> dict[str, np.ndarray]:
    shoulder, elbow, wrist = (joint(position_m, f"{name}{side}") for name in ("Shoulder", "Elbow", "Wrist"))
    flexion, adduction = limb_angles_deg(in_axes(torso, elbow - shoulder), sign)
    return {
        # the range from -90 to 270 degrees: the angle then jumps by 360 degrees where an arm would point straight back,
        # which no arm can, and not where an arm points overhead
        f"arm_flex_{end}": (flexion + 90.0) % 360.0 - 90.0,
        f"arm_add_{end}": adduction,
        f"elbow_flex_{end}": bend_deg(elbow - shoulder, wrist - elbow),
    }


def _axial_rotation_deg(above: np.ndarray, along: np.ndarray, hinge: np.ndarray, side: int) -> np.ndarray:
    """Return the inward rotation (n,), degrees, of a thigh or upper arm about its long axis. above (n, 3, 3): axes of
    the trunk or pelvis; along, hinge (n, 3): direction of the limb, and axis of the knee or elbow at its end.
    """
    y = -unit(along)
    x = unit(np.cross(y, hinge))
    limb = np.stack([x, y, np.cross(x, y)], axis=-1)
    return side * rotations_deg(np.einsum("nji,njk->nik", above, limb))[2]


STEM: Final = "motion"
DIGITS: Final = 6  # number of digits after the point


def write_mot(folder: Path, source: Source, config: ExportConfig) -> Product:
    """Write motion.mot, or one file for each stretch of frames without a pause in which all written coordinates are
    known; raises AnchorposeError without such a stretch.
    """
    hinges = read_hinge_axes(source.folder / POSES_FILE, source.frame)
    coordinates = opensim_coordinates(source.samples.position_m, config.model, hinges)
    names = tuple(coordinates)
    whole = np.stack([coordinates.pop(name) for name in names], axis=1)  # ``pop`` frees memory for long results
    stretches = stretches_of(np.isfinite(whole), near_in_time(source.samples.time_s))
    if not stretches.runs:
        raise AnchorposeError("No two frames in a row have the joints that a MOT needs; export with --to csv instead.")
    kept = tuple(name for name, keep in zip(names, stretches.kept, strict=True) if keep)
    for number, (first, last) in enumerate(stretches.runs):
        name = stretch_name(STEM, ".mot", number, len(stretches.runs))
        values = _turning_on(kept, whole[first:last, stretches.kept])
        write_mot_file(folder / name, source.samples.time_s[first:last], kept, values)
    left_out = [name for name in names if name not in kept]
    return Product(
        axes=f"OpenSim's coordinates of the model {config.model}; X forward, Y up, Z to the patient's right",
        units="degrees; pelvis_tx, pelvis_ty, pelvis_tz metres; seconds",
        time="as recorded",
        missing="a MOT cannot hold a gap: coordinates known in less than half of the patient's frames are left out, "
        "and each stretch of frames without a pause in which all the others are known is a separate file",
        counts=(
            ("files", len(stretches.runs)),
            ("frames", stretches.frames),
            ("frames_left_out", len(source.frame) - stretches.frames),
        ),
        notes=(
            f"Left out, since joints are missing: {', '.join(left_out) or 'nothing'}.",
            "hip_rotation and arm_rot are those of the learnt body (poses.parquet); they are the least certain."
            if hinges is not None
            else "hip_rotation and arm_rot are left out: joint centres do not determine them (no poses.parquet).",
            *stretches.notes,
        ),
    )


def _turning_on(names: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """Return the values (n, c) without the jumps of ``pelvis_rotation`` by 360 degrees that occur when a turning
    patient faces -X. Across such a jump, interpolation and filters would take the longer arc.

    The other rotations keep their jumps: no other joint turns full circle, and where such a rotation has no definite
    value, removing jumps would only add whole turns.
    """
    turning = values.copy()
    for column in np.flatnonzero(np.isin(names, "pelvis_rotation")):
        turning[:, column] = np.unwrap(values[:, column], period=360.0)
    return turning


def write_mot_file(path: Path, time_s: np.ndarray, names: tuple[str, ...], values: np.ndarray) -> None:
    """Write a MOT file; values (n, c) without NaN."""
    head = [path.stem, "version=1", f"nRows={len(time_s)}", f"nColumns={len(names) + 1}", "inDegrees=yes", "endheader"]
    body = (
        [repr(float(time)), *(rounded_text(value, DIGITS, "") for value in row.tolist())]
        for time, row in zip(time_s, values, strict=True)
    )
    write_rows(path, "\t", ([line] for line in head), [["time", *names]], body)
