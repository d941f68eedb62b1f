"""Build equipment: a standing frame, parallel bars, a chest pad, a walker, a wheelchair, a sling or a stool.

All equipment stands still, and is fitted around the sweep: the space through which the patient's skin moves in the
recording. So the trunk does not pass through the equipment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.recording.equipment import Box, Cylinder, EquipmentPart
from anchorpose.rotations import FORWARD, RIGHT, UP
from anchorpose.simulate.person import Person

ARM_BONES = ("Arm", "Hand", "Finger", "Thumb")  # a bone whose name contains one of these texts belongs to an arm
LOOSE_M = 0.06  # m, maximum movement of the chest in the recording for a sling to have a harness
# m, maximum distance of each rail from the middle plane z = 0: that of the widest parallel bars on the market
WIDEST_M = 0.62


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """The space through which a patient moves, given by the patient's skin at k moments."""

    skin_m: np.ndarray  # (k, v, 3) vertices of the skin at the k moments, including clothes
    arms: np.ndarray  # (v,) bool, vertices of the arms
    pelvis_m: np.ndarray  # (k, 3) positions of the pelvis at the k moments

    def within(self, low_m: float, high_m: float, aside_m: float = np.inf, arms: bool = False) -> np.ndarray:
        """Return the skin points (n, 3) of all moments that lie between two heights and within ``aside_m`` of the plane
        z = 0.

        arms: whether points of the arms are included.
        """
        skin = self.skin_m if arms else self.skin_m[:, ~self.arms]
        inside = (skin[..., 1] > low_m) & (skin[..., 1] < high_m) & (np.abs(skin[..., 2]) < aside_m)
        return np.asarray(skin[inside], dtype=np.float64)

    def standing(self) -> Sweep:
        """Return the space that the patient fills at the single moment at which the pelvis is highest."""
        highest = int(np.argmax(self.pelvis_m[:, 1]))
        return Sweep(self.skin_m[highest : highest + 1], self.arms, self.pelvis_m[highest : highest + 1])

    def seated(self) -> Sweep:
        """Return the space that the patient fills at the single moment at which the pelvis is lowest."""
        lowest = int(np.argmin(self.pelvis_m[:, 1]))
        return Sweep(self.skin_m[lowest : lowest + 1], self.arms, self.pelvis_m[lowest : lowest + 1])


def sweep_of(person: Person, bones: np.ndarray) -> Sweep:
    """Return the space through which a person moves, by the skin at k moments; bones (k, b, 4, 4): T_world_rest of the
    bones.
    """
    asset = person.body.asset
    arms = np.array([any(part in asset.bone_names[bone] for part in ARM_BONES) for bone in asset.main_bone()])
    skin = np.stack([person.skin(moment, 0.0) for moment in bones])
    root = bones[:, 0]
    return Sweep(skin, arms, root[:, :3, :3] @ person.body.bone_heads[0] + root[:, :3, 3])


@dataclass(frozen=True, slots=True, eq=False)
class HeldEquipment:
    """Equipment that the patient holds."""

    parts: tuple[EquipmentPart, ...]
    grip_m: np.ndarray  # (2, 3) places where the left and the right hand hold the equipment


def fit_standing_frame(
    rng: np.random.Generator, pelvis_m: float, knee_m: float, front_m: float, half_width_m: float
) -> HeldEquipment:
    """Build a standing frame: posts, rails, floor runners, a bar in front of the belly and a bar in front of the knees.

    pelvis_m, knee_m: heights of pelvis and knees. front_m: x of the foremost skin of belly and knees. half_width_m:
    distance of the rails from the plane z = 0 that leaves space for the arms.
    """
    bar_height_m = rng.uniform(0.05, 0.09)
    bar_depth_m = rng.uniform(0.03, 0.05)
    x = front_m + bar_depth_m / 2.0 + rng.uniform(0.04, 0.08)
    half_m = max(half_width_m, 0.40) + rng.uniform(0.0, 0.06)
    tube_m = rng.uniform(0.035, 0.05)
    rail_m = pelvis_m + rng.uniform(-0.06, 0.04)
    cross_m = rail_m + rng.uniform(0.05, 0.13)
    parts: list[EquipmentPart] = []
    for side, z in (("left", -half_m), ("right", half_m)):
        parts += [
            _tube(rng, f"post-{side}", (x, (cross_m + 0.05) / 2.0, z), tube_m, cross_m + 0.05, 1),
            _tube(rng, f"rail-{side}", (x - 0.35, rail_m, z), tube_m, 0.75, 0),
            _box(f"base-{side}", (x - 0.3, 0.03, z), (1.0, 0.06, 0.06)),
        ]
    parts.append(_box("cross-bar", (x + 0.02, cross_m, 0.0), (0.04, 0.05, 2.0 * half_m)))
    knee_bar_m = knee_m + rng.uniform(-0.06, 0.02)
    parts.append(_box("knee-bar", (x, knee_bar_m, 0.0), (bar_depth_m, bar_height_m, 2.0 * half_m - tube_m)))
    grip_x, top_m = x - rng.uniform(0.08, 0.18), rail_m + tube_m / 2.0
    return HeldEquipment(tuple(parts), np.array([[grip_x, top_m, -half_m], [grip_x, top_m, half_m]]))


def fit_parallel_bars(rng: np.random.Generator, pelvis_m: float, half_width_m: float) -> HeldEquipment:
    """Build two rails on four posts around a patient at the origin. The bars' front half mirrors their back half."""
    rail_m = pelvis_m + rng.uniform(-0.06, 0.04)
    half_m = max(half_width_m, 0.32) + rng.uniform(0.0, 0.05)
    tube_m, length_m = rng.uniform(0.035, 0.045), rng.uniform(1.6, 2.2)
    parts: list[EquipmentPart] = []
    for side, z in (("left", -half_m), ("right", half_m)):
        parts.append(_tube(rng, f"rail-{side}", (0.0, rail_m, z), tube_m, length_m, 0))
        for end, x in (("front", 0.4 * length_m), ("back", -0.4 * length_m)):
            post = np.array([x, (rail_m - tube_m / 2.0) / 2.0, z])
            parts.append(Cylinder(f"post-{side}-{end}", post, UP, tube_m / 2.0, rail_m - tube_m / 2.0))
    top_m = rail_m + tube_m / 2.0
    return HeldEquipment(tuple(parts), np.array([[0.12, top_m, -half_m], [0.12, top_m, half_m]]))


def build_stool(rng: np.random.Generator, center_m: tuple[float, float], height_m: float) -> tuple[EquipmentPart, ...]:
    """Return a round or square stool whose top is at ``height_m``, centred at (x, z)."""
    x, z = center_m
    if rng.random() < 0.5:
        column_m = height_m - 0.06
        return (
            Cylinder("seat", np.array([x, height_m - 0.03, z]), UP, 0.18, 0.06),
            Cylinder("column", np.array([x, column_m / 2.0, z]), UP, 0.03, column_m),
        )
    leg_m = height_m - 0.05
    legs = [
        _box(f"leg-{number}", (x + dx, leg_m / 2.0, z + dz), (0.03, leg_m, 0.03))
        for number, (dx, dz) in enumerate([(-0.15, -0.16), (-0.15, 0.16), (0.15, -0.16), (0.15, 0.16)])
    ]
    return (_box("seat", (x, height_m - 0.025, z), (0.36, 0.05, 0.38)), *legs)


def fit_chest_pad(
    rng: np.random.Generator, sweep: Sweep, sternum_m: float, rail_m: float, half_m: float
) -> tuple[EquipmentPart, ...]:
    """Return a pad in front of the sternum (its post stands on a bar across both rails) and straps around the hips.

    sternum_m, rail_m: heights; half_m: distance of each rail from the plane z = 0.
    """
    height_m, thick_m, gap_m = rng.uniform(0.20, 0.28), rng.uniform(0.04, 0.07), rng.uniform(0.02, 0.045)
    low_m = sternum_m - height_m / 2.0
    front_m = _front(sweep.within(low_m, low_m + height_m, 0.2)) + gap_m
    bar_m = max(front_m + thick_m + 0.03, _front(sweep.within(rail_m - 0.06, rail_m + 0.06)) + 0.05)
    post_m = low_m + height_m / 2.0
    parts: list[EquipmentPart] = [
        _box("chest-pad", (front_m + thick_m / 2.0, low_m + height_m / 2.0, 0.0), (thick_m, height_m, 0.32)),
        _box("chest-bar", (bar_m, rail_m, 0.0), (0.04, 0.04, 2.0 * half_m)),
        _box("chest-post", (bar_m, (rail_m + post_m) / 2.0, 0.0), (0.03, post_m - rail_m, 0.05)),
        _box(
            "chest-arm",
            ((front_m + thick_m + bar_m) / 2.0, post_m, 0.0),
            (bar_m - front_m - thick_m + 0.03, 0.04, 0.05),
        ),
    ]
    strap_m = rail_m + rng.uniform(-0.06, 0.02)
    hips = sweep.within(strap_m - 0.05, strap_m + 0.05)
    aside_m, behind_m = float(np.abs(hips[:, 2]).max()) + 0.02, float(hips[:, 0].min()) - 0.02
    for side, way in (("left", -1.0), ("right", 1.0)):
        size = (bar_m - behind_m, 0.05, 0.008)
        parts.append(_box(f"strap-{side}", ((bar_m + behind_m) / 2.0, strap_m, way * aside_m), size))
    parts.append(_box("strap-behind", (behind_m, strap_m, 0.0), (0.008, 0.05, 2.0 * aside_m)))
    return tuple(parts)


def fit_walker(rng: np.random.Generator, sweep: Sweep, handle_m: float) -> HeldEquipment:
    """Build a walker: two side frames, joined by bars in front of the patient, with handles ``handle_m`` high."""
    tube_m, length_m = rng.uniform(0.025, 0.032), rng.uniform(0.40, 0.48)
    body = sweep.within(0.1, handle_m + 0.1)
    half_m = float(np.clip(np.abs(body[:, 2]).max() + 0.07, 0.28, WIDEST_M))
    front_m = _front(body) + rng.uniform(0.06, 0.12)
    back_m = front_m - length_m
    parts: list[EquipmentPart] = []
    for side, z in (("left", -half_m), ("right", half_m)):
        for end, x in (("front", front_m), ("back", back_m)):
            parts.append(Cylinder(f"leg-{side}-{end}", np.array([x, handle_m / 2.0, z]), UP, tube_m / 2.0, handle_m))
        for name, y in (("handle", handle_m), ("brace", 0.4 * handle_m)):
            middle = np.array([(front_m + back_m) / 2.0, y, z])
            parts.append(Cylinder(f"{name}-{side}", middle, FORWARD, tube_m / 2.0, length_m))
    for name, y in (("front-bar", handle_m - 0.06), ("front-brace", 0.5 * handle_m)):
        parts.append(Cylinder(name, np.array([front_m, y, 0.0]), RIGHT, tube_m / 2.0, 2.0 * half_m))
    grip = np.array([[back_m + 0.55 * length_m, handle_m + tube_m / 2.0, z] for z in (-half_m, half_m)])
    return HeldEquipment(tuple(parts), grip)


def fit_wheelchair(rng: np.random.Generator, sweep: Sweep, sits: bool) -> tuple[EquipmentPart, ...]:
    """Build a wheelchair without leg rests, under a patient who sits at times (``sits``), else behind the patient."""
    depth_m = rng.uniform(0.40, 0.44)
    seat = sweep.seated() if sits else sweep
    legs = sweep.standing().within(0.2, 0.6)
    if sits:
        hips_m = seat.pelvis_m[0]
        front_m = min(float(hips_m[0]) + 0.20, float(legs[:, 0].min()) - 0.03)
        sat_on = seat.within(0.2, 1.0, 0.25)
        near = (sat_on[:, 0] < front_m) & (sat_on[:, 0] > hips_m[0] - 0.25)
        seat_m = float(sat_on[near, 1].min()) - 0.01
        depth_m = max(depth_m, front_m - float(seat.within(seat_m, seat_m + 0.6, 0.25)[:, 0].min()) + 0.03)
    else:
        seat_m = rng.uniform(0.45, 0.52)
        front_m = float(sweep.within(0.0, 1.2)[:, 0].min()) - rng.uniform(0.05, 0.12)
    hips = seat.within(seat_m, seat_m + 0.3)
    half_m = float(np.clip(np.abs(hips[hips[:, 0] < front_m, 2]).max(initial=0.0) + 0.03, 0.22, 0.34))
    back_m, middle_m, wheel_m = front_m - depth_m, front_m - depth_m / 2.0, rng.uniform(0.28, 0.31)
    parts: list[EquipmentPart] = [
        _box("seat", (middle_m, seat_m - 0.025, 0.0), (depth_m, 0.05, 2.0 * half_m)),
        _box("back", (back_m - 0.02, seat_m + 0.21, 0.0), (0.04, 0.42, 2.0 * half_m)),
    ]
    for side, way in (("left", -1.0), ("right", 1.0)):
        z = way * (half_m + 0.02)
        parts += [
            Cylinder(f"wheel-{side}", np.array([back_m + 0.08, wheel_m, z + way * 0.03]), RIGHT, wheel_m, 0.03),
            Cylinder(f"castor-{side}", np.array([front_m - 0.10, 0.08, z]), RIGHT, 0.08, 0.03),
            _box(f"fork-{side}", (front_m - 0.10, (seat_m + 0.11) / 2.0, z), (0.03, seat_m - 0.11, 0.02)),
            _box(f"armrest-{side}", (middle_m - 0.05, seat_m + 0.22, z), (0.28, 0.03, 0.04)),
            _box(f"upright-{side}", (back_m - 0.02, seat_m / 2.0 + 0.26, z), (0.03, seat_m + 0.48, 0.03)),
            _box(f"handle-{side}", (back_m - 0.08, seat_m + 0.49, z), (0.12, 0.03, 0.03)),
        ]
    return tuple(parts)


def fit_sling(rng: np.random.Generator, sweep: Sweep, sternum_m: float, ceiling_m: float) -> tuple[EquipmentPart, ...]:
    """Build a spreader bar above the head, two straps beside the head, and a harness if the trunk keeps still.
    sternum_m, ceiling_m: heights.
    """
    standing = sweep.standing()
    chest = standing.within(sternum_m - 0.1, sternum_m + 0.1, 0.2)
    middle_m = float(chest[:, 0].mean())
    top_m = float(sweep.skin_m[..., 1].max())
    bar_m = min(top_m + rng.uniform(0.08, 0.16), ceiling_m - 0.25)
    aside_m = rng.uniform(0.17, 0.21)
    parts: list[EquipmentPart] = [
        Cylinder("spreader", np.array([middle_m, bar_m, 0.0]), RIGHT, 0.02, 2.0 * aside_m + 0.1),
        _box("ceiling-strap", (middle_m, (bar_m + ceiling_m) / 2.0, 0.0), (0.05, ceiling_m - bar_m, 0.01)),
    ]
    for side, way in (("left", -1.0), ("right", 1.0)):
        below = sweep.skin_m.reshape(-1, 3)
        column = (np.abs(below[:, 0] - middle_m) < 0.05) & (np.abs(below[:, 2] - way * aside_m) < 0.03)
        end_m = min(float(below[column, 1].max(initial=sternum_m)) + 0.02, bar_m - 0.1)
        size = (0.05, bar_m - end_m, 0.008)
        parts.append(_box(f"strap-{side}", (middle_m, (bar_m + end_m) / 2.0, way * aside_m), size))
    band, worn = (s.within(sternum_m - 0.16, sternum_m - 0.02, 0.2) for s in (sweep, standing))
    if max(_front(band) - _front(worn), float(worn[:, 0].min() - band[:, 0].min())) > LOOSE_M:
        return tuple(parts)  # no harness is built: it would have to move with the trunk, but all equipment stands still
    for name, x in (("harness-front", _front(band) + 0.015), ("harness-back", float(band[:, 0].min()) - 0.015)):
        parts.append(_box(name, (x, sternum_m - 0.09, 0.0), (0.012, 0.12, 0.30)))
    return tuple(parts)


def _front(points_m: np.ndarray) -> float:
    return float(points_m[:, 0].max())


def _box(name: str, center_m: tuple[float, float, float], size_m: tuple[float, float, float]) -> Box:
    return Box(name, np.array(center_m), np.array(size_m), np.eye(3))


def _tube(
    rng: np.random.Generator, name: str, center_m: tuple[float, float, float], tube_m: float, length_m: float, axis: int
) -> EquipmentPart:
    """Return a tube ``tube_m`` thick along axis 0, 1 or 2; whether it is round or square is drawn."""
    along = np.eye(3)[axis]
    if rng.random() < 0.5:
        return Cylinder(name, np.array(center_m), along, tube_m / 2.0, length_m)
    return Box(name, np.array(center_m), np.where(along > 0, length_m, tube_m), np.eye(3))
