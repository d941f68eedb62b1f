"""Kept results give back the skin with which they were made."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import kept_contacts
from body_builder import adult_body, random_pose

from anchorpose.body.skin_points import CLOTHES, pose_points
from anchorpose.results.tables import PoseTable
from anchorpose.tracker.frame_record import body_pose


@pytest.mark.parametrize("seed", [1, 2])
def test_the_skin_of_a_stored_pose_is_that_of_the_pose(seed):
    body, pose = adult_body(clothing_m=0.01), random_pose(seed)
    stored, lost = body_pose(body, 4, 0.2, pose, None), body_pose(None, 5, 0.3, None, None)
    columns = ("frame", "time_s", "head_m", "quaternion", "axial_sigma_rad")
    table = PoseTable(*(np.array([getattr(one, name) for one in (stored, lost)]) for name in columns))
    run = {"body": {"coefficients": body.shape.coefficients.tolist(), "clothes_m": dict.fromkeys(CLOTHES, 0.01)}}
    again = kept_contacts.posed_skin(kept_contacts.learnt_body(run), table, 0)
    expected = pose_points(body, pose)
    np.testing.assert_allclose(again.points_m, expected.points_m, atol=1e-5)
    np.testing.assert_allclose(again.normals, expected.normals, atol=1e-5)
    assert kept_contacts.posed_skin(body, table, 1) is None


def test_results_that_are_not_kept_are_refused_by_name(tmp_path):
    with pytest.raises(SystemExit, match="easy-2-1-6"):
        kept_contacts.kept(tmp_path, "easy-2-1-6")
