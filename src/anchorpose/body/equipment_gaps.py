"""Measure the gap between each region of the patient's posed skin and each part of the equipment near this region."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS, area_of_point, region_of_points, skin_there
from anchorpose.body.skin_points import Body
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.equipment import EquipmentModel

NEAR_M: Final = 0.12  # m, maximum gap that is stored; all gaps that may be contacts are far smaller
# m, standard deviation of the place of the equipment model's surface; docs/guide/equipment.md allows errors of 0.01 m,
# which is two sigma
MODEL_SIGMA_M: Final = 0.005
SAMPLING_M: Final = 0.005
"""Metres that are subtracted from each gap: the nearest skin point is farther from the equipment than the continuous
skin between the points. The value is the mean difference over hands, arms, thighs and pelvis in two simulated clinics
(seeds 52001 and 52002); the means of single regions were -2 to 9 mm."""

# body regions without gaps, since feet always touch the floor and objects on the floor
FEET: Final = ("foot_left", "foot_right")

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
"""The joints that determine the place of each region's skin. The region's skin gets the sigma of the least certain of
these joints."""


def _joints_of(region: str) -> list[int]:
    for side in ("left", "right"):
        if region.endswith(f"_{side}"):
            return [JOINT_INDEX[f"{name}{side.capitalize()}"] for name in _ENDS[region.removesuffix(f"_{side}")]]
    return [JOINT_INDEX[name] for name in _ENDS[region]]


REGION_JOINTS: Final = {region: _joints_of(region) for region in REGIONS if region not in FEET}


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentGaps:
    """Pairs of an equipment part and a body region within ``NEAR_M`` of this part, sorted by part, then by region."""

    part: np.ndarray  # (n,) int16, index into the parts of the equipment model
    region: np.ndarray  # (n,) uint8, index into ``REGIONS``
    # (n,) float32, minimum distance from the region's skin to the part's surface, negative inside the part
    gap_m: np.ndarray
    sigma_m: np.ndarray  # (n,) float32, standard deviation of the gap
    # (n,) float32, area of the region's skin that is nearer to the part than ``reach_m``, an argument of
    # ``find_equipment_gaps``
    area_m2: np.ndarray
    # (n,) float32, share of seen points among the region's camera-facing skin points within ``reach_m`` of the part; 0
    # if none of these points faces a camera
    shown: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ShownSkin:
    """The visibility of each skin point of the patient."""

    faces: np.ndarray  # (p,) bool, whether the point faces some camera
    seen: np.ndarray  # (p,) bool, whether some camera sees the point


def find_equipment_gaps(
    body: Body,
    skin_m: np.ndarray,
    shown: ShownSkin,
    joint_sigma_m: np.ndarray,
    equipment: EquipmentModel,
    reach_m: float,
) -> EquipmentGaps:
    """Return the gaps between the patient's skin and the equipment in one frame.

    skin_m (p, 3): the posed skin points in the world. joint_sigma_m (21,): sigma of each joint, NaN for a lost joint;
    no gaps are returned for regions of the body with a lost joint. reach_m: maximum distance from the equipment at
    which skin counts for the fields ``area_m2`` and ``shown`` of the result.
    """
    region, sigma_m = region_of_points(body.points), region_sigma(joint_sigma_m)
    known = np.flatnonzero(np.isfinite(sigma_m)[region] & skin_there(body))
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
    area_m2, share = area_of_point(body) * counts[0], counts[2] / np.maximum(counts[1], 1)
    single = (each.astype(np.float32) for each in (gap_m - SAMPLING_M, sigma_m[index], area_m2, share))
    return EquipmentGaps(number.astype(np.int16), index.astype(np.uint8), *single)


def _of_part(part: int, distance_m: np.ndarray, region: np.ndarray, counted: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return part, region and gap (k,) for the k body regions near one part of the equipment. Also return (3, k): for
    each row of ``counted``, the number of skin points of each region at which the row is True.

    distance_m, region (n,): for each skin point around the part, its distance from the part and its body region.
    counted (3, n) bool: three selections of these skin points, one per row.
    """
    least = np.full(len(REGIONS), np.inf)
    np.minimum.at(least, region, distance_m)
    index = np.flatnonzero(least < NEAR_M)
    counts = np.stack([np.bincount(region[row], minlength=len(REGIONS)) for row in counted])
    return np.full(len(index), part), index, least[index], counts[:, index]


def _inside(skin_m: np.ndarray, low_m: np.ndarray, high_m: np.ndarray) -> np.ndarray:
    """Return (p,) bool: whether each skin point is in the box. The axes are tested in succession, which takes half the
    time of testing all axes at once.
    """
    inside = (skin_m[:, 0] > low_m[0]) & (skin_m[:, 0] < high_m[0])
    for axis in (1, 2):
        inside &= (skin_m[:, axis] > low_m[axis]) & (skin_m[:, axis] < high_m[axis])
    return np.asarray(inside)


def region_sigma(joint_sigma_m: np.ndarray) -> np.ndarray:
    """Return the standard deviation (regions,), metres, of the distance between each region's skin and the equipment.
    The result is NaN for feet (``FEET``) and for regions with a lost joint. joint_sigma_m (21,): NaN for lost joints.
    """
    variance = joint_sigma_m**2
    sigma = [variance[REGION_JOINTS[name]].max() if name in REGION_JOINTS else np.nan for name in REGIONS]
    return np.asarray(np.sqrt(np.array(sigma) + MODEL_SIGMA_M**2))


@lru_cache(maxsize=2)  # a run has a single model of the equipment
def part_boxes(equipment: EquipmentModel) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high corners (parts, 3) of a box around each equipment part, ``NEAR_M`` wider on every side."""
    corners = [part.triangles()[0] for part in equipment.parts]
    low = np.stack([each.min(axis=0) for each in corners]) - NEAR_M
    return low, np.stack([each.max(axis=0) for each in corners]) + NEAR_M
