"""Joint angles from joint centres alone, with the state and the uncertainty that they inherit.

ISB axes (X forward, Y up, Z right). Bending from a straight limb is positive. Angles about a long axis (turns of the
thigh, of the forearm) cannot be had from joint centres and are not given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.joints import JOINT_INDEX, JointState
from anchorpose.results.joint_frame import LOST
from anchorpose.results.tables import FRAMES_PER_ROW_GROUP, JointTable, open_parquet

ANGLES_FILE: Final = "angles.parquet"

ANGLES_SCHEMA: Final = pa.schema(
    [
        pa.field("frame", pa.int32(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("angle", pa.string(), nullable=False),
        pa.field("degrees", pa.float64()),
        pa.field("state", pa.string(), nullable=False),
        pa.field("sigma_deg", pa.float64()),
    ]
)

_VERTICAL: Final = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class AngleDefinition:
    """An angle's name, the joints that it is made of, in the order its formula takes them, and the formula."""

    name: str
    joints: tuple[str, ...]
    formula: Callable[..., np.ndarray]  # joints, each (..., 3), to (...) radians


@dataclass(frozen=True, slots=True, eq=False)
class AngleTable:
    """degrees and sigma_deg (n, a) float64, NaN where a joint is lost; severity (n, a) int8 of ``JointState``."""

    frame: np.ndarray
    time_s: np.ndarray
    names: tuple[str, ...]
    degrees: np.ndarray
    severity: np.ndarray
    sigma_deg: np.ndarray


def bend_rad(proximal: np.ndarray, middle: np.ndarray, distal: np.ndarray) -> np.ndarray:
    """How far a limb is bent at its middle joint: 0 = straight, pi = folded. Knee and elbow flexion."""
    return _between(middle - proximal, distal - middle)


def hip_flexion_rad(
    spine_base: np.ndarray, spine_shoulder: np.ndarray, hip_left: np.ndarray, hip_right: np.ndarray,
    hip: np.ndarray, knee: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Thigh against trunk in the patient's sagittal plane: 0 = in line, positive = knee forward, else extended."""
    right = _unit(hip_right - hip_left)
    trunk = spine_shoulder - spine_base
    up = _unit(trunk - np.sum(trunk * right, axis=-1, keepdims=True) * right)
    thigh = knee - hip
    return np.arctan2(np.sum(thigh * np.cross(up, right), axis=-1), -np.sum(thigh * up, axis=-1))


def shoulder_elevation_rad(
    spine_base: np.ndarray, spine_shoulder: np.ndarray, shoulder: np.ndarray, elbow: np.ndarray
) -> np.ndarray:
    """Upper arm against trunk, in whichever direction it is raised: 0 = along the trunk, pi = overhead."""
    return _between(spine_base - spine_shoulder, elbow - shoulder)


def trunk_flexion_rad(
    spine_base: np.ndarray, spine_shoulder: np.ndarray, hip_left: np.ndarray, hip_right: np.ndarray
) -> np.ndarray:
    """Trunk against the vertical of the world, forwards and backwards only: 0 = upright, positive = leant forward."""
    across = hip_right - hip_left
    forward = _unit(np.cross(_VERTICAL, across))
    trunk = spine_shoulder - spine_base
    return np.arctan2(np.sum(trunk * forward, axis=-1), trunk[..., 1])


def _sided(side: str) -> tuple[AngleDefinition, ...]:
    trunk, pelvis = ("SpineBase", "SpineShoulder"), ("HipLeft", "HipRight")
    hip, knee, shoulder, elbow = (f"{name}{side}" for name in ("Hip", "Knee", "Shoulder", "Elbow"))
    end = side.lower()
    return (
        AngleDefinition(f"hip_flexion_{end}", (*trunk, *pelvis, hip, knee), hip_flexion_rad),
        AngleDefinition(f"knee_flexion_{end}", (hip, knee, f"Ankle{side}"), bend_rad),
        AngleDefinition(f"shoulder_elevation_{end}", (*trunk, shoulder, elbow), shoulder_elevation_rad),
        AngleDefinition(f"elbow_flexion_{end}", (shoulder, elbow, f"Wrist{side}"), bend_rad),
    )


ANGLES: Final = (
    AngleDefinition("trunk_flexion", ("SpineBase", "SpineShoulder", "HipLeft", "HipRight"), trunk_flexion_rad),
    *_sided("Left"),
    *_sided("Right"),
)


def joint_angles(joints: JointTable) -> AngleTable:
    """All ``ANGLES`` of all frames; the state is the worst of the joints involved, NaN where one of them is lost."""
    indices = [np.array([JOINT_INDEX[name] for name in definition.joints]) for definition in ANGLES]
    angle_rad, sigma_rad, severity = [], [], []
    for definition, used in zip(ANGLES, indices, strict=True):
        value, sigma = _with_sigma(definition, joints.position_m, joints.sigma_m)
        worst = joints.severity[:, used].max(axis=1)
        angle_rad.append(value)
        sigma_rad.append(sigma)
        severity.append(np.where(np.isnan(value), LOST, worst))
    return AngleTable(
        frame=joints.frame,
        time_s=joints.time_s,
        names=tuple(definition.name for definition in ANGLES),
        degrees=np.degrees(np.stack(angle_rad, axis=1)),
        severity=np.stack(severity, axis=1).astype(np.int8),
        sigma_deg=np.degrees(np.stack(sigma_rad, axis=1)),
    )


def write_angles(path: Path, angles: AngleTable) -> None:
    """Writes angles.parquet, one row an angle and frame; the same bytes for the same angles."""
    states = [str(state) for state in JointState]
    with open_parquet(path, ANGLES_SCHEMA) as writer:
        for start in range(0, len(angles.frame), FRAMES_PER_ROW_GROUP):
            rows = slice(start, start + FRAMES_PER_ROW_GROUP)
            count = len(angles.frame[rows])
            columns = [
                pa.array(np.repeat(angles.frame[rows].astype(np.int32), len(angles.names))),
                pa.array(np.repeat(angles.time_s[rows], len(angles.names))),
                pa.array(angles.names * count, pa.string()),
                pa.array(angles.degrees[rows].ravel(), pa.float64(), from_pandas=True),
                pa.array([states[code] for code in angles.severity[rows].ravel()], pa.string()),
                pa.array(angles.sigma_deg[rows].ravel(), pa.float64(), from_pandas=True),
            ]
            writer.write_table(pa.Table.from_arrays(columns, schema=ANGLES_SCHEMA))


def _with_sigma(
    definition: AngleDefinition, position_m: np.ndarray, sigma_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Angle (n,) and its standard deviation (n,), radians, errors independent between joints and axes.

    Each coordinate is moved by its own sigma, both ways, instead of using a derivative: at a straight knee the
    derivative of the angle is not defined and would promise certainty.
    """
    points = [position_m[:, JOINT_INDEX[name]] for name in definition.joints]
    # a joint that stands twice in the formula (the hip of its own side) moves in both places at once
    angle = definition.formula(*points)
    variance = np.zeros(len(angle))
    for name in dict.fromkeys(definition.joints):
        for axis in np.eye(3):
            step = sigma_m[:, JOINT_INDEX[name], None] * axis
            for sign in (-1.0, 1.0):
                moved = [
                    p + sign * step if other == name else p for p, other in zip(points, definition.joints, strict=True)
                ]
                change = definition.formula(*moved) - angle
                variance += 0.5 * np.arctan2(np.sin(change), np.cos(change)) ** 2
    return angle, np.where(np.isnan(angle), np.nan, np.sqrt(variance))


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between vectors (..., 3), exact for small ones too; NaN where a vector has no length."""
    across, along = np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)
    return np.where((across == 0) & (along == 0), np.nan, np.arctan2(across, along))


def _unit(vector: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0, length, np.nan)
