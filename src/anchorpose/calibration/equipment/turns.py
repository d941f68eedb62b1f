"""Equipment that looks the same from several sides: which of its turns each camera saw, and which way X points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from anchorpose.calibration.equipment.pose import Equipment
from anchorpose.calibration.equipment.seen import EquipmentWorldConfig, SeenEquipment, common_floor, disagreement
from anchorpose.camera import Camera, invert_rigid
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording

TellFacing = Callable[[tuple[Camera, ...], float, Sequence[np.ndarray]], int | None]
"""Which of several level unit vectors the patient faces, None where unsure; from all cameras with their poses in
Gamma_0 and the floor's Y. It takes a body model, which calibration does not know, so the layer above hands it in."""


def resolve_symmetry(
    recording: Recording, sample_frames: Sequence[FrameSet], seen: Sequence[SeenEquipment], equipment: Equipment,
    config: EquipmentWorldConfig, tell_facing: TellFacing | None, notes: list[str],
) -> list[Camera]:  # fmt: skip
    """The cameras with poses that belong to one world, X the way the patient faces."""
    cameras = list(recording.cameras)
    for one in seen:
        cameras[one.index] = replace(cameras[one.index], T_world_camera=one.pose.camera_to_world)
    turns = equipment.symmetry.same
    if not turns:
        return cameras
    choices = [np.eye(4), *(invert_rigid(turn) for turn in turns)]
    given = [index for index, camera in enumerate(recording.cameras) if camera.T_world_camera is not None]
    free = seen if given else seen[1:]
    if free:
        best = _agreeing_turns(recording, cameras, sample_frames, free, choices, config)
        for one, turn in zip(free, best, strict=True):
            cameras[one.index] = replace(cameras[one.index], T_world_camera=turn @ one.pose.camera_to_world)
    if given:
        return cameras
    headings = [turn[:3, :3].T @ [1.0, 0.0, 0.0] for turn in choices]
    floor_m = common_floor(seen, cameras, config).height_m
    facing = None if tell_facing is None else tell_facing(tuple(cameras), floor_m, headings)
    if facing is None:
        raise InputError(
            recording.folder / "recording.json",
            "camera_to_world is null, the equipment looks the same from several sides, and which way the patient faces "
            "is not sure",
            "add to equipment.json a part that one side has and the other has not, or give camera_to_world",
        )
    notes.append(
        "the equipment looks the same from several sides: which way X points was decided by how a body fits the patient"
    )
    return [replace(camera, T_world_camera=choices[facing] @ camera.require_pose()) for camera in cameras]


def _agreeing_turns(
    recording: Recording, cameras: Sequence[Camera], sample_frames: Sequence[FrameSet], free: Sequence[SeenEquipment],
    choices: Sequence[np.ndarray], config: EquipmentWorldConfig,
) -> list[np.ndarray]:  # fmt: skip
    """For each free camera the turn with which it agrees best with the first camera that is not free."""
    anchor = next(index for index in range(len(cameras)) if index not in {one.index for one in free})
    taken = []
    for one in free:
        shares = []
        for turn in choices:
            turned = replace(cameras[one.index], T_world_camera=turn @ one.pose.camera_to_world)
            shares.append(disagreement((cameras[anchor], turned), (anchor, one.index), sample_frames, one, config))
        known = [1.0 if share is None else share for share in shares]
        order = np.argsort(known, kind="stable")
        if known[order[0]] > config.most_disagreement or known[order[1]] - known[order[0]] < config.least_lead:
            raise InputError(
                recording.folder / "recording.json",
                f"camera_to_world is null for {cameras[one.index].name}, the equipment looks the same from several "
                f"sides, and what cameras {cameras[anchor].name} and {cameras[one.index].name} see does not tell them "
                "apart",
                "give camera_to_world",
            )
        taken.append(choices[int(order[0])])
    return taken
