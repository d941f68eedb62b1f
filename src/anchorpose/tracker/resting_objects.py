"""Objects that are moved become a part of the room while they rest, unless they may be people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.body.skin_points import body_points
from anchorpose.camera import transform_points
from anchorpose.isolation.background import BackgroundSource
from anchorpose.isolation.empty_room import PERSON_M, in_equipment
from anchorpose.isolation.resting_objects import RestingObject, resting_objects
from anchorpose.isolation.scene import Scene, find_pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.bystanders import ordinary_body, person_evidence, rough_body
from anchorpose.tracker.sighting import ONE_PERSON

CHECKED: Final = 3  # samples with a body each
BELOW_FLOOR_M: Final = 0.3  # of a rough body's lowest joint; a body that explains a stool has it at a metre
MOST_SHARED: Final = 0.1  # of an object, within the equipment or about the place that the user named


def with_resting_objects(
    scene: Scene,
    number: int,
    samples: Sequence[FrameSet],
    floor_height_m: float | None,
    equipment: EquipmentModel | None,
    named_xz_m: tuple[float, float] | None,
) -> Scene:
    """The scene of the camera with a number, with the objects in its room that are moved, each while it rests.

    Only in a room that was learnt from the recording: from a picture of the empty room everything stands out.
    named_xz_m: where the user named the patient, who may keep still.
    """
    model, camera = scene.background, scene.camera
    if model.source is not BackgroundSource.RECORDING:
        return scene
    seen = [(depth, sample.time_s) for sample in samples if (depth := sample.depths_m[number]) is not None]
    frames, times = [depth for depth, _ in seen], [time_s for _, time_s in seen]
    found = [
        one
        for one in resting_objects(frames, times, model, camera, floor_height_m)
        if not _is_named(one, scene, named_xz_m)
        and not _is_in_equipment(one, scene, equipment, floor_height_m)
        and (one.flat or not _is_person(one, frames, scene, floor_height_m))
    ]
    return replace(scene, background=replace(model, layers=tuple(one.layer for one in found)))


def _is_named(one: RestingObject, scene: Scene, named_xz_m: tuple[float, float] | None) -> bool:
    if named_xz_m is None:
        return False
    camera = scene.camera
    points = transform_points(camera.require_pose(), camera.back_project(one.layer.depth_m))[one.piece]
    return bool((np.linalg.norm(points[:, [0, 2]] - named_xz_m, axis=1) < PERSON_M).mean() > MOST_SHARED)


def _is_in_equipment(
    one: RestingObject, scene: Scene, equipment: EquipmentModel | None, floor_height_m: float | None
) -> bool:
    if equipment is None:
        return False
    inside = in_equipment(one.layer.depth_m, scene.camera, equipment, floor_height_m, scene.background.noise_per_m)
    return bool(inside[one.piece].mean() > MOST_SHARED)


def _is_person(one: RestingObject, frames_m: Sequence[np.ndarray], scene: Scene, floor_height_m: float | None) -> bool:
    """Whether a body on the floor explains an object in most of some samples, or too little is seen to find one."""
    chosen = [int(one.samples[k]) for k in thin(len(one.samples), CHECKED)]
    return 2 * sum(_body_explains(one, frames_m[k], scene, floor_height_m) for k in chosen) > len(chosen)


def _body_explains(one: RestingObject, frame_m: np.ndarray, scene: Scene, floor_height_m: float | None) -> bool:
    """A body that explains a stool has its legs below the floor."""
    pieces = find_pieces(frame_m, scene)
    labels = np.where(one.piece & (pieces.depth_m > 0), np.uint8(PixelLabel.PATIENT), pieces.labels)
    evidence = person_evidence((View(pieces.depth_m, labels),), (scene.camera,), PixelLabel.PATIENT)
    body = ordinary_body(body_points())
    found = rough_body(body, evidence)
    if found is None:
        return True
    lowest_m = float(body.joints(found.belief.pose)[:, 1].min())
    on_floor = floor_height_m is None or lowest_m > floor_height_m - BELOW_FLOOR_M
    return found.explained >= ONE_PERSON and on_floor
