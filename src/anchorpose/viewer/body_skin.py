"""The learnt body for the page: its skin at rest, and how each point of it hangs on the bones that move."""

from __future__ import annotations

from typing import Any

import numpy as np

from anchorpose.body.asset import BodyAsset, load_body_asset
from anchorpose.body.pose import MOVING_BONES
from anchorpose.body.shaped import shape_body

INFLUENCES = 4  # bones a point, for the graphics card; the others move no point by more than 5 mm, for the eye only


def moving_ancestor(asset: BodyAsset) -> np.ndarray:
    """(b,) which of ``MOVING_BONES`` carries each bone: itself, or the next one above it."""
    row_of = {asset.bone(name): row for row, name in enumerate(MOVING_BONES)}
    carried = np.zeros(len(asset.bone_names), np.int64)
    for bone, parent in enumerate(asset.bone_parents.tolist()):
        carried[bone] = row_of[bone] if bone in row_of else carried[parent]
    return carried


def body_skin(run: dict[str, Any]) -> dict[str, np.ndarray] | None:
    """The arrays of the page's body; None where no body was learnt.

    vertices (v, 3) and normals (v, 3) float32 at rest, faces (f, 3) uint32, bones (v, 4) uint8 rows of
    ``MOVING_BONES``, weights (v, 4) float32, heads (21, 3) float32: where the bones turn about, at rest. Posed:
    ``sum of weight * (turn (vertex - head) + head in the world)``, linear blend skinning as in ``ShapedBody.skin``.
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
    """The ``INFLUENCES`` heaviest bones of each point, bones that move together counted as one; weights sum to 1."""
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
