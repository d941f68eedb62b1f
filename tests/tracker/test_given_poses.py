"""Given poses that floor, equipment or other cameras contradict: refused, noted, or beyond what can be asked."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from clinic_builder import shoot
from scipy.spatial.transform import Rotation

from anchorpose.calibration.calibration import Calibration
from anchorpose.calibration.clocks import CameraClock, Clocks, ClockSource
from anchorpose.calibration.world import find_world
from anchorpose.errors import InputError
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import Clock, FrameSet, Recording
from anchorpose.simulate.config import SimulationConfig
from anchorpose.tracker.given_poses import agreeing_poses
from anchorpose.tracker.preparation import Settled, scenes_of

pytestmark = pytest.mark.thorough

Clinic = tuple[Recording, list[FrameSet]]
SLOW = pytest.mark.slow
BESIDE_M = np.array([0.1, 0.0, 0.08])


@pytest.fixture(scope="module")
def clinic() -> Clinic:
    """Three cameras with their true poses, a standing frame and a therapist."""
    true, recording, frames = shoot(SimulationConfig(seed=33, seconds=6.0, fps=10.0, therapists=1))
    return replace(recording, cameras=true.cameras), frames


def agreed(recording: Recording, frames: Sequence[FrameSet]) -> Calibration:
    """As ``track`` asks; the clocks are right."""
    calibration = find_world(recording, frames)
    known = (CameraClock(camera.name, Clock(), ClockSource.SURFACES) for camera in recording.cameras)
    settled = Settled(recording, Clocks(tuple(known), None), calibration, tuple(range(len(frames))), tuple(frames))
    return agreeing_poses(recording, calibration, settled.clocks, scenes_of(settled), frames)


def posed(recording: Recording, index: int, turn_deg: Sequence[float] = (0, 0, 0), shift_m=(0, 0, 0)) -> Recording:
    """One camera turned where it stands, about the world's axes, and shifted."""
    T = recording.cameras[index].T_world_camera.copy()
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix() @ T[:3, :3]
    T[:3, 3] += shift_m
    cameras = list(recording.cameras)
    cameras[index] = replace(cameras[index], T_world_camera=T)
    return replace(recording, cameras=tuple(cameras))


def only(clinic: Clinic, index: int, equipment: bool = True) -> Clinic:
    """What one camera alone recorded."""
    recording, frames = clinic
    alone = replace(
        recording,
        cameras=(recording.cameras[index],),
        backgrounds_m=(recording.backgrounds_m[index],),
        equipment=recording.equipment if equipment else None,
    )
    return alone, [replace(frame, depths_m=(frame.depths_m[index],)) for frame in frames]


def with_images(clinic: Clinic, order: Sequence[int], turned: Sequence[int] = ()) -> Clinic:
    """The images of camera ``order[k]`` in the folder of camera k; some turned by 180 degrees."""
    recording, frames = clinic

    def image(images: Sequence[np.ndarray], k: int) -> np.ndarray:
        return np.ascontiguousarray(images[order[k]][::-1, ::-1]) if k in turned else images[order[k]]

    every = range(len(order))
    spoilt = replace(recording, backgrounds_m=tuple(image(recording.backgrounds_m, k) for k in every))
    return spoilt, [replace(frame, depths_m=tuple(image(frame.depths_m, k) for k in every)) for frame in frames]


def test_right_poses_are_not_doubted(clinic):
    found = agreed(*clinic)
    assert found.doubts == ()
    assert found.displaced_m == 0.0


def test_a_camera_turned_by_five_degrees_is_refused_with_its_name_by_how_much_and_a_remedy(clinic):
    recording, frames = clinic
    with pytest.raises(InputError, match=r"camera left puts the equipment 2\d\d mm and 5\.0 degrees .*--ignore-given"):
        agreed(posed(recording, 1, (0, 5, 0)), frames)


@SLOW
def test_without_equipment_the_other_cameras_refuse_it(clinic):
    recording, frames = clinic
    off = posed(replace(recording, equipment=None), 1, (0, 5, 0))
    with pytest.raises(InputError, match=r"cameras (front and left|left and right) (have the people|see past)"):
        agreed(off, frames)
    assert agreed(replace(recording, equipment=None), frames).doubts == ()


def test_two_centimetres_are_noted_and_half_of_them_widen_sigma(clinic):
    recording, frames = clinic
    found = agreed(posed(recording, 1, shift_m=(0, 0, 0.02)), frames)
    assert not any(doubt.refuted for doubt in found.doubts)
    assert any("camera left puts the equipment" in note for note in found.notes)
    assert found.displaced_m == pytest.approx(0.01, abs=0.003)


def off_by(recording: Recording, shift_m: float, turn_deg: float, longer: float) -> Recording:
    """Every camera off its pose, in a direction of its own, with a focal length that is longer or shorter."""
    rng, found = np.random.default_rng(5), recording
    for index, camera in enumerate(recording.cameras):
        shift, axis = rng.normal(size=(2, 3))
        turned = turn_deg * axis / np.linalg.norm(axis)
        found = posed(found, index, turned, shift_m * shift / np.linalg.norm(shift))
        lens, scale = camera.intrinsics, 1.0 + longer * (-1) ** index
        scaled = replace(lens, fx=scale * lens.fx, fy=scale * lens.fy)
        cameras = [replace(one, intrinsics=scaled) if k == index else one for k, one in enumerate(found.cameras)]
        found = replace(found, cameras=tuple(cameras))
    return found


@pytest.mark.parametrize("equipment", [True, False])
def test_poses_as_good_as_published_ones_are_noted_and_widen_sigma(clinic, equipment):
    """Three cameras 2 cm and 0.7 degrees off, with nominal lenses, see past half of each other's rooms by 5 cm."""
    recording, frames = clinic
    given = recording if equipment else replace(recording, equipment=None)
    found = agreed(off_by(given, 0.02, 0.7, 0.015), frames)
    assert not any(doubt.refuted for doubt in found.doubts)
    assert any("have the people and the room" in note for note in found.notes)
    assert 0.01 < found.displaced_m < 0.08


def test_exchanged_folders_are_refused_as_exchanged(clinic):
    with pytest.raises(InputError, match=r"cameras front and left seem to be exchanged.*exchange their folders"):
        agreed(*with_images(clinic, (1, 0, 2)))


def test_a_camera_upside_down_is_refused_as_such(clinic):
    with pytest.raises(InputError, match=r"camera left is upside down: by its given pose.*by 180 degrees"):
        agreed(*with_images(clinic, (0, 1, 2), turned=(1,)))


@pytest.mark.parametrize("given", [True, False])
def test_a_single_camera_upside_down_is_refused_without_equipment_too(clinic, given):
    recording, frames = only(with_images(clinic, (0, 1, 2), turned=(0,)), 0, equipment=False)
    if not given:
        recording = replace(recording, cameras=(replace(recording.cameras[0], T_world_camera=None),))
    with pytest.raises(InputError, match=r"camera front is upside down: by its (given pose|images)"):
        agreed(recording, frames)


def test_a_camera_that_hangs_upside_down_with_its_true_pose_is_not_refused(clinic):
    recording, frames = only(with_images(clinic, (0, 1, 2), turned=(0,)), 0)
    lens, camera = recording.cameras[0].intrinsics, recording.cameras[0]
    hung = replace(lens, cx=camera.width - 1 - lens.cx, cy=camera.height - 1 - lens.cy)
    T = camera.T_world_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])
    found = agreed(replace(recording, cameras=(replace(camera, intrinsics=hung, T_world_camera=T),)), frames)
    assert found.doubts == ()
    assert found.floor_height_m == pytest.approx(0.0, abs=0.01)


def test_one_camera_alone_is_refused_by_its_floor(clinic):
    recording, frames = only(clinic, 0, equipment=False)
    assert agreed(recording, frames).doubts == ()
    with pytest.raises(InputError, match=r"the floor that camera front sees is tilted by 5\.\d degrees by its pose"):
        agreed(posed(recording, 0, (0, 0, 5)), frames)


def test_without_equipment_one_camera_cannot_tell_that_it_is_turned_about_the_vertical(clinic):
    """What docs/calibration.md says cannot be asked."""
    recording, frames = only(clinic, 0, equipment=False)
    assert agreed(posed(recording, 0, (0, 5, 0)), frames).doubts == ()


def test_equipment_that_stands_elsewhere_for_all_cameras_is_noted(clinic):
    """They agree with each other, so not they were moved."""
    recording, frames = clinic
    parts = tuple(replace(part, center_m=part.center_m + BESIDE_M) for part in recording.equipment.parts)
    found = agreed(replace(recording, equipment=EquipmentModel(parts)), frames)
    assert any("stands elsewhere than equipment.json has it" in note for note in found.notes)
    assert found.displaced_m == 0.0


def test_a_floor_at_two_heights_is_doubted(clinic):
    recording, frames = clinic
    bare = replace(recording, equipment=None)
    heights = [
        doubt
        for doubt in find_world(posed(bare, 2, shift_m=(0, 0.06, 0)), frames).doubts
        if "heights" in doubt.sentence
    ]
    assert [doubt.refuted for doubt in heights] == [False]
    assert heights[0].cameras == ("right",)
    assert heights[0].off_m == pytest.approx(0.06, abs=0.01)
