"""Check that the poses of cameras that saw the equipment are consistent: all see the same floor, and no camera sees
through a surface that another camera sees.

Some equipment looks the same from several sides. The module then also finds from which side each camera saw the
equipment, and in which direction the world's X points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from anchorpose.calibration.equipment_model import Equipment
from anchorpose.calibration.equipment_pose import EquipmentPose, EquipmentPoseConfig
from anchorpose.calibration.equipment_refine import FloorPrior, StillView
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording

# m, minimum distance between a point and a reading behind it for the point to count as seen through
APART_M: Final = 0.20
NOISE_GATE: Final = 4.0
POINTS: Final = 3000  # approximate number of points compared per depth frame
FRAMES: Final = 6  # approximate number of frames in which two cameras are compared
# m above the floor; lower points are not compared, since they may show the floor, which looks the same from every side
# of the equipment
ABOVE_FLOOR_M: Final = 0.15
FLOOR_SIGMA_M: Final = 0.002  # m, sigma of the floor's mean height over all cameras
FLOOR_SIGMA_RAD: Final = 0.0009  # rad, sigma of the floor's mean direction over all cameras: 0.05 degrees
MOST_DISAGREEMENT: Final = 0.25  # maximum share of one camera's points that another camera may see through
# minimum difference between the best and the second-best of the possible poses of symmetric equipment, in the share of
# points that another camera sees through; with a smaller difference, no pose is accepted
LEAST_LEAD: Final = 0.15
LEAST_COMPARED: Final = 300  # minimum number of compared points; with fewer, the share seen through is not computed

REMEDY: Final = (
    "compare equipment.json with the room, add a background.png of the empty room, "
    "switch the camera's depth filters off, or give camera_to_world yourself"
)

ChooseHeading = Callable[[tuple[Camera, ...], float, Sequence[np.ndarray]], int | None]
"""A function that returns the index of the direction that the patient faces, among several level unit vectors; None if
uncertain. Its arguments are all cameras with poses in the equipment's frame Gamma_0, the floor's Y, and these vectors.
This function needs a body model, which calibration does not have, so the caller passes the function in.
"""


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentInputs:
    """The inputs from which the cameras' poses are found: sample_frames, spread over the recording, and the prepared
    equipment.
    """

    recording: Recording
    sample_frames: Sequence[FrameSet]
    equipment: Equipment
    config: EquipmentPoseConfig

    def frames_of(self, index: int) -> tuple[tuple[np.ndarray, ...], tuple[float, ...]]:
        """Return the depth frames of one camera, and their times."""
        pairs = [(depth, frame.time_s) for frame in self.sample_frames if (depth := frame.depths_m[index]) is not None]
        return tuple(depth for depth, _ in pairs), tuple(time for _, time in pairs)


@dataclass(frozen=True, slots=True, eq=False)
class SeenEquipment:
    """A camera without a given pose: its frames over time, and the pose of the equipment that was found in them."""

    index: int
    view: StillView
    frames_m: tuple[np.ndarray, ...]
    times_s: tuple[float, ...]
    pose: EquipmentPose


def share_seen_through(
    cameras: tuple[Camera, Camera],
    depths_m: Sequence[tuple[np.ndarray, np.ndarray]],
    floor_height_m: float,
    noise_per_m: float,
) -> float | None:
    """Return the share of points, seen by either camera, that the other camera sees through: the other camera reads a
    surface behind the point. Points that are hidden from the other camera do not count. The result is None for too few
    points.

    cameras: two cameras with poses; depths_m: pairs of frames (height, width), of the first and the second camera at
    about the same moment, 0 = no reading.
    """
    tested = through = 0
    for pair in depths_m:
        for here, there in ((0, 1), (1, 0)):
            depth, other = pair[here], cameras[there]
            step = max(1, int(np.sqrt(depth.size / POINTS)))
            points = cameras[here].back_project(depth)[::step, ::step].reshape(-1, 3)
            points = points[np.isfinite(points[:, 2])].astype(np.float64)
            world = transform_points(cameras[here].require_pose(), points)
            world = world[world[:, 1] > floor_height_m + ABOVE_FLOOR_M]
            z, reading, inside = other.look(world, pair[there])
            margin = APART_M + NOISE_GATE * noise_per_m * np.square(z)
            usable = inside & (reading > 0) & (z > 0)
            tested += int(np.count_nonzero(usable & (reading > z - margin)))
            through += int(np.count_nonzero(usable & (reading > z + margin)))
    return through / tested if tested >= LEAST_COMPARED else None


def _disagreement(
    inputs: EquipmentInputs, cameras: tuple[Camera, Camera], first: int, one: SeenEquipment
) -> float | None:
    """Return the share of points, seen by either of two ``cameras`` (indices ``first`` and ``one.index``) in some
    sampled frames, that the other camera sees through; None for too few points.
    """
    frames = inputs.sample_frames[:: max(1, len(inputs.sample_frames) // FRAMES)]
    pairs = [
        (here, there)
        for frame in frames
        if (here := frame.depths_m[first]) is not None and (there := frame.depths_m[one.index]) is not None
    ]
    up = cameras[1].require_pose()[:3, :3] @ one.view.floor.up
    foot = transform_points(cameras[1].require_pose(), -one.view.floor.height_m * one.view.floor.up)
    floor_m = float(foot @ up / up[1])
    return share_seen_through(cameras, pairs, floor_m, one.view.noise_per_m)


def common_floor(seen: Sequence[SeenEquipment], cameras: Sequence[Camera]) -> FloorPrior:
    """Return the floor in the equipment's frame Gamma_0. Its upward direction and its height are means over the cameras
    in which the equipment was found.
    """
    ups, heights = [], []
    for one in seen:
        T = cameras[one.index].require_pose()
        ups.append(T[:3, :3] @ one.view.floor.up)
        heights.append(T[:3, 3] @ ups[-1] - one.view.floor.height_m)
    up = np.mean(ups, axis=0)
    return FloorPrior(up / np.linalg.norm(up), float(np.mean(heights)), FLOOR_SIGMA_M, FLOOR_SIGMA_RAD)


def refuse_contradiction(inputs: EquipmentInputs, cameras: Sequence[Camera], seen: Sequence[SeenEquipment]) -> None:
    """Raise InputError if one camera sees through surfaces that another sees; only pairs in which at least one pose was
    not given are checked.
    """
    of_index = {one.index: one for one in seen}
    for a, b in product(range(len(cameras)), range(len(cameras))):
        if a == b or b not in of_index or (a in of_index and a > b):
            continue
        share = _disagreement(inputs, (cameras[a], cameras[b]), a, of_index[b])
        if share is not None and share > MOST_DISAGREEMENT:
            raise InputError(
                inputs.recording.folder / "recording.json",
                f"the poses found for {cameras[a].name} and {cameras[b].name} contradict each other: one sees through "
                f"{100 * share:.0f} % of what the other sees",
                REMEDY,
            )


def resolve_symmetry(
    inputs: EquipmentInputs, seen: Sequence[SeenEquipment], choose_heading: ChooseHeading | None
) -> tuple[list[Camera], list[str]]:
    """Return the cameras with poses in one world, and notes. If the equipment looks the same from several sides, the
    cameras are compared to find from which side each camera saw it; if no pose is given, ``choose_heading`` then
    decides in which direction X of the world points.
    """
    given = [camera.T_world_camera is not None for camera in inputs.recording.cameras]
    cameras = list(inputs.recording.cameras)
    for one in seen:
        cameras[one.index] = replace(cameras[one.index], T_world_camera=one.pose.camera_to_world)
    turns = inputs.equipment.symmetry.same
    if not turns:
        return cameras, []
    choices = [np.eye(4), *(invert_rigid(turn) for turn in turns)]
    free = seen if any(given) else seen[1:]
    if free:
        best = _agreeing_turns(inputs, cameras, free, choices)
        for one, turn in zip(free, best, strict=True):
            cameras[one.index] = replace(cameras[one.index], T_world_camera=turn @ one.pose.camera_to_world)
    if any(given):
        return cameras, []
    headings = [turn[:3, :3].T @ [1.0, 0.0, 0.0] for turn in choices]
    floor_m = common_floor(seen, cameras).height_m
    facing = None if choose_heading is None else choose_heading(tuple(cameras), floor_m, headings)
    if facing is None:
        raise InputError(
            inputs.recording.folder / "recording.json",
            "camera_to_world is null, the equipment looks the same from several sides, and which way the patient faces "
            "is not certain",
            "add to equipment.json a part that one side has and the other has not, or give camera_to_world",
        )
    note = "the equipment looks the same from several sides: a body fitted to the patient decided which way X points"
    return [replace(camera, T_world_camera=choices[facing] @ camera.require_pose()) for camera in cameras], [note]


def _agreeing_turns(
    inputs: EquipmentInputs, cameras: Sequence[Camera], free: Sequence[SeenEquipment], choices: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Return, for each camera in ``free`` (cameras that may have seen the symmetric equipment from another side), the
    turn among ``choices`` after which this camera agrees best with the first camera that is not in ``free``. Raises
    InputError if no turn is clearly the best.
    """
    anchor = next(index for index in range(len(cameras)) if index not in {one.index for one in free})
    best = []
    for one in free:
        shares = []
        for turn in choices:
            turned = replace(cameras[one.index], T_world_camera=turn @ one.pose.camera_to_world)
            shares.append(_disagreement(inputs, (cameras[anchor], turned), anchor, one))
        known = [1.0 if share is None else share for share in shares]
        order = np.argsort(known, kind="stable")
        if known[order[0]] > MOST_DISAGREEMENT or known[order[1]] - known[order[0]] < LEAST_LEAD:
            raise InputError(
                inputs.recording.folder / "recording.json",
                f"camera_to_world is null for {cameras[one.index].name}, the equipment looks the same from several "
                f"sides, and what cameras {cameras[anchor].name} and {cameras[one.index].name} see does not "
                "distinguish them",
                "give camera_to_world",
            )
        best.append(choices[int(order[0])])
    return best
