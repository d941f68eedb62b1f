"""Local descriptors that the paper compares with: FPFH, SHOT, 3D shape context, RoPS (Section V)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.experiments.method import DescriptorSetting, Family, Method, by_descriptor
from anchorpose.features.fpfh import FpfhConfig, fpfh
from anchorpose.features.nearest import Metric
from anchorpose.features.rops import RopsConfig, rops
from anchorpose.features.shape_context import ShapeContextConfig, shape_context
from anchorpose.features.shot import ShotConfig, shot
from anchorpose.surface.mesh import faces
from anchorpose.tracker.observation import Observation

RADII_M = (0.15, 0.05, 0.10, 0.20, 0.30)


def _fpfh(seen: Observation, config: FpfhConfig) -> np.ndarray:
    return fpfh(seen.surface.points_m, seen.surface.normals, config)


def _shot(seen: Observation, config: ShotConfig) -> np.ndarray:
    return shot(seen.surface.points_m, seen.surface.normals, config)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContextSetting:
    """unit_length: contexts are compared by their shape alone, not by how much surface there is around the node."""

    config: ShapeContextConfig
    unit_length: bool


def _shape_context(seen: Observation, setting: ContextSetting) -> np.ndarray:
    found = shape_context(seen.surface.points_m, seen.surface.normals, setting.config)
    if not setting.unit_length:
        return found
    rooted = np.sqrt(found)
    length = np.linalg.norm(rooted, axis=1, keepdims=True)
    return np.asarray(rooted / np.where(length > 0, length, np.nan))


def _rops(seen: Observation, config: RopsConfig) -> np.ndarray:
    return rops(seen.surface.points_m, faces(seen.surface), config)


METHODS = (
    Method(
        key="fpfh",
        title="FPFH",
        family=Family.LOCAL,
        source="Rusu et al. 2009, doi:10.1109/ROBOT.2009.5152473",
        settings=tuple(
            DescriptorSetting(config=FpfhConfig(radius_m=radius), metric=metric)
            for radius in RADII_M
            for metric in (Metric.EUCLIDEAN, Metric.HELLINGER)
        ),
        associate=by_descriptor(_fpfh),
    ),
    Method(
        key="shot",
        title="SHOT",
        family=Family.LOCAL,
        source="Tombari et al. 2010, doi:10.1007/978-3-642-15558-1_26",
        settings=tuple(
            DescriptorSetting(config=ShotConfig(radius_m=radius, z_by_normal=by_normal))
            for radius in RADII_M
            for by_normal in (False, True)
        ),
        associate=by_descriptor(_shot),
    ),
    Method(
        key="shape-context",
        title="3D shape context",
        family=Family.LOCAL,
        source="Frome et al. 2004, doi:10.1007/978-3-540-24672-5_18",
        settings=tuple(
            DescriptorSetting(config=ContextSetting(config=ShapeContextConfig(radius_m=radius), unit_length=unit))
            for radius in RADII_M
            for unit in (True, False)
        ),
        associate=by_descriptor(_shape_context),
    ),
    Method(
        key="rops",
        title="RoPS",
        family=Family.LOCAL,
        source="Guo et al. 2013, doi:10.1007/s11263-013-0627-y",
        settings=tuple(
            DescriptorSetting(config=RopsConfig(radius_m=radius), metric=metric)
            for radius in RADII_M
            for metric in (Metric.EUCLIDEAN, Metric.MANHATTAN)
        ),
        associate=by_descriptor(_rops),
    ),
)
