"""A depth picture with what the tracker made of it: mesh, anchors, body outline and joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import LIMBS, JointState

_Colour = tuple[int, int, int]  # blue, green, red

# Okabe and Ito's palette, told apart by colour-blind readers
_SKY: Final = (233, 180, 86)
_ORANGE: Final = (0, 159, 230)
_GREEN: Final = (115, 158, 0)
_YELLOW: Final = (66, 228, 240)
_VERMILLION: Final = (0, 94, 213)
_PURPLE: Final = (167, 121, 204)
_WHITE: Final = (255, 255, 255)
_BLACK: Final = (0, 0, 0)

_LABEL_TINT: Final = {
    PixelLabel.EQUIPMENT: _ORANGE,
    PixelLabel.PATIENT: _SKY,
    PixelLabel.OTHER_PERSON: _PURPLE,  # and all labels above
}

PICTURE_WIDTH: Final = 960
"""Pixels: wide enough to read the names on a phone held sideways, small enough to embed a dozen in a page."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OverlayScene:
    """One camera's picture and what is to be drawn over it; all points in the camera's world frame.

    depth_m (height, width), 0 = no reading; labels (height, width) of ``PixelLabel``; mesh_m (n, 3) and mesh_edges
    (m, 2); anchors_m (a, 3), NaN where missed; joints_m (21, 3), NaN where lost; body_m (v, 3) and body_faces (f, 3).
    """

    camera: Camera  # with the pose that was used
    depth_m: np.ndarray
    labels: np.ndarray | None = None
    mesh_m: np.ndarray | None = None
    mesh_edges: np.ndarray | None = None
    anchors_m: np.ndarray | None = None
    anchor_names: tuple[str, ...] = ()
    joints_m: np.ndarray | None = None
    joint_states: tuple[JointState, ...] = ()
    body_m: np.ndarray | None = None
    body_faces: np.ndarray | None = None


def draw_frame(scene: OverlayScene) -> bytes:
    """The scene as a PNG: filled joints are observed, hollow ones inferred, crossed ones of unknown cause."""
    picture, scale = enlarge(shade(scene.depth_m, scene.labels), scene.camera)
    to_pixel = _projector(scene.camera, scale)
    if scene.mesh_m is not None:
        _draw_mesh(picture, to_pixel(scene.mesh_m), scene.mesh_edges)
    if scene.body_m is not None and scene.body_faces is not None:
        _draw_outline(picture, to_pixel(scene.body_m), scene.body_faces)
    if scene.joints_m is not None:
        _draw_joints(picture, to_pixel(scene.joints_m), scene.joint_states)
    if scene.anchors_m is not None:
        _draw_anchors(picture, to_pixel(scene.anchors_m), scene.anchor_names)
    return encode(picture)


def encode(picture: np.ndarray) -> bytes:
    """The picture as a PNG."""
    _, encoded = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return bytes(encoded)


def enlarge(picture: np.ndarray, camera: Camera) -> tuple[np.ndarray, int]:
    """The camera's picture about ``PICTURE_WIDTH`` wide, and how many pixels each of its pixels became."""
    scale = max(1, round(PICTURE_WIDTH / camera.width))
    return cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST), scale


def draw_axes(picture: np.ndarray, camera: Camera, scale: int) -> None:
    """The world's axes, 0.3 m each from its origin, named, into an enlarged picture."""
    ends = _projector(camera, scale)(np.concatenate([np.zeros((1, 3)), 0.3 * np.eye(3)]))
    for end, name, colour in zip(ends[1:], "XYZ", (_VERMILLION, _GREEN, _SKY), strict=True):
        if np.isfinite(ends[0]).all() and np.isfinite(end).all():
            cv2.line(picture, _whole(ends[0]), _whole(end), _BLACK, 4, cv2.LINE_AA)
            cv2.line(picture, _whole(ends[0]), _whole(end), colour, 2, cv2.LINE_AA)
            _write(picture, name, _whole(end))


def shade(depth_m: np.ndarray, labels: np.ndarray | None) -> np.ndarray:
    """Near is light, far is dark, no reading is black with a blue cast; people and equipment are tinted."""
    seen = depth_m > 0
    near, far = np.percentile(depth_m[seen], [1, 99]) if seen.any() else (0.0, 1.0)
    grey = 0.75 - 0.6 * np.clip((depth_m - near) / max(far - near, 1e-6), 0.0, 1.0)
    tint = np.full((*depth_m.shape, 3), 255.0)
    if labels is not None:
        for label, colour in _LABEL_TINT.items():
            chosen = labels >= label if label is PixelLabel.OTHER_PERSON else labels == label
            tint[chosen] = 0.45 * 255.0 + 0.55 * np.array(colour)
    picture = np.where(seen[..., None], grey[..., None] * tint, (48.0, 24.0, 16.0))
    return np.ascontiguousarray(picture, dtype=np.uint8)


def _projector(camera: Camera, scale: int) -> Callable[[np.ndarray], np.ndarray]:
    """World points (n, 3) to pixels (n, 2) of the enlarged picture, NaN behind the camera or where a point is NaN."""
    T_camera_world = invert_rigid(camera.require_pose())

    def to_pixel(points_m: np.ndarray) -> np.ndarray:
        pixels = camera.project(transform_points(T_camera_world, np.asarray(points_m, dtype=np.float64)))
        # far outside is as good as not there, and keeps OpenCV's fixed-point coordinates from overflowing
        pixels[(np.abs(pixels) > 10 * max(camera.width, camera.height)).any(axis=1)] = np.nan
        return (pixels + 0.5) * scale - 0.5

    return to_pixel


def _draw_mesh(picture: np.ndarray, pixels: np.ndarray, edges: np.ndarray | None) -> None:
    layer = picture.copy()
    if edges is None:
        for place in pixels[np.isfinite(pixels).all(axis=1)]:
            cv2.circle(layer, _whole(place), 1, _GREEN, -1)
    else:
        lines = pixels[edges]
        lines = np.rint(lines[np.isfinite(lines).all(axis=(1, 2))]).astype(np.int32)
        cv2.polylines(layer, list(lines[:, :, None]), isClosed=False, color=_GREEN, lineType=cv2.LINE_AA)
    cv2.addWeighted(layer, 0.35, picture, 0.65, 0.0, dst=picture)


def _draw_outline(picture: np.ndarray, pixels: np.ndarray, faces: np.ndarray) -> None:
    """The silhouette of a posed body."""
    corners = pixels[faces]
    corners = np.rint(corners[np.isfinite(corners).all(axis=(1, 2))]).astype(np.int32)
    mask = np.zeros(picture.shape[:2], np.uint8)
    for corner in corners:
        cv2.fillConvexPoly(mask, corner, 255)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, _YELLOW, 1, cv2.LINE_AA)


def _draw_joints(picture: np.ndarray, pixels: np.ndarray, states: tuple[JointState, ...]) -> None:
    there = np.isfinite(pixels).all(axis=1)
    for start, end in LIMBS:
        if there[start] and there[end]:
            cv2.line(picture, _whole(pixels[start]), _whole(pixels[end]), _BLACK, 4, cv2.LINE_AA)
            cv2.line(picture, _whole(pixels[start]), _whole(pixels[end]), _WHITE, 2, cv2.LINE_AA)
    for place, state in zip(pixels[there], np.array(states, dtype=object)[there], strict=True):
        _draw_joint(picture, _whole(place), state)


def _draw_joint(picture: np.ndarray, place: tuple[int, int], state: JointState) -> None:
    cv2.circle(picture, place, 7, _BLACK, -1, cv2.LINE_AA)
    if state == JointState.OBSERVED:
        cv2.circle(picture, place, 6, _WHITE, -1, cv2.LINE_AA)
    elif state == JointState.HIDDEN:
        cv2.drawMarker(picture, place, _WHITE, cv2.MARKER_TILTED_CROSS, 9, 2, cv2.LINE_AA)
    else:
        cv2.circle(picture, place, 5, _WHITE, 2, cv2.LINE_AA)


def _draw_anchors(picture: np.ndarray, pixels: np.ndarray, names: tuple[str, ...]) -> None:
    for place, name in zip(pixels, names, strict=True):
        if np.isfinite(place).all():
            cv2.circle(picture, _whole(place), 10, _BLACK, -1, cv2.LINE_AA)
            cv2.circle(picture, _whole(place), 8, _VERMILLION, -1, cv2.LINE_AA)
            _write(picture, name, _whole(place))


def _write(picture: np.ndarray, text: str, place: tuple[int, int]) -> None:
    """Text beside a dot, kept inside the picture, white on a black rim."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 2)
    left = place[0] + 14 if place[0] + 14 + width < picture.shape[1] else place[0] - 14 - width
    corner = (left, int(np.clip(place[1] + height // 2, height + 2, picture.shape[0] - 4)))
    ink = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(ink, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 1, cv2.LINE_AA)
    picture[cv2.dilate(ink, np.ones((5, 5), np.uint8)) > 0] = _BLACK
    picture[ink > 0] = ink[ink > 0][:, None]


def _whole(place: np.ndarray) -> tuple[int, int]:
    column, row = np.rint(place).astype(int)
    return int(column), int(row)
