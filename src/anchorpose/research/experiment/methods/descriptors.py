"""Define methods with the descriptors of the paper's comparison and related work.

A node is matched with the node of the next frame that has the nearest descriptor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from anchorpose.research.experiment.config import Update
from anchorpose.research.experiment.method import DescriptorSetting, Family, Method, by_descriptor
from anchorpose.research.features.fpfh import FpfhConfig, fpfh
from anchorpose.research.features.ld_sift import Beyond, LdSiftConfig, ld_sift
from anchorpose.research.features.mesh_hog import MeshHogConfig, ScalarFunction, mesh_hog
from anchorpose.research.features.nearest import Metric
from anchorpose.research.features.rops import RopsConfig, rops
from anchorpose.research.features.shape_context import ShapeContextConfig, shape_context
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.research.features.spectral_signatures import (
    HksConfig,
    SiHksConfig,
    Spectrum,
    WksConfig,
    hks,
    si_hks,
    spectrum,
    wks,
)
from anchorpose.surface.mesh import faces
from anchorpose.tracker.observation import Observation

RADII_M = (0.20, 0.15, 0.05, 0.10, 0.30)  # m, radii to be tried, within which a node's descriptor is computed


def _fpfh(seen: Observation, config: FpfhConfig) -> np.ndarray:
    return fpfh(seen.surface.points_m, seen.surface.normals, config)


def _shot(seen: Observation, config: ShotConfig) -> np.ndarray:
    return shot(seen.surface.points_m, seen.surface.normals, config)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContextSetting:
    """Settings of the 3D shape context, and of how two shape contexts are compared."""

    config: ShapeContextConfig
    # whether the square roots of a descriptor are scaled to unit length: the amount of seen surface then has no effect
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


USUAL_RADIUS_M = 0.05
"""Radius in metres within which descriptors are customarily computed, for objects on a table and also for people."""


def _both(
    key: str,
    title: str,
    source: str,
    describe: Callable[[Observation, Any], np.ndarray],
    setting: Callable[[float, int], DescriptorSetting],
    frame_ms: float,
    first_m: float = RADII_M[0],
) -> tuple[Method, Method]:
    """Return two methods with the same descriptor: the first has the best of all tried settings, the second has the
    fixed radius ``USUAL_RADIUS_M``.

    The difference between the two methods' errors shows the effect of tuning. setting: returns the setting for a radius
    and for one of two variants (0 or 1) of the descriptor or its metric. first_m: the radius that is tried first, and
    used without tuning.
    """
    radii = sorted(RADII_M, key=lambda radius: radius != first_m)
    chosen = tuple(setting(radius, variant) for radius in radii for variant in (0, 1))
    associate = by_descriptor(describe)
    return (
        Method(
            key=key,
            title=title,
            family=Family.LOCAL,
            source=source,
            settings=chosen,
            associate=associate,
            anchored=False,
            frame_ms=frame_ms,
        ),
        Method(
            key=f"{key}-5cm",
            title=f"{title}, 5 cm",
            family=Family.LOCAL,
            source=source,
            settings=(setting(USUAL_RADIUS_M, 0),),
            associate=associate,
            anchored=False,
            frame_ms=frame_ms / 2.0,
        ),
    )


LOCAL = (
    *_both(
        "fpfh",
        "FPFH",
        "Rusu et al. 2009, doi:10.1109/ROBOT.2009.5152473",
        _fpfh,
        lambda radius, variant: DescriptorSetting(
            config=FpfhConfig(radius_m=radius), metric=(Metric.HELLINGER, Metric.EUCLIDEAN)[variant]
        ),
        80.0,
    ),
    *_both(
        "shot",
        "SHOT",
        "Tombari et al. 2010, doi:10.1007/978-3-642-15558-1_26",
        _shot,
        lambda radius, variant: DescriptorSetting(
            config=ShotConfig(radius_m=radius, z_by_normal=(True, False)[variant])
        ),
        160.0,
    ),
    *_both(
        "shape-context",
        "3D shape context",
        "Frome et al. 2004, doi:10.1007/978-3-540-24672-5_18",
        _shape_context,
        lambda radius, variant: DescriptorSetting(
            config=ContextSetting(config=ShapeContextConfig(radius_m=radius), unit_length=(True, False)[variant])
        ),
        640.0,
        0.30,
    ),
    *_both(
        "rops",
        "RoPS",
        "Guo et al. 2013, doi:10.1007/s11263-013-0627-y",
        _rops,
        lambda radius, variant: DescriptorSetting(
            config=RopsConfig(radius_m=radius), metric=(Metric.MANHATTAN, Metric.EUCLIDEAN)[variant]
        ),
        330.0,
        0.30,
    ),
)


def _mesh_hog(seen: Observation, config: MeshHogConfig) -> np.ndarray:
    return mesh_hog(seen.surface, config)


def _ld_sift(seen: Observation, config: LdSiftConfig) -> np.ndarray:
    return ld_sift(seen.surface, config)


MESH = (
    Method(
        key="mesh-hog",
        title="MeshHOG",
        family=Family.MESH,
        source="Zaharescu et al. 2009, doi:10.1109/CVPRW.2009.5206748",
        settings=tuple(
            DescriptorSetting(
                config=MeshHogConfig(radius_m=radius, function=function, spread=spread), metric=Metric.HELLINGER
            )
            for function in reversed(ScalarFunction)
            for radius, spread in ((0.20, 0.5), (0.20, 0.3), (0.10, 0.3))
        ),
        associate=by_descriptor(_mesh_hog),
        anchored=False,
        frame_ms=200.0,
    ),
    Method(
        key="ld-sift",
        title="LD-SIFT",
        family=Family.MESH,
        source="Darom and Keller 2012, doi:10.1109/TIP.2012.2183142",
        settings=tuple(
            DescriptorSetting(config=LdSiftConfig(radius_m=radius, beyond=beyond), metric=Metric.HELLINGER)
            for beyond in Beyond
            for radius in (0.20, 0.15, 0.10)
        ),
        associate=by_descriptor(_ld_sift),
        anchored=False,
        frame_ms=360.0,
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectralConfig:
    """Settings of a spectral signature (a node's descriptor from eigenpairs of the surface's Laplacian)."""

    signature: Any  # settings of the function that computes the signature, such as ``hks``
    pairs: int = 100  # number of eigenpairs; with more, matching takes longer and is not better
    logarithm: bool = False  # whether the logarithms of signatures are compared, instead of signatures


Signature = Callable[[Spectrum, Any], np.ndarray]


def _described(signature: Signature) -> Callable[[Observation, SpectralConfig], np.ndarray]:
    def describe(seen: Observation, config: SpectralConfig) -> np.ndarray:
        found = signature(spectrum(seen.surface, config.pairs), config.signature)
        if not config.logarithm:
            return found
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(np.where(found > 0, found, np.nan)))

    return describe


def _spectral_method(
    key: str, title: str, source: str, signature: Signature, configs: tuple[Any, ...], logarithms: tuple[bool, ...]
) -> Method:
    settings = tuple(
        DescriptorSetting(
            config=SpectralConfig(signature=config, pairs=pairs, logarithm=logarithm), metric=Metric.MANHATTAN
        )
        for config in configs
        for pairs in (100, 150)
        for logarithm in logarithms
    )
    return Method(
        key=key,
        title=title,
        family=Family.SPECTRAL,
        source=source,
        settings=settings,
        associate=by_descriptor(_described(signature)),
        anchored=False,
        frame_ms=200.0,
    )


SPECTRAL = (
    _spectral_method(
        "hks",
        "heat kernel signature",
        "Sun et al. 2009, doi:10.1111/j.1467-8659.2009.01515.x",
        hks,
        (HksConfig(scaled=False), HksConfig(), HksConfig(scaled=False, range_m2=(1e-3, 0.03))),
        (False, True),
    ),
    _spectral_method(
        "si-hks",
        "scale-invariant HKS",
        "Bronstein and Kokkinos 2010, doi:10.1109/CVPR.2010.5539838",
        si_hks,
        (SiHksConfig(frequencies=12), SiHksConfig()),
        (False,),
    ),
    _spectral_method(
        "wks",
        "wave kernel signature",
        "Aubry et al. 2011, doi:10.1109/ICCVW.2011.6130444",
        wks,
        (WksConfig(width_steps=3.0), WksConfig()),
        (False, True),
    ),
)


_SHOT = next(method for method in LOCAL if method.key == "shot")

FILTERED = (replace(_SHOT, key="shot-filter", title="SHOT with a Kalman filter", update=Update.KALMAN),)
"""SHOT with the Kalman filter of the method "next generation", which shows the effect of this filter alone."""

METHODS = (*LOCAL, *FILTERED, *MESH, *SPECTRAL)
