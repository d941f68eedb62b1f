"""run.json; pictures that show what they should."""

import json
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pytest
from results_builder import standing_joints

from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState
from anchorpose.lens import Intrinsics
from anchorpose.pages.overlay import OverlayScene, draw_scene
from anchorpose.results.run_record import as_json, hash_files

FACING = np.array([[0.0, 0, -1, 2.5], [0, -1, 0, 1.0], [-1, 0, 0, 0], [0, 0, 0, 1]])  # looks along -X
CAMERA = Camera(
    name="front",
    width=256,
    height=212,
    depth_scale=0.001,
    intrinsics=Intrinsics(fx=182.0, fy=182.0, cx=128.0, cy=106.0),
    T_world_camera=FACING,
)


def test_run_json_holds_only_what_json_knows():
    class Colour(Enum):
        RED = "red"

    @dataclass(frozen=True)
    class Settings:
        radius_m: float
        colour: Colour
        place: Path
        weights: np.ndarray
        count: np.int8
        names: frozenset[str]

    names = frozenset({"b", "d", "a", "c"})  # sorted, so that every run writes the same bytes
    settings = Settings(np.float64(0.5), Colour.RED, Path("a/b"), np.array([1.0, np.nan]), np.int8(3), names)
    expected = {"radius_m": 0.5, "colour": "red", "place": "a/b", "weights": [1.0, None], "count": 3}
    assert as_json(settings) == expected | {"names": ["a", "b", "c", "d"]}
    json.dumps(as_json(settings), allow_nan=False)
    with pytest.raises(TypeError, match="type object has no JSON form"):
        as_json({"settings": [object()]})


def test_hashes_are_those_of_the_bytes(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "b.txt").write_bytes(b"abc")
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert hash_files([tmp_path / "a" / "b.txt"], tmp_path) == (("a/b.txt", known),)


def _pixel(picture: np.ndarray, point_m: np.ndarray) -> np.ndarray:
    in_camera = np.linalg.inv(FACING) @ [*point_m, 1.0]
    scale = picture.shape[1] / CAMERA.width
    column, row = (CAMERA.project(in_camera[None, :3])[0] + 0.5) * scale - 0.5
    return picture[round(row), round(column)]


def test_a_seen_joint_is_filled_an_inferred_one_hollow_and_an_anchor_a_vermillion_dot_where_it_is():
    depth = np.full((212, 256), 2.0, np.float32)
    states = [JointState.OBSERVED] * JOINT_COUNT
    states[JOINT_INDEX["HandLeft"]] = JointState.HIDDEN_BY_PERSON
    joints = standing_joints()
    joints[JOINT_INDEX["FootRight"]] = np.nan  # lost: not drawn, and no limb to it
    picture = draw_scene(OverlayScene(camera=CAMERA, depth_m=depth, joints_m=joints, joint_states=tuple(states)))
    assert _pixel(picture, joints[JOINT_INDEX["HandRight"]]).min() > 200
    assert _pixel(picture, joints[JOINT_INDEX["HandLeft"]]).max() < 60
    depth = np.full((212, 256), 2.0, np.float32)
    head = standing_joints()[JOINT_INDEX["Head"]]
    anchors = np.array([head, *[[np.nan] * 3] * 4])
    scene = OverlayScene(camera=CAMERA, depth_m=depth, anchors_m=anchors)
    blue, green, red = _pixel(draw_scene(scene), head)
    assert (red > 180, green < 130, blue < 60) == (True, True, True)


def test_people_and_equipment_are_tinted_and_nothing_at_all_can_be_drawn():
    depth = np.full((212, 256), 2.0, np.float32)
    labels = np.full((212, 256), PixelLabel.BACKGROUND, np.uint8)
    labels[:, :80], labels[:, 80:160] = PixelLabel.PATIENT, PixelLabel.OTHER_PERSON + 1
    picture = draw_scene(OverlayScene(camera=CAMERA, depth_m=depth, labels=labels))
    patient, person, wall = picture[400, 100], picture[400, 500], picture[400, 900]
    assert wall[0] == wall[1] == wall[2]
    assert patient[0] > patient[2]
    assert tuple(person) not in (tuple(patient), tuple(wall))
    empty = draw_scene(OverlayScene(camera=CAMERA, depth_m=np.zeros((212, 256), np.float32)))
    assert empty.shape[0] > 0
