"""Define changes of the body's shape, called directions, by which a single segment becomes longer, thicker or larger.

The shape coefficients of the shipped body asset change all segments together, left and right equally. Each direction in
this module changes a single segment of the mean adult. A direction of length stretches the segment along its axis and
shifts everything beyond its end. A direction of girth moves the skin away from the axis. A direction of size enlarges a
hand, a foot or the head. A bulge moves a region of the trunk's skin. One unit of a direction's coefficient is one
standard deviation among people of the same height (``shape_prior``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.asset import BodyAsset, stored_asset

SIDES: Final = ("left", "right")
LENGTH_SIGMA: Final = {"upper_arm": 0.032, "forearm": 0.042, "thigh": 0.050, "shank": 0.037}
"""Standard deviation of the logarithm of each segment's length among people of one height and sex: 6,068 adults of
ANSUR II (Gordon et al. 2014, NATICK/TR-15/007, public data), regressed on the logarithm of stature. In the same order,
the measured lengths are acromion-radiale, radiale-stylion, trochanterion to lateral femoral epicondyle, and epicondyle
to lateral malleolus."""

END_SIGMA: Final = {"hand": 0.039, "foot": 0.034, "head": 0.035}
"""Standard deviation of the logarithm of hand, foot and head size. Hands, feet and heads are scaled as a whole, about
the wrist, ankle or head joint.
"""

GIRTH_SIGMA: Final = {"upper_arm": 0.06, "forearm": 0.06, "thigh": 0.09, "shank": 0.09}
"""Standard deviation of the logarithm of each segment's girth. The healthy people of ANSUR II have 0.035 to 0.050 at
one height and weight. The values in this table are larger, since paralysed legs lose a third to a half of their muscle
(Giangregorio and McCartney 2006, doi:10.1080/10790268.2006.11753898)."""

_BONES: Final = {
    "upper_arm": ("Arm", "ForeArm"),
    "forearm": ("ForeArm", "Hand"),
    "thigh": ("UpLeg", "Leg"),
    "shank": ("Leg", "Foot"),
}
"""The two bones whose heads (first ends) are the ends of each segment."""


TRUNK: Final = ("Hips", "LHipJoint", "RHipJoint", "LowerBack", "Spine", "Spine1")

_TRUNK_LENGTHS: Final = {
    "trunk_length": ((("LowerBack", "Neck"),), 0.035),
    "neck_length": ((("Neck", "Head"),), 0.08),
    "shoulder_breadth": ((("LeftShoulder", "LeftArm"), ("RightShoulder", "RightArm")), 0.040),
    "hip_breadth": ((("LHipJoint", "LeftUpLeg"), ("RHipJoint", "RightUpLeg")), 0.062),
}
"""For each direction: the spans that the direction lengthens, all by the same share, and the standard deviation of the
logarithm of their length. A span extends from the head of one bone to the head of another. The standard deviations are
known from sitting height, biacromial and bicristal breadth in ANSUR II.
"""


class _Bulge(NamedTuple):
    """A bulge of the trunk, such as the belly: a region of its skin that moves along an axis."""

    axis: int  # 0 = forward, 2 = sideways
    towards: int  # direction of the movement along the axis, 1 or -1; 0 = both sides of the trunk move apart
    height_m: float  # height of the bulge's middle on the mean adult
    spread_m: float  # standard deviation of the bulge's bell-shaped profile over the height
    sigma_m: float  # movement of the skin by one unit of the coefficient


_BULGES: Final = {
    "belly_depth": _Bulge(0, 1, 1.02, 0.09, 0.010),
    "waist_breadth": _Bulge(2, 0, 1.06, 0.08, 0.004),
    "chest_depth": _Bulge(0, 1, 1.27, 0.08, 0.006),
    "back_depth": _Bulge(0, -1, 1.22, 0.12, 0.004),
    "chest_breadth": _Bulge(2, 0, 1.26, 0.09, 0.004),
    "seat_depth": _Bulge(0, -1, 0.88, 0.08, 0.005),
    "seat_breadth": _Bulge(2, 0, 0.88, 0.07, 0.003),
}
"""Bulges of the trunk. Their standard deviations are smaller than the standard deviations of the trunk's depths and
breadths in ANSUR II (5 to 7 % at one height and weight), for two reasons: the whole-body coefficients contain most of
this variation, and the heavy tails of the prior allow a large belly."""


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """A direction of shape: its name, and the change (m) of skin and bone ends by one unit of its coefficient."""

    name: str
    vertices: np.ndarray  # (v, 3) change of the skin
    heads: np.ndarray  # (b, 3) change of the bones' first ends
    tails: np.ndarray  # (b, 3) change of the bones' second ends


@cache
def load_body_asset() -> BodyAsset:
    """Return the asset that is fitted to patients: the shipped asset with the directions of single segments added."""
    return with_own_segments(stored_asset())


def with_own_segments(asset: BodyAsset) -> BodyAsset:
    """Return the asset with the directions of this module added after its whole-body coefficients."""
    found = tuple(_directions(asset))
    return replace(
        asset,
        vertex_basis=np.concatenate([asset.vertex_basis, [own.vertices for own in found]]),
        bone_head_basis=np.concatenate([asset.bone_head_basis, [own.heads for own in found]]),
        bone_tail_basis=np.concatenate([asset.bone_tail_basis, [own.tails for own in found]]),
        own_names=tuple(own.name for own in found),
    )


def _directions(asset: BodyAsset) -> Iterator[Direction]:
    for side in SIDES:
        for name, sigma in LENGTH_SIGMA.items():
            yield _stretched(asset, f"{name}_length_{side}", [_bones_of(name, side)], sigma)
        for name, sigma in GIRTH_SIGMA.items():
            yield _widened(asset, f"{name}_girth_{side}", *_bones_of(name, side), sigma)
        for name in ("hand", "foot"):
            yield _larger(asset, f"{name}_size_{side}", f"{side.capitalize()}{name.capitalize()}", END_SIGMA[name])
    for name, (spans, sigma) in _TRUNK_LENGTHS.items():
        yield _stretched(asset, name, spans, sigma)
    for name, bulge in _BULGES.items():
        yield _bulging(asset, name, bulge)
    yield _larger(asset, "head_size", "Head", END_SIGMA["head"])


def _bones_of(segment: str, side: str) -> tuple[str, str]:
    start, end = _BONES[segment]
    return f"{side.capitalize()}{start}", f"{side.capitalize()}{end}"


def _stretched(asset: BodyAsset, name: str, spans: Sequence[tuple[str, str]], sigma: float) -> Direction:
    """Return the direction (change of shape) that lengthens several spans together by the share ``sigma`` of their
    length. A span extends from the head (first end) of one bone to the head of another.
    """
    total = [np.zeros_like(asset.vertices), np.zeros_like(asset.bone_heads), np.zeros_like(asset.bone_tails)]
    for start, end in spans:
        first, last = asset.bone(start), asset.bone(end)
        step = asset.bone_heads[last] - asset.bone_heads[first]
        along = _shares_along(asset, first, last)
        # (v, b): the share of the span's growth by which vertex v moves if bone b alone moves it
        of_vertex = asset.vertices @ along[:, :3].T + along[:, 3]
        share = (asset.skin_weights * np.take_along_axis(of_vertex, asset.skin_bones, axis=1)).sum(axis=1)
        total[0] += share[:, None] * step
        for kept, points in ((total[1], asset.bone_heads), (total[2], asset.bone_tails)):
            kept += ((points * along[:, :3]).sum(axis=1) + along[:, 3])[:, None] * step
    vertices, heads, tails = (sigma * part for part in total)
    return Direction(name, vertices, heads, tails)


def _shares_along(asset: BodyAsset, first: int, last: int) -> np.ndarray:
    """Return (b, 4): three factors and a constant per bone, which state how far the bone's points move if the span
    between the heads (first ends) of the bones ``first`` and ``last`` grows. If the span grows, a point of the bone at
    (x, y, z) in the rest pose moves by the share ``factors @ (x, y, z) + constant`` of the growth.

    Points of the span move in proportion to their distance along the span from its start; everything beyond the span
    moves as a whole.
    """
    heads, parents = asset.bone_heads, asset.bone_parents.tolist()
    step = heads[last] - heads[first]
    linear = np.append(step, -heads[first] @ step) / (step @ step)
    chain, bone = {first}, parents[last]
    while bone != first:
        chain.add(bone)
        bone = parents[bone]
    along = np.zeros((len(parents), 4))
    for bone, parent in enumerate(parents):  # parents stand before children
        if bone in chain:
            along[bone] = linear
        elif parent in chain:
            along[bone, 3] = linear[:3] @ heads[bone] + linear[3]
        elif parent >= 0:
            along[bone] = along[parent]
    return along


def _widened(asset: BodyAsset, name: str, start: str, end: str, sigma: float) -> Direction:
    """Return the direction (change of shape) that makes a segment thicker: each point of its skin moves away from the
    segment's axis by the share ``sigma`` of its distance from the axis; bones do not move.
    """
    first, last = asset.bone(start), asset.bone(end)
    axis = asset.bone_heads[last] - asset.bone_heads[first]
    away = asset.vertices - asset.bone_heads[first]
    away -= np.outer(away @ axis / (axis @ axis), axis)
    return _skin_only(asset, name, sigma * share_of_bones(asset, (start,))[:, None] * away)


def share_of_bones(asset: BodyAsset, names: Sequence[str]) -> np.ndarray:
    """Return, for each vertex (v,), the sum of its skinning weights for the bones in ``names``, 0 to 1."""
    chosen = np.isin(asset.bone_names, names).astype(np.float64)
    return np.asarray((asset.skin_weights * chosen[asset.skin_bones]).sum(axis=1))


def _bulging(asset: BodyAsset, name: str, bulge: _Bulge) -> Direction:
    """Return the direction (change of shape) that moves trunk skin near the bulge's height outwards along the bulge's
    axis. The movement is proportional to the skin's distance from the trunk's middle along this axis.
    """
    share = share_of_bones(asset, TRUNK)
    facing = asset.vertices[:, bulge.axis] - np.median(asset.bone_heads[[asset.bone(b) for b in TRUNK]][:, bulge.axis])
    facing /= np.abs(facing[share > 0.5]).max()
    facing = np.where(facing * bulge.towards >= 0.0, facing, 0.0) if bulge.towards else facing
    near = np.exp(-0.5 * ((asset.vertices[:, 1] - bulge.height_m) / bulge.spread_m) ** 2)
    moved = np.zeros_like(asset.vertices)
    moved[:, bulge.axis] = bulge.sigma_m * near * np.clip(facing, -1.0, 1.0) * share
    return _skin_only(asset, name, moved)


def _larger(asset: BodyAsset, name: str, end: str, sigma: float) -> Direction:
    """Return the direction (change of shape) that enlarges a bone, and everything beyond the bone, by the share
    ``sigma``; the bone's head stays in place.
    """
    bone, below = asset.bone(end), np.zeros(len(asset.bone_names))
    below[bone] = 1.0
    for other, parent in enumerate(asset.bone_parents.tolist()):  # parents stand before children
        below[other] = max(below[other], below[parent] if parent >= 0 else 0.0)
    joint = asset.bone_heads[bone]
    share = (asset.skin_weights * below[asset.skin_bones]).sum(axis=1)
    vertices = sigma * share[:, None] * (asset.vertices - joint)
    heads, tails = (sigma * below[:, None] * (ends - joint) for ends in (asset.bone_heads, asset.bone_tails))
    return Direction(name, vertices, heads, tails)


def _skin_only(asset: BodyAsset, name: str, vertices: np.ndarray) -> Direction:
    still = np.zeros_like(asset.bone_heads)
    return Direction(name, vertices, still, still)
