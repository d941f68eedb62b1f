"""Which recording, and which world, corrections are about."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.camera import Camera

SAME_WORLD_M: Final = 0.001
"""Camera poses closer than this, in every number of the matrix, are of the same world: a metre away from the camera
a joint then moves by a millimetre or two, less than any hand places it to."""


@dataclass(frozen=True, slots=True, eq=False)
class ReviewedRecording:
    """What corrections are about: a name for people, a hash of pictures and times, and the world by its cameras.

    T_world_camera: (4, 4) by name; None for a camera that was not used for want of a pose.
    """

    name: str
    sha256: str
    T_world_camera: dict[str, np.ndarray | None]


def reviewed_recording(
    name: str, inputs_sha256: Iterable[tuple[str, str]], T_world_camera: dict[str, np.ndarray | None]
) -> ReviewedRecording:
    """inputs_sha256: (path in the recording folder, hash) as in run.json.

    The hash is that of pictures and times only: a height added to recording.json makes no other recording of it.
    """
    lines = sorted(
        f"{path} {digest}\n"
        for path, digest in inputs_sha256
        if path.endswith("/timestamps.csv") or Path(path).parent.name == "depth"
    )
    return ReviewedRecording(name, hashlib.sha256("".join(lines).encode()).hexdigest(), T_world_camera)


def recording_of_run(run: dict[str, Any]) -> ReviewedRecording:
    """The recording and the world that a run.json tells of (``read_run_document``)."""
    poses = {
        camera["name"]: None if camera["camera_to_world"] is None else np.array(camera["camera_to_world"])
        for camera in run["cameras"]
    }
    return reviewed_recording(run["recording"], run["inputs_sha256"].items(), poses)


def poses_of(cameras: Iterable[Camera]) -> dict[str, np.ndarray | None]:
    """T_world_camera by name, for ``reviewed_recording``."""
    return {camera.name: camera.T_world_camera for camera in cameras}


def same_world(a: dict[str, np.ndarray | None], b: dict[str, np.ndarray | None]) -> bool:
    """Whether two sets of camera poses, (4, 4) by name, are the same but for rounding."""
    if a.keys() != b.keys():
        return False
    for name, pose in a.items():
        other = b[name]
        if pose is None or other is None:
            if pose is not other:
                return False
        elif not np.allclose(pose, other, rtol=0, atol=SAME_WORLD_M):
            return False
    return True
