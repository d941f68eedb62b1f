"""What cameras see past each other: python benchmarks/camera_agreement.py --clinics 12 --first-seed 61000.

Where too little of the people is in common view, this decides whether "cameras agree" (``check`` and ``track``).
Simulated clinics of different cameras and equipment, with right poses and with one camera off by a known amount:
towards the patient, to its side, up, or turned about the vertical (yaw), the horizontal across its view (pitch) or its
view (roll). For each, the table has in how many clinics the finding is green, yellow and red, and the shares seen past.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.camera import invert_rigid, transform_points
from anchorpose.check.finding import Level
from anchorpose.isolation.empty_room import learn_background
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces, set_scene
from anchorpose.recording.reader import open_recording
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.given_poses import CameraPair, SeenPast, doubt_of, seen_past
from anchorpose.tracker.preparation import settle

SENSORS: Final[tuple[presets.Sensor, ...]] = (
    "kinect-v2", "femto-bolt", "realsense", "kinect-v2", "azure-kinect", "xtion",
    "kinect-v2", "d435", "kinect-v2", "realsense-filtered", "kinect-v2", "iphone-lidar",
)  # fmt: skip
EQUIPMENT: Final[tuple[presets.Equipment, ...]] = (
    "standing-frame", "parallel-bars", "standing-frame", "none", "none", "parallel-bars",
    "walker", "standing-frame", "wheelchair", "none", "none", "standing-frame",
)  # fmt: skip
MIXED: Final[tuple[presets.Sensor, ...]] = ("femto-bolt", "realsense", "kinect-v2")
MOVED: Final = 1  # the camera that is off
SHIFTS_M, TURNS_DEG = (0.01, 0.02, 0.05, 0.20), (1.0, 3.0, 5.0)


def clinic(seed: int, number: int) -> presets.SimulationConfig:
    """Other cameras, equipment and therapists for each of twelve; in two the cameras are of different models."""
    kind = number % len(SENSORS)
    config = replace(presets.clinic(seed, 6.0, fps=3.0), sensor=SENSORS[kind], equipment=EQUIPMENT[kind])
    config = replace(config, therapists=number % 3, stool=number % 2 == 0)
    return replace(config, sensors=MIXED) if kind in (1, 6) else config


def poses(T_world_camera: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """The right one and wrong ones, (4, 4) each, with their names."""
    yield "right", T_world_camera
    up = np.array([0.0, 1.0, 0.0])
    view = T_world_camera[:3, 2] * [1.0, 0.0, 1.0]
    view /= np.linalg.norm(view)
    side = np.cross(up, view)
    for shift_m in SHIFTS_M:
        for name, along in (("towards", view), ("sideways", side), ("up", up)):
            wrong = T_world_camera.copy()
            wrong[:3, 3] += shift_m * along
            yield f"{100 * shift_m:.0f} cm {name}", wrong
    for turn_deg in TURNS_DEG:
        for name, axis in (("yaw", up), ("pitch", side), ("roll", view)):
            wrong = T_world_camera.copy()
            wrong[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg) * axis).as_matrix() @ wrong[:3, :3]
            yield f"{turn_deg:.0f} degrees {name}", wrong


def with_pose(
    scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]], T_world_camera: np.ndarray
) -> tuple[list[Scene], list[list[Pieces | None]]]:
    """The same frames with the moved camera at another place."""
    camera = scenes[MOVED].camera
    T_new_old = T_world_camera @ invert_rigid(camera.require_pose())
    moved = list(scenes)
    moved[MOVED] = replace(scenes[MOVED], camera=replace(camera, T_world_camera=T_world_camera))
    shifted = [
        [
            replace(one, points_m=transform_points(T_new_old, one.points_m)) if index == MOVED and one else one
            for index, one in enumerate(moment)
        ]
        for moment in moments
    ]
    return moved, shifted


def empty_rooms_and_people(recording: Path) -> tuple[list[Scene], list[list[Pieces | None]]]:
    """As the check has them."""
    settled = settle(open_recording(recording), TrackConfig())
    equipment, floor_m = settled.recording.equipment, settled.calibration.floor_height_m
    scenes = []
    for index, (camera, room_m) in enumerate(
        zip(settled.calibration.cameras, settled.recording.backgrounds_m, strict=True)
    ):
        frames = [depth for sample in settled.samples if (depth := sample.depths_m[index]) is not None]
        scenes.append(set_scene(camera, learn_background(room_m, frames, camera, floor_m, equipment), equipment))
    return scenes, [find_all_pieces(sample, scenes) for sample in settled.samples[::2]]


def measure(seed: int, number: int) -> dict[str, list[SeenPast]]:
    """The pairs with the moved camera of one clinic, for each of ``poses``."""
    with TemporaryDirectory() as folder, one_thread():
        simulate_recording(Path(folder) / "s", clinic(seed, number))
        scenes, moments = empty_rooms_and_people(Path(folder) / "s" / "recording")
    name = scenes[MOVED].camera.name
    found = {}
    for what, T_world_camera in poses(scenes[MOVED].camera.require_pose()):
        pairs = seen_past(*with_pose(scenes, moments, T_world_camera))
        found[what] = [pair for pair in pairs if name in pair.cameras]
    return found


def row(what: str, clinics: Sequence[Sequence[SeenPast]]) -> str:
    """One line of the table."""
    levels = [max(level_of(pair) for pair in pairs) for pairs in clinics]
    counts = " / ".join(str(levels.count(level)) for level in Level)
    rooms, people = ([[getattr(pair, of) for pair in pairs] for pairs in clinics] for of in ("of_room", "of_people"))
    return f"| {what} | {counts} | {_range(rooms)} | {_range(people)} |"


def level_of(pair: SeenPast) -> Level:
    """As ``anchorpose check`` says it where nothing else is known, and the clocks are."""
    doubt = doubt_of(CameraPair(pair, None), clocks_known=True)
    return Level.GREEN if doubt is None else Level.RED if doubt.refuted else Level.YELLOW


def _range(shares: Sequence[Sequence[float]]) -> str:
    worst = [float(np.nanmax(one)) for one in shares if np.isfinite(one).any()]
    return f"{100 * min(worst):.0f} to {100 * max(worst):.0f}" if worst else "–"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clinics", type=int, default=12)
    parser.add_argument("--first-seed", type=int, default=61000)
    chosen = parser.parse_args()
    found = []
    for number in range(chosen.clinics):
        found.append(measure(chosen.first_seed + number, number))
        print(f"clinic {number} with right poses: {found[-1]['right']}", file=sys.stderr)
    print("| camera off by | green / yellow / red | % of the room seen past | % of the people |\n|---|--:|--:|--:|")
    print("\n".join(row(what, [one[what] for one in found]) for what in found[0]))


if __name__ == "__main__":
    main()
