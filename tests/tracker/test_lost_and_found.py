"""Whole recordings in which the patient comes late, leaves, is hidden, or sits: lost where he must be, found again."""

from dataclasses import replace

import numpy as np
import pytest

from anchorpose.joints import JOINT_INDEX
from anchorpose.pipeline import track_recording
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig

FPS, SECONDS = 10.0, {"enters-late": 10.0, "leaves": 12.0, "hidden": 8.0, "sits": 8.0}
IN_VIEW_PX = 4000  # of one camera: a third of a standing body
ROOT = JOINT_INDEX["SpineBase"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SECONDS)
def test_he_is_lost_and_found_again(name, tmp_path):
    scene = presets.scene(replace(presets.clinic(5, SECONDS[name], FPS), cameras=1), name)
    simulate_recording(tmp_path / "scene", scene)
    (tmp_path / "results").mkdir()
    config = TrackConfig()
    if scene.away_s:  # without equipment, only a given place distinguishes him from people who stay longer
        there = int(FPS * (SECONDS[name] - 2.0)) if name == "enters-late" else 0
        config = TrackConfig(patient_xz_m=(0.0, 0.0), patient_frame=there)
    track_recording(tmp_path / "scene/recording", tmp_path / "results", config, lambda done, total: None)
    joints = read_joints(tmp_path / "results" / JOINTS_FILE)
    with np.load(tmp_path / "scene/truth/truth.npz") as truth:
        seen_px, off_m = truth["patient_pixels"], np.linalg.norm(joints.position_m - truth["joints"], axis=2)
    in_view, lost = seen_px > IN_VIEW_PX, joints.lost.all(axis=1)
    a_second = int(FPS)

    long_gone = np.array([not in_view[max(0, k - 2 * a_second) : k + 2 * a_second].any() for k in range(len(lost))])
    assert lost[long_gone].all()
    assert np.nanmax(off_m[in_view, ROOT]) < 0.3  # never another person
    long_seen = np.array([in_view[max(0, k - a_second) : k + a_second].all() for k in range(len(lost))])
    assert not lost[long_seen].any()
    # found again at a picture's edge, a foot may be wrong for a while; everything right is 7 to 15 mm
    assert np.nanmean(off_m[long_seen]) < 0.05
