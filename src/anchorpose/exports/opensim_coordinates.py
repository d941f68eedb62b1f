"""Joint coordinates as OpenSim's models of the whole body name, sign and zero them, from joint centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.exports.osim_geometry import SIDES
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


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """values (n, c): degrees for turns and metres for pelvis_tx, _ty, _tz; NaN where a joint is missing."""

    names: tuple[str, ...]
    values: np.ndarray


def opensim_coordinates(position_m: np.ndarray, model: CoordinateModel) -> Coordinates:
    """Coordinates of the joints (n, 21, 3), world, metres; what joint centres do not carry is left out.

    The model that ``osim_model`` writes has the same axes and zeros: played on it, these put its markers where the
    joints are. Names, axes and signs: Rajagopal et al. 2016 (doi:10.1109/TBME.2016.2586891), Delp et al. 1990
    (doi:10.1109/10.102791) for gait2392, in which a bent knee is negative.
    """
    pelvis, torso = pelvis_axes(position_m), torso_axes(position_m)
    named = _root(position_m, pelvis) | _back(pelvis, torso)
    for side, end, sign in SIDES:
        named |= _leg(position_m, pelvis, side, end, sign, model) | _arm(position_m, torso, side, end, sign)
    return Coordinates(tuple(named), np.stack(list(named.values()), axis=1))


def _root(position_m: np.ndarray, pelvis: np.ndarray) -> dict[str, np.ndarray]:
    tilt, obliquity, rotation = turns_deg(pelvis)
    place = joint(position_m, "SpineBase")
    return {
        "pelvis_tilt": tilt,
        "pelvis_list": obliquity,
        "pelvis_rotation": rotation,
        **{f"pelvis_t{axis}": place[:, index] for index, axis in enumerate("xyz")},
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
        f"knee_angle_{end}": bent * bend_deg(knee - hip, ankle - knee),
        f"ankle_angle_{end}": 90.0 + FOOT_SLOPE_DEG - bend_deg(knee - ankle, foot - ankle),
    }


def _arm(position_m: np.ndarray, torso: np.ndarray, side: str, end: str, sign: int) -> dict[str, np.ndarray]:
    shoulder, elbow, wrist = (joint(position_m, f"{name}{side}") for name in ("Shoulder", "Elbow", "Wrist"))
    flexion, adduction = limb_turns_deg(in_axes(torso, elbow - shoulder), sign)
    return {
        f"arm_flex_{end}": flexion,
        f"arm_add_{end}": adduction,
        f"elbow_flex_{end}": bend_deg(elbow - shoulder, wrist - elbow),
    }
