"""Draw moments of tracked simulated recordings: draw_moments.py OUT.webp --moment SIMULATED RESULTS FRAME ...

Each moment is a row, each camera a picture: the person labels, the joints found (filled: observed) with circles of two
sigmas, and the true joints as thin green lines. Where the joints that are furthest from the truth are, is in the title.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera
from anchorpose.joints import JOINT_NAMES, LIMBS, JointState
from anchorpose.pages.canvas import Ink, projector, scale_of, whole, write
from anchorpose.pages.overlay import OverlayScene, draw_scene
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.results.records import PEOPLE_FILE, decode_labels, read_people
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.results.truth import read_truth
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import prepare_room

STATES: Final = tuple(JointState)
HALF_M: Final = 1.15  # of a picture's side: a person with raised arms
SIDE_PX: Final = 300
NAMED: Final = 3  # joints in the title
WEBP_QUALITY: Final = 80


def draw_moment(simulated: Path, results: Path, frame: int) -> np.ndarray:
    """One row: what each camera shows of a frame."""
    recording = open_recording(simulated / "recording")
    joints, truth = read_joints(results / JOINTS_FILE), read_truth(simulated / "truth" / "truth.npz")
    row = int(np.flatnonzero(joints.frame == frame)[0])
    found_m, true_m = joints.position_m[row], truth.position_m[frame]
    position = int(np.flatnonzero(recording.streams[0].frame == frame)[0])
    depths, people = read_frame(recording, position).depths_m, read_people(results / PEOPLE_FILE, [frame])
    pictures = []
    for camera, depth_m in zip(prepare_room(recording, TrackConfig()).cameras, depths, strict=True):
        labels = people.get((frame, camera.name))
        if depth_m is None or labels is None:
            continue
        scene = OverlayScene(
            camera=camera,
            depth_m=depth_m,
            labels=decode_labels(labels),
            joints_m=found_m,
            joint_states=tuple(STATES[code] for code in joints.state_code[row]),
            sigma_m=joints.sigma_m[row],
        )
        pictures.append(_cut_out(_with_truth(draw_scene(scene), camera, true_m), camera, true_m))
    strip = np.hstack(pictures)
    write(strip, _title(simulated.name, frame, found_m, true_m), (4, 14))
    return strip


def _with_truth(picture: np.ndarray, camera: Camera, true_m: np.ndarray) -> np.ndarray:
    pixels = projector(camera, scale_of(camera))(true_m)
    for start, end in LIMBS:
        if np.isfinite(pixels[[start, end]]).all():
            cv2.line(picture, whole(pixels[start]), whole(pixels[end]), Ink.GREEN, 2, cv2.LINE_AA)
    return picture


def _cut_out(picture: np.ndarray, camera: Camera, true_m: np.ndarray) -> np.ndarray:
    """A square about the patient, of the same size for every camera."""
    middle_m = (true_m.min(axis=0) + true_m.max(axis=0)) / 2.0
    scale = scale_of(camera)
    x, y = whole(projector(camera, scale)(middle_m[None])[0])
    half = round(HALF_M * camera.intrinsics.fx * scale / float(np.linalg.norm(middle_m - camera.position_m)))
    padded = cv2.copyMakeBorder(picture, half, half, half, half, cv2.BORDER_CONSTANT, value=(255, 255, 255))
    square = padded[max(y, 0) : max(y, 0) + 2 * half, max(x, 0) : max(x, 0) + 2 * half]
    return cv2.resize(square, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)


def _title(name: str, frame: int, found_m: np.ndarray, true_m: np.ndarray) -> str:
    off_m = np.nan_to_num(np.linalg.norm(found_m - true_m, axis=1))
    worst = [f"{JOINT_NAMES[joint]} {100 * off_m[joint]:.0f} cm" for joint in np.argsort(-off_m)[:NAMED]]
    return f"{name}, frame {frame}: {', '.join(worst)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--moment", nargs=3, action="append", metavar=("SIMULATED", "RESULTS", "FRAME"), required=True)
    options = parser.parse_args()
    rows = [draw_moment(Path(simulated), Path(results), int(frame)) for simulated, results, frame in options.moment]
    width = max(row.shape[1] for row in rows)
    sheet = np.vstack(
        [
            cv2.copyMakeBorder(row, 0, 4, 0, width - row.shape[1], cv2.BORDER_CONSTANT, value=(255, 255, 255))
            for row in rows
        ]
    )
    cv2.imwrite(str(options.out), sheet, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])


if __name__ == "__main__":
    main()
