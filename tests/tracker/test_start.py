"""What a first pose must be to be believed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anchorpose.body.pose import Pose
from anchorpose.body.shape_prior import shape_of_height, standing_height
from anchorpose.body.skin_points import FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.tracker.start import hangs, is_human

ASSET = body_points().asset


@pytest.mark.parametrize("height_m", [1.45, 1.7, 2.0])
def test_adults_are_human(height_m):
    assert is_human(shape_of_height(ASSET, height_m))


def test_half_a_person_is_not():
    """The upper half of one who sits, taken for the whole of a small person."""
    small = shape_of_height(ASSET, 1.45)
    while standing_height(ASSET, small)[0] > 0.85:
        small = FittedShape(small.coefficients * 1.1, small.offset_m)
    assert not is_human(small)
    assert np.isfinite(small.coefficients).all()


def raised(by_m: float, turn: np.ndarray) -> tuple[PosedPoints, np.ndarray]:
    """An adult at rest, turned about the pelvis, whose lowest point is so far above a floor at height 0."""
    body = build_body(body_points(), shape_of_height(ASSET, 1.7))
    rotations = np.tile(np.eye(3), (len(ASSET.bone_names), 1, 1))
    rotations[ASSET.bone("Hips")] = turn
    pose = Pose(rotations, np.zeros(3))
    lowest_m = pose_points(body, pose).points_m[:, 1].min()
    pose = Pose(rotations, np.array([0.0, by_m - lowest_m, 0.0]))
    return pose_points(body, pose), body.joints(pose)


@pytest.mark.parametrize(("by_m", "expected"), [(0.0, False), (0.25, False), (0.5, True)])
def test_nobody_hangs_above_the_floor(by_m, expected):
    assert hangs(*raised(by_m, np.eye(3)), floor_m=0.0) is expected


def test_who_lies_on_a_bed_does_not_hang():
    on_the_back = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert not hangs(*raised(0.6, on_the_back), floor_m=0.0)
