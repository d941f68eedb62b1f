"""Labels by eye of MSR Action3D: which frames, and how a tracked joint is compared with a label."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from label_frames import draw_frames
from msr_labels import FOLDER, NAME, Frame, rows_of

from anchorpose.camera import Camera
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.lens import Intrinsics
from anchorpose.research.benchmark.labels import LABELLERS, LabelledPerson, read_label_set

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "msr_action3d"


def test_both_labelled_the_same_60_frames_twelve_of_each_subject():
    first, second = (read_label_set(FOLDER, NAME, labeller) for labeller in LABELLERS)
    frames = {(sequence, number) for sequence, of in first.items() for number in of}
    assert frames == {(sequence, number) for sequence, of in second.items() for number in of}
    assert Counter(sequence.split("_")[1] for sequence, _ in frames) == {f"s0{k}": 12 for k in range(1, 6)}
    for labels in (first, second):
        for person in (person for of in labels.values() for people in of.values() for person in people):
            assert person.unclear <= set(person.joints) <= set(JOINT_INDEX)


@pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")
def test_the_labelled_frames_are_drawn_again_from_the_data():
    labelled = {(sequence, number) for sequence, of in read_label_set(FOLDER, NAME, "first").items() for number in of}
    assert set(draw_frames(DATA)) == labelled


def test_a_joint_is_compared_in_the_plane_of_the_image_at_the_labelled_skin():
    """The left elbow is 30 mm right of the middle of both labels and 50 mm beneath the skin; the right one is lost."""
    camera = Camera(
        name="front", width=40, height=30, depth_scale=0.001, T_world_camera=np.eye(4),
        intrinsics=Intrinsics(fx=100.0, fy=100.0, cx=20.0, cy=15.0),
    )  # fmt: skip
    labels = {"ElbowLeft": (20.0, 14.0), "ElbowRight": (10.0, 15.0), "HipLeft": (20.0, 20.0)}
    one = LabelledPerson("A", True, (0, 0, 39, 29), labels)
    two = replace(one, joints=labels | {"ElbowLeft": (20.0, 16.0)}, unclear=frozenset({"ElbowRight"}))
    ours_m = np.full((JOINT_COUNT, 3), np.nan)
    ours_m[JOINT_INDEX["ElbowLeft"]] = np.array([0.03, 0.0, 2.0]) * 2.05 / 2.0
    frame = Frame("s", 0, camera, np.full((30, 40), 2.0), (one, two), ours_m, ours_m, np.full((JOINT_COUNT, 3), np.nan))
    left, right = rows_of(frame, ours_m)
    assert (left.joint, left.clear, right.joint, right.clear) == ("ElbowLeft", True, "ElbowRight", False)
    assert left.ours == pytest.approx(30.0)
    assert left.shift_mm == pytest.approx((30.0, 0.0))
    assert left.labellers == pytest.approx(40.0)
    assert right.ours == np.inf
    assert np.isnan(left.theirs)
    before = ours_m * 1.8 / 2.05  # on the same ray, 0.2 m before the skin
    assert next(rows_of(frame, before)).ours == np.inf
