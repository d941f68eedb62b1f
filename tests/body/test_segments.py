"""Directions of a person's own: what each one changes, and that it changes nothing else."""

import numpy as np
import pytest
from body_builder import asset
from scipy.spatial import cKDTree

from anchorpose.body.asset import stored_asset
from anchorpose.body.kinematics import shape_body
from anchorpose.body.segments import END_SIGMA, GIRTH_SIGMA, LENGTH_SIGMA, SIDES, TRUNK, share_of_bones

STARTS = {"upper_arm": "Arm", "forearm": "ForeArm", "thigh": "UpLeg", "shank": "Leg"}
ENDS = {"upper_arm": "ForeArm", "forearm": "Hand", "thigh": "Leg", "shank": "Foot"}
SEGMENTS = [(segment, side) for segment in LENGTH_SIGMA for side in SIDES]
SPANS = {"trunk_length": ("LowerBack", "Neck"), "neck_length": ("Neck", "Head")}
BREADTHS = {"shoulder_breadth": "Arm", "hip_breadth": "UpLeg"}
BULGES = {
    "belly_depth": (0, 1.0),
    "chest_depth": (0, 1.0),
    "back_depth": (0, -1.0),
    "seat_depth": (0, -1.0),
    "waist_breadth": (2, 0.0),
    "chest_breadth": (2, 0.0),
    "seat_breadth": (2, 0.0),
}
MIRROR = np.array([1.0, 1.0, -1.0])


def moves_of(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What one unit adds to skin, bone heads and bone tails."""
    row = asset().common_count + asset().own_names.index(name)
    return asset().vertex_basis[row], asset().bone_head_basis[row], asset().bone_tail_basis[row]


def heads_with(name: str, units: float) -> np.ndarray:
    """Bone heads of the mean adult with so many units of one direction."""
    names = asset().own_names
    own = units * (np.arange(len(names)) == names.index(name))
    return shape_body(asset(), np.append(np.zeros(asset().common_count), own)).bone_heads


def ends_of(segment: str, side: str) -> tuple[int, int]:
    """The bones whose heads are the ends of a segment."""
    return asset().bone(side.capitalize() + STARTS[segment]), asset().bone(side.capitalize() + ENDS[segment])


def bone_lengths_m(heads: np.ndarray) -> np.ndarray:
    """From the head of each bone's parent to its own; the root has none."""
    return np.linalg.norm(heads[1:] - heads[asset().bone_parents[1:]], axis=1)


def at_and_below(bone: int) -> np.ndarray:
    """(b,) bool: the bone and all that hangs on it."""
    below = np.arange(len(asset().bone_names)) == bone
    for other, parent in enumerate(asset().bone_parents.tolist()):
        below[other] |= parent >= 0 and below[parent]
    return below


def share_of(bones: np.ndarray) -> np.ndarray:
    """(v,) share of each vertex that the bones (b,) bool move."""
    return share_of_bones(asset(), [asset().bone_names[bone] for bone in np.flatnonzero(bones)])


def other_side(name: str) -> str:
    for one, other in (("Left", "Right"), ("LHip", "RHip"), ("LThumb", "RThumb"), ("_left", "_right")):
        name = name.replace(one, "@").replace(other, one).replace("@", other)
    return name


def test_the_statistical_components_stay_as_they_are():
    own, stored = asset(), stored_asset()
    assert own.common_count == stored.shape_count == stored.common_count
    assert own.shape_count == stored.shape_count + len(own.own_names)
    for part in ("vertex_basis", "bone_head_basis", "bone_tail_basis"):
        np.testing.assert_array_equal(getattr(own, part)[: own.common_count], getattr(stored, part))
    np.testing.assert_array_equal(own.vertices, stored.vertices)
    np.testing.assert_array_equal(own.bone_heads, stored.bone_heads)


def test_every_segment_of_both_sides_has_a_length_and_a_girth_and_each_direction_its_own_name():
    names = asset().own_names
    assert len(set(names)) == len(names)
    for segment, side in SEGMENTS:
        assert {f"{segment}_length_{side}", f"{segment}_girth_{side}"} <= set(names)
    assert {f"{end}_size_{side}" for end in ("hand", "foot") for side in SIDES} <= set(names)
    assert {"head_size", *SPANS, *BREADTHS, *BULGES} <= set(names)


@pytest.mark.parametrize("units", [1.0, -2.0])
@pytest.mark.parametrize(("segment", "side"), SEGMENTS)
def test_a_length_changes_its_own_bone_by_its_share_and_no_other(segment, side, units):
    before, after = (bone_lengths_m(h) for h in (asset().bone_heads, heads_with(f"{segment}_length_{side}", units)))
    own = ends_of(segment, side)[1] - 1
    assert after[own] / before[own] == pytest.approx(1.0 + units * LENGTH_SIGMA[segment])
    np.testing.assert_allclose(np.delete(after, own), np.delete(before, own), atol=1e-12)


@pytest.mark.parametrize(("segment", "side"), SEGMENTS)
def test_what_hangs_on_a_longer_segment_moves_as_a_whole_and_what_lies_before_it_not_at_all(segment, side):
    start, end = ends_of(segment, side)
    skin, heads, tails = moves_of(f"{segment}_length_{side}")
    step = LENGTH_SIGMA[segment] * (asset().bone_heads[end] - asset().bone_heads[start])
    beyond, own = at_and_below(end), np.arange(len(heads)) == start
    for moved in (heads, tails):
        np.testing.assert_allclose(moved[beyond], np.tile(step, (beyond.sum(), 1)), atol=1e-12)
        np.testing.assert_allclose(moved[~beyond & ~own], 0.0, atol=1e-12)
    np.testing.assert_allclose(heads[start], 0.0, atol=1e-12)
    whole, none = share_of(beyond) > 1.0 - 1e-12, share_of(beyond | own) == 0.0
    assert min(whole.sum(), none.sum()) > 200
    np.testing.assert_allclose(skin[whole], np.tile(step, (whole.sum(), 1)), atol=1e-12)
    assert not skin[none].any()


@pytest.mark.parametrize(("segment", "side"), SEGMENTS)
def test_skin_of_a_longer_segment_moves_by_what_lies_before_it(segment, side):
    start, end = ends_of(segment, side)
    axis = asset().bone_heads[end] - asset().bone_heads[start]
    on_it = share_of(np.arange(len(asset().bone_names)) == start) > 1.0 - 1e-12
    along = (asset().vertices[on_it] - asset().bone_heads[start]) @ axis / (axis @ axis)
    assert on_it.sum() > 20
    moved = moves_of(f"{segment}_length_{side}")[0][on_it]
    np.testing.assert_allclose(moved, LENGTH_SIGMA[segment] * np.outer(along, axis), atol=1e-12)


@pytest.mark.parametrize(("segment", "side"), SEGMENTS)
def test_a_girth_moves_skin_straight_away_from_the_axis_and_no_bone(segment, side):
    skin, heads, tails = moves_of(f"{segment}_girth_{side}")
    assert not heads.any()
    assert not tails.any()
    start, end = ends_of(segment, side)
    axis = asset().bone_heads[end] - asset().bone_heads[start]
    axis /= np.linalg.norm(axis)
    share = share_of(np.arange(len(heads)) == start)
    away = asset().vertices - asset().bone_heads[start]
    away -= np.outer(away @ axis, axis)
    np.testing.assert_allclose(skin, GIRTH_SIGMA[segment] * share[:, None] * away, atol=1e-12)
    assert (np.linalg.norm(skin, axis=1) > 0.001).sum() > 50


@pytest.mark.parametrize(
    ("name", "bone"),
    [(f"{end}_size_{side}", side.capitalize() + end.capitalize()) for end in ("hand", "foot") for side in SIDES]
    + [("head_size", "Head")],
)
def test_hand_foot_and_head_grow_about_their_joint(name, bone):
    skin, heads, tails = moves_of(name)
    sigma, joint = END_SIGMA[name.split("_")[0]], asset().bone_heads[asset().bone(bone)]
    own = at_and_below(asset().bone(bone))
    for moved, rest in ((heads, asset().bone_heads), (tails, asset().bone_tails)):
        np.testing.assert_allclose(moved[own], sigma * (rest[own] - joint), atol=1e-12)
        assert not moved[~own].any()
    whole = share_of(own) > 1.0 - 1e-12
    assert whole.sum() > 100
    np.testing.assert_allclose(skin[whole], sigma * (asset().vertices[whole] - joint), atol=1e-12)
    assert not skin[share_of(own) == 0.0].any()


@pytest.mark.parametrize("name", SPANS)
def test_trunk_and_neck_grow_and_leave_every_limb_as_long_as_it_is(name):
    first, last = (asset().bone(bone) for bone in SPANS[name])
    rest, own = asset().bone_heads, heads_with(name, 1.0)
    ratio = np.linalg.norm(own[last] - own[first]) / np.linalg.norm(rest[last] - rest[first])
    assert 1.03 < ratio < 1.10
    limbs = [ends_of(segment, side)[1] - 1 for segment, side in SEGMENTS]
    np.testing.assert_allclose(bone_lengths_m(own)[limbs], bone_lengths_m(rest)[limbs], atol=1e-12)


@pytest.mark.parametrize("name", BREADTHS)
def test_a_breadth_moves_both_sides_apart_alike_and_changes_no_other_bone(name):
    own = [asset().bone(side.capitalize() + BREADTHS[name]) for side in SIDES]
    before, after = (bone_lengths_m(heads) for heads in (asset().bone_heads, heads_with(name, 1.0)))
    children = np.array(own) - 1
    ratio = after[children] / before[children]
    assert ratio[0] == pytest.approx(ratio[1])
    assert 1.03 < ratio[0] < 1.10
    np.testing.assert_allclose(np.delete(after, children), np.delete(before, children), atol=1e-12)


@pytest.mark.parametrize("name", BULGES)
def test_a_bulge_moves_skin_of_the_trunk_along_its_axis_outward_and_no_bone(name):
    skin, heads, tails = moves_of(name)
    axis, towards = BULGES[name]
    assert not heads.any()
    assert not tails.any()
    assert not np.delete(skin, axis, axis=1).any()
    assert not skin[share_of_bones(asset(), TRUNK) == 0.0].any()
    out = skin[:, axis] * (towards or np.sign(asset().vertices[:, axis]))
    assert out.min() > -1e-4  # the middle of the bones is a millimetre beside the middle of the skin
    assert (out > 0.001).sum() > 20


def test_left_and_right_are_mirror_images():
    names, bones = asset().own_names, asset().bone_names
    away, twin = cKDTree(asset().vertices).query(asset().vertices * MIRROR)
    assert away.max() < 0.001
    swapped = [bones.index(other_side(bone)) for bone in bones]
    for name in names:
        skin, heads, tails = moves_of(name)
        other_skin, other_heads, other_tails = moves_of(other_side(name))
        np.testing.assert_allclose(other_heads[swapped] * MIRROR, heads, atol=1e-5)
        np.testing.assert_allclose(other_tails[swapped] * MIRROR, tails, atol=1e-4)
        off = np.linalg.norm(other_skin[twin] * MIRROR - skin, axis=1)
        # the artist's skinning weights of 3 % of the skin are not symmetric
        assert np.percentile(off, 97) < 1e-4, name
        assert off.max() < 0.001, name


def test_every_direction_moves_skin_by_millimetres():
    for name in asset().own_names:
        assert 0.001 < np.linalg.norm(moves_of(name)[0], axis=1).max() < 0.040, name


def test_no_direction_tears_the_skin():
    """A unit stretches hardly an edge by more than a seventh; only in the groin do neighbours belong to both legs."""
    faces = asset().faces
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    start, end = edges.T
    length_m = np.linalg.norm(asset().vertices[end] - asset().vertices[start], axis=1)
    for name in asset().own_names:
        skin = moves_of(name)[0]
        stretch = np.linalg.norm(skin[end] - skin[start], axis=1) / length_m
        assert np.percentile(stretch, 99.9) < 0.15, name
