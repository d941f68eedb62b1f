"""What the page asks for, as bytes: the tables at once, pictures and surfaces some frames at a time."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from anchorpose.viewer.container import pack
from anchorpose.viewer.footage import Footage
from anchorpose.viewer.review import Review

MILLIMETRES: Final = 1000.0
MOST_FRAMES: Final = 32  # in one answer


def motion_payload(review: Review) -> bytes:
    """All tables: one row a frame of the results, NaN where unknown, metres, world frame.

    joints (n, 21, 3), sigma (n, 21), severity (n, 21) uint8 of ``JointState``, angles, angle_sigma, angle_severity
    (n, a), matched (n,), and where the results have them poses (n, 21, 7: head, quaternion w x y z) and anchors
    (n, 5, 4: place, sigma).
    """
    joints, angles = review.joints, review.angles
    arrays: dict[str, np.ndarray] = {
        "time_s": joints.time_s.astype(np.float64),
        "frame": joints.frame.astype(np.int32),
        "joints": joints.position_m.astype(np.float32),
        "sigma": joints.sigma_m.astype(np.float32),
        "severity": joints.severity.astype(np.uint8),
        "angles": angles.degrees.astype(np.float32),
        "angle_sigma": angles.sigma_deg.astype(np.float32),
        "angle_severity": angles.severity.astype(np.uint8),
        "matched": review.matched_share.astype(np.float32),
    }
    if review.poses is not None:
        arrays["poses"] = np.concatenate([review.poses.head_m, review.poses.quaternion], axis=2).astype(np.float32)
    if review.anchors is not None:
        found = review.anchors
        arrays["anchors"] = np.concatenate([found.position_m, found.sigma_m[..., None]], axis=2).astype(np.float32)
    return pack({}, arrays)


def rays_payload(footage: Footage) -> bytes:
    """Where each pixel of each camera looks: ``rays<i>`` (height, width, 2) float32, x/z and y/z, camera frame."""
    return pack({}, {f"rays{number}": camera.pixel_rays() for number, camera in enumerate(footage.cameras)})


def points_payload(footage: Footage, first: int, count: int, room: bool) -> bytes:
    """Pixels of the frames (rows of the results) ``first`` on: points (m, 4) uint16 as ``Footage.points``.

    They stand frame by frame, camera by camera; meta counts [[one a camera] a frame] tells them apart. A point in the
    world is ``T_world_camera @ (ray x, ray y, 1) * grey * depth_scale``.
    """
    frames = [footage.points(position, room) for position in _range(footage, first, count)]
    meta: dict[str, Any] = {
        "first": first,
        "counts": [[len(camera) for camera in cameras] for cameras, _ in frames],
        "problems": [problems for _, problems in frames],
    }
    parts = [camera for cameras, _ in frames for camera in cameras]
    return pack(meta, {"points": np.concatenate([np.empty((0, 4), np.uint16), *parts])})


def surface_payload(footage: Footage, first: int, count: int) -> bytes:
    """The patient's surface of some frames: vertices (v, 3) int16 millimetres, world; faces (f, 3) uint32.

    meta counts [[vertices, faces] a frame]; a frame's faces count from its own first vertex.
    """
    frames = [footage.surface(position) for position in _range(footage, first, count)]
    meta = {"first": first, "counts": [[len(vertices), len(faces)] for vertices, faces in frames]}
    limits = np.iinfo(np.int16)
    vertices_mm = np.rint(MILLIMETRES * np.concatenate([vertices for vertices, _ in frames]))
    return pack(
        meta,
        {
            "vertices": np.clip(vertices_mm, limits.min, limits.max).astype(np.int16),
            "faces": np.concatenate([faces for _, faces in frames]).astype(np.uint32),
        },
    )


def _range(footage: Footage, first: int, count: int) -> range:
    """Raises ValueError for frames that there are not."""
    if not (0 <= first < len(footage.frame) and 1 <= count <= MOST_FRAMES):
        raise ValueError(f"there are no frames {first} to {first + count - 1}")
    return range(first, min(first + count, len(footage.frame)))
