"""Pictures of chosen frames for the report, drawn from the tables and the recording once everything is tracked."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.camera import Camera
from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JointState
from anchorpose.recording.reader import read_frames
from anchorpose.results.anchors_table import ANCHORS_FILE, AnchorTable, read_anchors
from anchorpose.results.chosen_frames import ChosenFrame, choose_frames
from anchorpose.results.episodes import EPISODES_FILE, read_episodes
from anchorpose.results.overlay import OverlayScene, draw_frame
from anchorpose.results.people_labels import PEOPLE_FILE, LabelPicture, frames_of_people, read_people, read_picture
from anchorpose.results.pictures import FramePicture
from anchorpose.results.poses import POSES_FILE, PoseTable, pose_of, read_poses
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.surface.mesh import SheetConfig, build_surface, edges
from anchorpose.tracker.room import Room

_STATES = tuple(JointState)


def draw_chosen(results: Path, room: Room, shape: FittedShape | None, sheet: SheetConfig) -> Iterator[FramePicture]:
    """A picture of each camera in each frame of ``choose_frames``; none without a body, or where nobody was told apart.

    results: a folder with all tables; sheet: how a camera's mesh is made.
    """
    if shape is None:
        return
    joints, poses, anchors = (
        read_joints(results / JOINTS_FILE), read_poses(results / POSES_FILE), read_anchors(results / ANCHORS_FILE)
    )  # fmt: skip
    told_apart = np.isin(joints.frame, frames_of_people(results / PEOPLE_FILE))
    chosen = choose_frames(joints, read_episodes(results / EPISODES_FILE), told_apart)
    people = read_people(results / PEOPLE_FILE, [int(joints.frame[frame.row]) for frame in chosen])
    for frame in chosen:
        yield from _draw(frame, room, shape, sheet, joints, poses, anchors, people)


def _draw(
    frame: ChosenFrame, room: Room, shape: FittedShape, sheet: SheetConfig, joints: JointTable, poses: PoseTable,
    anchors: AnchorTable, people: dict[tuple[int, str], LabelPicture],
) -> Iterator[FramePicture]:  # fmt: skip
    row, number = frame.row, int(joints.frame[frame.row])
    position = int(np.flatnonzero(room.recording.streams[0].frame == number)[0])
    frame_set = next(iter(read_frames(room.recording, position, position + 1)))
    body_m = _body(shape, poses, row)
    for camera, depth_m in zip(room.cameras, frame_set.depths_m, strict=True):
        labels = people.get((number, camera.name))
        if depth_m is None or labels is None:
            continue
        told = read_picture(labels)
        mesh_m, mesh_edges = _mesh(depth_m, told, camera, sheet)
        scene = OverlayScene(
            camera=camera, depth_m=depth_m, labels=told, mesh_m=mesh_m, mesh_edges=mesh_edges,
            anchors_m=anchors.position_m[row], anchor_names=ANCHOR_NAMES, joints_m=joints.position_m[row],
            joint_states=tuple(_STATES[code] for code in joints.severity[row]), body_m=body_m,
            body_faces=body_points().asset.faces,
        )  # fmt: skip
        caption = _caption(joints, anchors, row)
        yield FramePicture(number, frame_set.time_s, camera.name, draw_frame(scene), caption, frame.why)


def _body(shape: FittedShape, poses: PoseTable, row: int) -> np.ndarray | None:
    """(v, 3) the learnt skin in the frame's pose, None where the patient is lost."""
    if not np.isfinite(poses.head_m[row]).all():
        return None
    asset = body_points().asset
    body, pose = shape.body(asset), pose_of(asset, poses.head_m[row], poses.quaternion[row])
    return body.skin(body.bone_transforms(pose.rotations, pose.root_m))


def _mesh(depth_m: np.ndarray, labels: np.ndarray, camera: Camera, sheet: SheetConfig) -> tuple[np.ndarray, np.ndarray]:
    """The camera's own mesh of the patient: its nodes (n, 3), world, and edges (m, 2)."""
    surface = build_surface(depth_m, labels == PixelLabel.PATIENT, camera, sheet)
    return surface.points_m, edges(surface)


def _caption(joints: JointTable, anchors: AnchorTable, row: int) -> str:
    found = int(np.isfinite(anchors.sigma_m[row]).sum())
    known = joints.sigma_m[row][~joints.lost[row]]
    sigma = f", joints to about {1000 * np.median(known):.0f} mm" if len(known) else ""
    return f"{found} of {len(ANCHOR_NAMES)} anchors found{sigma}"
