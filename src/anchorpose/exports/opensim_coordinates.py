"""Joint coordinates as OpenSim's models of the whole body name, sign and zero them, from joint centres.

Knee and elbow axes of the learnt body: they carry the turns about thigh and upper arm that joint centres do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import load_body_asset
from anchorpose.body.pose import MOVING_BONES, hinge_axes
from anchorpose.errors import InputError
from anchorpose.exports.osim_segments import SIDES
from anchorpose.exports.product import CoordinateModel
from anchorpose.exports.segment_frames import (
    FOOT_SLOPE_DEG,
    bend_deg,
    in_axes,
    joint,
    limb_turns_deg,
    pelvis_axes,
    torso_axes,
    turns_deg,
)
from anchorpose.results.kinematics.limbs import knee_bend
from anchorpose.results.poses import PoseTable, read_poses
from anchorpose.rotations import unit


@dataclass(frozen=True, slots=True, eq=False)
class HingeAxes:
    """knee, elbow (n, 2, 3): unit axes in the world, right then left, each pointing to the right where the limb hangs
    down; NaN where the patient is lost."""

    knee: np.ndarray
    elbow: np.ndarray


def read_hinge_axes(path: Path, frame: np.ndarray) -> HingeAxes | None:
    """From poses.parquet; None where there is none. Raises InputError where its frames are not ``frame`` (n,)."""
    if not path.exists():
        return None
    poses = read_poses(path)
    if not np.array_equal(poses.frame, frame):
        raise InputError(path, "has other frames than joints.parquet", "track the recording again")
    sides = [side for side, _, _ in SIDES]
    return HingeAxes(
        # our knee bends about an axis to the left, OpenSim's about one to the right
        knee=np.stack([-_axis(poses, f"{side}UpLeg", f"{side}Leg") for side in sides], axis=1),
        elbow=np.stack([_axis(poses, f"{side}Arm", f"{side}ForeArm") for side in sides], axis=1),
    )


def _axis(poses: PoseTable, upper: str, lower: str) -> np.ndarray:
    """(n, 3) the axis about which the lower bone bends, carried by the upper."""
    hinge, _ = hinge_axes(load_body_asset(), lower)
    quaternion = poses.quaternion[:, MOVING_BONES.index(upper)].astype(np.float64)
    axis = np.full((len(quaternion), 3), np.nan)
    known = np.isfinite(quaternion).all(axis=1)
    axis[known] = Rotation.from_quat(quaternion[known], scalar_first=True).apply(hinge[0])
    return axis


SHIFTS: Final = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
"""The coordinates that are no turns."""


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """values (n, c): degrees for turns and metres for ``SHIFTS``; NaN where a joint is missing."""

    names: tuple[str, ...]
    values: np.ndarray


def opensim_coordinates(position_m: np.ndarray, model: CoordinateModel, hinges: HingeAxes | None = None) -> Coordinates:
    """Coordinates of the joints (n, 21, 3), world, metres; what joint centres do not carry is left out.

    hinges: the knee and elbow axes of the learnt body; with them hip_rotation and arm_rot are there too.
    The model that ``osim_model`` writes has the same axes and zeros: played on it, these put its markers where the
    joints are. Names, axes and signs: Rajagopal et al. 2016 (doi:10.1109/TBME.2016.2586891), Delp et al. 1990
    (doi:10.1109/10.102791) for gait2392, in which a bent knee is negative.
    """
    pelvis, torso = pelvis_axes(position_m), torso_axes(position_m)
    named = _root(position_m, pelvis) | _back(pelvis, torso)
    for index, (side, end, sign) in enumerate(SIDES):
        named |= _leg(position_m, pelvis, side, end, sign, model) | _arm(position_m, torso, side, end, sign)
        if hinges is not None:
            thigh = joint(position_m, f"Knee{side}") - joint(position_m, f"Hip{side}")
            upper_arm = joint(position_m, f"Elbow{side}") - joint(position_m, f"Shoulder{side}")
            named[f"hip_rotation_{end}"] = _turn_about_itself(pelvis, thigh, hinges.knee[:, index], sign)
            named[f"arm_rot_{end}"] = _turn_about_itself(torso, upper_arm, hinges.elbow[:, index], sign)
    return Coordinates(tuple(named), np.stack(list(named.values()), axis=1))


def _root(position_m: np.ndarray, pelvis: np.ndarray) -> dict[str, np.ndarray]:
    tilt, obliquity, rotation = turns_deg(pelvis)
    place = joint(position_m, "SpineBase")
    return {
        "pelvis_tilt": tilt,
        "pelvis_list": obliquity,
        "pelvis_rotation": rotation,
        **{name: place[:, index] for index, name in enumerate(SHIFTS)},
    }


def _back(pelvis: np.ndarray, torso: np.ndarray) -> dict[str, np.ndarray]:
    extension, bending, rotation = turns_deg(np.einsum("nji,njk->nik", pelvis, torso))
    return {"lumbar_extension": extension, "lumbar_bending": bending, "lumbar_rotation": rotation}


def _leg(
    position_m: np.ndarray, pelvis: np.ndarray, side: str, end: str, sign: int, model: CoordinateModel
) -> dict[str, np.ndarray]:
    hip, knee, ankle, foot = (joint(position_m, f"{name}{side}") for name in ("Hip", "Knee", "Ankle", "Foot"))
    flexion, adduction = limb_turns_deg(in_axes(pelvis, knee - hip), sign)
    bent = 1.0 if model is CoordinateModel.RAJAGOPAL else -1.0
    return {
        f"hip_flexion_{end}": flexion,
        f"hip_adduction_{end}": adduction,
        f"knee_angle_{end}": bent * _knee_deg(position_m, side),
        f"ankle_angle_{end}": 90.0 + FOOT_SLOPE_DEG - bend_deg(knee - ankle, foot - ankle),
    }


def _knee_deg(position_m: np.ndarray, side: str) -> np.ndarray:
    """(n,) as in angles.parquet, signed where the knee is nearly straight: a model can bend it backwards too."""
    names = (f"Hip{side}", f"Knee{side}", f"Ankle{side}", "HipLeft", "HipRight")
    ((radians, lever),) = knee_bend({name: joint(position_m, name).T for name in names}, side)
    return np.where(np.greater(lever, 0.0), np.degrees(radians), np.nan)


def _arm(position_m: np.ndarray, torso: np.ndarray, side: str, end: str, sign: int) -> dict[str, np.ndarray]:
    shoulder, elbow, wrist = (joint(position_m, f"{name}{side}") for name in ("Shoulder", "Elbow", "Wrist"))
    flexion, adduction = limb_turns_deg(in_axes(torso, elbow - shoulder), sign)
    return {
        f"arm_flex_{end}": flexion,
        f"arm_add_{end}": adduction,
        f"elbow_flex_{end}": bend_deg(elbow - shoulder, wrist - elbow),
    }


def _turn_about_itself(above: np.ndarray, along: np.ndarray, hinge: np.ndarray, side: int) -> np.ndarray:
    """(n,) degrees inwards of a limb about its long axis, from the axis of the hinge at its end."""
    y = -unit(along)
    x = unit(np.cross(y, hinge))
    limb = np.stack([x, y, np.cross(x, y)], axis=-1)
    return side * turns_deg(np.einsum("nji,njk->nik", above, limb))[2]
