"""A proposal for the equipment of a recording: which cameras, in which world, near which place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anchorpose.calibration.floor import FloorConfig
from anchorpose.calibration.proposal.proposal import (
    EquipmentFitConfig,
    EquipmentProposal,
    NoEquipment,
    propose_equipment,
)
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import Recording

SAMPLES = 8  # frames by which the place of the patient is found where no pose is given


@dataclass(frozen=True, slots=True, eq=False)
class FittedRoom:
    """cameras with the poses used, rooms_m one picture of the empty room each, the proposal, and notes on both."""

    cameras: tuple[Camera, ...]
    rooms_m: tuple[np.ndarray, ...]
    proposal: EquipmentProposal
    notes: tuple[str, ...]


def fit_equipment(recording: Recording, camera: str | None, config: EquipmentFitConfig) -> FittedRoom:
    """The equipment in the empty rooms of a recording's cameras, or of the named one alone.

    Where the poses are given, parts are in their world; one camera without a pose is placed by the floor and by where
    the patient stands first. Raises InputError where there is no picture of the empty room, no floor or no equipment.
    """
    chosen = _with_cameras(recording, camera)
    rooms = tuple(room for room in chosen.backgrounds_m if room is not None)
    if len(rooms) < len(chosen.cameras):
        missing = next(c.name for c, room in zip(chosen.cameras, chosen.backgrounds_m, strict=True) if room is None)
        path = recording.folder / missing / "background.png"
        raise InputError(path, "there is no such file", "record the empty room with the equipment, or choose --camera")
    count = len(chosen.streams[0].files)
    places = np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int)).tolist()
    samples = [next(iter(read_frames(chosen, place, place + 1))) for place in places]
    world = find_world(chosen, samples, FloorConfig())
    if world.floor_height_m is None:
        path = recording.folder / chosen.cameras[0].name / "background.png"
        raise InputError(path, "shows no floor to stand on", "let the camera see some floor, then record it again")
    proposal = propose_equipment(world.cameras, rooms, world.floor_height_m, config)
    if isinstance(proposal, NoEquipment):
        x, z = config.region.center_xz_m
        where = f"{config.region.radius_m:g} m around x {x:g}, z {z:g}"
        raise InputError(recording.folder, f"{proposal.value} ({where})", "say where it is with --around and --radius")
    return FittedRoom(world.cameras, rooms, proposal, world.notes)


def _with_cameras(recording: Recording, name: str | None) -> Recording:
    """The recording with one camera only, or with all; without its equipment, which is what is looked for."""
    names = [camera.name for camera in recording.cameras]
    if name is not None and name not in names:
        raise InputError(recording.folder, f"has no camera '{name}'", f"choose one of {', '.join(names)}")
    kept = [index for index, other in enumerate(names) if name in (None, other)]
    unknown = [names[index] for index in kept if recording.cameras[index].T_world_camera is None]
    if len(kept) > 1 and unknown:
        problem = f"the pose of {', '.join(unknown)} is unknown, so the cameras' pictures cannot be put together"
        raise InputError(recording.folder / "recording.json", problem, "choose one with --camera, or calibrate first")
    return replace(
        recording,
        cameras=tuple(recording.cameras[index] for index in kept),
        streams=tuple(recording.streams[index] for index in kept),
        backgrounds_m=tuple(recording.backgrounds_m[index] for index in kept),
        equipment=None,
    )
