"""Proposing the equipment: known boxes and tubes come back, and what is not seen is a guess."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from recording_builder import write_recording
from room_builder import ROOM, camera_at, picture, write_room_recording

from anchorpose.calibration.proposal import EquipmentProposal, NoEquipment, propose_equipment
from anchorpose.calibration.proposal_readings import Region
from anchorpose.cli import main
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel, read_equipment, write_equipment

POST = Box("post", np.array([0.3, 0.5, -0.4]), np.array([0.05, 1.0, 0.05]), np.eye(3))
RAIL = Cylinder("rail", np.array([-0.1, 0.8, -0.4]), np.array([1.0, 0.0, 0.0]), 0.02, 0.7)
BAR = Box("bar", np.array([0.3, 0.5, 0.05]), np.array([0.04, 0.08, 0.7]), np.eye(3))
SEAT = Box("seat", np.array([-0.1, 0.45, 0.1]), np.array([0.36, 0.05, 0.38]), np.eye(3))
FRONT, LEFT, RIGHT = (
    camera_at(place, (0.0, 0.6, 0.0), width=512, height=424)
    for place in ((2.4, 1.3, 0.1), (1.5, 1.4, -2.0), (1.5, 1.4, 2.0))
)
REGION = Region()


def proposed(cameras, *parts, region: Region = REGION) -> EquipmentProposal:
    rooms = [picture(camera, *ROOM, *parts, seed=index) for index, camera in enumerate(cameras)]
    proposal = propose_equipment(cameras, rooms, 0.0, region)
    assert isinstance(proposal, EquipmentProposal)
    return proposal


def near(proposal: EquipmentProposal, true: Box | Cylinder):
    """The proposed part whose middle is nearest."""
    return min(proposal.parts, key=lambda p: float(np.linalg.norm(p.part.center_m - true.center_m)))


@pytest.fixture(scope="module")
def three() -> EquipmentProposal:
    return proposed((FRONT, LEFT, RIGHT), POST, RAIL, BAR)


@pytest.mark.thorough
def test_three_cameras_give_every_part_to_millimetres_and_a_tube_is_no_square_bar(three):
    assert len(three.parts) == 3
    post, bar = near(three, POST).part, near(three, BAR).part
    np.testing.assert_allclose(post.center_m, POST.center_m, atol=0.008)
    np.testing.assert_allclose(np.sort(post.size_m), [0.05, 0.05, 1.0], atol=0.01)
    np.testing.assert_allclose(np.sort(bar.size_m), [0.04, 0.08, 0.7], atol=0.012)
    assert three.explained_share > 0.98
    assert all(part.residual_m < 0.006 for part in three.parts)  # the sensor's own noise is 7 mm at 2.4 m
    rail = near(three, RAIL).part
    assert isinstance(rail, Cylinder)
    assert rail.radius_m == pytest.approx(0.02, abs=0.004)
    assert abs(rail.axis[0]) == pytest.approx(1.0, abs=1e-6)
    assert isinstance(near(three, POST).part, Box)


@pytest.mark.thorough
def test_every_surface_point_of_the_truth_is_explained_none_is_invented_and_the_file_is_the_same_model(three, tmp_path):
    truth = EquipmentModel((POST, RAIL, BAR))
    for one, other in ((truth, three.model), (three.model, truth)):
        depth = picture(FRONT, *one.parts)
        points = FRONT.back_project(depth).reshape(-1, 3)[depth.ravel() > 0].astype(float)
        world = points @ FRONT.require_pose()[:3, :3].T + FRONT.position_m
        assert np.mean(np.abs(other.distance_m(world)) < 0.015) > 0.97
    write_equipment(tmp_path / "equipment.json", three.model)
    again = read_equipment(tmp_path / "equipment.json")
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    np.testing.assert_allclose(again.distance_m(points), three.model.distance_m(points), atol=1e-12)
    assert [part.name for part in again.parts] == [part.name for part in three.model.parts]


def test_from_one_side_the_thickness_is_a_guess_and_marked_as_one():
    proposal = proposed((FRONT,), POST)
    (post,) = proposal.parts
    assert set(post.guessed) & {"breadth", "thickness"}
    size = np.sort(post.part.size_m) if isinstance(post.part, Box) else np.full(2, 2 * post.part.radius_m)
    assert size[0] == pytest.approx(size[1], abs=0.002)  # assumed square
    assert size[0] == pytest.approx(0.05, abs=0.01)
    assert post.part.center_m[2] == pytest.approx(-0.4, abs=0.005)


@pytest.mark.thorough
def test_pieces_behind_a_bar_are_one_post_and_pieces_with_a_view_between_them_are_two():
    cut = Box("cut", np.array([0.4, 0.5, -0.4]), np.array([0.04, 0.12, 0.7]), np.eye(3))
    assert sum(part.part.name.startswith("post") for part in proposed((FRONT,), POST, cut).parts) == 1
    apart = [replace(POST, center_m=np.array([0.3, y, -0.4]), size_m=np.array([0.05, 0.4, 0.05])) for y in (0.2, 0.8)]
    assert sum(part.part.name.startswith("post") for part in proposed((FRONT, LEFT), *apart).parts) == 2


@pytest.mark.thorough
def test_a_seat_is_a_plate_of_its_size():
    legs = [
        replace(POST, center_m=np.array([x, 0.21, z]), size_m=np.array([0.03, 0.42, 0.03]))
        for x, z in ((-0.25, -0.06), (-0.25, 0.26), (0.05, -0.06), (0.05, 0.26))
    ]
    seat = near(proposed((FRONT, LEFT, RIGHT), SEAT, *legs), SEAT)
    assert seat.part.name == "seat-1"
    np.testing.assert_allclose(np.sort(seat.part.size_m), [0.05, 0.36, 0.38], atol=0.03)
    assert seat.part.center_m[1] + np.sort(seat.part.size_m)[0] / 2 == pytest.approx(0.475, abs=0.008)


@pytest.mark.thorough
def test_equipment_that_stands_askew_gets_its_own_right_angles():
    turn = np.radians(25.0)
    R = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    turned = [Box(p.name, R @ p.center_m, p.size_m, R) for p in (POST, BAR)]
    bar = near(proposed((FRONT, LEFT), *turned), turned[1]).part
    along = bar.rotation[:, int(np.argmax(bar.size_m))]
    assert abs(along @ R[:, 2]) > np.cos(np.radians(1.0))
    assert along[1] == pytest.approx(0.0, abs=1e-9)  # level to the last digit: snapped


@pytest.mark.thorough
def test_a_strut_keeps_its_slant():
    slant = np.radians(40.0)
    R = np.array([[1, 0, 0], [0, np.cos(slant), -np.sin(slant)], [0, np.sin(slant), np.cos(slant)]])
    strut = Box("strut", np.array([0.1, 0.6, 0.0]), np.array([0.05, 0.05, 0.9]), R)
    (part,) = proposed((FRONT, LEFT), strut).parts
    along = part.part.rotation[:, 2] if isinstance(part.part, Box) else part.part.axis
    assert abs(along @ R[:, 2]) > np.cos(np.radians(1.5))
    assert part.part.name == "strut-1"


def test_an_empty_room_has_no_equipment_and_neither_has_the_wall_behind():
    rooms = [picture(FRONT, *ROOM, seed=0)]
    assert propose_equipment((FRONT,), rooms, 0.0, REGION) is NoEquipment.NOTHING_STANDS
    wide = Region(center_xz_m=(-1.8, 0.0), radius_m=1.0)
    assert propose_equipment((FRONT,), rooms, 0.0, wide) is NoEquipment.NOTHING_STANDS


@pytest.mark.thorough
def test_the_verb_writes_a_file_and_pictures_and_says_what_is_a_guess(tmp_path, capsys, refusal):
    camera = replace(FRONT, name="front")
    room = picture(camera, *ROOM, POST, BAR, seed=0)
    recording = write_room_recording(tmp_path / "r", camera, room, [room, room])
    command = ["equipment", "fit", str(recording), "-o", str(tmp_path / "out" / "equipment.json")]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "post-1" in said
    assert "square" in said
    assert len(read_equipment(tmp_path / "out" / "equipment.json").parts) == 2
    assert cv2.imread(str(tmp_path / "out" / "equipment_front.png")) is not None
    for kept, other in (("equipment.json", "equipment_front.png"), ("equipment_front.png", "equipment.json")):
        (tmp_path / "out" / other).unlink()
        before = (tmp_path / "out" / kept).read_bytes()
        assert f"{kept}: exists already; choose another name, or give --overwrite" in refusal(command)
        assert [path.name for path in (tmp_path / "out").iterdir()] == [kept]
        assert (tmp_path / "out" / kept).read_bytes() == before
        (tmp_path / "out" / other).touch()


def test_what_cannot_be_fitted_is_refused_in_one_sentence(tmp_path, refusal):
    recording = write_recording(tmp_path / "r", frames=2, cameras=("front", "left"))
    out = ["-o", str(tmp_path / "e.json")]
    assert "choose one of front, left" in refusal(["equipment", "fit", str(recording), *out, "--camera", "top"])
    document = json.loads((recording / "recording.json").read_text())
    document["cameras"][1]["camera_to_world"] = None
    (recording / "recording.json").write_text(json.dumps(document))
    assert "--camera" in refusal(["equipment", "fit", str(recording), *out])
    (recording / "front" / "background.png").unlink()
    assert "record the empty room" in refusal(["equipment", "fit", str(recording), *out, "--camera", "front"])
    assert not (tmp_path / "e.json").exists()
