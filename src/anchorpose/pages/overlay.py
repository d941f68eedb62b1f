"""Draw tracking results over a depth image (mesh, outline of the body, joints, and the anchors: head, hands and feet),
and choose the report's pictures.

The report shows some frames spread over the recording, the frames in which the joints are most and least certain, and
the first transitions (standing up and sitting down).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from anchorpose.body.skin_points import FittedShape, body_points
from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import ANCHOR_NAMES, LIMBS, LOST, JointState
from anchorpose.pages.canvas import Ink, as_png, draw_dots, enlarge, projector, scale_of, shade, whole
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import DepthStream, half_period_s
from anchorpose.results.records import (
    EPISODES_FILE,
    PEOPLE_FILE,
    SIT_TO_STAND,
    STAND_TO_SIT,
    Episode,
    decode_labels,
    frames_of_people,
    read_episodes,
    read_people,
)
from anchorpose.results.run_record import PictureRecord
from anchorpose.results.tables import (
    ANCHORS_FILE,
    JOINTS_FILE,
    POSES_FILE,
    AnchorTable,
    JointTable,
    PoseTable,
    pose_of,
    read_anchors,
    read_joints,
    read_poses,
)
from anchorpose.surface.mesh import build_surface, edges
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.room import Room

_LABEL_TINT: Final = {
    PixelLabel.EQUIPMENT: Ink.EQUIPMENT,
    PixelLabel.PATIENT: Ink.PATIENT,
    PixelLabel.OTHER_PERSON: Ink.PURPLE,  # larger labels, of further people, get this colour, too
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OverlayScene:
    """One camera's depth image and the results to draw over it; a field that is None is not drawn. All points are in
    the world.

    depth_m (height, width), 0 = no reading; labels (height, width) of ``PixelLabel``; mesh_m (n, 3): points of the
    mesh; mesh_edges (m, 2): pairs of indices of these points; anchors_m (5, 3), NaN where missed; joints_m (21, 3), NaN
    where lost, with sigma_m (21,); body_m (v, 3): skin of the posed body.
    """

    camera: Camera  # the camera with the pose with which the frame was tracked
    depth_m: np.ndarray
    labels: np.ndarray | None = None
    mesh_m: np.ndarray | None = None
    mesh_edges: np.ndarray | None = None
    anchors_m: np.ndarray | None = None
    joints_m: np.ndarray | None = None
    joint_states: tuple[JointState, ...] = ()
    sigma_m: np.ndarray | None = None
    body_m: np.ndarray | None = None


def draw_scene(scene: OverlayScene) -> np.ndarray:
    """Draw the scene. Filled dots are observed joints, hollow dots are inferred joints, and crossed dots are joints
    that are hidden for an unknown reason.
    """
    scale = scale_of(scene.camera)
    picture = enlarge(shade(scene.depth_m, None if scene.labels is None else _tint(scene.labels)), scale)
    to_pixel = projector(scene.camera, scale)
    if scene.mesh_m is not None and scene.mesh_edges is not None:
        _draw_mesh(picture, to_pixel(scene.mesh_m), scene.mesh_edges)
    if scene.body_m is not None:
        _draw_outline(picture, to_pixel(scene.body_m), body_points().asset.faces)
    if scene.joints_m is not None:
        pixels = to_pixel(scene.joints_m)
        if scene.sigma_m is not None:
            _draw_sigma(picture, scene, pixels, scene.sigma_m)
        _draw_joints(picture, pixels, scene.joint_states)
    if scene.anchors_m is not None:
        draw_dots(picture, to_pixel(scene.anchors_m), Ink.VERMILLION, 8, ANCHOR_NAMES)
    return picture


def _tint(labels: np.ndarray) -> np.ndarray:
    """Return the tint (height, width, 3) of each pixel by its label: people and equipment have their colours,
    everything else is white.
    """
    tint = np.full((*labels.shape, 3), 255.0)
    for label, colour in _LABEL_TINT.items():
        chosen = labels >= label if label is PixelLabel.OTHER_PERSON else labels == label
        tint[chosen] = 0.45 * 255.0 + 0.55 * np.array(colour)
    return tint


def _draw_mesh(picture: np.ndarray, pixels: np.ndarray, edges: np.ndarray) -> None:
    layer, lines = picture.copy(), pixels[edges]
    lines = np.rint(lines[np.isfinite(lines).all(axis=(1, 2))]).astype(np.int32)
    cv2.polylines(layer, list(lines[:, :, None]), isClosed=False, color=Ink.GREEN, lineType=cv2.LINE_AA)
    cv2.addWeighted(layer, 0.35, picture, 0.65, 0.0, dst=picture)


def _draw_outline(picture: np.ndarray, pixels: np.ndarray, faces: np.ndarray) -> None:
    """Draw the silhouette of a posed body."""
    corners = pixels[faces]
    corners = np.rint(corners[np.isfinite(corners).all(axis=(1, 2))]).astype(np.int32)
    mask = np.zeros(picture.shape[:2], np.uint8)
    for corner in corners:
        cv2.fillConvexPoly(mask, corner, 255)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, Ink.YELLOW, 1, cv2.LINE_AA)


def _draw_joints(picture: np.ndarray, pixels: np.ndarray, states: tuple[JointState, ...]) -> None:
    there = np.isfinite(pixels).all(axis=1)
    for start, end in LIMBS:
        if there[start] and there[end]:
            cv2.line(picture, whole(pixels[start]), whole(pixels[end]), Ink.BLACK, 4, cv2.LINE_AA)
            cv2.line(picture, whole(pixels[start]), whole(pixels[end]), Ink.WHITE, 2, cv2.LINE_AA)
    for place, state in zip(pixels[there], np.array(states, dtype=object)[there], strict=True):
        _draw_joint(picture, whole(place), state)


def _draw_sigma(picture: np.ndarray, scene: OverlayScene, pixels: np.ndarray, sigma_m: np.ndarray) -> None:
    """Draw a circle of two sigmas around each joint; about six of seven true positions lie inside this circle."""
    away_m = np.linalg.norm(scene.joints_m - scene.camera.position_m, axis=1)
    radius = 2.0 * sigma_m * scene.camera.intrinsics.fx * scale_of(scene.camera) / away_m
    for place, size in zip(pixels, radius, strict=True):
        if np.isfinite(place).all() and np.isfinite(size):
            cv2.circle(picture, whole(place), max(1, round(float(size))), Ink.YELLOW, 1, cv2.LINE_AA)


def _draw_joint(picture: np.ndarray, place: tuple[int, int], state: JointState) -> None:
    cv2.circle(picture, place, 7, Ink.BLACK, -1, cv2.LINE_AA)
    if state == JointState.OBSERVED:
        cv2.circle(picture, place, 6, Ink.WHITE, -1, cv2.LINE_AA)
    elif state == JointState.HIDDEN:
        cv2.drawMarker(picture, place, Ink.WHITE, cv2.MARKER_TILTED_CROSS, 9, 2, cv2.LINE_AA)
    else:
        cv2.circle(picture, place, 5, Ink.WHITE, 2, cv2.LINE_AA)


def save_pictures(folder: Path, pictures: Iterable[tuple[PictureRecord, bytes]]) -> tuple[PictureRecord, ...]:
    """Write the pictures, each given by its entry in run.json and its PNG, into ``folder`` and return their entries."""
    records = []
    for record, png in pictures:
        (folder / record.file).parent.mkdir(exist_ok=True)
        (folder / record.file).write_bytes(png)
        records.append(record)
    return tuple(records)


SPREAD: Final = 4  # number of frames that are chosen evenly over the recording
TRANSITIONS: Final = 4  # maximum number of transitions (standing up, sitting down) shown; the first are chosen

_WORDS: Final = {SIT_TO_STAND: "standing up", STAND_TO_SIT: "sitting down"}


def choose_frames(joints: JointTable, episodes: Sequence[Episode], segmented: np.ndarray) -> dict[int, str]:
    """Choose the frames for the report's pictures; return a dict, in the order of time, from the row of each chosen
    frame in the joints' table to the reason for the choice in words, which is empty for frames spread over the
    recording.

    segmented (n,) bool: True for frames with person labels; the most and the least certain frame are chosen among these
    frames, if the patient is found in them.
    """
    why = dict.fromkeys(np.unique(np.linspace(0, len(joints.frame) - 1, SPREAD).astype(int)).tolist(), "")
    transitions = [episode for episode in episodes if episode.kind in _WORDS][:TRANSITIONS]
    for episode in transitions:
        middle_s = 0.5 * (episode.start_s + episode.end_s)
        why[int(np.abs(joints.time_s - middle_s).argmin())] = _WORDS[episode.kind]
    found = np.flatnonzero(segmented & ~joints.lost.all(axis=1))
    if len(found):
        why[min(found.tolist(), key=lambda row: _uncertainty(joints, row))] = "surest of all frames"
        why[max(found.tolist(), key=lambda row: _uncertainty(joints, row))] = "least sure of all frames"
    return dict(sorted(why.items()))


def _uncertainty(joints: JointTable, row: int) -> tuple[int, int, float]:
    """Return a sort key of a frame's uncertainty: numbers of lost and of unobserved joints, then median sigma."""
    state_code, sigma = joints.state_code[row], joints.sigma_m[row]
    return int((state_code == LOST).sum()), int((state_code > 0).sum()), float(np.nanmedian(sigma))


def draw_chosen(
    results: Path, room: Room, shape: FittedShape | None, sheet: SurfaceConfig
) -> Iterator[tuple[PictureRecord, bytes]]:
    """Yield, for each frame of ``choose_frames`` and each camera with a depth image and person labels in this frame, a
    picture (see ``draw_scene``), as its entry in run.json and its PNG. Yield no pictures if the patient's body
    (``shape``) is unknown.

    results: a folder with all tables; sheet: settings by which a camera's surface is meshed.
    """
    if shape is None:
        return
    joints, anchors = read_joints(results / JOINTS_FILE), read_anchors(results / ANCHORS_FILE)
    poses = read_poses(results / POSES_FILE)
    position, recorded = _recorded(joints, room.recording.streams[0])
    segmented = recorded & np.isin(joints.frame, frames_of_people(results / PEOPLE_FILE))
    chosen = choose_frames(joints, read_episodes(results / EPISODES_FILE), segmented)
    chosen = {row: why for row, why in chosen.items() if recorded[row]}
    people = read_people(results / PEOPLE_FILE, [int(joints.frame[row]) for row in chosen])
    for row, why in chosen.items():
        number = int(joints.frame[row])
        frame_set = read_frame(room.recording, int(position[row]))
        caption, body_m = _caption(joints, anchors, row), _posed_skin(shape, poses, row)
        for camera, depth_m in zip(room.cameras, frame_set.depths_m, strict=True):
            packed = people.get((number, camera.name))
            if depth_m is None or packed is None:
                continue
            labels = decode_labels(packed)
            surface = build_surface(depth_m, labels == PixelLabel.PATIENT, camera, sheet)
            scene = OverlayScene(
                camera=camera,
                depth_m=depth_m,
                labels=labels,
                mesh_m=surface.points_m,
                mesh_edges=edges(surface),
                anchors_m=anchors.position_m[row],
                joints_m=joints.position_m[row],
                joint_states=tuple(tuple(JointState)[code] for code in joints.state_code[row]),
                body_m=body_m,
            )
            file = f"pictures/{number:06d}_{camera.name}.png"
            record = PictureRecord(file, number, frame_set.time_s, camera.name, caption, why)
            yield record, as_png(draw_scene(scene))


def _recorded(joints: JointTable, stream: DepthStream) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each frame, its position (n,) in the first camera's stream of depth images, and (n,) bool: whether
    the stream has an image of this frame.

    The recording of a live session may hold only the session's start. A camera that gave no images for a while may
    continue with frame numbers that were used before, so the times must agree, too.
    """
    position = np.searchsorted(stream.frame, joints.frame).clip(max=len(stream.frame) - 1)
    apart_s = np.abs(stream.time_s[position] - joints.time_s)
    return position, (stream.frame[position] == joints.frame) & (apart_s <= half_period_s(stream.time_s))


def _posed_skin(shape: FittedShape, poses: PoseTable, row: int) -> np.ndarray | None:
    """Return the skin (v, 3) of the patient's body in the pose of a table's row; None if the patient is lost."""
    if not np.isfinite(poses.head_m[row]).all():
        return None
    asset = body_points().asset
    body, pose = shape.mesh(asset), pose_of(asset, poses.head_m[row], poses.quaternion[row])
    return body.skin(body.bone_transforms(pose.rotations, pose.root_m))


def _caption(joints: JointTable, anchors: AnchorTable, row: int) -> str:
    found = int(np.isfinite(anchors.sigma_m[row]).sum())
    known = joints.sigma_m[row][~joints.lost[row]]
    sigma = f", joints to about {1000 * np.median(known):.0f} mm" if len(known) else ""
    return f"{found} of {len(ANCHOR_NAMES)} anchors found{sigma}"
