"""A real body that no model drew: python benchmarks/foreign_body.py CAPTURED.npz --results RESULTS.

CAPTURED.npz: a person's captured surface, the same vertices in every frame: ``vertices_tenth_mm`` (t, v, 3) int16, X
the way the person faces, Y up, and ``faces`` (f, 3) wound outwards. It is drawn by the simulator's camera and sensor in
an empty room, by one camera in front and by three, at an assumed rate; the cameras' poses are given. The recordings are
tracked, and the learnt body is posed as poses.parquet says. Each row is a part of it that no skirt covers: how far its
skin in view of a camera lies from the nearest place of the captured surface (median, 95 %, share within 12 mm, and the
median with a sign, positive outside), and how much of it is nearest to another limb or the trunk.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np
from true_body import TrueBody

from anchorpose import pipeline
from anchorpose.body.segments import load_body_asset
from anchorpose.body.skin_points import Body, FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.body.visibility import GRAZING, pixels_of, projection_of
from anchorpose.camera import Camera
from anchorpose.recording.recording_file import camera_document
from anchorpose.results.poses import POSES_FILE, pose_of, read_poses
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.simulate.clinic import draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import PATIENT, Figure, draw_figures, render_still
from anchorpose.simulate.shoot import Studio, set_up

SEED: Final = 71000  # of the room, the cameras' places and the sensors' noise
NEAR_M: Final = 0.012
SAME_SKIN_M: Final = 0.015  # behind the body's own depth: the inside of the mouth lies deeper
LEARNT_FILE: Final = "learnt.npz"  # run.json lacks how far the patches of skin stand off
HEADER: Final = (
    "| part | n | median mm | 95 % mm | within 12 mm % | signed mm | on another limb % |\n|---|--:|--:|--:|--:|--:|--:|"
)
BARE: Final = {
    "head": ("Head",), "upper arms": ("LeftArm", "RightArm"), "forearms": ("LeftForeArm", "RightForeArm"),
    "hands": ("LeftHand", "LeftFingerBase", "LeftHandFinger1", "LThumb",
              "RightHand", "RightFingerBase", "RightHandFinger1", "RThumb"),
    "shanks": ("LeftLeg", "RightLeg"), "feet": ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase"),
}  # fmt: skip
"""The bones whose skin is measured: the skirt hangs from the trunk over hips and thighs."""


@dataclass(frozen=True, slots=True, eq=False)
class Captured:
    """A captured surface: skin_m (t, v, 3) float32 in the world, the lowest vertex on the floor; faces (f, 3)."""

    skin_m: np.ndarray
    faces: np.ndarray

    def figure(self, frame: int) -> Figure:
        """The person to draw; no part is known."""
        return Figure(self.skin_m[frame], self.faces, np.zeros(len(self.faces), np.uint8), PATIENT)


def read_captured(path: Path) -> Captured:
    """The person's mean place is the room's middle."""
    with np.load(path) as stored:
        skin_m, faces = stored["vertices_tenth_mm"] * np.float32(1e-4), stored["faces"].astype(np.int32)
    middle = skin_m.mean(axis=(0, 1))
    return Captured(skin_m - np.float32([middle[0], skin_m[..., 1].min(), middle[2]]), faces)


def studio_of(captured: Captured, cameras: int, rate_hz: float) -> Studio:
    """The simulator's empty room and cameras; the person whom it would have drawn stays out."""
    seconds = len(captured.skin_m) / rate_hz
    return set_up(draw_clinic(SimulationConfig(
        seed=SEED, seconds=seconds, fps=rate_hz, cameras=cameras, equipment="none", stool=False, therapists=0
    )))  # fmt: skip


def record(captured: Captured, studio: Studio, folder: Path) -> None:
    """Write a recording folder."""
    import cv2

    cameras, config = studio.clinic.cameras, studio.clinic.config
    for index, camera in enumerate(cameras):
        (folder / camera.name / "depth").mkdir(parents=True)
        cv2.imwrite(str(folder / camera.name / "background.png"), studio.background_mm(index))
        stamps = "".join(f"{frame},{frame / config.fps:.6f}\n" for frame in range(config.frames))
        (folder / camera.name / "timestamps.csv").write_text(f"frame,time_s\n{stamps}")
        for frame in range(config.frames):
            image = draw_figures(camera, studio.stills[index], (captured.figure(frame),))
            depth_mm = studio.readers[index].raw_mm(random_stream(config, "sensor", index, frame), image)
            cv2.imwrite(str(folder / camera.name / "depth" / f"{frame:06d}.png"), depth_mm)
    document = {"format": "rgbd-recording", "version": 1, "cameras": [camera_document(camera) for camera in cameras]}
    (folder / "recording.json").write_text(json.dumps({**document, "equipment": None}))


def track(recording: Path, results: Path) -> None:
    """Track, and keep the learnt shape beside the results."""
    results.mkdir(parents=True)

    def write_all(folder: Path, frames: Any, run: Any, learnt: Any, inputs: Any) -> None:
        write(folder, frames, run, learnt, inputs)
        if learnt is not None:
            shape = learnt.shape
            np.savez(results / LEARNT_FILE, coefficients=shape.coefficients, offset_m=shape.offset_m)

    write = pipeline.write_results
    with mock.patch.object(pipeline, "write_results", write_all):
        pipeline.track_recording(recording, results, pipeline.TrackConfig(), lambda done, total: None)


def learnt_body(results: Path) -> Body:
    """The body that was tracked, dressed as learnt."""
    with np.load(results / LEARNT_FILE) as stored:
        return build_body(body_points(), FittedShape(stored["coefficients"], stored["offset_m"]))


def limbs_of_captured(captured: Captured) -> np.ndarray:
    """(v,) the limb of each vertex, numbers as in ``limb_of_bare``, 0 for trunk and skirt: frame 0 of samba.npz, in
    which the person stands upright, arms off the body, with a hem 0.45 m above the floor and a neck 1.45 m."""
    _, height, right = captured.skin_m[0].T
    right = right - np.median(right)
    arm = (height > 0.7) & (np.abs(right) > 0.15 + 0.2 * np.maximum(1.25 - height, 0.0))
    return np.select([height > 1.45, arm, height < 0.45], [1, np.where(right < 0, 2, 3), np.where(right < 0, 4, 5)])


def limb_of_bare(part: np.ndarray) -> np.ndarray:
    """(n,) 1 head, 2 and 3 left and right arm, 4 and 5 left and right leg, of the bone of each point."""
    names = np.array(load_body_asset().bone_names)[part]
    leg = np.isin(names, [*BARE["shanks"], *BARE["feet"]])
    left = np.char.startswith(names, "L")
    return np.where(names == "Head", 1, np.where(leg, 4, 2) + ~left)


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Skin points in view of a camera, of all frames: frame, point (n,); away_m (n,), negative inside the captured
    surface; elsewhere (n,) bool: the nearest place of it is on another limb or the trunk."""

    frame: np.ndarray
    point: np.ndarray
    away_m: np.ndarray
    elsewhere: np.ndarray


def in_view(body: Body, posed: PosedPoints, cameras: Sequence[Camera]) -> np.ndarray:
    """(p,) bool: skin points that face some camera and that no skin of the same posed body hides from it."""
    seen, none = np.zeros(len(posed.points_m), dtype=bool), np.zeros((0, 3, 3))
    skin_m, faces = body.mesh.skin(posed.transforms).astype(np.float32), body.points.asset.faces.astype(np.int32)
    figure = Figure(skin_m, faces, np.zeros(len(faces), np.uint8), PATIENT)
    for camera in cameras:
        towards = camera.position_m - posed.points_m
        facing = (towards * posed.normals).sum(axis=1) > GRAZING * np.linalg.norm(towards, axis=1)
        depth_m = draw_figures(camera, render_still(camera, none, none), (figure,)).depth_m
        column, row, far_m = pixels_of(posed.points_m, projection_of(camera), *depth_m.shape)
        seen |= facing & (column >= 0) & (far_m < depth_m[row, column] + SAME_SKIN_M)
    return seen


def measure(captured: Captured, studio: Studio, results: Path) -> Skin:
    """How far the learnt body's skin is from the captured surface, in every frame that is not lost."""
    body, table, limb = learnt_body(results), read_poses(results / POSES_FILE), limbs_of_captured(captured)
    asset = load_body_asset()
    surface = TrueBody(captured.skin_m[0], replace(asset, faces=captured.faces))
    bare = np.isin(body.points.part, [asset.bone(name) for names in BARE.values() for name in names])
    rows = []
    for frame, head_m, quaternion in zip(table.frame, table.head_m, table.quaternion, strict=True):
        if not np.isfinite(head_m).all():
            continue
        posed = pose_points(body, pose_of(asset, head_m, quaternion))
        chosen = np.flatnonzero(bare & in_view(body, posed, studio.clinic.cameras))
        surface.move(captured.skin_m[frame])
        face, share, away_m = surface.project(posed.points_m[chosen])
        corners = surface.vertices[surface.faces[face]]
        outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        step = posed.points_m[chosen] - np.einsum("nk,nkx->nx", share, corners)
        sign = np.where((step * outwards).sum(axis=1) < 0.0, -1.0, 1.0)
        nearest = surface.faces[face, share.argmax(axis=1)]
        elsewhere = limb[nearest] != limb_of_bare(body.points.part[chosen])
        rows.append((np.full(len(chosen), frame), chosen, sign * away_m, elsewhere))
    return Skin(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def report(skin: Skin, results: Path) -> str:
    """One line per part, and what the tool says of the recording."""
    points, lines = body_points(), []
    for name, bones in {**BARE, "all": tuple(bone for names in BARE.values() for bone in names)}.items():
        mine = np.isin(points.part[skin.point], [points.asset.bone(bone) for bone in bones])
        away = 1000 * np.abs(skin.away_m[mine])
        middle, high = np.percentile(away, [50, 95])
        near, sign = 100 * (away < 1000 * NEAR_M).mean(), 1000 * np.median(skin.away_m[mine])
        other = 100 * skin.elsewhere[mine].mean()
        lines.append(f"| {name} | {mine.sum()} | {middle:.1f} | {high:.1f} | {near:.0f} | {sign:+.1f} | {other:.1f} |")
    run, joints = json.loads((results / RUN_FILE).read_text()), read_joints(results / JOINTS_FILE)
    lost = joints.lost
    lines += [
        f"frames: {len(lost)}, lost {lost.all(axis=1).sum()}; joints lost in the others: "
        f"{100 * lost[~lost.all(axis=1)].mean():.2f} %",
        f"explained: {json.dumps(run['explained'])}",
        f"body: {json.dumps(run['body'])}",
        *run["notes"],
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captured", type=Path)
    parser.add_argument("--results", type=Path, required=True, help="for recordings and results, kept if there")
    parser.add_argument("--cameras", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--rate", type=float, default=30.0, help="frames per second; the file does not state it")
    chosen = parser.parse_args()
    captured = read_captured(chosen.captured)
    for cameras in chosen.cameras:
        folder = chosen.results / f"{cameras}-cameras"
        studio = studio_of(captured, cameras, chosen.rate)
        if not (folder / "recording" / "recording.json").exists():
            record(captured, studio, folder / "recording")
        if not (folder / "results" / RUN_FILE).exists():
            track(folder / "recording", folder / "results")
        print(f"\n{cameras} camera(s)\n{HEADER}")
        print(report(measure(captured, studio, folder / "results"), folder / "results"))


if __name__ == "__main__":
    main()
