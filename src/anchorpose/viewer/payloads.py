"""Pack data for the page as bytes (payloads of responses). The page requests an overview of all frames, the body, and
the tables, points and surfaces of a few frames at a time.

All arrays of a payload are sent together: first a short head in JSON, which states where each array begins, then the
arrays.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import MOVING_BONES
from anchorpose.body.segments import load_body_asset
from anchorpose.joints import STATE_CODE, JointState
from anchorpose.report.chart import after_pause
from anchorpose.results.explained import unexplained
from anchorpose.viewer.depth_frames import DepthFrames
from anchorpose.viewer.review import Review

MAGIC: Final = b"APV1"
# bytes; each array begins at a multiple of this number of bytes, as the typed arrays of JavaScript require
ALIGNED: Final = 8

TYPES: Final = ("uint8", "uint16", "int16", "int32", "uint32", "float32", "float64")


def pack(meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return bytes for a page: MAGIC, length of the head (uint32), head, arrays; little-endian, each array at a
    multiple of ``ALIGNED``.

    The head is {"meta": meta, "arrays": [{"name", "type", "shape", "start"}]}; start, the byte at which an array
    begins, is counted from the first multiple of ``ALIGNED`` after the head. Raises ValueError for a number type that
    browsers' arrays do not have.
    """
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    entries, start = [], 0
    for name, array in contiguous.items():
        if array.dtype.name not in TYPES:
            raise ValueError(f"{name} is {array.dtype.name}, not one of {', '.join(TYPES)}")
        entries.append({"name": name, "type": array.dtype.name, "shape": list(array.shape), "start": start})
        start += _up(array.nbytes)
    head = json.dumps({"meta": meta, "arrays": entries}, allow_nan=False).encode()
    before = len(MAGIC) + 4 + len(head)
    parts = [MAGIC, struct.pack("<I", len(head)), head, bytes(_up(before) - before)]
    for array in contiguous.values():
        parts += [array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes(), bytes(-array.nbytes % ALIGNED)]
    return b"".join(parts)


def _up(place: int) -> int:
    return place + -place % ALIGNED


MOST_FRAMES: Final = 32  # maximum number of frames whose points or surfaces are in one answer
# approximate number of frames, spread over the results, whose joints determine the middle of the page's view
SAMPLED: Final = 2000
MOST_ROWS: Final = 512  # maximum number of frames whose table rows are in one answer (some hundred kilobytes)


def overview_payload(review: Review) -> bytes:
    """Return packed arrays with one entry per frame of the results: time_s (n,) float64 and frame (n,) int32, the
    frame's number; observed and lost (n,) uint8: the number of joints in these states; unexplained (n,), if the results
    have this table: how badly the pose explains the depth images (``results.explained.unexplained``).

    meta: middle_m, the median position of the patient's joints, and lowest_m, the height of the lowest joint in all
    frames; null if unknown.
    """
    joints = review.joints
    arrays: dict[str, np.ndarray] = {
        "time_s": joints.time_s.astype(np.float64),
        "frame": joints.frame.astype(np.int32),
        "observed": (joints.state_code == STATE_CODE[JointState.OBSERVED]).sum(axis=1).astype(np.uint8),
        "lost": joints.lost.sum(axis=1).astype(np.uint8),
    }
    if review.explained is not None:
        arrays["unexplained"] = unexplained(review.explained).astype(np.float32)
    sampled_m = joints.position_m[:: max(1, len(joints.frame) // SAMPLED)].reshape(-1, 3)
    seen_m = sampled_m[np.isfinite(sampled_m).all(axis=1)]
    lowest_m = float(np.nanmin(joints.position_m[..., 1], initial=np.inf))
    known = len(seen_m) > 0 and bool(np.isfinite(lowest_m))
    meta = {"middle_m": np.median(seen_m, axis=0).tolist(), "lowest_m": lowest_m} if known else {}
    return pack({"middle_m": None, "lowest_m": None, **meta}, arrays)


def motion_payload(review: Review, first: int, count: int) -> bytes:
    """Return the packed tables of ``count`` frames from row ``first`` of the results on, in metres and the world frame,
    NaN where unknown.

    joints (n, 21, 3), sigma (n, 21), state (n, 21) uint8 of ``JointState``, angles, angle_sigma, angle_state (n, a),
    and, if the results have them, poses (n, 21, 7: head of the bone, quaternion w x y z) and anchors (n, 5, 4:
    position, sigma).
    """
    rows = _rows(len(review.joints.frame), first, count, MOST_ROWS)
    joints, angles = review.joints, review.angles
    arrays: dict[str, np.ndarray] = {
        "joints": joints.position_m[rows],
        "sigma": joints.sigma_m[rows],
        "state": joints.state_code[rows],
        "angles": angles.degrees[rows],
        "angle_sigma": angles.sigma_deg[rows],
        "angle_state": angles.state_code[rows],
    }
    if review.poses is not None:
        arrays["poses"] = np.concatenate([review.poses.head_m[rows], review.poses.quaternion[rows]], axis=2)
    if review.anchors is not None:
        sigma_m = review.anchors.sigma_m[rows][..., None]
        arrays["anchors"] = np.concatenate([review.anchors.position_m[rows], sigma_m], axis=2)
    types = {name: np.uint8 if name.endswith("state") else np.float32 for name in arrays}
    return pack({"first": first}, {name: array.astype(types[name]) for name, array in arrays.items()})


def curves_payload(review: Review, first: int, count: int) -> bytes:
    """Return the packed curves of all joint angles over ``count`` frames from row ``first`` of the results on, reduced
    to as many points as a screen can show.

    Points are ordered by angle, then by time. start (a + 1,) int32: where each angle's points begin. row (m,) int32:
    row of each point in the results; degrees and sigma (m,) float32, state (m,) uint8: the values in that row. broken
    (m,) uint8: 1 where no line may connect the point with the previous point of its angle.
    """
    frames = len(review.joints.frame)
    rows, table = _rows(frames, first, count, frames), review.angles
    kept = [rows.start + each for each in thinned(table.degrees[rows], table.sigma_deg[rows], table.state_code[rows])]
    counts, row = [len(each) for each in kept], np.concatenate([np.empty(0, int), *kept])
    angle = np.repeat(np.arange(len(kept)), counts)
    piece = pieces(table.degrees[rows], after_pause(review.joints.time_s)[rows])[row - rows.start, angle]
    arrays = {
        "start": np.cumsum([0, *counts]).astype(np.int32),
        "row": row.astype(np.int32),
        "degrees": table.degrees[row, angle].astype(np.float32),
        "sigma": table.sigma_deg[row, angle].astype(np.float32),
        "state": table.state_code[row, angle].astype(np.uint8),
        "broken": (np.diff(piece, prepend=0) != 0).astype(np.uint8),
    }
    return pack({}, arrays)


def pieces(degrees: np.ndarray, paused: np.ndarray) -> np.ndarray:
    """Return (n, angles): for each frame and angle, the number of the unbroken piece of the angle's curve to which the
    frame belongs. A piece ends before a frame that follows a pause (``paused`` (n,) bool), and where the angle
    ``degrees`` (n, angles) jumps by more than half a turn, for example from 180 to -180.
    """
    jumps = np.abs(np.diff(degrees, axis=0, prepend=degrees[:1])) > 180.0
    return np.cumsum(jumps | paused[:, None], axis=0)


INTERVALS: Final = 800
"""Number of intervals into which the time shown in a chart is divided: two per pixel, since a chart is some 400 pixels
wide.
"""

KEPT: Final = 5
"""Maximum number of frames kept per interval and angle: the frames with the smallest value, the largest value, the
largest sigma, the first unknown angle and the first inferred angle. With these frames, every peak, gap and inferred
part of a curve stays visible.
"""


def thinned(degrees: np.ndarray, sigma_deg: np.ndarray, state_code: np.ndarray) -> list[np.ndarray]:
    """Return, for each angle, the rows of the arrays (n, angles) that the chart draws, in ascending order: at most
    ``KEPT`` rows for each of the chart's intervals of time (``INTERVALS``), or all rows if the arrays have few rows.
    """
    count, angles = degrees.shape
    size = count // INTERVALS  # number of frames in an interval
    if size <= KEPT:
        return [np.arange(count)] * angles

    def first_largest(values: np.ndarray) -> np.ndarray:
        filled = np.pad(values.astype(np.float64), ((0, -count % size), (0, 0)), constant_values=-np.inf)
        starts = np.arange(0, len(filled), size)
        return starts[:, None] + filled.reshape(len(starts), size, angles).argmax(axis=1)

    low, high = (np.where(np.isnan(degrees), -np.inf, each) for each in (-degrees, degrees))
    widest = np.nan_to_num(sigma_deg, nan=-1.0)
    found = np.stack([first_largest(each) for each in (low, high, widest, np.isnan(degrees), state_code > 0)])
    return [np.unique(found[..., angle]) for angle in range(angles)]


def rays_payload(depth_frames: DepthFrames) -> bytes:
    """Return the packed rays (lines of sight) of all pixels of each camera: ``rays<i>`` (height, width, 2) float32, x/z
    and y/z, camera frame.
    """
    return pack({}, {f"rays{number}": camera.pixel_rays() for number, camera in enumerate(depth_frames.cameras)})


def points_payload(depth_frames: DepthFrames, first: int, count: int, room: bool) -> bytes:
    """Return the packed pixels of ``count`` frames from row ``first`` of the results on: points (m, 4) uint16 as
    ``DepthFrames.points`` returns them.

    Pixels are ordered by frame, then by camera; meta: ``counts`` has one list per frame, with one number of pixels per
    camera. A point in the world is ``T_world_camera @ (ray x, ray y, 1) * grey * depth_scale``.
    """
    frames = [depth_frames.points(position, room) for position in _positions(depth_frames, first, count)]
    meta: dict[str, Any] = {
        "first": first,
        "counts": [[len(camera) for camera in cameras] for cameras, _ in frames],
        "problems": [problems for _, problems in frames],
    }
    parts = [camera for cameras, _ in frames for camera in cameras]
    return pack(meta, {"points": np.concatenate([np.empty((0, 4), np.uint16), *parts])})


def surface_payload(depth_frames: DepthFrames, first: int, count: int) -> bytes:
    """Return the packed surface of the patient in ``count`` frames from row ``first`` of the results on: vertices (v,
    3) int16, millimetres in the world; faces (f, 3) uint32.

    meta: ``counts`` has the numbers of [vertices, faces] of each frame. Faces are indices of vertices, counted from 0
    at the first vertex of the same frame.
    """
    frames = [depth_frames.surface(position) for position in _positions(depth_frames, first, count)]
    meta = {"first": first, "counts": [[len(vertices), len(faces)] for vertices, faces in frames]}
    limits = np.iinfo(np.int16)
    vertices_mm = np.rint(1000.0 * np.concatenate([vertices for vertices, _ in frames]))
    return pack(
        meta,
        {
            "vertices": np.clip(vertices_mm, limits.min, limits.max).astype(np.int16),
            "faces": np.concatenate([faces for _, faces in frames]).astype(np.uint32),
        },
    )


def _positions(depth_frames: DepthFrames, first: int, count: int) -> range:
    frames = len(depth_frames.frame)
    return range(frames)[_rows(frames, first, count, MOST_FRAMES)]


def _rows(frames: int, first: int, count: int, most: int) -> slice:
    """Return the slice of ``count`` rows from ``first`` on, cut off at the last row, ``frames`` - 1. Raises ValueError
    if the row ``first`` does not exist, or if ``count`` is not from 1 to ``most``.
    """
    if not (0 <= first < frames and 1 <= count <= most):
        raise ValueError(f"there are no frames {first} to {first + count - 1}")
    return slice(first, min(first + count, frames))


# Maximum number of bones that move a vertex of the body's skin on the page. If all bones with a weight on a vertex
# moved it, the vertex would be elsewhere by at most 5 mm.
INFLUENCES: Final = 4


def moving_ancestor(asset: BodyAsset) -> np.ndarray:
    """Return (b,): for each bone, the index in ``MOVING_BONES`` of the bone that moves it: the bone itself or, if it
    does not move on its own, its nearest ancestor that does.
    """
    row_of = {asset.bone(name): row for row, name in enumerate(MOVING_BONES)}
    carried = np.zeros(len(asset.bone_names), np.int64)
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        carried[bone] = row_of[bone] if bone in row_of else carried[parent]
    return carried


def body_skin(run: dict[str, Any]) -> dict[str, np.ndarray] | None:
    """Return the arrays from which the page draws the patient's body; None if no body was learnt in the run.

    vertices (v, 3) and normals (v, 3) float32 at rest, faces (f, 3) uint32, bones (v, 4) uint8 rows of
    ``MOVING_BONES``, weights (v, 4) float32, heads (21, 3) float32: the centres of rotation at rest. A posed vertex is
    ``sum of weight * (rotation @ (vertex - head) + head in the world)``: linear blend skinning as in ``BodyMesh.skin``.
    """
    learnt = run.get("body")
    if learnt is None:
        return None
    asset = load_body_asset()
    body = shape_body(asset, np.array(learnt["coefficients"]))
    bones, weights = _heaviest(moving_ancestor(asset)[asset.skin_bones], asset.skin_weights)
    return {
        "vertices": body.vertices.astype(np.float32),
        "normals": _normals(body.vertices, asset.faces).astype(np.float32),
        "faces": asset.faces.astype(np.uint32),
        "bones": bones,
        "weights": weights,
        "heads": body.bone_heads[[asset.bone(name) for name in MOVING_BONES]].astype(np.float32),
    }


def _heaviest(bones: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ``INFLUENCES`` bones with the largest weight on each vertex, and these weights, scaled so that their
    sum is 1. Bones that move together count as a single bone.
    """
    total = np.zeros((len(bones), len(MOVING_BONES)))
    np.add.at(total, (np.arange(len(bones))[:, None], bones), weights)
    chosen = np.argsort(-total, axis=1, kind="stable")[:, :INFLUENCES]
    kept = np.take_along_axis(total, chosen, axis=1)
    return chosen.astype(np.uint8), (kept / kept.sum(axis=1, keepdims=True)).astype(np.float32)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    across = np.cross(b - a, c - a)
    summed = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(summed, faces[:, corner], across)
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.where(length > 0, length, 1.0)
