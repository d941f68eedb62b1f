"""Sessions made up for the tests of events: legs that bend each by its own angle, with errors like tracked ones."""

import numpy as np
from results_builder import standing_joints
from scipy.ndimage import gaussian_filter1d

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.results.tables import JointTable
from anchorpose.simulate.movements import GivingWay
from anchorpose.simulate.timeline import ease

HZ = 30.0
BONE_M = 0.42
"""Thigh and shank of the stick figure."""

SLOW_S, FAST_M = 1.5, 0.001
"""Errors of a joint: most is constant or changes within seconds; a millimetre differs from frame to frame."""


def legs(left_deg: np.ndarray, right_deg: np.ndarray) -> np.ndarray:
    """(n, 21, 3): feet on the floor, each knee bent by its angle forwards, each hip above its ankle, trunk upright."""
    rest = standing_joints()
    joints = np.repeat(rest[None], len(left_deg), axis=0)
    drop = {}
    for side, degrees in (("Left", left_deg), ("Right", right_deg)):
        half = np.radians(degrees) / 2.0
        drop[side] = 2.0 * BONE_M * (np.cos(half) - 1.0)
        joints[:, JOINT_INDEX[f"Knee{side}"], 0] += BONE_M * np.sin(half)
        joints[:, JOINT_INDEX[f"Knee{side}"], 1] += BONE_M * (np.cos(half) - 1.0)
        joints[:, JOINT_INDEX[f"Hip{side}"], 1] += drop[side]
    for row, name in enumerate(JOINT_NAMES):
        if not name.startswith(("Hip", "Knee", "Ankle", "Foot")):
            joints[:, row, 1] += 0.5 * (drop["Left"] + drop["Right"])
    return joints


def buckling(seconds: float, onsets_s: list[float], depth_deg: float, fall_s: float, share: float = 0.4) -> np.ndarray:
    """The left knee gives way as in simulated sessions, is caught, and straightens in a second.

    share: of the depth by which the other knee bends too, since the pelvis comes down.
    """
    time_s = np.arange(0.0, seconds, 1.0 / HZ)
    left = np.full(len(time_s), 6.0)
    for onset_s in onsets_s:
        left += depth_deg * GivingWay((), onset_s, fall_s, 0.3, 1.0).strength(time_s)
    return legs(left, 6.0 + share * (left - 6.0))


def tracked(position_m: np.ndarray, sigma_m: float, seed: int, hz: float = HZ, fast_m: float = FAST_M) -> JointTable:
    """Joints (n, 21, 3) with errors of so much per axis: 70 % of the variance is constant, the rest changes slowly."""
    rng, shape = np.random.default_rng(seed), position_m.shape
    lasting = rng.normal(size=(1, *shape[1:]))
    slow = gaussian_filter1d(rng.normal(size=(shape[0] + 400, *shape[1:])), SLOW_S * hz / 2.0, axis=0)[200:-200]
    slow /= slow.std()
    error_m = sigma_m * (np.sqrt(0.7) * lasting + np.sqrt(0.3) * slow) + fast_m * rng.normal(size=shape)
    time_s = np.arange(shape[0]) / hz
    codes, sigma = np.zeros(shape[:2], np.int8), np.full(shape[:2], sigma_m)
    return JointTable(np.arange(shape[0], dtype=np.int32), time_s, position_m + error_m, codes, sigma)


def still(seconds: float) -> np.ndarray:
    """(n, 21, 3): who stands with both knees bent by 6 degrees."""
    bent = np.full(round(seconds * HZ), 6.0)
    return legs(bent, bent)


def rising(
    lowest_deg: list[float], up_s: float = 0.8, stood_s: float = 0.0, seated_s: float = 3.0
) -> tuple[np.ndarray, list[float]]:
    """Thighs (n,) in degrees of a patient who rises from a seat until the thighs are so steep, and sits again.

    Also returns when each rise begins.
    """
    parts, onsets_s, seat_deg = [np.full(round(seated_s * HZ), 85.0)], list[float](), 85.0
    for lowest in lowest_deg:
        onsets_s.append(sum(len(part) for part in parts) / HZ)
        up, down = (ease(np.linspace(0.0, 1.0, round(length_s * HZ))) for length_s in (up_s, 0.6))
        parts += [seat_deg + (lowest - seat_deg) * up, np.full(round(stood_s * HZ), lowest)]
        parts += [lowest + (seat_deg - lowest) * down, np.full(round(seated_s * HZ), seat_deg)]
    return np.concatenate(parts), onsets_s


def falling(seconds: float, onsets_s: list[float], way: tuple[float, float], body_m: float) -> np.ndarray:
    """(n, 21, 3): the body moves by so much on the floor (x, z) within 0.8 s, and after 0.45 s the left foot follows.

    Foot and body come back within two seconds, three seconds after the onset.
    """
    time_s, direction = np.arange(0.0, seconds, 1.0 / HZ), np.array([way[0], 0.0, way[1]])
    joints = np.repeat(standing_joints()[None], len(time_s), axis=0)
    for onset_s in onsets_s:
        since_s = time_s - onset_s
        back = 1.0 - ease((since_s - 3.0) / 2.0)
        body, foot = body_m * ease(since_s / 0.8) * back, 0.35 * ease((since_s - 0.45) / 0.35) * back
        lift = 0.08 * np.sin(np.pi * np.clip((since_s - 0.45) / 0.35, 0.0, 1.0))
        for row, name in enumerate(JOINT_NAMES):
            moved = foot if name in ("AnkleLeft", "FootLeft") else 0.5 * (body + foot) if name == "KneeLeft" else body
            still_foot = name in ("AnkleRight", "FootRight")
            joints[:, row] += np.outer(0.0 * body if still_foot else moved, direction)
            if name in ("AnkleLeft", "FootLeft"):
                joints[:, row, 1] += lift
    return joints
