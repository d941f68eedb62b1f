"""Which skeletons of another tracker can be judged against: made-up people and skeletons."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

from reference_soundness import (
    FRAMES_NEEDED,
    LIMB_M2,
    RIGID,
    Body,
    judge,
    legs_tangled,
    off_body,
    own_lengths,
    unexplained_m2,
    wrong_length,
)

SIDE = {
    "Shoulder": (0.20, -0.50), "Elbow": (0.28, -0.22), "Wrist": (0.30, 0.05), "Hand": (0.30, 0.13),
    "Hip": (0.12, 0.0), "Knee": (0.13, 0.45), "Ankle": (0.13, 0.88), "Foot": (0.15, 0.93),
}  # fmt: skip
MIDDLE = {"Head": (0.0, -0.75), "SpineShoulder": (0.0, -0.55), "SpineMid": (0.0, -0.25), "SpineBase": (0.0, 0.0)}
NAMES = (*MIDDLE, *(part + "Left" for part in SIDE), *(part + "Right" for part in SIDE))
DEPTH_M, PIXEL_M = 2.5, 0.01  # a camera without perspective: a pixel is a square centimetre
LIMBS = (
    ("Head", "SpineBase", 0.14),
    *((start + side, end + side, 0.06) for side in ("Left", "Right") for start, end in (
        ("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Wrist", "Hand"), ("Hip", "Knee"), ("Knee", "Ankle"))),
)  # fmt: skip


def _standing() -> np.ndarray:
    """(m, 3) a person who faces the camera, arms down, in the plane of ``DEPTH_M``."""
    left = [(x, y) for x, y in SIDE.values()]
    flat = [*MIDDLE.values(), *left, *((-x, y) for x, y in left)]
    return np.array([(x, y, DEPTH_M) for x, y in flat])


def _with(joints_m: np.ndarray, **places: tuple[float, float, float]) -> np.ndarray:
    changed = joints_m.copy()
    for name, place in places.items():
        changed[NAMES.index(name)] = place
    return changed


def _pixels(joints_m: np.ndarray) -> np.ndarray:
    return joints_m[:, :2] / PIXEL_M + 120.0


def _body(joints_m: np.ndarray) -> Body:
    """What a camera sees of a person who is as thick as ``LIMBS`` about these joints, all in one plane."""
    rows, columns = np.mgrid[0:240, 0:240]
    points = np.stack([(columns - 120) * PIXEL_M, (rows - 120) * PIXEL_M, np.full(rows.shape, DEPTH_M)], axis=-1)
    mask = np.zeros(rows.shape, dtype=bool)
    for start, end, radius in LIMBS:
        for place in np.linspace(joints_m[NAMES.index(start)], joints_m[NAMES.index(end)], 20):
            mask |= np.linalg.norm(points[..., :2] - place[:2], axis=-1) < radius
    return Body(mask, points, np.full(mask.shape, PIXEL_M**2))


ARM_OUT = {"ElbowLeft": (0.48, -0.50, DEPTH_M), "WristLeft": (0.75, -0.50, DEPTH_M), "HandLeft": (0.83, -0.50, DEPTH_M)}


def test_a_skeleton_that_fits_is_sound():
    person = _standing()
    found = _judged(person, person)
    assert found.sound.all()


def test_an_arm_stretched_out_that_the_skeleton_has_hanging_is_a_limb_unexplained():
    body = _body(_with(_standing(), **ARM_OUT))
    assert unexplained_m2(body, _standing(), NAMES) > LIMB_M2
    assert unexplained_m2(body, _with(_standing(), **ARM_OUT), NAMES) < LIMB_M2


def test_the_area_of_what_is_unexplained_is_that_of_the_limb_beyond_reach():
    """Arm from 0.20 m to 0.83 m and 0.06 m round its end; FAR_M is 0.2 m from the shoulder at 0.20 m."""
    area = unexplained_m2(_body(_with(_standing(), **ARM_OUT)), _with(_standing(), ElbowLeft=(np.nan,) * 3), NAMES)
    assert area == pytest.approx((0.83 - 0.40) * 0.12 + np.pi * 0.06**2 / 2, rel=0.1)


def test_much_that_is_far_in_many_strips_is_no_limb():
    body = _body(_standing())
    strips = np.zeros_like(body.mask)
    strips[::2, 200:230] = True  # 0.8 m to the side, each 0.3 m by one pixel
    assert strips.sum() * PIXEL_M**2 > 10 * LIMB_M2
    assert unexplained_m2(Body(strips, body.points_m, body.pixel_m2), _standing(), NAMES) == pytest.approx(0.003)


def test_a_frame_with_an_unexplained_limb_has_no_reference_at_all():
    found = _judged(_standing(), _with(_standing(), **ARM_OUT))
    assert found.unexplained.all()
    assert not found.sound.any()


def test_knees_that_changed_sides_tangle_the_legs_and_spare_the_arms():
    crossed = _exchanged(_standing(), "Knee", "Ankle", "Foot")
    found = _judged(crossed, _standing())
    legs = [j for j, name in enumerate(NAMES) if name.startswith(("Hip", "Knee", "Ankle", "Foot"))]
    assert found.tangled[0, legs].all()
    assert np.delete(found.sound[0], legs).all()


def test_legs_crossed_at_the_shins_are_possible():
    """A person stands with the legs crossed: the shins pass one before the other, a shin's thickness apart."""
    crossed = _exchanged(_standing(), "Ankle", "Foot")
    for name in ("AnkleLeft", "FootLeft", "KneeLeft"):
        crossed[NAMES.index(name), 2] -= 0.12
    assert not legs_tangled(crossed, NAMES)


def test_both_shanks_in_one_leg_are_tangled():
    one_leg = _with(_standing(), AnkleLeft=(-0.13, 0.88, DEPTH_M))
    assert legs_tangled(one_leg, NAMES)


@pytest.mark.parametrize("stride_m", [0.0, 0.2])
def test_legs_seen_from_the_side_are_not_tangled(stride_m):
    """Turned by a right angle the thighs lie one behind the other; in a stride they cross in the picture."""
    person = _standing()
    side = np.stack([person[:, 2] - DEPTH_M, person[:, 1], DEPTH_M + person[:, 0]], axis=1)
    for name, sign in (("Left", 1), ("Right", -1)):
        for part in ("Knee", "Ankle", "Foot"):
            side[NAMES.index(part + name), 0] += sign * stride_m
        side[NAMES.index("Hip" + name), 0] -= sign * 0.02
    assert not legs_tangled(side, NAMES)


def test_left_and_right_may_be_exchanged_in_all_legs_that_stand_apart():
    assert not legs_tangled(_exchanged(_standing(), "Hip", "Knee", "Ankle", "Foot"), NAMES)


def test_a_joint_beside_or_behind_the_body_is_off_it():
    person = _with(_standing(), HandLeft=(0.60, 0.13, DEPTH_M), HandRight=(-0.30, 0.13, DEPTH_M + 0.3))
    off = off_body(_body(_standing()), person, _pixels(person))
    assert {NAMES[j] for j in np.flatnonzero(off)} == {"HandLeft", "HandRight"}


def test_a_joint_near_the_rim_is_on_the_body():
    """5 pixels outside the arm's rim, and 0.15 m behind its skin."""
    person = _with(_standing(), HandLeft=(0.30 + 0.06 + 0.05, 0.13, DEPTH_M + 0.15))
    assert not off_body(_body(_standing()), person, _pixels(person)).any()


def test_a_joint_outside_the_picture_or_missing_is_off_the_body():
    person = _with(_standing(), HandLeft=(np.nan, np.nan, np.nan), HandRight=(-9.0, -9.0, DEPTH_M))
    off = off_body(_body(_standing()), person, _pixels(person))
    assert {NAMES[j] for j in np.flatnonzero(off)} == {"HandLeft", "HandRight"}


def test_a_forearm_of_another_length_condemns_both_its_ends_in_that_frame_alone():
    frames = np.stack([_standing()] * (FRAMES_NEEDED + 5))
    frames[3] = _with(_standing(), WristLeft=(0.30, 0.15, DEPTH_M))  # 0.37 m for 0.27 m
    sure = np.ones(frames.shape[:2], dtype=bool)
    wrong = wrong_length(frames, sure, own_lengths([frames], [sure], NAMES), NAMES)
    assert {(t, NAMES[j]) for t, j in np.argwhere(wrong)} == {(3, "ElbowLeft"), (3, "WristLeft")}


def test_nothing_is_said_of_a_length_that_is_not_known():
    frames = np.stack([_standing()] * (FRAMES_NEEDED - 1))
    frames[3] = _with(_standing(), WristLeft=(0.30, 0.15, DEPTH_M))
    sure = np.ones(frames.shape[:2], dtype=bool)
    own = own_lengths([frames], [sure], NAMES)
    assert np.isnan(own).all()
    assert not wrong_length(frames, sure, own, NAMES).any()


def _exchanged(joints_m: np.ndarray, *parts: str) -> np.ndarray:
    """The joints with left and right of some parts exchanged."""
    changed = joints_m.copy()
    for part in parts:
        left, right = NAMES.index(part + "Left"), NAMES.index(part + "Right")
        changed[[left, right]] = joints_m[[right, left]]
    return changed


def _judged(skeleton_m: np.ndarray, person_m: np.ndarray):
    """One frame in which a skeleton is said to be that of a person who stands elsewhere."""
    sure = np.ones((1, len(NAMES)), dtype=bool)
    unknown_m = np.full(len(RIGID), np.nan)
    return judge([_body(person_m)], skeleton_m[None], _pixels(skeleton_m)[None], sure, unknown_m, NAMES)
