"""Measure the gap between each region of the patient's posed skin and each part of the equipment that is near it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS, area_of_point, region_of_points
from anchorpose.body.skin_points import SkinPoints
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.equipment import EquipmentModel

NEAR_M: Final = 0.12  # gaps up to here are kept: a hand's length less the wrist, far beyond every gap that decides
MODEL_SIGMA_M: Final = 0.005  # of the equipment's surface: docs/guide/equipment.md asks for a tape measure's centimetre
SAMPLING_M: Final = 0.005
"""By how much the nearest of the skin points is farther from a part than the skin between them: the mean over hands,
arms, thighs and pelvis of two simulated clinics (seeds 52001 and 52002), where single regions had -2 to 9 mm."""

FEET: Final = ("foot_left", "foot_right")  # they stand on the floor and on what lies on it, which is no contact

_ENDS: Final = {
    "head": ("Head",),
    "neck_and_shoulders": ("SpineShoulder", "Neck"),
    "chest": ("SpineMid", "SpineShoulder"),
    "belly": ("SpineBase", "SpineMid"),
    "pelvis": ("SpineBase",),
    "upper_arm": ("Shoulder", "Elbow"),
    "forearm": ("Elbow", "Wrist"),
    "hand": ("Hand",),
    "thigh": ("Hip", "Knee"),
    "knee": ("Knee",),
    "shank": ("Knee", "Ankle"),
}
"""The joints that say where the skin of a region is: its skin is as uncertain as the less certain of them."""


def _joints_of(region: str) -> list[int]:
    for side in ("left", "right"):
        if region.endswith(f"_{side}"):
            return [JOINT_INDEX[f"{name}{side.capitalize()}"] for name in _ENDS[region.removesuffix(f"_{side}")]]
    return [JOINT_INDEX[name] for name in _ENDS[region]]


REGION_JOINTS: Final = {region: _joints_of(region) for region in REGIONS if region not in FEET}


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentGaps:
    """Pairs of a part of the equipment and a region of the body within ``NEAR_M`` of it, sorted by part, then region.

    part (n,) int16: index into the parts of the model; region (n,) uint8: index into ``REGIONS``. gap_m (n,) float32:
    least distance of the region's skin to the part's surface, negative inside of it; sigma_m (n,) float32: one standard
    deviation of that. area_m2 (n,) float32: the region's skin within reach of the part; shown (n,) float32: of that
    skin, as far as it faces a camera, the share that is seen, 0 where none faces one.
    """

    part: np.ndarray
    region: np.ndarray
    gap_m: np.ndarray
    sigma_m: np.ndarray
    area_m2: np.ndarray
    shown: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ShownSkin:
    """faces, seen (p,) bool: skin points that face some camera, and that some camera sees."""

    faces: np.ndarray
    seen: np.ndarray


def find_equipment_gaps(
    points: SkinPoints,
    skin_m: np.ndarray,
    shown: ShownSkin,
    joint_sigma_m: np.ndarray,
    equipment: EquipmentModel,
    reach_m: float,
) -> EquipmentGaps:
    """Return the gaps of one frame.

    skin_m (p, 3): the posed skin points, in the frame of the equipment, which is the world. joint_sigma_m (21,): NaN
    where a joint is lost, and then nothing is known of its regions. reach_m: skin within this distance of a part counts
    as touching it, or as close enough to show that it does.
    """
    region, sigma_m = region_of_points(points), region_sigma(joint_sigma_m)
    known = np.flatnonzero(np.isfinite(sigma_m)[region])
    low_m, high_m = part_boxes(equipment)
    found = [_of_part(0, np.zeros(0), np.zeros(0, np.int64), np.zeros((3, 0), bool))]
    for part, model in enumerate(equipment.parts):
        near = known[_inside(skin_m[known], low_m[part], high_m[part])]
        if len(near):
            distance_m = model.distance_m(skin_m[near])
            reached = distance_m < reach_m
            counted = np.stack([reached, reached & shown.faces[near], reached & shown.seen[near]])
            found.append(_of_part(part, distance_m, region[near], counted))
    number, index, gap_m, counts = (np.concatenate(column, axis=-1) for column in zip(*found, strict=True))
    area_m2, share = area_of_point(points) * counts[0], counts[2] / np.maximum(counts[1], 1)
    single = (each.astype(np.float32) for each in (gap_m - SAMPLING_M, sigma_m[index], area_m2, share))
    return EquipmentGaps(number.astype(np.int16), index.astype(np.uint8), *single)


def _of_part(part: int, distance_m: np.ndarray, region: np.ndarray, counted: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the part, region and gap (k,) of each region near it, and how many of its points are in each row of
    ``counted``.

    distance_m, region (n,): of the skin points around the part; counted (3, n) bool. The last is (3, k).
    """
    least = np.full(len(REGIONS), np.inf)
    np.minimum.at(least, region, distance_m)
    index = np.flatnonzero(least < NEAR_M)
    counts = np.stack([np.bincount(region[row], minlength=len(REGIONS)) for row in counted])
    return np.full(len(index), part), index, least[index], counts[:, index]


def _inside(skin_m: np.ndarray, low_m: np.ndarray, high_m: np.ndarray) -> np.ndarray:
    """Return (p,) bool: points in a box; an axis at a time, which takes half of the time of all at once."""
    inside = (skin_m[:, 0] > low_m[0]) & (skin_m[:, 0] < high_m[0])
    for axis in (1, 2):
        inside &= (skin_m[:, axis] > low_m[axis]) & (skin_m[:, axis] < high_m[axis])
    return np.asarray(inside)


def region_sigma(joint_sigma_m: np.ndarray) -> np.ndarray:
    """Return (regions,) one standard deviation of where each region's skin is against the equipment; NaN where unknown.

    joint_sigma_m (21,), NaN where lost. The feet have none: see ``FEET``.
    """
    variance = joint_sigma_m**2
    sigma = [variance[REGION_JOINTS[name]].max() if name in REGION_JOINTS else np.nan for name in REGIONS]
    return np.asarray(np.sqrt(np.array(sigma) + MODEL_SIGMA_M**2))


@lru_cache(maxsize=2)  # a run has one model
def part_boxes(equipment: EquipmentModel) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high (parts, 3): the box around each part, ``NEAR_M`` wider on every side."""
    corners = [part.triangles()[0] for part in equipment.parts]
    low = np.stack([each.min(axis=0) for each in corners]) - NEAR_M
    return low, np.stack([each.max(axis=0) for each in corners]) + NEAR_M
