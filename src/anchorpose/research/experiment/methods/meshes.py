"""Descriptors of the paper's related work on meshes: MeshHOG and LD-SIFT (Section II)."""

from __future__ import annotations

import numpy as np

from anchorpose.research.experiment.method import DescriptorSetting, Family, Method, by_descriptor
from anchorpose.research.features.ld_sift import Beyond, LdSiftConfig, ld_sift
from anchorpose.research.features.mesh_hog import MeshHogConfig, ScalarFunction, mesh_hog
from anchorpose.research.features.nearest import Metric
from anchorpose.tracker.observation import Observation


def _mesh_hog(seen: Observation, config: MeshHogConfig) -> np.ndarray:
    return mesh_hog(seen.surface, config)


def _ld_sift(seen: Observation, config: LdSiftConfig) -> np.ndarray:
    return ld_sift(seen.surface, config)


METHODS = (
    Method(
        key="mesh-hog",
        title="MeshHOG",
        family=Family.MESH,
        source="Zaharescu et al. 2009, doi:10.1109/CVPRW.2009.5206748",
        settings=tuple(
            DescriptorSetting(
                config=MeshHogConfig(radius_m=radius, function=function, spread=spread), metric=Metric.HELLINGER
            )
            for function in ScalarFunction
            for radius, spread in ((0.20, 0.3), (0.10, 0.3), (0.20, 0.5))
        ),
        associate=by_descriptor(_mesh_hog),
        frame_ms=150.0,
    ),
    Method(
        key="ld-sift",
        title="LD-SIFT",
        family=Family.MESH,
        source="Darom and Keller 2012, doi:10.1109/TIP.2012.2183142",
        settings=tuple(
            DescriptorSetting(config=LdSiftConfig(radius_m=radius, beyond=beyond), metric=Metric.HELLINGER)
            for beyond in Beyond
            for radius in (0.15, 0.10, 0.20)
        ),
        associate=by_descriptor(_ld_sift),
        frame_ms=150.0,
    ),
)
