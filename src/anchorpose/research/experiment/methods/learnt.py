"""Match nodes by the learnt descriptor, alone and together with SHOT.

The learnt descriptor is the place on the whole body that a network assigns to a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.camera import invert_rigid, transform_points
from anchorpose.descriptor.learnt import described, nearest_rays
from anchorpose.research.experiment.method import DescriptorSetting, Family, Method, by_descriptor
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.tracker.observation import Observation

SHOT: Final = ShotConfig(radius_m=0.20, z_by_normal=True)  # the settings that were chosen for the method SHOT
SOURCE: Final = "docs/descriptor.md; Li and Burdick, Section VII (future work)"


@dataclass(frozen=True, slots=True, kw_only=True)
class LearntConfig:
    """Settings of the learnt descriptor."""

    # Factor by which SHOT's signature is multiplied before it is appended to the learnt place on the body (in body
    # heights); 0 = no signature, so the descriptor is the learnt place alone
    local: float = 0.0


def _describe(seen: Observation, config: LearntConfig) -> np.ndarray:
    """Return the descriptors of the seen nodes: (n, 3) or, with SHOT, (n, 3 + 352).

    A row is NaN if the network finds no person at the node, or if SHOT is undefined.
    """
    places = _places(seen)
    if config.local == 0.0:
        return places
    signatures = shot(seen.surface.points_m, seen.surface.normals, SHOT)
    return np.hstack([places, np.float32(config.local) * signatures])


def _places(seen: Observation) -> np.ndarray:
    """Return (n, 3) float32: each seen node's place on the mean adult's body, in body heights; NaN if unknown."""
    surface, evidence = seen.surface, seen.evidence
    places = np.full((len(surface), 3), np.nan, np.float32)
    for number, (view, camera) in enumerate(zip(evidence.views, evidence.cameras, strict=True)):
        own = np.flatnonzero(surface.camera == number)
        if view is None or not len(own):
            continue
        in_camera = transform_points(invert_rigid(camera.require_pose()), surface.points_m[own].astype(np.float64))
        column, row, inside = camera.pixel_of(in_camera)
        ray_row, ray_column, on_ray = (axis[row, column] for axis in nearest_rays(camera))
        said = described(view.depth_m, camera).place[ray_row, ray_column]
        places[own] = np.where((inside & on_ray)[:, None], said, np.nan)
    return places


METHODS = (
    Method(
        key="learnt",
        title="learnt descriptor",
        family=Family.LEARNT,
        source=SOURCE,
        settings=(DescriptorSetting(config=LearntConfig()),),
        associate=by_descriptor(_describe),
        frame_ms=30.0,
    ),
    Method(
        key="learnt-shot",
        title="learnt descriptor with SHOT",
        family=Family.LEARNT,
        source=f"{SOURCE}; Tombari et al. 2010, doi:10.1007/978-3-642-15558-1_26",
        settings=tuple(DescriptorSetting(config=LearntConfig(local=weight)) for weight in (0.1, 0.05, 0.2)),
        associate=by_descriptor(_describe),
        frame_ms=100.0,
    ),
)
