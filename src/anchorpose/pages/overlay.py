"""A depth picture with what the tracker made of it: mesh, anchors, body outline and joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import LIMBS, JointState
from anchorpose.pages.canvas import (
    BLACK,
    EQUIPMENT,
    GREEN,
    PATIENT,
    PURPLE,
    VERMILLION,
    WHITE,
    YELLOW,
    as_png,
    enlarge,
    projector,
    scale_of,
    shade,
    whole,
    write,
)

_LABEL_TINT: Final = {
    PixelLabel.EQUIPMENT: EQUIPMENT,
    PixelLabel.PATIENT: PATIENT,
    PixelLabel.OTHER_PERSON: PURPLE,  # and all labels above
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OverlayScene:
    """One camera's picture and what is to be drawn over it; all points in the camera's world frame.

    depth_m (height, width), 0 = no reading; labels (height, width) of ``PixelLabel``; mesh_m (n, 3) and mesh_edges
    (m, 2); anchors_m (a, 3), NaN where missed; joints_m (21, 3), NaN where lost, sigma_m (21,) of them; body_m (v, 3)
    and body_faces (f, 3).
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
    sigma_m: np.ndarray | None = None
    body_m: np.ndarray | None = None
    body_faces: np.ndarray | None = None


def draw_frame(scene: OverlayScene) -> bytes:
    """The scene as a PNG, see ``draw_scene``."""
    return as_png(draw_scene(scene))


def draw_scene(scene: OverlayScene) -> np.ndarray:
    """The scene as a picture: filled joints are observed, hollow ones inferred, crossed ones of unknown cause."""
    scale = scale_of(scene.camera)
    picture = enlarge(shade(scene.depth_m, None if scene.labels is None else _tint(scene.labels)), scale)
    to_pixel = projector(scene.camera, scale)
    if scene.mesh_m is not None:
        _draw_mesh(picture, to_pixel(scene.mesh_m), scene.mesh_edges)
    if scene.body_m is not None and scene.body_faces is not None:
        _draw_outline(picture, to_pixel(scene.body_m), scene.body_faces)
    if scene.joints_m is not None:
        if scene.sigma_m is not None:
            _draw_sigma(picture, scene.camera, scale, to_pixel, scene.joints_m, scene.sigma_m)
        _draw_joints(picture, to_pixel(scene.joints_m), scene.joint_states)
    if scene.anchors_m is not None:
        _draw_anchors(picture, to_pixel(scene.anchors_m), scene.anchor_names)
    return picture


def _tint(labels: np.ndarray) -> np.ndarray:
    """(height, width, 3): people and equipment in their colours, everything else white."""
    tint = np.full((*labels.shape, 3), 255.0)
    for label, colour in _LABEL_TINT.items():
        chosen = labels >= label if label is PixelLabel.OTHER_PERSON else labels == label
        tint[chosen] = 0.45 * 255.0 + 0.55 * np.array(colour)
    return tint


def _draw_mesh(picture: np.ndarray, pixels: np.ndarray, edges: np.ndarray | None) -> None:
    layer = picture.copy()
    if edges is None:
        for place in pixels[np.isfinite(pixels).all(axis=1)]:
            cv2.circle(layer, whole(place), 1, GREEN, -1)
    else:
        lines = pixels[edges]
        lines = np.rint(lines[np.isfinite(lines).all(axis=(1, 2))]).astype(np.int32)
        cv2.polylines(layer, list(lines[:, :, None]), isClosed=False, color=GREEN, lineType=cv2.LINE_AA)
    cv2.addWeighted(layer, 0.35, picture, 0.65, 0.0, dst=picture)


def _draw_outline(picture: np.ndarray, pixels: np.ndarray, faces: np.ndarray) -> None:
    """The silhouette of a posed body."""
    corners = pixels[faces]
    corners = np.rint(corners[np.isfinite(corners).all(axis=(1, 2))]).astype(np.int32)
    mask = np.zeros(picture.shape[:2], np.uint8)
    for corner in corners:
        cv2.fillConvexPoly(mask, corner, 255)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, YELLOW, 1, cv2.LINE_AA)


def _draw_joints(picture: np.ndarray, pixels: np.ndarray, states: tuple[JointState, ...]) -> None:
    there = np.isfinite(pixels).all(axis=1)
    for start, end in LIMBS:
        if there[start] and there[end]:
            cv2.line(picture, whole(pixels[start]), whole(pixels[end]), BLACK, 4, cv2.LINE_AA)
            cv2.line(picture, whole(pixels[start]), whole(pixels[end]), WHITE, 2, cv2.LINE_AA)
    for place, state in zip(pixels[there], np.array(states, dtype=object)[there], strict=True):
        _draw_joint(picture, whole(place), state)


def _draw_sigma(
    picture: np.ndarray,
    camera: Camera,
    scale: int,
    to_pixel: Callable[[np.ndarray], np.ndarray],
    joints_m: np.ndarray,
    sigma_m: np.ndarray,
) -> None:
    """A circle of two sigmas around each joint: the joint lies inside it about six times in seven."""
    away_m = np.linalg.norm(joints_m - camera.position_m, axis=1)
    radius = 2.0 * sigma_m * camera.intrinsics.fx * scale / away_m
    places = to_pixel(joints_m)
    for place, size in zip(places, radius, strict=True):
        if np.isfinite(place).all() and np.isfinite(size):
            cv2.circle(picture, whole(place), max(1, round(float(size))), YELLOW, 1, cv2.LINE_AA)


def _draw_joint(picture: np.ndarray, place: tuple[int, int], state: JointState) -> None:
    cv2.circle(picture, place, 7, BLACK, -1, cv2.LINE_AA)
    if state == JointState.OBSERVED:
        cv2.circle(picture, place, 6, WHITE, -1, cv2.LINE_AA)
    elif state == JointState.HIDDEN:
        cv2.drawMarker(picture, place, WHITE, cv2.MARKER_TILTED_CROSS, 9, 2, cv2.LINE_AA)
    else:
        cv2.circle(picture, place, 5, WHITE, 2, cv2.LINE_AA)


def _draw_anchors(picture: np.ndarray, pixels: np.ndarray, names: tuple[str, ...]) -> None:
    for place, name in zip(pixels, names, strict=True):
        if np.isfinite(place).all():
            cv2.circle(picture, whole(place), 10, BLACK, -1, cv2.LINE_AA)
            cv2.circle(picture, whole(place), 8, VERMILLION, -1, cv2.LINE_AA)
            write(picture, name, whole(place))
