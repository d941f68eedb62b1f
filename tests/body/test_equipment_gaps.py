"""The gap between posed skin and the equipment: known distances, laws of motion, and what is not known."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import adult_body, points, standing
from scipy.spatial.transform import Rotation

from anchorpose.body.contact_regions import REGIONS, area_of_point, region_of_points
from anchorpose.body.equipment_gaps import (
    MODEL_SIGMA_M,
    NEAR_M,
    SAMPLING_M,
    EquipmentGaps,
    ShownSkin,
    find_equipment_gaps,
    region_sigma,
)
from anchorpose.body.skin_points import pose_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel, EquipmentPart, Mesh

POSED = pose_points(adult_body(), standing())
REGION = region_of_points(points())
SIGMA_M = np.full(JOINT_COUNT, 0.008)
ALL = ShownSkin(np.ones(len(REGION), bool), np.ones(len(REGION), bool))
REACH_M = 0.06


def region(name: str) -> np.ndarray:
    return np.flatnonzero(REGIONS.index(name) == REGION)


def rail_below(hand: str, gap_m: float, name: str = "rail") -> Box:
    """A level rail whose top is so far below the lowest skin point of a hand."""
    skin = POSED.points_m[region(hand)]
    lowest = skin[skin[:, 1].argmin()]
    return Box(name, lowest - [0.0, gap_m + 0.02, 0.0], np.array([0.8, 0.04, 0.04]), np.eye(3))


def gaps_to(*parts: EquipmentPart, sigma_m: np.ndarray = SIGMA_M, shown: ShownSkin = ALL) -> EquipmentGaps:
    return find_equipment_gaps(adult_body(), POSED.points_m, shown, sigma_m, EquipmentModel(parts), REACH_M)


def row_of(gaps: EquipmentGaps, name: str, part: int = 0) -> int:
    (row,) = np.flatnonzero((gaps.region == REGIONS.index(name)) & (gaps.part == part))
    return int(row)


@pytest.mark.parametrize("gap_m", [0.0, 0.02, 0.10])
def test_the_gap_is_the_distance_of_the_nearest_skin_point_less_what_lies_between_the_points(gap_m):
    gaps = gaps_to(rail_below("hand_left", gap_m))
    row = row_of(gaps, "hand_left")
    assert gaps.gap_m[row] == pytest.approx(gap_m - SAMPLING_M, abs=1e-5)
    assert gaps.sigma_m[row] == pytest.approx(np.hypot(0.008, MODEL_SIGMA_M), rel=1e-5)
    within = np.count_nonzero(rail_below("hand_left", gap_m).distance_m(POSED.points_m[region("hand_left")]) < REACH_M)
    assert gaps.area_m2[row] == pytest.approx(within * area_of_point(adult_body()), rel=1e-5)


def test_skin_inside_of_a_part_has_a_negative_gap_and_what_is_far_away_has_none():
    gaps = gaps_to(rail_below("hand_left", -0.02), rail_below("hand_left", NEAR_M + 0.08))
    assert gaps.gap_m[row_of(gaps, "hand_left")] < -0.02
    assert set(gaps.part.tolist()) == {0}
    assert "hand_right" not in {REGIONS[k] for k in gaps.region}


def test_gaps_are_those_of_plain_search_for_boxes_tubes_and_meshes():
    seat = rail_below("thigh_right", 0.01)
    vertices, faces = seat.triangles()
    tube = Cylinder("tube", POSED.points_m[region("knee_left")[0]], np.array([0.0, 0.0, 1.0]), 0.02, 0.6)
    parts = (seat, tube, Mesh("mesh", vertices, faces))
    gaps = gaps_to(*parts)
    for part, model in enumerate(parts):
        plain = {
            name: model.distance_m(POSED.points_m[region(name)]).min()
            for name in REGIONS
            if not name.startswith("foot")
        }
        found = {REGIONS[gaps.region[row]]: gaps.gap_m[row] for row in np.flatnonzero(gaps.part == part)}
        assert set(found) == {name for name, distance_m in plain.items() if distance_m < NEAR_M}
        for name, gap_m in found.items():
            assert gap_m == pytest.approx(plain[name] - SAMPLING_M, abs=1e-5)


def test_moving_patient_and_equipment_alike_changes_nothing():
    rail, tube = rail_below("hand_left", 0.01), Cylinder("t", POSED.points_m[0], np.array([0.0, 1.0, 0.0]), 0.02, 0.5)
    turn, shift = Rotation.from_rotvec([0.3, 1.1, -0.4]).as_matrix(), np.array([0.7, -0.2, 1.9])
    moved = EquipmentModel(
        (
            replace(rail, center_m=turn @ rail.center_m + shift, rotation=turn),
            replace(tube, center_m=turn @ tube.center_m + shift, axis=turn @ tube.axis),
        )
    )
    skin_m = POSED.points_m @ turn.T + shift
    before, after = gaps_to(rail, tube), find_equipment_gaps(adult_body(), skin_m, ALL, SIGMA_M, moved, REACH_M)
    np.testing.assert_array_equal(before.part, after.part)
    np.testing.assert_array_equal(before.region, after.region)
    np.testing.assert_allclose(before.gap_m, after.gap_m, atol=1e-6)


def test_a_region_is_as_uncertain_as_its_worse_joint_and_unknown_where_that_is_lost():
    sigma_m = SIGMA_M.copy()
    sigma_m[JOINT_INDEX["WristLeft"]], sigma_m[JOINT_INDEX["HandRight"]] = 0.05, np.nan
    found = dict(zip(REGIONS, region_sigma(sigma_m), strict=True))
    assert found["forearm_left"] == pytest.approx(np.hypot(0.05, MODEL_SIGMA_M))
    assert found["upper_arm_left"] == pytest.approx(np.hypot(0.008, MODEL_SIGMA_M))
    assert np.isnan([found["hand_right"], found["foot_left"], found["foot_right"]]).all()
    gaps = gaps_to(rail_below("hand_right", 0.0), sigma_m=sigma_m)
    assert REGIONS.index("hand_right") not in gaps.region.tolist()


def test_feet_on_the_floor_touch_nothing():
    low = POSED.points_m[:, 1].min()
    floor = Box("floor", np.array([0.0, low - 0.05, 0.0]), np.array([2.0, 0.1, 2.0]), np.eye(3))
    assert not {REGIONS[k] for k in gaps_to(floor).region} & {"foot_left", "foot_right"}


def test_what_is_shown_is_a_share_of_the_skin_beside_the_part_that_faces_a_camera():
    rail = rail_below("hand_left", 0.0)
    beside = region("hand_left")[rail.distance_m(POSED.points_m[region("hand_left")]) < REACH_M]
    faces, seen = np.zeros(len(REGION), bool), np.zeros(len(REGION), bool)
    faces[beside[:6]], seen[beside[:3]] = True, True
    gaps = gaps_to(rail, shown=ShownSkin(faces, seen))
    assert gaps.shown[row_of(gaps, "hand_left")] == pytest.approx(0.5)
    gaps = gaps_to(rail, shown=ShownSkin(np.zeros_like(faces), np.zeros_like(faces)))
    assert gaps.shown[row_of(gaps, "hand_left")] == 0.0
