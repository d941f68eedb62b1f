"""A recording put on one clock, and what people should know of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anchorpose.calibration.clock.clocks import (
    CameraClock,
    ClockConfig,
    Clocks,
    NoClock,
    estimate_clocks,
    pose_level,
)
from anchorpose.calibration.clock.motion_signal import Level
from anchorpose.calibration.floor import FloorConfig, FloorPlane, find_floor
from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import Camera
from anchorpose.recording.depth_image import RecordedFootage
from anchorpose.recording.recording import Recording, put_clocks_together

FLOOR_PICTURES = 9  # of a camera without a picture of the empty room: their median has few people in it


def settle_clocks(
    recording: Recording, cameras: Sequence[Camera], floor: FloorConfig, config: ClockConfig
) -> tuple[Recording, Clocks]:
    """``recording``, its own clocks untouched so far, with all times on the first camera's clock.

    cameras: as in the recording, with the poses that are known by now: with poses the clocks come out sharper, so
    where poses are found this is called before and after. A clock that cannot be told is left as it is.
    """
    footage = RecordedFootage(recording, tuple(cameras))
    wanted = config.estimate and len(cameras) > 1
    levels = [_level(footage, index, floor) if wanted else None for index in range(len(cameras))]
    clocks = estimate_clocks(footage, levels, config)
    return put_clocks_together(recording, clocks.clocks), clocks


def clock_notes(clocks: Clocks) -> tuple[str, ...]:
    """One sentence a camera but the first; none where the clocks were not asked for."""
    first = clocks.cameras[0].camera
    return tuple(_sentence(found, first) for found in clocks.cameras[1:] if found.doubt is not NoClock.SWITCHED_OFF)


def _sentence(found: CameraClock, first: str) -> str:
    if found.doubt is not None:
        return f"the clock of camera {found.camera} was taken as it stands: {found.doubt.value}"
    ahead = f"{abs(found.clock.ahead_s):.4f} s {'ahead of' if found.clock.ahead_s > 0 else 'behind'}"
    sigma = f"± {found.sigma_s:.4f} s"
    drift = ""
    if found.drift_sigma is not None and abs(found.clock.drift) > 2.0 * found.drift_sigma:
        drift = f", drifts by {1e6 * found.clock.drift:.0f} parts in a million"
    return f"the clock of camera {found.camera} was {ahead} that of {first} ({sigma}{drift}), and was corrected"


def _level(footage: RecordedFootage, index: int, config: FloorConfig) -> Level | None:
    """Heights by the camera's pose or by the floor it sees; None without either."""
    camera, recording = footage.cameras[index], footage.recording
    if camera.T_world_camera is not None:
        return pose_level(camera)
    room = recording.backgrounds_m[index]
    if room is None:
        positions = np.linspace(0, len(footage.times_s[index]) - 1, FLOOR_PICTURES).astype(int)
        seen = [depth for k in np.unique(positions) if (depth := footage.read(index, int(k))) is not None]
        if not seen:
            return None
        room = np.median(np.stack(seen), axis=0).astype(np.float32)
    try:
        plane = find_floor(room, camera, noise_per_m([room]), config)
    except ValueError:  # no three neighbouring pixels have a reading
        return None
    return Level(plane.up, plane.height_m) if isinstance(plane, FloorPlane) else None
