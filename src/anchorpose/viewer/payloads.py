"""What the page asks for, as bytes: the tables at once, pictures and surfaces some frames at a time.

Arrays in one piece of bytes, for the page: a short JSON head that says where each array lies, then the arrays.

What the page is told of an error.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.viewer.depth_frames import Footage
from anchorpose.viewer.review import Review

MAGIC: Final = b"APV1"
ALIGNED: Final = 8  # bytes: typed arrays of a browser begin at a multiple of their item's size

TYPES: Final = ("uint8", "uint16", "int16", "int32", "uint32", "float32", "float64")


def pack(meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """MAGIC, length of the head (uint32), head, arrays; little-endian, each array at a multiple of ``ALIGNED``.

    The head is {"meta": meta, "arrays": [{"name", "type", "shape", "start"}]}; start is counted from the first multiple
    of ``ALIGNED`` after the head. Raises ValueError for types that a browser has no array of.
    """
    plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    entries, start = [], 0
    for name, array in plain.items():
        if array.dtype.name not in TYPES:
            raise ValueError(f"{name} is {array.dtype.name}, not one of {', '.join(TYPES)}")
        entries.append({"name": name, "type": array.dtype.name, "shape": list(array.shape), "start": start})
        start += _up(array.nbytes)
    head = json.dumps({"meta": meta, "arrays": entries}, allow_nan=False).encode()
    before = len(MAGIC) + 4 + len(head)
    parts = [MAGIC, struct.pack("<I", len(head)), head, bytes(_up(before) - before)]
    for array in plain.values():
        parts += [array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes(), bytes(-array.nbytes % ALIGNED)]
    return b"".join(parts)


def unpack(data: bytes) -> tuple[Any, dict[str, np.ndarray]]:
    """The meta and the arrays of ``pack``; what the page does in JavaScript, here for tests and programs."""
    if data[:4] != MAGIC:
        raise ValueError("these bytes were not packed here")
    (length,) = struct.unpack_from("<I", data, 4)
    head, first = json.loads(data[8 : 8 + length]), _up(8 + length)
    arrays = {}
    for entry in head["arrays"]:
        kind = np.dtype(entry["type"]).newbyteorder("<")
        count = int(np.prod(entry["shape"], dtype=np.int64))
        arrays[entry["name"]] = np.frombuffer(data, kind, count, first + entry["start"]).reshape(entry["shape"])
    return head["meta"], arrays


def _up(place: int) -> int:
    return place + -place % ALIGNED


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
        "severity": joints.state_code.astype(np.uint8),
        "angles": angles.degrees.astype(np.float32),
        "angle_sigma": angles.sigma_deg.astype(np.float32),
        "angle_severity": angles.state_code.astype(np.uint8),
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


def told(error: Exception) -> str:
    """What the page may know of an error: a file by its name, not where it lies, which often says whose it is."""
    if isinstance(error, InputError):
        return str(InputError(error.path.name, error.problem, error.remedy))
    if isinstance(error, OSError):
        name = Path(str(error.filename)).name if error.filename else "The computer"
        return f"{name}: {error.strerror or 'cannot be used'}."
    return str(error)
