"""Where depth is too poor for joints: limbs that cannot be told from what is beside them, skin without a reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from anchorpose.body.skin_points import PosedPoints
from anchorpose.body.visibility import SkinReason, skin_reasons
from anchorpose.camera import Camera
from anchorpose.isolation.depth_noise import LIMB_M, DepthDetail
from anchorpose.isolation.view import View

MOST_MISSING: Final = 0.5  # of the skin turned to a camera: more of it without a reading than with one


class PoorKind(StrEnum):
    """What makes the depth images of a camera poor."""

    EDGES = "edges"  # drawn out by filters, or by pixels that are as wide as a limb
    STEPS = "steps"  # between neighbouring readings
    HOLES = "holes"


@dataclass(frozen=True, slots=True)
class PoorDepth:
    """Why one camera's depth image of a frame is too poor for joints.

    amount: how wide an edge or how high a step is at the patient, metres; the share of the patient's skin turned to the
    camera without a usable reading.
    """

    camera: str
    kind: PoorKind
    amount: float

    @property
    def resolves_limbs(self) -> bool:
        """Holes leave the limbs that are read as they are: their other joints are stated as hidden one by one."""
        return self.kind is PoorKind.HOLES


def too_coarse(camera: str, detail: DepthDetail, distance_m: float) -> PoorDepth | None:
    """Whether a limb at a distance from a camera is thinner than an edge is wide, or than a step; None where not."""
    edge_m, step_m = detail.edge_m(distance_m), detail.step_m(distance_m)
    if max(edge_m, step_m) <= LIMB_M:
        return None
    kind = PoorKind.EDGES if edge_m >= step_m else PoorKind.STEPS
    return PoorDepth(camera, kind, max(edge_m, step_m))


def poor_depth(
    posed: PosedPoints,
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    details: Sequence[DepthDetail | None],
    reach_m: float,
) -> tuple[PoorDepth | None, ...]:
    """Of each camera, why its depth image of the patient is too poor for joints; None where it is not, or shows nobody.

    posed: the body as it was found. details: of each camera, None where it has no depth image of the frame.
    """
    return tuple(
        None if view is None or detail is None else _of_camera(posed, view, camera, detail, reach_m)
        for view, camera, detail in zip(views, cameras, details, strict=True)
    )


def _of_camera(posed: PosedPoints, view: View, camera: Camera, detail: DepthDetail, reach_m: float) -> PoorDepth | None:
    distance_m = distance_of(view)
    if distance_m is None:
        return None
    coarse = too_coarse(camera.name, detail, distance_m)
    missing = missing_share(posed, view, camera, reach_m)
    if coarse is None and missing > MOST_MISSING:
        return PoorDepth(camera.name, PoorKind.HOLES, missing)
    return coarse


def distance_of(view: View) -> float | None:
    """Median depth of the patient in a view, metres; None where the patient is not in it."""
    depth = view.depth_m[view.patient]
    return float(np.median(depth)) if depth.size else None


def missing_share(posed: PosedPoints, view: View, camera: Camera, reach_m: float) -> float:
    """Share of the skin turned to a camera, within its image, that has no usable reading; 0 to 1.

    What a person or equipment hides was read: it says why it is not the patient's.
    """
    reason, facing = skin_reasons(posed, view, camera, reach_m)
    inside = reason[facing & (reason != SkinReason.OUTSIDE)]
    return float(np.count_nonzero(inside == SkinReason.HOLE) / max(1, len(inside)))
