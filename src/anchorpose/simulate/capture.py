"""Represent a captured movement over time: directions of body segments and places of feet, without bone lengths."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from anchorpose.rotations import FORWARD, RIGHT, UP, orthonormal_frame, unit
from anchorpose.simulate.movement_file import CLIP_HZ, SEATED, Clips, movement_of
from anchorpose.simulate.timeline import ease

# s, sigma of the Gaussian that smooths joints over time, since joints of a Kinect v2 jitter by mm to cm
SMOOTHING_S: Final = 0.07
OVERLAP_S: Final = 0.4  # s, time over which the end of a repetition is blended into the start of the next repetition
STRAIGHT_RAD: Final = 0.35  # rad; if an elbow is bent by less than this, its axis comes partly from earlier frames
PLANE_MEMORY_S: Final = 0.5  # s, time constant with which the axis of a nearly straight elbow is updated

_AXES: Final = np.stack([-RIGHT, UP, FORWARD])  # world directions of a movement file's axes: left, up and ahead


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """A captured movement with ``CLIP_HZ`` frames per second; the subject faces +X on average. The second axis of all
    arrays of limbs is the side: left, right.
    """

    start_s: float  # time of the first of the n rows of the arrays
    waist_m: np.ndarray  # (n, 3) positions of the waist
    pelvis: np.ndarray  # (n, 3, 3) rotation from upright
    thorax: np.ndarray  # (n, 3, 3) rotation from upright
    head: np.ndarray  # (n, 3) direction from the head joint to the top of the head
    arms: np.ndarray  # (n, 2, 2, 3) directions of upper arm and forearm
    legs: np.ndarray  # (n, 2, 2, 3) directions of thigh and shank
    arm_axis: np.ndarray  # (n, 2, 3) axis about which the elbow bends
    knee_m: np.ndarray  # (n, 2, 3) vector to the knee from the line between hip and ankle
    ankle_m: np.ndarray  # (n, 2, 3) positions of the ankles
    toes: np.ndarray  # (n, 2, 3) direction of the foot
    leg_m: float  # length of the subject's leg
    seated: bool  # whether the subject sits down on a seat or gets up from a seat


def lay_out(clips: Clips, first: int, phase: float, from_s: float, until_s: float) -> Capture:
    """Join clips into a movement from ``from_s`` to ``until_s``. Time 0 s is at ``phase`` (0: start, 1: end) of clip
    ``first``.
    """
    rows_before = int(np.ceil(-from_s * CLIP_HZ))
    count = rows_before + int(np.ceil(until_s * CLIP_HZ)) + 2
    zero = int(phase * (len(clips.joints_m[first]) - 1))
    before, index = zero, first
    while before < rows_before:
        index = (index - 1) % len(clips.joints_m)
        before += len(clips.joints_m[index]) - _overlap(clips, index)
    series, skip = _chain(clips, index, count + before - rows_before), before - rows_before
    series = gaussian_filter1d(series, SMOOTHING_S * CLIP_HZ, axis=0, mode="nearest")[skip : skip + count]
    seated = movement_of(clips.names[0]) in SEATED
    return _measure(series @ _AXES, clips.joint_names, -rows_before / CLIP_HZ, seated)


def _overlap(clips: Clips, index: int) -> int:
    """Return the number of rows over which a clip is blended into the next clip."""
    shortest = min(len(clips.joints_m[index]), len(clips.joints_m[(index + 1) % len(clips.joints_m)]))
    return min(int(OVERLAP_S * CLIP_HZ), shortest // 3)


def _chain(clips: Clips, index: int, count: int) -> np.ndarray:
    """Return joints (count, j, 3) of the clips from ``index`` on; each clip is moved so that its feet begin where the
    feet of the previous clip end.
    """
    feet = [clips.joint_names.index(name) for name in ("LFoot", "RFoot")]
    series = clips.joints_m[index].copy()
    while len(series) < count:
        overlap = _overlap(clips, index)
        index = (index + 1) % len(clips.joints_m)
        following = clips.joints_m[index].copy()
        gap = series[-overlap:, feet].mean(axis=(0, 1)) - following[:overlap, feet].mean(axis=(0, 1))
        following += gap * [1.0, 0.0, 1.0]
        share = ease((np.arange(overlap) + 1.0) / (overlap + 1.0))[:, None, None]
        series[-overlap:] += share * (following[:overlap] - series[-overlap:])
        series = np.concatenate([series, following[overlap:]])
    return series[:count]


def _measure(joints_m: np.ndarray, names: tuple[str, ...], start_s: float, seated: bool) -> Capture:
    """Convert joints (n, j, 3) to a ``Capture`` (directions and rotations of body segments), after turning the subject
    to face +X on average.
    """
    at = {name: joints_m[:, names.index(name)] for name in names}
    across = (at["RUpperLeg"] - at["LUpperLeg"]).mean(axis=0)
    heading = np.arctan2(across[0], across[2])  # rad, angle between +Z and the direction of the subject's right side
    cos, sin = np.cos(heading), np.sin(heading)
    level = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    at = {name: place @ level.T for name, place in at.items()}

    def limb(*joints: str) -> np.ndarray:
        return np.stack([[at[f"{s}{b}"] - at[f"{s}{a}"] for a, b in pairwise(joints)] for s in "LR"])

    arms, legs = limb("UpperArm", "Forearm", "Hand"), limb("UpperLeg", "LowerLeg", "Foot")
    hips, knees, ankles = (np.stack([at[f"{s}{n}"] for s in "LR"]) for n in ("UpperLeg", "LowerLeg", "Foot"))
    along = unit(ankles - hips)
    bend = knees - hips - ((knees - hips) * along).sum(axis=2, keepdims=True) * along
    directions = unit(arms).transpose(2, 0, 1, 3)
    return Capture(
        start_s=start_s,
        waist_m=at["Waist"],
        pelvis=_frames(at["Spine"] - at["Waist"], at["RUpperLeg"] - at["LUpperLeg"]),
        thorax=_frames(at["Chest"] - at["Spine"], at["RUpperArm"] - at["LUpperArm"]),
        head=unit(at["HeadTip"] - at["Head"]),
        arms=directions,
        legs=unit(legs).transpose(2, 0, 1, 3),
        arm_axis=np.stack([_bending_axis(directions[:, side]) for side in (0, 1)], axis=1),
        knee_m=bend.transpose(1, 0, 2),
        ankle_m=ankles.transpose(1, 0, 2),
        toes=np.stack([unit(at[f"{s}Toes"] - at[f"{s}Foot"]) for s in "LR"], axis=1),
        leg_m=float(np.linalg.norm(legs, axis=3).mean(axis=(0, 2)).sum()),
        seated=seated,
    )


def _frames(up: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the rotations (n, 3, 3) from the upright posture of a segment whose long axis points along ``up`` (n, 3)
    and whose right side faces ``right`` (n, 3).
    """
    return orthonormal_frame(up, right) @ orthonormal_frame(UP, RIGHT).T


def _bending_axis(arm: np.ndarray) -> np.ndarray:
    """Return the axis (n, 3) about which a positive rotation bends the elbow.

    arm (n, 2, 3): directions of upper arm and forearm. A straight elbow does not determine the axis: the axis of
    earlier frames is then kept, and made perpendicular to the upper arm.
    """
    measured = np.cross(arm[:, 0], arm[:, 1])
    sine = np.linalg.norm(measured, axis=1)
    trust = np.clip(sine / np.sin(STRAIGHT_RAD), 0.0, 1.0) ** 2
    axes = np.zeros((len(arm), 3))
    axis = RIGHT.copy() if sine.max() == 0 else measured[int(np.argmax(sine))]
    # the backward pass comes first, so that the first frames have an axis, too
    for times in (range(len(arm) - 1, -1, -1), range(len(arm))):
        for t in times:
            carried = unit(axis - (axis @ arm[t, 0]) * arm[t, 0])
            gain = trust[t] * (1.0 if trust[t] >= 1.0 else 1.0 / (PLANE_MEMORY_S * CLIP_HZ))
            wanted = measured[t] / max(sine[t], 1e-9)
            axis = unit((1.0 - gain) * carried + gain * wanted)
            axes[t] = axis
    return axes
