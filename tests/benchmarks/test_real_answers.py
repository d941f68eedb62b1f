"""This project's own rows on real depth are answers like any others."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from body_builder import FRONT, adult_body, joints_of, seen_body, standing
from pyarrow.csv import write_csv

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "research"))
from real_answers import LABELS, _described, rows_of

from anchorpose.camera import invert_rigid, transform_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.research.benchmark.real import FILE, read_real

CAMERA = replace(FRONT, T_world_camera=np.eye(4))
TRUTH = standing(LeftArm=(-40.0, 0.0, 10.0))


def test_one_frame_alone_gives_joints_in_the_frame_of_the_camera():
    body = adult_body()
    depth_m = seen_body(TRUTH, body).views[0].depth_m
    true_m = transform_points(invert_rigid(FRONT.require_pose()), joints_of(body, TRUTH))
    everywhere = (0.0, 0.0, float(FRONT.width), float(FRONT.height))
    assert np.linalg.norm(_described(depth_m, CAMERA, everywhere) - true_m, axis=1).mean() < 0.08
    assert _described(depth_m, CAMERA, (0.0, 0.0, 5.0, 5.0)) is None


def test_rows_are_read_by_the_scorer_and_a_lost_joint_stays_empty(tmp_path):
    joints_m = np.arange(3.0 * JOINT_COUNT).reshape(-1, 3)
    joints_m[JOINT_INDEX["HandLeft"]] = np.nan
    write_csv(pa.concat_tables(rows_of("five_people", "A", iter([(0, joints_m)]))), tmp_path / FILE)
    found = read_real(tmp_path / FILE, LABELS, ["five_people"])
    np.testing.assert_array_equal(found["five_people", "A", 0], joints_m)
