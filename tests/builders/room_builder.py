"""A room of boxes with people in it, as depth cameras of known noise see it."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from body_builder import adult_body, asset, child_body, skin_in, standing
from body_builder import camera_at as kinect_at
from recording_builder import write_picture

from anchorpose.camera import Camera
from anchorpose.isolation.background import equipment_depth
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import Scene, set_scene
from anchorpose.lens import Intrinsics
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel, Mesh, write_equipment

NOISE_PER_M = 0.0012  # sigma = NOISE_PER_M z^2, about a Kinect v2's
ROOM = (
    Box("floor", np.array([0.0, -0.05, 0.0]), np.array([12.0, 0.1, 12.0]), np.eye(3)),
    Box("wall", np.array([-2.05, 1.5, 0.0]), np.array([0.1, 3.0, 12.0]), np.eye(3)),
)
KNEE_BAR = Box("knee-bar", np.array([0.3, 0.5, 0.0]), np.array([0.05, 0.1, 0.8]), np.eye(3))


def camera_at(position_m, look_at_m, width: int = 256, height: int = 212) -> Camera:
    """A level camera that looks at a place."""
    lens = Intrinsics(fx=0.71 * width, fy=0.71 * width, cx=width / 2, cy=height / 2)
    return replace(kinect_at(position_m, look_at_m), width=width, height=height, intrinsics=lens)


FRONT = camera_at((2.5, 1.2, 0.0), (0.0, 0.9, 0.0))


CHILD_M = 1.4  # people who are shorter have the shape of a child


def body(x: float, z: float, height_m: float = 1.7, heading_deg: float = 0.0, **turns_deg) -> tuple[Mesh]:
    """A naked person on the floor, arms hanging; 0: faces X; turns_deg: of other bones, as ``standing`` has them."""
    skin_m = _skin(height_m, heading_deg, tuple((_HANGING | turns_deg).items()))
    return (Mesh("person", skin_m + np.array([x, -skin_m[:, 1].min(), z]), asset().faces),)


def pillar(x: float, z: float) -> Cylinder:
    """What is as large as a person and smooth."""
    return Cylinder("pillar", np.array([x, 0.7, z]), np.array([0.0, 1.0, 0.0]), 0.16, 1.4)


def seated(x: float, z: float, height_m: float = 1.7, **turns_deg) -> tuple[Mesh]:
    """A naked person who sits on nothing, the feet on the floor."""
    thighs, shanks = ({f"{side}{bone}": (0.0, 0.0, turn) for side in ("Left", "Right")} for bone, turn in _BENT)
    return body(x, z, height_m, **thighs, **shanks, **turns_deg)


_HANGING = {"LeftArm": (-35.0, 0.0, 0.0), "RightArm": (35.0, 0.0, 0.0)}
_BENT = (("UpLeg", 85.0), ("Leg", -85.0))


@cache
def _skin(height_m: float, heading_deg: float, turns_deg: tuple) -> np.ndarray:
    pose = standing((0.0, 0.0, 0.0), Hips=(0.0, heading_deg, 0.0), **dict(turns_deg))
    return skin_in(pose, child_body(height_m) if height_m < CHILD_M else adult_body(height_m))


def picture(camera: Camera, *parts, seed: int | None = None) -> np.ndarray:
    """(height, width) float32 depth of the parts, millimetre steps, with noise where a seed is given."""
    depth = equipment_depth(camera, EquipmentModel(parts)).astype(np.float64)
    if seed is not None:
        depth += np.random.default_rng(seed).normal(0, 1, depth.shape) * NOISE_PER_M * depth**2
    return (np.round(np.maximum(depth, 0) / 0.001) * 0.001).astype(np.float32)


def shot(seed: int) -> np.ndarray:
    """Two pillars in the room."""
    return picture(FRONT, *ROOM, pillar(0.0, -0.5), pillar(0.0, 0.5), seed=seed)


def filtered(depth_m: np.ndarray, width_px: int) -> np.ndarray:
    """A box filter across edges, as cameras that smooth do it."""
    return cv2.blur(depth_m, (width_px, width_px))


def unposed(camera: Camera) -> Camera:
    return replace(camera, T_world_camera=None)


def in_front(camera: Camera, *parts) -> np.ndarray:
    """(height, width) bool: pixels where the parts are in front of the room."""
    return picture(camera, *ROOM, *parts) < picture(camera, *ROOM) - 1e-3


def built_scene(*equipment, camera: Camera = FRONT) -> Scene:
    """The room with equipment in it, as isolation knows it from a picture of it and four frames."""
    frames = [picture(camera, *ROOM, *equipment, seed=k) for k in range(5)]
    model = learn_background(frames[0], frames[1:], camera, 0.0)
    return set_scene(camera, model, EquipmentModel(equipment) if equipment else None)


def write_room_recording(
    folder: Path, camera: Camera, background_m: np.ndarray, images_m: Sequence[np.ndarray], *equipment: Box
) -> Path:
    """A recording of one camera: what the empty room and each frame look like, and boxes as equipment."""
    lens = camera.intrinsics
    entry: dict[str, Any] = {"name": "front", "width": camera.width, "height": camera.height, "depth_scale": 0.001}
    entry["fps"] = 10
    entry["intrinsics"] = {"fx": lens.fx, "fy": lens.fy, "cx": lens.cx, "cy": lens.cy, "distortion": [0.0] * 5}
    entry["camera_to_world"] = camera.require_pose().tolist()
    document: dict[str, Any] = {"format": "rgbd-recording", "version": 1, "cameras": [entry], "equipment": None}
    for name, depth_m in (("background", background_m), *((f"depth/{n:06d}", m) for n, m in enumerate(images_m))):
        write_picture(folder / "front" / f"{name}.png", np.round(depth_m * 1000).astype(np.uint16))
    if equipment:
        document["equipment"] = "equipment.json"
        write_equipment(folder / "equipment.json", EquipmentModel(equipment))
    (folder / "recording.json").write_text(json.dumps(document))
    return folder
