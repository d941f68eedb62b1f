"""Identify what a reviewer's corrections are about: the recording by a hash of its images and times, and the world
frame of their positions by the camera poses.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field

from anchorpose.recording.document import Text
from anchorpose.recording.recording import Clock
from anchorpose.recording.recording_file import FARTHEST_CAMERA_M, FARTHEST_TIME_S, CameraPose
from anchorpose.settings import STRICT, Unfit

LARGEST_DRIFT: Final = 0.1
"""Maximum drift of a camera's clock in seconds per second; real clocks drift by a thousandth at most."""


def _require_clock(clock: Clock) -> Clock:
    if abs(clock.drift) > LARGEST_DRIFT or max(abs(clock.ahead_s), abs(clock.at_s)) > FARTHEST_TIME_S:
        raise Unfit("is not a clock of a camera", f"write seconds, and a drift of at most {LARGEST_DRIFT:g}")
    return clock


CameraClock = Annotated[Clock, AfterValidator(_require_clock)]
_Height = Annotated[
    float, Field(ge=-FARTHEST_CAMERA_M, le=FARTHEST_CAMERA_M, description="metres, along the world's Y")
]


@dataclass(frozen=True, slots=True, eq=False)
class ReviewedCamera:
    """A camera of the recording. camera_to_world: its pose (4, 4), None for a camera without a pose, which was not
    used. clock: its clock, None if unknown.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    name: Text
    camera_to_world: CameraPose | None = None
    clock: CameraClock | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ReviewedRecording:
    """The recording, and its world frame, to which corrections refer. The recording is identified by a hash of its
    depth images and times (its name is for people), the world frame by the camera poses.

    The clocks and the height of the floor that tracking used (None if unknown) are stored too, so that they need not be
    estimated again.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    name: Text
    sha256: Text
    cameras: tuple[ReviewedCamera, ...]
    floor_height_m: _Height | None = None

    @property
    def poses(self) -> dict[str, np.ndarray | None]:
        """Return T_world_camera (4, 4) by camera name."""
        return {camera.name: camera.camera_to_world for camera in self.cameras}

    @property
    def clocks(self) -> dict[str, Clock]:
        """Return the known clocks, by camera name."""
        return {camera.name: camera.clock for camera in self.cameras if camera.clock is not None}


def reviewed_recording(
    name: str,
    inputs_sha256: Iterable[tuple[str, str]],
    cameras: Iterable[ReviewedCamera],
    floor_height_m: float | None = None,
) -> ReviewedRecording:
    """Describe a recording. inputs_sha256: path in the recording folder and hash of each file, as in run.json.

    Only depth images and times affect the hash. It stays the same if, for example, the patient's height is added to
    recording.json.
    """
    lines = sorted(
        f"{path} {digest}\n"
        for path, digest in inputs_sha256
        if path.endswith("/timestamps.csv") or path.split("/")[-2:-1] == ["depth"]
    )
    whole = hashlib.sha256("".join(lines).encode()).hexdigest()
    return ReviewedRecording(name, whole, tuple(cameras), floor_height_m)


def recording_of_run(run: dict[str, Any]) -> ReviewedRecording:
    """Return the recording that a run.json (``read_run``) describes."""
    cameras = [
        ReviewedCamera(
            camera["name"],
            None if camera["camera_to_world"] is None else np.array(camera["camera_to_world"]),
            Clock(**camera["clock"]) if camera.get("clock") else None,
        )
        for camera in run["cameras"]
    ]
    floor_m = run.get("floor_height_m")  # run.json of older versions lacks this entry
    return reviewed_recording(run["recording"], run["inputs_sha256"].items(), cameras, floor_m)


def same_world(a: dict[str, np.ndarray | None], b: dict[str, np.ndarray | None]) -> bool:
    """Return whether two sets of camera poses, (4, 4) by name, are the same except for rounding."""
    nowhere = np.full((4, 4), np.nan)
    first, second = ([nowhere if pose is None else pose for _, pose in sorted(poses.items())] for poses in (a, b))
    pairs = zip(first, second, strict=False)
    same = (np.allclose(one, other, rtol=0, atol=SAME_WORLD_M, equal_nan=True) for one, other in pairs)
    return a.keys() == b.keys() and all(same)


SAME_WORLD_M: Final = 0.001
"""Maximum difference between corresponding elements of the cameras' pose matrices for two worlds to count as the same.
At 1 m from the camera, such a difference moves a joint by one or two millimetres, less than the error of placing a
joint by hand.
"""
