"""The equipment model: exact distances, closed surfaces, and meshes from PLY files."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from anchorpose.errors import InputError
from anchorpose.recording.equipment import Box, Cylinder, Mesh, read_equipment, read_ply

TURN = Rotation.from_euler("xyz", [0.4, -0.8, 1.1]).as_matrix()
BOX = Box("box", np.array([0.3, 0.5, -0.2]), np.array([0.2, 0.5, 0.8]), TURN)
CYLINDER = Cylinder("post", np.array([-0.4, 0.6, 0.3]), TURN[:, 0], 0.15, 0.9)
TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6.0)


def test_triangles_enclose_the_volume_of_the_part_seen_from_outside():
    assert _volume(*BOX.triangles()) == pytest.approx(np.prod(BOX.size_m))
    round_volume = np.pi * CYLINDER.radius_m**2 * CYLINDER.length_m
    assert 0.99 * round_volume < _volume(*CYLINDER.triangles()) < round_volume


@pytest.mark.parametrize("part", [BOX, CYLINDER])
def test_signed_distance_is_zero_on_the_corners_and_minus_the_depth_in_the_middle(part):
    vertices, _ = part.triangles()
    np.testing.assert_allclose(part.distance_m(vertices), 0.0, atol=1e-12)
    least_half = min(BOX.size_m) / 2 if part is BOX else CYLINDER.radius_m
    assert part.distance_m(part.center_m[None])[0] == pytest.approx(-least_half)


def test_distance_outside_is_that_to_the_nearest_point_of_the_solid():
    rng = np.random.default_rng(3)
    for point in rng.uniform(-1.5, 1.5, (12, 3)):
        if BOX.distance_m(point[None])[0] > 0:
            bounds = [(-half, half) for half in BOX.size_m / 2]
            nearest = minimize(
                lambda q, p=point: np.sum((BOX.center_m + TURN @ q - p) ** 2), np.zeros(3), bounds=bounds
            )
            assert BOX.distance_m(point[None])[0] == pytest.approx(np.sqrt(nearest.fun), abs=1e-5)


def _sampled_distance(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The oracle: the nearest of many points on each triangle; never below the exact distance."""
    grid = [(i, j) for i in range(61) for j in range(61 - i)]
    weights = np.array([(i, j, 60 - i - j) for i, j in grid]) / 60.0
    samples = np.concatenate([weights @ vertices[face] for face in faces])
    return np.linalg.norm(points[:, None] - samples, axis=2).min(axis=1)


def test_distance_to_a_mesh_agrees_with_dense_sampling_and_that_of_a_box_with_the_box():
    points = np.random.default_rng(5).uniform(-1, 2, (80, 3))
    exact = Mesh("t", TETRAHEDRON, TETRAHEDRON_FACES).distance_m(points)
    sampled = _sampled_distance(points, TETRAHEDRON, TETRAHEDRON_FACES)
    assert (exact <= sampled + 1e-9).all()
    np.testing.assert_allclose(exact, sampled, atol=0.02)  # half the spacing of the samples
    points = np.random.default_rng(6).uniform(-2, 2, (200, 3))
    distance = BOX.distance_m(points)
    mesh = Mesh("m", *BOX.triangles()).distance_m(points)
    np.testing.assert_allclose(mesh, np.abs(distance), atol=1e-9)


def _ascii_ply() -> bytes:
    lines = ["ply", "format ascii 1.0", "comment a seat", "element vertex 4", "property float x", "property float y"]
    lines += ["property float z", "element face 2", "property list uchar int vertex_indices", "end_header"]
    lines += ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "4 0 1 2 3", "3 0 1 2"]
    return "\n".join(lines).encode() + b"\n"


def _binary_ply(order: str = "<", name: str = "little") -> bytes:
    header = f"ply\nformat binary_{name}_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
    header += (
        "property double z\nproperty uchar red\nelement face 2\nproperty list uchar uint vertex_index\nend_header\n"
    )
    body = b"".join(struct.pack(order + "dddB", x, y, 0, 7) for x, y in [(0, 0), (1, 0), (1, 1), (0, 1)])
    body += struct.pack(order + "B4I", 4, 0, 1, 2, 3) + struct.pack(order + "B3I", 3, 0, 1, 2)
    return header.encode() + body


@pytest.mark.parametrize("data", [_ascii_ply(), _binary_ply(), _binary_ply(">", "big")], ids=["ascii", "little", "big"])
def test_a_ply_mesh_is_read_and_its_polygons_split(tmp_path, data):
    (tmp_path / "m.ply").write_bytes(data)
    vertices, faces = read_ply(tmp_path / "m.ply")
    np.testing.assert_allclose(vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 2, 3], [0, 1, 2]])


BAD_PLY = {
    "no PLY header": b"solid stl",
    "cut short": _binary_ply()[:-5],
    "cut short in text": _ascii_ply()[:-8],
    "vertex that is not there": _ascii_ply().replace(b"3 0 1 2\n", b"3 0 1 9\n"),
    "unknown type": _ascii_ply().replace(b"float z", b"quad z"),
    "no number": _ascii_ply().replace(b"1 1 0", b"1 one 0"),
    "more rows than bytes": _ascii_ply().replace(b"element face 2", b"element note 999999999999\nelement face 2"),
    "an endless list": _ascii_ply().replace(b"4 0 1 2 3", b"inf 0 1 2 3"),
    "a huge index": _ascii_ply().replace(b"3 0 1 2\n", b"3 0 1 1e300\n"),
    "not finite": _ascii_ply().replace(b"1 1 0", b"1 nan 0"),
    "no faces": _ascii_ply().split(b"element face")[0] + b"end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n",
    "missing": None,
}


@pytest.mark.parametrize("data", BAD_PLY.values(), ids=BAD_PLY.keys())
def test_a_damaged_mesh_is_refused_by_name(tmp_path, data):
    if data is not None:
        (tmp_path / "seat.ply").write_bytes(data)
    with pytest.raises(InputError, match=r"seat\.ply"):
        read_ply(tmp_path / "seat.ply")


def _write_equipment(folder: Path, *parts: dict) -> Path:
    document = {"format": "equipment-model", "version": 1, "parts": parts}
    (folder / "equipment.json").write_text(json.dumps(document))
    return folder / "equipment.json"


def test_the_example_of_the_format_is_read(tmp_path):
    (tmp_path / "seat.ply").write_bytes(_ascii_ply())
    box = {"name": "knee-bar", "shape": "box", "center": [0.3, 0.46, 0], "size": [0.05, 0.09, 0.6]}
    box["rotation"] = TURN.tolist()
    post = {"name": "post", "shape": "cylinder", "center": [0.3, 0.55, -0.42], "radius": 0.025, "length": 1.1}
    post["axis"] = [0, 1, 0]
    model = read_equipment(_write_equipment(tmp_path, box, post, {"name": "s", "shape": "mesh", "file": "seat.ply"}))
    assert [type(part) for part in model.parts] == [Box, Cylinder, Mesh]
    np.testing.assert_allclose(model.parts[0].rotation, TURN)
    assert model.parts[1].length_m == 1.1


GOOD = {"name": "bar", "shape": "box", "center": [0, 0, 0], "size": [1, 1, 1]}
TUBE = {"name": "bar", "shape": "cylinder", "center": [0, 0, 0], "radius": 0.1, "length": 1, "axis": [0, 1, 0]}
BAD_PARTS = {
    "sizes'; did you mean 'size'": {**GOOD, "sizes": 1},
    "size.*at least 0.0001: a length in metres": {**GOOD, "size": [1, -1, 1]},
    "size.*at most 20: a length in metres": {**GOOD, "size": [1000, 1, 1]},
    "rotation is not a rotation": {**GOOD, "rotation": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]},
    "center.*missing.*metres from the origin": {**GOOD, "center": [0, 0]},
    "shape is \"sphere\".*'box', 'cylinder', 'mesh'": {**GOOD, "shape": "sphere"},
    'shape is "x{36}\\.\\.\\.; it must be': {**GOOD, "shape": "x" * 5000},
    "axis.*no direction": {**TUBE, "axis": [0, 0, 0]},
    "radius.*at least 0.0001": {**TUBE, "radius": 0},
    "file.*leads out": {"name": "s", "shape": "mesh", "file": "../seat.ply"},
    "name.*missing": {key: value for key, value in GOOD.items() if key != "name"},
}


@pytest.mark.parametrize("problem", BAD_PARTS)
def test_a_part_that_cannot_be_is_refused(tmp_path, problem):
    with pytest.raises(InputError, match=rf"equipment\.json: .*{problem}"):
        read_equipment(_write_equipment(tmp_path, BAD_PARTS[problem]))


def test_parts_of_one_name_and_no_parts_are_refused(tmp_path):
    with pytest.raises(InputError, match="two parts named 'bar'"):
        read_equipment(_write_equipment(tmp_path, GOOD, TUBE))
    with pytest.raises(InputError, match="parts is empty"):
        read_equipment(_write_equipment(tmp_path))
