"""Rooms as one camera sees them: what is drawn from a seed, who is labelled, and what is written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anchorpose.camera import invert_rigid, transform_points
from anchorpose.recording.reader import open_recording
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import SimulationConfig, room
from anchorpose.simulate.render import NOTHING, PATIENT
from anchorpose.simulate.rooms.plan import MIDDLE_SHARE, SEATED_SHARE, RoomConfig
from anchorpose.simulate.rooms.scene import room_camera
from anchorpose.simulate.shoot import set_up
from anchorpose.simulate.write import simulate_recording

SEEDS = range(51_000, 51_040)
BARE = RoomConfig(distance_m=3.2, camera_height_m=1.4, tilt_rad=0.15)


def plans() -> list[tuple[SimulationConfig, RoomConfig]]:
    return [(config, config.room) for config in (room(seed, seconds=6.0) for seed in SEEDS)]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [51_003, 51_014])
def test_the_same_seed_gives_the_same_bytes_and_no_picture_of_the_empty_room(seed, tmp_path):
    config = room(seed, seconds=0.8, fps=5.0)
    for name in ("one", "two"):
        simulate_recording(tmp_path / name, config)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert not list((tmp_path / "one").rglob("background.png"))
    document = json.loads((tmp_path / "one/recording/recording.json").read_text())
    assert document["cameras"][0]["camera_to_world"] is None
    assert document["equipment"] is None
    recording = open_recording(tmp_path / "one/recording")
    assert len(recording.cameras) == 1
    with np.load(tmp_path / "one/truth/truth.npz") as truth:
        assert truth["camera_to_world"].shape == (1, 4, 4)
        assert truth["camera_to_world"][0, 1, 3] == pytest.approx(config.room.camera_height_m)
        assert truth["joints"].shape == (4, 21, 3)


def test_cameras_are_where_the_plan_says_and_within_the_ranges():
    for config, room_plan in plans():
        camera = room_camera(room_plan, config.sensor, config.lens)
        pose = camera.require_pose()
        assert 0.5 <= camera.position_m[1] <= 2.5
        assert 1.2 <= np.hypot(*camera.position_m[[0, 2]]) <= 4.5
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        assert -pose[1, 2] == pytest.approx(np.sin(room_plan.tilt_rad), abs=1e-9)
        assert np.degrees(np.arcsin(-pose[1, 2])) <= 35.0 + 1e-6
        level = np.cross(pose[:3, 2], [0.0, 1.0, 0.0])
        roll = np.arccos(np.clip(level / np.linalg.norm(level) @ pose[:3, 0], -1.0, 1.0))
        assert roll == pytest.approx(abs(room_plan.roll_rad), abs=1e-6)
        assert np.degrees(roll) <= 4.0 + 1e-6


def test_the_border_cuts_off_what_the_seed_says():
    for config, room_plan in plans():
        camera = room_camera(room_plan, config.sensor, config.lens)
        head_m = config.height_m * (SEATED_SHARE if room_plan.posture == "sits" else 1.0)
        places = np.array([[0.0, 0.0, 0.0], [0.0, MIDDLE_SHARE * head_m, 0.0], [0.0, head_m, 0.0]])
        rows = camera.project(transform_points(invert_rigid(camera.require_pose()), places))[:, 1]
        assert 0 < rows[1] < camera.height
        if room_plan.framing != "head-cut-off":
            assert (rows[0] >= camera.height) == (room_plan.framing == "feet-cut-off")
        assert (rows[2] < 0) == (room_plan.framing == "head-cut-off")


def test_other_people_have_labels_after_the_patient_and_a_late_patient_walks_in():
    config = room(51_010, seconds=6.0, fps=5.0)
    assert config.room.late
    studio = set_up(draw_clinic(config))
    joints_m, times_s = studio.performances[0].joints_m(), studio.performances[0].times_s
    away = np.isnan(joints_m).all(axis=(1, 2))
    assert np.array_equal(away, times_s < config.away_s[0][1])
    hips_m = np.linalg.norm(joints_m[~away][:, 0, [0, 2]], axis=1)
    assert hips_m[0] > 1.2
    assert hips_m[-1] < 0.5
    labels = set(np.unique(studio.shoot(15).images[0].label)) - {NOTHING, PATIENT}
    assert labels
    assert labels <= {PATIENT + 1 + n for n in range(len(config.room.others))}


def test_what_does_not_belong_into_a_room_and_a_camera_outside_of_the_ranges_are_refused():
    foreign = {"cameras": 2, "equipment": "walker", "therapists": 1, "curtain_s": (0.1, 0.2), "away_s": ((1.0, 2.0),)}
    beyond = {"distance_m": 0.5, "camera_height_m": 3.0, "tilt_rad": 0.7, "roll_rad": 0.2}
    bases = ((room(51_012, seconds=3.0), foreign, "room"), (BARE, beyond, "should be"))
    for base, name, value, problem in ((b, n, v, p) for b, wrong, p in bases for n, v in wrong.items()):
        with pytest.raises(ValueError, match=problem):
            replace(base, **{name: value})
