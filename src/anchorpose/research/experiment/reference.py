"""What every method is given of a recording: the patient's body, and his pose in the frames that tracking starts in.

The paper takes both from the sensor's own tracker on unoccluded data (Section V). Here it is this project's, on the
recording before anything is removed from it. No method sees the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import FittedShape, body_points, build_body
from anchorpose.errors import AnchorposeError
from anchorpose.recording.recording import Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.run import Run
from anchorpose.tracking.motion_file import load_motions


class NoReference(AnchorposeError):
    """The patient was not found in the recording as it is, so that no method can start."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """T_world_camera (k, 4, 4): of the cameras, given or found, so that all methods share one world.

    Over t frames: rotations (t, b, 3, 3) and root_m (t, 3) of the pose, joints_m (t, 21, 3) and centre_m (t, 3), the
    mean of what is seen of the body, world; NaN where he was lost. shape: the learnt body.
    """

    T_world_camera: np.ndarray
    shape: FittedShape
    rotations: np.ndarray
    root_m: np.ndarray
    joints_m: np.ndarray
    centre_m: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(t,) bool."""
        return np.isfinite(self.root_m).all(axis=1)

    def pose(self, frame: int) -> Pose:
        """Of a frame in which he was found."""
        return Pose(self.rotations[frame], self.root_m[frame])


def make_reference(recording: Recording, config: TrackConfig) -> Reference:
    """Track the recording as it is. Raises NoReference where nobody is found, InputError where no world is."""
    room = prepare_room(recording, config)
    run = Run(room, config, load_motions(config.motion_file, recording.rate_hz, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    if learnt is None:
        raise NoReference(f"{recording.folder.name}: nobody was found in it, so that no method can start.")
    body = build_body(body_points(), learnt.shape)
    frames, bones = len(recording.streams[0].files), len(body.points.asset.bone_names)
    rotations, root = np.full((frames, bones, 3, 3), np.nan), np.full((frames, 3), np.nan)
    joints, centre = np.full((frames, 21, 3), np.nan), np.full((frames, 3), np.nan)
    for side in (route.backward, route.forward):
        estimates = follow_patient(run, route.frames(side), learnt.shape)
        for position, estimate in zip(side, estimates, strict=True):
            if estimate.belief is None or estimate.observation is None or len(estimate.observation.surface) == 0:
                continue
            pose = estimate.belief.pose
            rotations[position], root[position] = pose.rotations, pose.root_m
            joints[position] = body.joints(pose)
            centre[position] = estimate.observation.surface.points_m.mean(axis=0, dtype=np.float64)
    poses = np.array([camera.require_pose() for camera in room.cameras])
    return Reference(poses, learnt.shape, rotations, root, joints, centre)


def in_its_world(recording: Recording, reference: Reference) -> Recording:
    """The recording, or a copy of it with holes, with the reference's camera poses as if they had been given."""
    cameras = tuple(
        replace(camera, T_world_camera=T) for camera, T in zip(recording.cameras, reference.T_world_camera, strict=True)
    )
    return replace(recording, cameras=cameras)


def to_arrays(reference: Reference) -> dict[str, np.ndarray]:
    """The reference as arrays, for a file."""
    return {
        "T_world_camera": reference.T_world_camera,
        "coefficients": reference.shape.coefficients,
        "clothing_m": np.array(reference.shape.clothing_m),
        "rotations": reference.rotations,
        "root_m": reference.root_m,
        "joints_m": reference.joints_m,
        "centre_m": reference.centre_m,
    }


def from_arrays(arrays: Mapping[str, np.ndarray]) -> Reference:
    """The reference that ``to_arrays`` took apart."""
    shape = FittedShape(arrays["coefficients"], float(arrays["clothing_m"]))
    names = ("rotations", "root_m", "joints_m", "centre_m")
    return Reference(arrays["T_world_camera"], shape, *(arrays[name] for name in names))
