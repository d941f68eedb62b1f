"""How well cameras without poses and without equipment are placed: python benchmarks/camera_to_camera.py --seeds 6.

One minute of a simulated clinic, three cameras, of which only depth frames are given; each seed is another patient,
other therapists, other places of the cameras. Only the moments that are used are rendered. ``--clock-error`` sets
the other cameras' clocks wrong by so much, as the first estimate of the clocks may be.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from lazy_clinic import lazy_clinic

from anchorpose.calibration.camera_to_camera import CameraToCamera, PlacingConfig, place_cameras
from anchorpose.calibration.floor import FloorPlane, find_floor
from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import invert_rigid
from anchorpose.recording.recording import FrameSet
from anchorpose.simulate import config as presets


def errors(found: CameraToCamera, T_world_cameras: list[np.ndarray]) -> list[tuple[float, float]]:
    """Millimetres and degrees of each camera but the first."""
    off = []
    for camera, T_first_camera in enumerate(found.T_first_camera[1:], start=1):
        true = invert_rigid(T_world_cameras[0]) @ T_world_cameras[camera]
        difference = invert_rigid(true) @ T_first_camera
        turn = np.arccos(np.clip((np.trace(difference[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
        off.append((1000.0 * float(np.linalg.norm(difference[:3, 3])), float(np.degrees(turn))))
    return off


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first-seed", type=int, default=601)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--clock-error", type=float, default=0.0, help="seconds")
    chosen = parser.parse_args()
    config = PlacingConfig()
    print("| seed | placed | errors mm | errors degrees | s |\n|---|---|---|---|--:|", flush=True)
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        clinic = presets.clinic(seed, chosen.seconds, 30.0)
        footage = lazy_clinic(replace(clinic, clock_late_s=(0.0, chosen.clock_error, -chosen.clock_error)))
        cameras = [replace(camera, T_world_camera=None) for camera in footage.cameras]
        numbers = np.linspace(0, clinic.frames - 1, config.moments).astype(int).tolist()
        frames = [
            FrameSet(frame=k, time_s=k / 30.0, depths_m=tuple(footage.read(c, k) for c in range(3))) for k in numbers
        ]
        start = time.perf_counter()
        floors = [
            find_floor(room, camera, noise_per_m([room]))
            for room, camera in zip(footage.backgrounds_m, cameras, strict=True)
        ]
        if not all(isinstance(floor, FloorPlane) for floor in floors):
            print(f"| {seed} | no floor | | | |", flush=True)
            continue
        found = place_cameras(cameras, floors, footage.backgrounds_m, frames, config)
        elapsed = time.perf_counter() - start
        if isinstance(found, CameraToCamera):
            off = errors(found, [camera.require_pose() for camera in footage.cameras])
            cells = [", ".join(f"{pair[k]:.{k + 1}f}" for pair in off) for k in (0, 1)]
            print(f"| {seed} | yes | {cells[0]} | {cells[1]} | {elapsed:.0f} |", flush=True)
        else:
            print(f"| {seed} | no: {found.value} | | | {elapsed:.0f} |", flush=True)


if __name__ == "__main__":
    main()
