"""Measure how far the learnt body's skin is from a captured surface; TRUTH holds skin_m (t, v, 3) and faces (f, 3).

The recording is tracked, and the learnt body is posed as poses.parquet states. For skin that a camera sees, on
parts that no skirt covers, the distance to the nearest place of the surface is measured; signed_mm is positive outside
the surface.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from unittest import mock

import numpy as np
from probe import Row, Scene, answer
from scipy.spatial import cKDTree

from anchorpose import pipeline
from anchorpose.body.segments import load_body_asset
from anchorpose.body.skin_points import Body, FittedShape, PosedPoints, body_points, build_body, pose_points
from anchorpose.body.visibility import GRAZING, pixels_of, projection_of
from anchorpose.camera import Camera
from anchorpose.recording.reader import open_recording
from anchorpose.results.tables import POSES_FILE, PoseTable, pose_of, read_poses
from anchorpose.simulate.render import PATIENT, Figure, draw_figures, render_still

NEAR_MM: Final = 12.0
SAME_SKIN_M: Final = 0.015  # skin in view is at most so far behind the body's front; the mouth's inside is deeper
CANDIDATES: Final = 4  # number of nearest vertices, whose faces may hold the nearest place
BARE: Final = {
    "head": ("Head",),
    "upper arms": ("LeftArm", "RightArm"),
    "forearms": ("LeftForeArm", "RightForeArm"),
    "hands": (
        "LeftHand",
        "LeftFingerBase",
        "LeftHandFinger1",
        "LThumb",
        "RightHand",
        "RightFingerBase",
        "RightHandFinger1",
        "RThumb",
    ),
    "shanks": ("LeftLeg", "RightLeg"),
    "feet": ("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase"),
}
"""The bones whose skin is measured. Trunk, hips and thighs are left out: a skirt hangs from the trunk over hips and
thighs."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A captured surface. skin_m (t, v, 3); faces (f, 3); around (v, k): the faces at each vertex, then -1."""

    skin_m: np.ndarray
    faces: np.ndarray
    around: np.ndarray

    @classmethod
    def read(cls, path: Path) -> Surface:
        """Read the file that the recording was drawn from."""
        with np.load(path) as stored:
            skin_m, faces = stored["skin_m"], stored["faces"].astype(np.int64)
        corner = faces.ravel()
        order, count = np.argsort(corner, kind="stable"), np.bincount(corner, minlength=skin_m.shape[1])
        place = np.arange(len(corner)) - np.repeat(np.cumsum(count) - count, count)
        around = np.full((skin_m.shape[1], count.max()), -1)
        around[corner[order], place] = order // 3
        return cls(skin_m, faces, around)

    def nearest(self, frame: int, points_m: np.ndarray) -> np.ndarray:
        """Return the signed distance (n,) in m of the place nearest to each point (n, 3), positive outside."""
        vertices_m = self.skin_m[frame].astype(np.float64)
        faces = self.around[cKDTree(vertices_m).query(points_m, k=CANDIDATES)[1]].reshape(len(points_m), -1)
        corners = vertices_m[self.faces[faces]]  # (n, c, 3, 3)
        share = nearest_in_triangles(points_m[:, None], corners)
        step = points_m[:, None] - np.einsum("nck,nckx->ncx", share, corners)
        away_m = np.where(faces < 0, np.inf, np.linalg.norm(step, axis=2))
        row, best = np.arange(len(points_m)), away_m.argmin(axis=1)
        a, b, c = corners[row, best].transpose(1, 0, 2)
        outside = (step[row, best] * np.cross(b - a, c - a)).sum(axis=1) >= 0.0
        return np.asarray(np.where(outside, 1.0, -1.0) * away_m[row, best])


def nearest_in_triangles(points_m: np.ndarray, corners_m: np.ndarray) -> np.ndarray:
    """Return the place in triangles (..., 3, 3) nearest to points (..., 3), as barycentric coordinates (..., 3)."""
    a, ab, ac = (
        corners_m[..., 0, :],
        corners_m[..., 1, :] - corners_m[..., 0, :],
        corners_m[..., 2, :] - corners_m[..., 0, :],
    )
    ap = points_m - a
    bb, bc, cc = ((one * other).sum(axis=-1) for one, other in ((ab, ab), (ab, ac), (ac, ac)))
    pb, pc = (ap * ab).sum(axis=-1), (ap * ac).sum(axis=-1)
    area = np.maximum(bb * cc - bc * bc, 1e-18)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    best = np.stack([1 - v - w, v, w], axis=-1)
    away = np.where((best < 0).any(axis=-1), np.inf, 0.0)  # a place inside is the nearest
    for one, other in ((0, 1), (1, 2), (2, 0)):
        start, edge = corners_m[..., one, :], corners_m[..., other, :] - corners_m[..., one, :]
        along = ((points_m - start) * edge).sum(axis=-1) / np.maximum((edge * edge).sum(axis=-1), 1e-18)
        along = np.clip(along, 0.0, 1.0)[..., None]
        distance, share = np.linalg.norm(start + along * edge - points_m, axis=-1), np.zeros_like(best)
        share[..., one], share[..., other] = 1.0 - along[..., 0], along[..., 0]
        nearer = distance < away
        best, away = np.where(nearer[..., None], share, best), np.where(nearer, distance, away)
    return best


def track(recording: Path, results: Path) -> tuple[Body, PoseTable]:
    """Track, and return the learnt body and its poses. run.json does not hold the offsets of the skin's patches."""
    results.mkdir()
    learnt_shapes: list[FittedShape] = []

    def write_all(folder: Path, frames: Any, run: Any, learnt: Any, inputs: Any) -> None:
        write(folder, frames, run, learnt, inputs)
        learnt_shapes.append(learnt.shape)

    write = pipeline.write_results
    with mock.patch.object(pipeline, "write_results", write_all):
        pipeline.track_recording(recording, results, pipeline.TrackConfig(), lambda done, total: None)
    return build_body(body_points(), learnt_shapes[0]), read_poses(results / POSES_FILE)


def in_view(body: Body, posed: PosedPoints, cameras: Sequence[Camera]) -> np.ndarray:
    """Return which skin points (p,) face some camera and are not hidden from it by the same posed body."""
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


def measure(scene: Scene) -> Iterator[Row]:
    """Compare all frames in which the patient is not lost; yield one row for all parts, and one per part."""
    surface, cameras, asset = Surface.read(scene.truth), open_recording(scene.recording).cameras, load_body_asset()
    with TemporaryDirectory() as work:
        body, poses = track(scene.recording, Path(work) / "results")
    part = body.points.part
    bare = np.isin(part, [asset.bone(name) for names in BARE.values() for name in names])
    found = []
    for frame, head_m, quaternion in zip(poses.frame, poses.head_m, poses.quaternion, strict=True):
        if np.isfinite(head_m).all():
            posed = pose_points(body, pose_of(asset, head_m, quaternion))
            chosen = np.flatnonzero(bare & in_view(body, posed, cameras))
            found.append((part[chosen], 1e3 * surface.nearest(frame, posed.points_m[chosen])))
    bone, away_mm = (np.concatenate(column) for column in zip(*found, strict=True))
    for name, bones in {"all": tuple(bone for names in BARE.values() for bone in names), **BARE}.items():
        own = np.isin(bone, [asset.bone(each) for each in bones])
        size_mm = np.abs(away_mm[own])
        yield (
            name,
            {
                "skin_mm": float(np.median(size_mm)),
                "p95_mm": float(np.percentile(size_mm, 95)),
                "skin_near": float((size_mm < NEAR_MM).mean()),
                "signed_mm": float(np.median(away_mm[own])),
            },
        )


if __name__ == "__main__":
    answer(measure)
