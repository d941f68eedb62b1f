"""Divide the patient's skin into clinical regions, find other people near the skin, and keep standing feet in place.

A leg that a therapist hides from all cameras is constrained only by the hip, so its estimate would swing. In stand
training, patients keep standing, so the place where the foot of the hidden leg stood last is the best evidence of the
leg's pose.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.asset import BodyAsset
from anchorpose.body.config import VisibilityConfig
from anchorpose.body.constraints import Constraints, join, no_constraints, place_constraints
from anchorpose.body.hands_on_patient import HAND_M, find_hands
from anchorpose.body.kinematics import missing_points
from anchorpose.body.skin_points import Body, PosedPoints, SkinPoints
from anchorpose.body.visibility import seen_skin
from anchorpose.camera import Camera
from anchorpose.isolation.bystander_memory import BystanderMemory
from anchorpose.isolation.view import View
from anchorpose.joints import JOINT_INDEX, JointState

_MIDDLE: Final = {
    "head": ("Head",),
    "neck_and_shoulders": ("Neck", "Neck1", "LeftShoulder", "RightShoulder"),
    "chest": ("Spine", "Spine1"),
    "belly": ("LowerBack",),
    "pelvis": ("Hips", "LHipJoint", "RHipJoint"),
}
_SIDED: Final = {
    "upper_arm": ("{side}Arm",),
    "forearm": ("{side}ForeArm",),
    "hand": ("{side}Hand", "{initial}Thumb", "{side}FingerBase", "{side}HandFinger1"),
    "thigh": ("{side}UpLeg",),
    "knee": ("{side}UpLeg", "{side}Leg"),
    "shank": ("{side}Leg",),
    "foot": ("{side}Foot", "{side}ToeBase"),
}


def _all_regions() -> dict[str, tuple[str, ...]]:
    sided = {
        f"{name}_{side.lower()}": tuple(bone.format(side=side, initial=side[0]) for bone in bones)
        for side in ("Left", "Right")
        for name, bones in _SIDED.items()
    }
    return _MIDDLE | sided


REGION_BONES: Final = _all_regions()
"""The bones that move the skin of each clinical region; chest, belly and pelvis include the back."""

REGIONS: Final = tuple(REGION_BONES)


# m, radius around the knee joint within which skin belongs to the region of the knee: the kneecap plus a hand's breadth
KNEE_RADIUS_M: Final = 0.10


@cache
def region_of_points(points: SkinPoints) -> np.ndarray:
    """Return the clinical region (p,) of every skin point, as an index into ``REGIONS``."""
    asset = points.asset
    return region_of_skin(asset, points.part, asset.vertices[points.vertex], asset.bone_heads)


def region_of_skin(asset: BodyAsset, part: np.ndarray, place_m: np.ndarray, heads_m: np.ndarray) -> np.ndarray:
    """Return the region (p,) of skin points, an index into ``REGIONS``; the region of a knee is the skin around the
    knee joint.

    part (p,): bone that moves each point most; place_m (p, 3): each point in the rest pose; heads_m (b, 3): the first
    end of each bone in the rest pose.
    """
    whole = {
        bone: k for k, (name, bones) in enumerate(REGION_BONES.items()) if not name.startswith("knee") for bone in bones
    }
    region = np.array([whole[name] for name in asset.bone_names])[part]
    for side in ("Left", "Right"):
        leg = np.isin(part, [asset.bone(f"{side}UpLeg"), asset.bone(f"{side}Leg")])
        near = np.linalg.norm(place_m - heads_m[asset.bone(f"{side}Leg")], axis=1) < KNEE_RADIUS_M
        region[leg & near] = REGIONS.index(f"knee_{side.lower()}")
    return region


@lru_cache(maxsize=2)
def area_of_point(body: Body) -> float:
    """Return the area (m2) of skin that each of the evenly spread skin points represents on a body."""
    vertices, faces = body.mesh.vertices, body.points.asset.faces
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 / np.count_nonzero(skin_there(body)))


@lru_cache(maxsize=2)
def skin_there(body: Body) -> np.ndarray:
    """Return (p,) bool: the skin points that are not on missing parts of the body."""
    return ~missing_points(body.points.asset, body.points.part, body.shape.missing)


@dataclass(frozen=True, slots=True, eq=False)
class Nearness:
    """Pairs of a skin point of the patient and another person within a hand's length of this point, sorted by person,
    then by point.
    """

    person: np.ndarray  # (n,) uint8, pixel label of the other person
    point: np.ndarray  # (n,) int32, skin point of the patient
    distance_m: np.ndarray  # (n,) float32, distance from the point to the other person's nearest skin
    remembered: np.ndarray  # (n,) bool, whether the other person's skin was seen shortly before but is hidden now
    shown: np.ndarray  # (p,) bool, whether some camera sees the skin point of the patient
    area_m2: float  # m2, area of skin that each skin point of the patient represents


def find_nearness(
    body: Body,
    posed: PosedPoints,
    memory: BystanderMemory,
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    config: VisibilityConfig,
) -> Nearness:
    """Return the pairs of a skin point of the patient and another person near it. Skin of other people counts where
    cameras see it now or saw it shortly before. memory: the skin of all people as last seen. Hands of other people that
    wrongly have the patient's label (``find_hands``) are included. Body parts that the patient lacks are left out.
    """
    others, shown = memory.without_patient, seen_skin(posed, views, cameras, config)
    hands_m, whose = find_hands(posed, views, cameras)
    points_m, owner = np.concatenate([others.points_m, hands_m]), np.concatenate([others.owner, whose])
    hidden = np.concatenate([others.age_s > 0.0, np.zeros(len(whose), bool)])
    person, point, distance, remembered = [], [], [], []
    for label in np.flatnonzero(np.bincount(owner)).tolist():
        own = np.flatnonzero(_within(points_m, posed.points_m) & (owner == label))
        skin = np.flatnonzero(_within(posed.points_m, points_m[own]) & skin_there(body))
        found, nearest = cKDTree(points_m[own]).query(posed.points_m[skin], distance_upper_bound=HAND_M)
        near = np.isfinite(found)
        person.append(np.full(near.sum(), label, np.uint8))
        point.append(skin[near].astype(np.int32))
        distance.append(found[near].astype(np.float32))
        remembered.append(hidden[own[nearest[near]]])
    return Nearness(
        np.concatenate([np.zeros(0, np.uint8), *person]),
        np.concatenate([np.zeros(0, np.int32), *point]),
        np.concatenate([np.zeros(0, np.float32), *distance]),
        np.concatenate([np.zeros(0, bool), *remembered]),
        shown,
        area_of_point(body),
    )


def _within(points_m: np.ndarray, box_m: np.ndarray) -> np.ndarray:
    """Return (n,) bool: whether each of the points (n, 3) is less than ``HAND_M`` outside the bounding box of ``box_m``
    (k, 3).
    """
    if not len(box_m):
        return np.zeros(len(points_m), dtype=bool)
    low, high = box_m.min(axis=0) - HAND_M, box_m.max(axis=0) + HAND_M
    return np.asarray(((points_m > low) & (points_m < high)).all(axis=1))


SIDES = ("Left", "Right")
# number of skin points of a standing foot that are kept in place; enough to fix the foot's place and rotation
PLACES: Final = 6
# s; a foot counts as standing if it was seen at rest for about this time; in a step, the sole rests for less time
STILL_S: Final = 0.4
# m; a foot is at rest if its ankle moves by less than this, which is the error of the estimated place of a visible
# ankle
STILL_M: Final = 0.03
SIGMA_M: Final = 0.02  # m, standard deviation of a standing foot's place when the foot becomes hidden
# m/s; while a foot is hidden, the standard deviation of its place grows from ``SIGMA_M`` at this rate, in two seconds
# by the length of a small step
DRIFT_M_S: Final = 0.05
# m; a hidden foot is assumed to stand if the pose puts it less than this height above the floor; the height allows for
# errors of the pose
ON_FLOOR_M: Final = 0.10
# m, scale of the robust kernel in ``rows``: if the visible knee moves farther than this, the rows lose weight and the
# hidden foot follows the knee
DOUBT_M: Final = 0.10


@dataclass(frozen=True, slots=True, eq=False)
class _Stand:
    """The place where a foot stands, in the world."""

    places_m: np.ndarray  # (PLACES, 3) places at which the skin points of the foot are kept
    ankle_m: np.ndarray  # (3,) place of the foot's ankle
    since_s: float  # s, time of the last frame that confirmed this place
    seen: bool  # True: the foot was seen there; False: the foot is assumed to be there


class StandingFeet:
    """The place where each foot stands, as last seen or as assumed. Frames may come in reverse order of time."""

    _skin: dict[str, np.ndarray]
    _recent: dict[str, deque[tuple[float, np.ndarray]]]
    _stand: dict[str, _Stand]

    def __init__(self, points: SkinPoints) -> None:
        region = region_of_points(points)
        self._skin = {}
        for side in SIDES:
            foot = np.flatnonzero(region == REGIONS.index(f"foot_{side.lower()}"))
            self._skin[side] = foot[np.linspace(0, len(foot) - 1, PLACES).astype(np.int64)]
        self._recent = {side: deque() for side in SIDES}
        self._stand = {}

    def note(
        self,
        skin_m: np.ndarray,
        joints_m: np.ndarray,
        states: tuple[JointState, ...],
        time_s: float,
        floor_m: float | None = None,
    ) -> None:
        """Update the places where feet stand from one more registered frame. A visible foot counts as standing if its
        ankle was at rest, or is still near the place where the foot stood before.

        skin_m (p, 3), joints_m (21, 3): posed skin points and joints of this frame; floor_m: height of the floor, None
        if unknown. A hidden foot stays where it stood, unless cameras see past this place, that is, see something
        farther away there. A foot may be hidden without ever having been seen standing. If such a foot is on the floor
        in the registered pose, it is kept at this place until the next frame. So the hidden foot does not swing if the
        visible hip and knee bend.
        """
        for side in SIDES:
            ankle = JOINT_INDEX[f"Ankle{side}"]
            state, recent = states[ankle], self._recent[side]
            if state is JointState.LOST:
                self._stand.pop(side, None)
            if state is not JointState.OBSERVED:
                recent.clear()
                if state is not JointState.LOST and not self._was_seen(side):
                    self._believe(side, skin_m, joints_m[ankle], time_s, floor_m)
                continue
            recent.append((time_s, joints_m[ankle]))
            while abs(time_s - recent[0][0]) > STILL_S + 1e-6 and len(recent) > 2:
                recent.popleft()
            before = self._stand.get(side)
            stayed = before is not None and np.linalg.norm(joints_m[ankle] - before.ankle_m) < STILL_M
            if stayed or self._is_still(recent):
                self._stand[side] = _Stand(skin_m[self._skin[side]], joints_m[ankle], time_s, seen=True)
            else:
                self._stand.pop(side, None)

    def _was_seen(self, side: str) -> bool:
        stand = self._stand.get(side)
        return stand is not None and stand.seen

    def _believe(
        self, side: str, skin_m: np.ndarray, ankle_m: np.ndarray, time_s: float, floor_m: float | None
    ) -> None:
        """Assume that a hidden foot stands where the registered pose puts it, if this place is on the floor."""
        places_m = skin_m[self._skin[side]]
        if floor_m is not None and places_m[:, 1].min() < floor_m + ON_FLOOR_M:
            self._stand[side] = _Stand(places_m, ankle_m, time_s, seen=False)
        else:
            self._stand.pop(side, None)

    def forget(self, joints: Sequence[int]) -> None:
        """Forget where a foot stands if its ankle or foot joint is among ``joints``, which a reviewer corrected."""
        for side in SIDES:
            if {JOINT_INDEX[f"Ankle{side}"], JOINT_INDEX[f"Foot{side}"]} & set(joints):
                self._stand.pop(side, None)
                self._recent[side].clear()

    def rows(self, time_s: float) -> Constraints:
        """Return constraints that keep the standing feet in place in the frame at time_s; feet that do not stand get no
        rows.
        """
        held = []
        for side, stand in self._stand.items():
            sigma_m = SIGMA_M + DRIFT_M_S * abs(time_s - stand.since_s)
            held.append(place_constraints(self._skin[side], stand.places_m, sigma_m, DOUBT_M))
        return join(held) if held else no_constraints()

    def _is_still(self, recent: deque[tuple[float, np.ndarray]]) -> bool:
        places = np.array([place for _, place in recent])
        long = abs(recent[-1][0] - recent[0][0]) >= 0.75 * STILL_S
        return bool(long and np.linalg.norm(places - places[-1], axis=1).max() < STILL_M)
