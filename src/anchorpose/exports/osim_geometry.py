"""The patient's skeleton as OpenSim needs it: joint places in their segments, measured over all frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.exports.segment_frames import in_axes, joint, pelvis_axes, torso_axes

SIDES: Final = (("Right", "r", 1), ("Left", "l", -1))
"""Our name of a side, OpenSim's, and its sign on Z."""


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """Lengths in metres from joint to joint."""

    thigh: float
    shank: float
    foot: float
    upper_arm: float
    forearm: float
    hand: float


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBody:
    """Metres. hips and shoulders (2, 3), right then left: from SpineBase in pelvis axes, from SpineMid in torso axes.

    spine_mid (3,) from SpineBase in pelvis axes; spine_shoulder, neck (3,) from SpineMid in torso axes; head (3,) from
    the neck in torso axes.
    """

    hips: np.ndarray
    shoulders: np.ndarray
    spine_mid: np.ndarray
    spine_shoulder: np.ndarray
    neck: np.ndarray
    head: np.ndarray
    limbs: tuple[Limb, Limb]  # right, left


def measure_body(position_m: np.ndarray) -> MeasuredBody | None:
    """Medians over the frames (n, 21, 3); None where two ends of a bone were never there together."""
    pelvis, torso = pelvis_axes(position_m), torso_axes(position_m)

    def middle(axes: np.ndarray, start: str, end: str) -> np.ndarray:
        places = in_axes(axes, joint(position_m, end) - joint(position_m, start))
        known = places[np.isfinite(places).all(axis=1)]
        return np.median(known, axis=0) if len(known) else np.full(3, np.nan)

    limbs = [_limb(position_m, side) for side, _, _ in SIDES]
    body = MeasuredBody(
        hips=np.stack([middle(pelvis, "SpineBase", f"Hip{side}") for side, _, _ in SIDES]),
        shoulders=np.stack([middle(torso, "SpineMid", f"Shoulder{side}") for side, _, _ in SIDES]),
        spine_mid=middle(pelvis, "SpineBase", "SpineMid"),
        spine_shoulder=middle(torso, "SpineMid", "SpineShoulder"),
        neck=middle(torso, "SpineMid", "Neck"),
        head=middle(torso, "Neck", "Head"),
        limbs=(limbs[0], limbs[1]),
    )
    lengths = [getattr(limb, name) for limb in limbs for name in Limb.__slots__]
    places = [body.hips, body.shoulders, body.spine_mid, body.spine_shoulder, body.neck, body.head, np.array(lengths)]
    return body if all(np.isfinite(place).all() for place in places) else None


def _limb(position_m: np.ndarray, side: str) -> Limb:
    def length(start: str, end: str) -> float:
        along = np.linalg.norm(joint(position_m, f"{end}{side}") - joint(position_m, f"{start}{side}"), axis=1)
        known = along[np.isfinite(along)]
        return float(np.median(known)) if len(known) else float("nan")

    return Limb(
        thigh=length("Hip", "Knee"),
        shank=length("Knee", "Ankle"),
        foot=length("Ankle", "Foot"),
        upper_arm=length("Shoulder", "Elbow"),
        forearm=length("Elbow", "Wrist"),
        hand=length("Wrist", "Hand"),
    )
