"""The simulated patient's own skin as a mesh: exact geodesics on it, and what a place on it belongs to."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.asset import BodyAsset

LIMBS: Final = {"Head": ("Head",), "HandLeft": ("LeftHand", "LeftFinger", "LThumb"),
                "HandRight": ("RightHand", "RightFinger", "RThumb"), "FootLeft": ("LeftFoot", "LeftToe"),
                "FootRight": ("RightFoot", "RightToe")}  # fmt: skip
"""The bones of each anchor's limb, in the order of ``ANCHOR_NAMES``."""


def limb_of_bones(asset: BodyAsset) -> np.ndarray:
    """(b,) the number of the anchor at whose limb's end each bone is, -1 for the others."""
    limb = np.full(len(asset.bone_names), -1)
    for number, begins in enumerate(LIMBS.values()):
        limb[[name.startswith(begins) for name in asset.bone_names]] = number
    return limb


class TrueBody:
    """One frame's dressed skin: places on it are a face and barycentric coordinates."""

    def __init__(self, skin_m: np.ndarray, asset: BodyAsset) -> None:
        self.vertices, self.faces = skin_m.astype(np.float64), asset.faces.astype(np.int64)
        self.limb = limb_of_bones(asset)[asset.main_bone()]
        self.tree = cKDTree(self.vertices)
        around: list[list[int]] = [[] for _ in self.vertices]
        for face, corners in enumerate(self.faces):
            for corner in corners:
                around[corner].append(face)
        self.around = np.full((len(around), max(map(len, around))), -1)
        for vertex, faces in enumerate(around):
            self.around[vertex, : len(faces)] = faces

    def move(self, skin_m: np.ndarray) -> None:
        """The same skin in another frame."""
        self.vertices = skin_m.astype(np.float64)
        self.tree = cKDTree(self.vertices)

    def project(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The nearest place of each point: face (n,), coordinates (n, 3), distance (n,)."""
        points = points_m.astype(np.float64)
        candidates = self.around[self.tree.query(points, k=4)[1]].reshape(len(points), -1)
        face, share = np.zeros(len(points), int), np.zeros((len(points), 3))
        away = np.full(len(points), np.inf)
        for column in candidates.T:
            known = np.flatnonzero(column >= 0)
            corners = self.vertices[self.faces[column[known]]]
            found = _nearest_in_triangle(points[known], corners)
            distance = np.linalg.norm(np.einsum("nk,nkx->nx", found, corners) - points[known], axis=1)
            nearer = distance < away[known]
            rows = known[nearer]
            face[rows], share[rows], away[rows] = column[rows], found[nearer], distance[nearer]
        return face, share, away

    def limb_at(self, point_m: np.ndarray) -> int:
        """The limb whose end a point is nearest to, -1 for the rest of the body."""
        return int(self.limb[self.tree.query(point_m)[1]])

    def exact_field(self, face: int, share: np.ndarray) -> np.ndarray:
        """(v,) exact geodesic distance of every vertex from a place (pygeodesic)."""
        from pygeodesic.geodesic import PyGeodesicAlgorithmExact

        a, b, c = self.faces[face]
        new = len(self.vertices)
        if share.max() > 0.999:  # a corner: no need to split the face
            vertices, faces, new = self.vertices, self.faces, int(self.faces[face][share.argmax()])
        else:
            vertices = np.vstack([self.vertices, share @ self.vertices[self.faces[face]]])
            faces = np.vstack([np.delete(self.faces, face, 0), [[a, b, new], [b, c, new], [c, a, new]]])
        field = PyGeodesicAlgorithmExact(vertices, faces).geodesicDistances(np.array([new]), None)[0]
        return np.asarray(field[: len(self.vertices)])

    def read(self, field: np.ndarray, face: np.ndarray, share: np.ndarray) -> np.ndarray:
        """(n,) a field (v,) at places; NaN where a corner is not reached (eyes, teeth)."""
        values = np.where(np.isfinite(field), field, np.nan)
        return np.asarray((values[self.faces[face]] * share).sum(axis=1))


def _nearest_in_triangle(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n, 3) barycentric coordinates of the place of each triangle (n, 3, 3) that is nearest to its point."""
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    ap = points - a
    bb, bc, cc = (ab * ab).sum(1), (ab * ac).sum(1), (ac * ac).sum(1)
    pb, pc = (ap * ab).sum(1), (ap * ac).sum(1)
    area = np.maximum(bb * cc - bc * bc, 1e-18)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    share = np.stack([1 - v - w, v, w], axis=1)
    outside = np.flatnonzero((share < 0).any(axis=1))
    nearest = np.full(len(outside), np.inf)
    for one, other in ((0, 1), (1, 2), (2, 0)):
        start, edge = corners[outside, one], corners[outside, other] - corners[outside, one]
        along = ((points[outside] - start) * edge).sum(1) / np.maximum((edge * edge).sum(1), 1e-18)
        along = np.clip(along, 0, 1)
        distance = np.linalg.norm(start + along[:, None] * edge - points[outside], axis=1)
        nearer = distance < nearest
        rows = outside[nearer]
        nearest[nearer] = distance[nearer]
        share[rows] = 0.0
        share[rows, one], share[rows, other] = 1 - along[nearer], along[nearer]
    return share
